"""Less memory for long-running processes: few malloc heaps, and unused pages returned to the operating system."""

import ctypes
import os
import threading
import time
from contextlib import suppress

M_ARENA_MAX = -8
"""Number of the parameter of `mallopt` that limits the number of heaps, from malloc.h of the GNU C library."""

ARENAS = 2
"""Number of malloc heaps that a process may have. By default its threads share eight for each core, and each keeps what
the messages of a peer needed at most: 20 MB after 25 restarts of a peer. The bus has two busy threads; more heaps make
nothing faster."""


APART_S = 5.0
"""Least time between two returns of memory, s: each takes some milliseconds, and processes may come by the hundred."""
_returned_s = [-APART_S]
GROWN_BYTES = 32 << 20
"""Growth of the memory of a process above its least since the last return, bytes, from which memory is returned."""
_least_bytes = [0]
_PAGE = os.sysconf("SC_PAGE_SIZE")


def share_heaps() -> None:
    """Limit the number of malloc heaps of this process to `ARENAS`; call before there are threads.

    Does nothing where `MALLOC_ARENA_MAX` is set in the environment, or where the C library has no such limit.
    """
    if "MALLOC_ARENA_MAX" not in os.environ:
        with suppress(AttributeError):
            ctypes.CDLL(None).mallopt(M_ARENA_MAX, ARENAS)


def hand_back() -> None:
    """Return the pages of freed memory that glibc keeps to the operating system; does nothing with another C library.

    At most once in `APART_S`; calls in between do nothing.

    When a process ends, the processes that exchanged messages with it each keep about 0.1 MB of freed memory in their
    heaps, which the C library would never return.
    """
    now = time.monotonic()
    if now - _returned_s[0] < APART_S:
        return
    _returned_s[0] = now
    with suppress(AttributeError):  # no malloc_trim
        ctypes.CDLL(None).malloc_trim(0)


def hand_back_growth() -> None:
    """Let a thread return freed memory if that of this process has grown by `GROWN_BYTES`; call it now and then.

    Otherwise each process through which a large message passed would keep the memory that it needed, 60 MB for a
    message of 60 MB.
    """
    now = _resident()
    _least_bytes[0] = min(now, _least_bytes[0] or now)
    if now - _least_bytes[0] > GROWN_BYTES and time.monotonic() - _returned_s[0] >= APART_S:
        threading.Thread(target=_hand_back_and_note, name="heap", daemon=True).start()


def _hand_back_and_note() -> None:
    hand_back()
    _least_bytes[0] = _resident()  # what is still there is in use


def _resident() -> int:
    """Return the memory of this process that is resident, bytes; 0 where the system has no /proc."""
    try:
        with open("/proc/self/statm", "rb") as file:
            return int(file.read().split()[1]) * _PAGE
    except (OSError, ValueError, IndexError):
        return 0
