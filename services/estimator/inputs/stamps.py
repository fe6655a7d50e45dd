"""Stamps that contradict the samples: a clock that steps back, and feet whose stamps step ahead of their motion.

A sample that is older than the newest is late, and belongs where one is missing. Where none is missing, the clock of
the inertial unit has stepped back: samples are refused until some in a row have shown it, and the estimate goes on.

Feet move on between two samples whose stamps are far apart. If they do not, and moved alike before and after, no sample
was lost: the stamps stepped. With the displacements a, b, c of all feet over n samples before the gap, over it and over
n after it, T the mean step of the stamps,

    time by motion = 2 n T sum b.(a + c)/sum (a + c).(a + c),   late = gap - that time
"""

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.kernels.jit import kernel

Stamps = NDArray[np.int64]

MOST_BACK = 3
"""Number of inertial samples in a row which show that their clock has stepped back."""
NO_ROOM = 1.5
"""Step between two samples, in usual periods, above which a sample between them is missing."""
SPANS_NS = (40_000_000, 20_000_000, 10_000_000)
"""Times before and after a gap over which the motion of the feet is compared, ns: short ones for feet that turn round,
long ones against noise."""
ALIKE = 1.5
"""Largest ratio of the times compared before and after a gap, and least ratio of the gap to the usual step."""
MOVES = 0.002
"""Least motion of the feet, m, before and after a gap for a comparison: several times the noise of encoders."""
EVEN = 1.4
"""Largest difference of the motion before and after a gap, as a fraction of its mean: no foot stopped in the gap."""
FITS = 0.05
"""Squared misfit of feet that moved one usual step in a gap over that of the whole gap, below which it is one step."""
LONGEST_NS = 150_000_000
"""Longest gap in which stepped stamps are sought, ns: feet of a walk are where they were one step later."""
LEAST_LATE = 0.4
"""Fraction of a gap explained by late stamps above which the stamps have stepped and no sample was lost."""
EVEN_ROWS = 40
"""Number of steps before a gap that show how evenly the stamps come."""
BEYOND_JITTER = 5.0
"""Excess of a gap over the usual step, in mean distances of a step from it, below which stamps are only uneven."""


@kernel
def has_room(stamps: Stamps, at: int, period_ns: float) -> bool:
    """Return True if a sample is missing before row `at` of rising stamps (n,), ns, 0 < at <= n.

    `period_ns`: usual step of the stamps, ns. There is always room after the last row, at = n.
    """
    return at == stamps.size or stamps[at] - stamps[at - 1] > NO_ROOM * period_ns


@kernel
def late_by(stamps: Stamps, feet: Array) -> tuple[int, int]:
    """Return the row from which the stamps of the feet are late, and by how many ns; (0, 0) if none is.

    Args:
        stamps: rising stamps, (n,) ns.
        feet: positions of the feet at these stamps, (n, L, 3) m.
    """
    for span_ns in SPANS_NS:
        row, late = _late_over(stamps, feet, span_ns)
        if late > 0:
            return (row, late) if _exceeds(stamps, row) else (0, 0)
    return 0, 0


@kernel
def _exceeds(stamps: Stamps, row: int) -> bool:
    """Return True if the step to a row of rising stamps (n,), ns, is long beside the steps before it.

    It exceeds their mean by `BEYOND_JITTER` times their mean distance from it.
    """
    first, spread = max(row - EVEN_ROWS, 0), 0.0
    if row - first < 2:
        return True
    usual = (stamps[row - 1] - stamps[first]) / (row - 1 - first)
    for i in range(first + 1, row):
        spread += abs(stamps[i] - stamps[i - 1] - usual) / (row - 1 - first)
    return stamps[row] - stamps[row - 1] - usual > BEYOND_JITTER * spread


@kernel
def _late_over(stamps: Stamps, feet: Array, span_ns: int) -> tuple[int, int]:
    """Return row and delay, ns, of late stamps by the motion of the feet before and after the last gap; (0, 0): none.

    Args:
        stamps: rising stamps, (n,) ns.
        feet: positions of the feet at these stamps, (n, L, 3) m.
        span_ns: time before and after the gap over which the motion is compared, ns.
    """
    last, row = stamps.size - 1, stamps.size - 1
    while row > 0 and stamps[last] - stamps[row] < span_ns and stamps[row] - stamps[row - 1] < span_ns // 2:
        row -= 1
    count = last - row
    if count == 0:
        row, count = last - 1, 1
    first = row - 1 - count
    if first < 0 or stamps[last] - stamps[row] < span_ns // 2:
        return 0, 0
    after_ns, before_ns = stamps[last] - stamps[row], stamps[row - 1] - stamps[first]
    gap_ns = stamps[row] - stamps[row - 1]
    least, most = min(after_ns, before_ns), max(after_ns, before_ns)
    if least <= 0 or most > ALIKE * least or gap_ns * count < ALIKE * most or gap_ns > LONGEST_NS:
        return 0, 0
    period = 0.5 * (after_ns + before_ns) / count
    square = apart = along = one = whole = 0.0
    for f in range(feet.shape[1]):
        for i in range(3):
            a, c = feet[row - 1, f, i] - feet[first, f, i], feet[last, f, i] - feet[row, f, i]
            b, mean = feet[row, f, i] - feet[row - 1, f, i], 0.5 * (a + c)
            square += mean**2
            apart += (a - c) ** 2
            along += b * mean
            one += (b - mean / count) ** 2
            whole += (b - mean / count * gap_ns / period) ** 2
    if not (square > MOVES**2 and apart < EVEN**2 * square and one < FITS * whole):
        return 0, 0
    late = gap_ns - max(round(count * along / square), 1) * period
    return (row, int(late)) if late > LEAST_LATE * gap_ns else (0, 0)
