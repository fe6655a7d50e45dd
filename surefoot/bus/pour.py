"""Threads that pass messages from a bounded channel of Zenoh to a reader's function.

The channel keeps the newest messages and drops older ones without waking a thread, so that a flood costs the process
little; the thread takes them out no faster than the reader works, and no faster than a limit such as ``MOST_HZ``.
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
"""Largest rate of observed messages of one key, or of queries of one key, 1/s; those beyond it are dropped."""
REST_S = 0.02  # s, how long a full reader is left alone
BURST = 64


_kept: set[int] = set()


def keep_thread_state() -> None:
    """Keep the Python thread state of the calling thread; call it first in a callback on a thread of Zenoh.

    Otherwise Python makes a new state for a foreign thread at every callback and frees it afterwards, which maps and
    unmaps memory for each message and interrupts all other threads. One more reference to the state keeps it.
    """
    ident = threading.get_ident()
    if ident not in _kept:
        _kept.add(ident)
        ctypes.pythonapi.PyGILState_Ensure()


def pour(
    handler: Any, make: Callable[[Any], Any], sink: Callable[[Any], Any], *, most_hz: float = 0.0
) -> threading.Thread:
    """Start and return a thread that passes what a Zenoh handler receives to a function; it ends with the session.

    Args:
        handler: has ``recv``, which raises ZError when the session is closed.
        make: converts a received sample or query for ``sink``.
        sink: gets each converted item; returns False when it has no room, which makes the thread pause.
        most_hz: limit of the rate, 1/s; 0 = none.
    """
    thread = threading.Thread(target=_work, args=(handler, make, sink, most_hz), name="pour", daemon=True)
    thread.start()
    return thread


def unless_none(sink: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return a function that passes an item to `sink`, unless it is None."""
    return lambda item: None if item is None else sink(item)


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
