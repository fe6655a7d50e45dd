"""The last second of inertial data on its own clock, for kinematic samples whose stamps lie between."""

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.kernels.jit import kernel

Stamps = NDArray[np.int64]

ROWS = 128


@kernel
def _at(stamps: Stamps, values: Array, count: int, stamp_ns: int) -> Array:
    """Return the row (c,) at a stamp by linear interpolation, clamped to the oldest and the newest row.

    Args:
        stamps: ring of stamps, (n,) ns.
        values: ring of rows of c numbers, (n, c).
        count: rows that were written so far, also those written over.
        stamp_ns: the stamp, ns.
    """
    rows = stamps.size
    stored = min(count, rows)
    newest = (count - 1) % rows
    if stamp_ns >= stamps[newest]:
        return values[newest].copy()
    later = newest
    for back in range(1, stored):
        row = (count - 1 - back) % rows
        if stamps[row] <= stamp_ns:
            part = (stamp_ns - stamps[row]) / (stamps[later] - stamps[row])
            return values[row] + part * (values[later] - values[row])
        later = row
    return values[later].copy()


@kernel
def _put(stamps: Stamps, values: Array, count: int, stamp_ns: int, row: Array) -> None:
    """Write a row (c,) and its stamp, ns, over the oldest of the rings stamps (n,) and values (n, c), in place.

    `count`: rows that were written before.
    """
    at = count % stamps.size
    stamps[at] = stamp_ns
    for i in range(row.size):
        values[at, i] = row[i]


class History:
    """Ring of the newest 128 rows of numbers, each with a stamp in ns; `width`: numbers in a row."""

    def __init__(self, width: int) -> None:
        self._stamps = np.zeros(ROWS, dtype=np.int64)
        self._values = np.zeros((ROWS, width))
        self._count = 0

    def put(self, stamp_ns: int, row: Array) -> None:
        """Append a row (width,), in the units of its owner, with a stamp, ns, later than those before."""
        _put(self._stamps, self._values, self._count, stamp_ns, row)
        self._count += 1

    def at(self, stamp_ns: int) -> Array:
        """Return the row (width,) at a stamp, ns, by interpolation; outside the stored stamps the nearest row."""
        return _at(self._stamps, self._values, self._count, stamp_ns)

    def clear(self) -> None:
        """Remove all rows of past samples."""
        self._count = 0

    def __len__(self) -> int:
        return min(self._count, ROWS)
