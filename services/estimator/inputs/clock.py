"""Clock of each source of samples: late stamps, stamps far ahead, and clocks that begin anew."""

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import kernel

from .results import AHEAD, LATE, OK, RESTART

Stamps = NDArray[np.int64]

WINDOW_NS = 500_000_000
"""Delay up to which a late sample is inserted in the order of its stamp, ns; an older one is refused."""
AHEAD_NS = 500_000_000
"""Step between stamps of a source, ns, above which the stamp waits for the next one to confirm it."""
RESYNC_AFTER = 20
"""Number of older but rising stamps in a row from which on the clock of a source counts as restarted."""
LARGEST_NS = 2**62
"""Largest stamp that is accepted, ns."""
NEWEST, KNOWN, OLDER, OLDER_LAST, FAR, FAR_KNOWN = range(6)
"""Indices in a clock, (6,); `NEWEST`: newest stamp, ns; `KNOWN`: 1 if it is known, else 0; `OLDER`: number of older
stamps in a row; `OLDER_LAST`: the last of these, ns; `FAR`: an unconfirmed stamp far ahead, ns; `FAR_KNOWN`: 1 if there
is one, else 0."""
CLOCK = 6
"""Length of the array that holds the clock of a source, with parts from `NEWEST` to `FAR_KNOWN`."""


def bounded(stamp_ns: int) -> int:
    """Return a stamp, ns, clipped to less than 2^63 in size, which fits 64 bits; kernels refuse stamps that large."""
    return min(max(stamp_ns, -2 * LARGEST_NS + 1), 2 * LARGEST_NS - 1)


@kernel
def _accept(clock: Stamps, stamp_ns: int) -> None:
    """Store a stamp, ns, as the newest of a clock (6,), in place; forget older stamps and one far ahead."""
    clock[NEWEST], clock[KNOWN], clock[OLDER], clock[FAR_KNOWN] = stamp_ns, 1, 0, 0


@kernel
def check_clock(clock: Stamps, stamp_ns: int, now_ns: int) -> int:
    """Check a stamp of a source against those before it, and update the source's clock by it, in place.

    Args:
        clock: clock of the source, (6,), zeros at first: newest stamp, ns; 1 if there is one; number of older stamps in
            a row; the last of them, ns; a stamp far ahead that is not confirmed yet, ns; 1 if there is one. Changed.
        stamp_ns: the stamp, ns.
        now_ns: newest stamp of all sources, ns.

    Returns:
        Code of `ok`; `late`: older than the window of 0.5 s; `ahead`: further ahead than 0.5 s, unconfirmed; `restart`:
        the source's clock began anew.
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
