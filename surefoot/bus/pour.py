"""From a bounded channel of the network library into a sink, on a thread of its own.

The channel keeps the newest messages and drops older ones without waking anybody, so that a flood costs the process
next to nothing; the thread takes them out no faster than the reader works, and never faster than ``MOST_HZ``.
"""
# pyright: reportUnknownMemberType=false

import ctypes
import threading
import time
import traceback
from collections.abc import Callable
from typing import Any

import zenoh

MOST_HZ = 2000.0
"""Messages per s of one key that are only observed, and queries per s of one key, beyond which some are dropped."""
REST_S = 0.02  # s, how long a full reader is left alone
BURST = 64


_kept: set[int] = set()


def keep_thread_state() -> None:
    """Keep the interpreter's state of the present thread; call it first on a thread of Zenoh's.

    Python gives a foreign thread a new state at every call and takes it away after: memory mapped and unmapped per
    message, and every other thread of the process interrupted for it. One more hold on the state lets it stay.
    """
    ident = threading.get_ident()
    if ident not in _kept:
        _kept.add(ident)
        ctypes.pythonapi.PyGILState_Ensure()


def pour(
    handler: Any, make: Callable[[Any], Any], sink: Callable[[Any], Any], *, most_hz: float = 0.0
) -> threading.Thread:
    """Start a thread that hands what a Zenoh handler receives to a sink, and return it; it ends with the session.

    Args:
        handler: has ``recv``, which raises ZError at the end.
        make: what the sink gets of a sample or query.
        sink: returns False when it has no room.
        most_hz: limit of the rate, 1/s; 0 = none.
    """
    thread = threading.Thread(target=_work, args=(handler, make, sink, most_hz), name="pour", daemon=True)
    thread.start()
    return thread


def _work(handler: Any, make: Callable[[Any], Any], sink: Callable[[Any], Any], most_hz: float) -> None:
    began, count = time.monotonic(), 0
    while True:
        try:
            item = handler.recv()
        except zenoh.ZError:
            return  # the session is closed
        try:
            room = sink(make(item))
        except Exception:  # a defect in a reader of one message must not silence the key
            traceback.print_exc()
            room = None
        del item  # a query that is kept here would stay open
        count += 1
        if room is False:
            time.sleep(REST_S)
        elif most_hz and count >= BURST:
            rest = began + count / most_hz - time.monotonic()
            if rest > 0.0:
                time.sleep(rest)
            began, count = time.monotonic(), 0
