"""Stamps: stores of samples in the order of their stamps, and clocks."""

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import kernel

from .results import AHEAD, LATE, OK, RESTART

Stamps = NDArray[np.int64]

WINDOW_NS = 500_000_000
"""A sample may come this late and still be put where it belongs."""
AHEAD_NS = 500_000_000  # a stamp further ahead of its source waits for the next to confirm it
RESYNC_AFTER = 20  # samples of an older but orderly clock in a row: the source restarted its clock
CAPACITY = 4096  # samples of a store; at 1 kHz 4 s
LARGEST_NS = 2**62  # stamps beyond are none

# parts of a clock, (6,) ns and counts: newest stamp, whether there is one, older stamps in a row, the last of them, a
# stamp far ahead that nothing has confirmed yet, whether there is one
NEWEST, KNOWN, OLDER, OLDER_LAST, FAR, FAR_KNOWN = range(6)
CLOCK = 6


def bounded(stamp_ns: int) -> int:
    """Return a stamp as far as a kernel can take it; those beyond are none and are refused there."""
    return min(max(stamp_ns, -2 * LARGEST_NS + 1), 2 * LARGEST_NS - 1)


@kernel
def after(stamps: Stamps, stamp_ns: int) -> int:
    """Index of the first of rising stamps (n,) that is later than a stamp."""
    low, high = 0, stamps.size
    while low < high:
        middle = (low + high) // 2
        if stamps[middle] <= stamp_ns:
            low = middle + 1
        else:
            high = middle
    return low


@kernel
def place_of(stamps: Stamps, stamp_ns: int) -> int:
    """Index at which a stamp belongs among rising stamps (n,), -1 if it is there."""
    n = stamps.size
    if n == 0 or stamp_ns > stamps[n - 1]:
        return n
    at = after(stamps, stamp_ns)
    return -1 if at > 0 and stamps[at - 1] == stamp_ns else at


@kernel
def make_room(column: np.ndarray, at: int, end: int) -> None:
    """Move the rows from `at` to before `end` of a column (N, ...) on by one, in place."""
    for i in range(end, at, -1):
        column[i] = column[i - 1]


@kernel
def keep_newest(column: np.ndarray, keep: int) -> None:
    """Move the last `keep` rows of a full column (N, ...) to its beginning, in place."""
    first = column.shape[0] - keep
    for i in range(keep):
        column[i] = column[first + i]


@kernel
def _accept(clock: Stamps, stamp_ns: int) -> None:
    clock[NEWEST], clock[KNOWN], clock[OLDER], clock[FAR_KNOWN] = stamp_ns, 1, 0, 0


@kernel
def judge_clock(clock: Stamps, stamp_ns: int, now_ns: int) -> int:
    """Judge a stamp by those before it, and take it into the clock, in place.

    Args:
        clock: of the source, (6,), zeros at first.
        stamp_ns: the stamp.
        now_ns: newest stamp of all sources.

    Returns:
        Code of `ok`; `late`: older than the window; `ahead`: further ahead than a gap, unconfirmed; `restart`: the
        source's clock began anew.
    """
    if clock[KNOWN] == 0:
        _accept(clock, stamp_ns)
        return OK
    if stamp_ns > clock[NEWEST] + AHEAD_NS:
        confirmed = clock[FAR_KNOWN] > 0 and 0 < stamp_ns - clock[FAR] < AHEAD_NS
        if confirmed:
            _accept(clock, stamp_ns)
            return OK
        clock[FAR], clock[FAR_KNOWN] = stamp_ns, 1
        return AHEAD
    if stamp_ns >= now_ns - WINDOW_NS:
        _accept(clock, max(stamp_ns, clock[NEWEST]))
        return OK
    clock[OLDER] = clock[OLDER] + 1 if clock[OLDER] > 0 and stamp_ns > clock[OLDER_LAST] else 1
    clock[OLDER_LAST] = stamp_ns
    if clock[OLDER] < RESYNC_AFTER:
        return LATE
    _accept(clock, stamp_ns)
    return RESTART
