"""Bins of outcomes on a fixed lattice: count, sum and sum of squares of the slip of each bin.

The lattice has the axes K1 / K2 (0 where K2 ~ 0), K2 / (8 cell) and cos K3: the wedge |K1| <= K2 would leave half of
a rectangular grid over K1 and K2 empty. Sums are integers of a fixed unit, so that the order of samples and of merges
does not change a byte.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.errors import InvalidField

Key = tuple[int, int, int]

UNIT = 1e-9
"""Unit of the integer sums of slips per stroke (no unit); sums of their squares are in units of 1e-18."""
FLAT = 1e-6
"""Roughness K2 over 8 cell edges, no unit, below which ground is flat: convexity K1 over K2 is set to 0."""
ROUGHEST = 4.0
"""Largest roughness K2 over 8 cell edges of a sample, no unit; larger values, as at a cliff, are clipped to it."""
LARGEST = 20.0
"""Largest slip of a sample, in strokes; a sample above it is rejected: the foot was carried, not placed."""


class LatticeError(InvalidField):
    """Error for a lattice of bins with impossible numbers; `field` names the wrong part."""


@dataclass(frozen=True)
class Lattice:
    """Lattice of bins over the ground coefficients; a point x lies in the bin floor((x - origin) / width).

    Axes are K1 / K2, K2 / (8 cell) and cos K3, no unit; the lattice has no edges.
    """

    origin: tuple[float, float, float] = (-1.1, 0.0, -1.05)
    width: tuple[float, float, float] = (0.2, 0.05, 0.1)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.origin).all() and np.isfinite(self.width).all() and min(self.width) > 0.0):
            raise LatticeError("lattice", f"needs finite origins and widths > 0, got {self.origin!r}, {self.width!r}")

    def keys(self, x: Array) -> NDArray[np.int64]:
        """Return the indices (n, 3) of the bins of points x, (n, 3): K1 / K2, K2 / (8 cell), cos K3, no unit."""
        return np.floor((x - np.array(self.origin)) / np.array(self.width)).astype(np.int64)

    def centres(self, keys: Iterable[Key]) -> Array:
        """Return the centres (n, 3) of bins with n indices (i, j, k): K1 / K2, K2 / (8 cell), cos K3, no unit."""
        return np.array(self.origin) + (np.array(list(keys), dtype=np.float64).reshape(-1, 3) + 0.5) * self.width


@dataclass(frozen=True, slots=True)
class Bin:
    """Count, sum and sum of squares of the slips (per stroke) of samples whose ground lies in one bin of a lattice."""

    count: float
    """Number of samples in the bin; a fraction after weighted re-learning."""
    total: int
    """Sum of the slips r per stroke, in units of 1e-9."""
    squares: int
    """Sum of the squares r^2 of the slips per stroke, in units of 1e-18."""

    @property
    def mean(self) -> float:
        """Mean slip in the bin: distance slid by the contact point per length of the stroke, no unit."""
        return self.total * UNIT / self.count

    @property
    def m2(self) -> float:
        """Sum of squared deviations of the bin's slips per stroke from their mean, no unit."""
        return max(0.0, (self.squares * UNIT * UNIT) - self.total * UNIT * self.mean)

    @property
    def possible(self) -> bool:
        """True if slips r of 0 to 20 can have these sums: (sum r)^2 <= n sum r^2 <= n 20 sum r, n the count."""
        if not 0.0 <= self.mean <= LARGEST:
            return False
        total, squares = self.total * UNIT, self.squares * UNIT * UNIT
        slack = UNIT * (1.0 + total) * (1.0 + self.count)
        return total * total <= self.count * squares + slack and squares <= LARGEST * total + slack

    @property
    def sd(self) -> float:
        """Standard deviation of the slip per stroke of the bin's samples, no unit; NaN for one sample."""
        return float(np.sqrt(self.m2 / (self.count - 1.0))) if self.count > 1.0 else float("nan")


Bins = Mapping[Key, Bin]


def coordinates(k1: Array, k2: Array, cos_k3: Array, cell: float) -> Array:
    """Return points on the axes of a lattice, (n, 3), no unit: K1 / K2, K2 / (8 cell), cos K3 of ground coefficients.

    They are clipped to -1 .. 1, 0 .. 4 and -1 .. 1; K1 / K2 of flat ground is 0. `k1` (n,) m, `k2` (n,) m, `cos_k3`
    (n,): coefficients; `cell`: edge of a cell, m.
    """
    b = k2 / (8.0 * cell)
    ratio = np.where(b < FLAT, 0.0, k1 / np.where(k2 == 0.0, 1.0, k2))
    return np.column_stack((np.clip(ratio, -1.0, 1.0), np.clip(b, 0.0, ROUGHEST), np.clip(cos_k3, -1.0, 1.0)))


def inputs(x: Array) -> Array:
    """Return the inputs K1 / (8 cell), K2 / (8 cell), cos K3 of a slip model, (n, 3), no unit.

    `x`: points on the axes of a lattice, K1 / K2, K2 / (8 cell), cos K3, (n, 3).
    """
    return np.column_stack((x[:, 0] * x[:, 1], x[:, 1], x[:, 2]))


def filled(lattice: Lattice, x: Array, r: Array) -> dict[Key, Bin]:
    """Return the bins of samples, in the order of their keys.

    Args:
        lattice: axes of the bins.
        x: points on the axes, K1 / K2, K2 / (8 cell), cos K3, (n, 3), no unit.
        r: slip per stroke, (n,), no unit.
    """
    found: dict[Key, list[int]] = {}
    for key, value in zip(lattice.keys(x).tolist(), r.tolist(), strict=True):
        whole = round(value / UNIT)
        entry = found.setdefault((key[0], key[1], key[2]), [0, 0, 0])
        entry[0] += 1
        entry[1] += whole
        entry[2] += whole * whole
    return {key: Bin(float(n), total, squares) for key, (n, total, squares) in sorted(found.items())}


def merged(a: Bins, b: Bins, weight: float = 1.0) -> dict[Key, Bin]:
    """Return the union of two sets of bins in which each sample keeps its weight (counted form of re-learning).

        r <- (N_old r_old + c N_new r_new) / (N_old + c N_new),   N <- N_old + c N_new

    r: mean slip of a bin, N: its count. With c = 1 this equals the bins of all samples, to the byte.

    Args:
        a: the old bins, by index on the lattice.
        b: the new bins, on the same lattice.
        weight: c, 0 to 1.
    """
    out = dict(a)
    for key, new in b.items():
        old = a.get(key, Bin(0.0, 0, 0))
        if weight == 1.0:
            out[key] = Bin(old.count + new.count, old.total + new.total, old.squares + new.squares)
        elif weight > 0.0:
            total, squares = round(weight * new.total), round(weight * new.squares)
            out[key] = Bin(old.count + weight * new.count, old.total + total, old.squares + squares)
    return dict(sorted(out.items()))


def faded(a: Bins, b: Bins, c: float) -> dict[Key, Bin]:
    """Return re-learned bins by (19) of Walas & Belter: r <- (r_old + c r_new) / (1 + c), without regard to counts.

    r: mean slip of a bin. Bins that only one set has are taken as they are. Counts of bins that both sets have are
    those of the old set.

    Args:
        a: the old bins, by index on the lattice.
        b: the new bins, on the same lattice.
        c: weight of the new bins, 0 to 1.
    """
    out = dict(a)
    for key, new in b.items():
        if key not in a:
            out[key] = new
            continue
        old = a[key]
        n = old.count
        mean = (old.mean + c * new.mean) / (1.0 + c)
        spread = (old.m2 / n + c * new.m2 / new.count) / (1.0 + c)
        out[key] = Bin(n, round(n * mean / UNIT), round(n * (spread + mean * mean) / UNIT / UNIT))
    return dict(sorted(out.items()))
