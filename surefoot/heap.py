"""Memory of a process that lives as long as the robot: few heaps, and what is unused goes back to the system."""

import ctypes
import os
from contextlib import suppress

M_ARENA_MAX = -8
"""Name of the limit for `mallopt`, from malloc.h of the GNU C library."""

ARENAS = 2
"""Heaps of a process. By default the threads share eight for each core, and each keeps what the messages of a peer
needed at most: 20 MB after 25 restarts of a peer. The bus has two busy threads; more heaps make nothing faster."""


def share_heaps() -> None:
    """Let all threads of this process share few heaps; call before there are threads.

    Does nothing where `MALLOC_ARENA_MAX` stands in the environment, or where the C library has no such limit.
    """
    if "MALLOC_ARENA_MAX" not in os.environ:
        with suppress(AttributeError):
            ctypes.CDLL(None).mallopt(M_ARENA_MAX, ARENAS)


def hand_back() -> None:
    """Return the pages that the C library keeps of freed memory; does nothing where it is not glibc.

    A process that ended leaves holes in the heaps of those that exchanged messages with it: about 0.1 MB each, which
    the C library would keep for good.
    """
    with suppress(AttributeError):  # no malloc_trim
        ctypes.CDLL(None).malloc_trim(0)
