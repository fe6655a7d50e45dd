"""Slip model learned from stances: terms over the scaled coefficients, evaluated by a table, and bins for its spread.

P is computed once at the nodes of a table over (K1 / K2, K2 / (8 cell), cos K3) and interpolated linearly between
them, so a prediction costs the same whatever the family and number of the terms.
"""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.kernels.jit import row_kernel

from ..features import Features, Layer
from .bases import Basis, Warp, warped
from .lattice import FLAT, Bin, Key, Lattice, coordinates, inputs
from .protocol import UNLEARNED

NODES = (17, 65, 33)
"""Number of nodes of the table of predictions along K1 / K2, K2 / (8 cell) and cos K3."""
CELL_TOLERANCE = 0.01
"""Largest relative difference of cell edge and of foot radius from those learned with, up to which a model applies."""
ROUNDS = "rounds"
"""Key of `LearnedModel.choice` under which rounds of re-learning are counted."""
HALF_SUPPORT = 10.0
"""Number n of samples near a point at which its support n / (n + 10) is one half."""
KNOTS = (0.0, 0.1, 0.2, 0.3, 0.5)
"""Values of roughness K2 over 8 cell edges, no unit, at which the slope of the simple rule of slip may change."""
BROAD = 10
"""Weight, in samples, of the variance pooled over all bins in the variance of one bin."""
LEAST_RANGE = 1e-3
"""Least width of the range of a table axis, no unit, for samples that are all alike."""


Table = tuple[Layer, Layer, Layer, float]
"""Slip P at the nodes of a grid over K1 / K2, K2 / (8 cell), cos K3, (17, 65, 33); first value and steps per unit of
each axis, (3, 2); ranges of the model, (3, 2); rise of P per K2 / (8 cell) above its range, negative: P is unknown
outside the ranges."""
Support = tuple[NDArray[np.int32], NDArray[np.int64], Layer, int]
"""Samples of each bin, (a, b, c); index on the lattice of its element [0, 0, 0], (3,); origin of the lattice and bins
per unit of each axis, (3, 2); samples that a bin needs, 0 = none."""


@dataclass(frozen=True)
class Conditions:
    """Map, foot and robot that a model was learned with."""

    cell: float
    """Edge of a cell of the maps that the model was learned on, m."""
    smooth: bool
    """True if the map went through the 3 x 3 median filter, False if its heights are as received."""
    foot_radius: float
    """Radius of the foot sphere of the robot that the model was learned with, m."""
    robot: str = ""
    robot_hash: str = ""


@dataclass(frozen=True, eq=False)
class Terms:
    """Weighted sum P(u) = sum_q c_q phi_q(u) of terms over warped inputs u: K1 / (8 cell), K2 / (8 cell), cos K3."""

    basis: Basis
    weights: Array
    """Weights c of the m terms, (m,), slip per stroke."""
    warps: tuple[Warp, ...]
    """Map of each of the three inputs: identity, log or asinh."""
    scales: Array
    """Divisors s of the three inputs before they are warped, (3,), no unit."""

    def values(self, u: Array) -> Array:
        """Return P, the expected slip per stroke, (n,), of inputs u (n, 3): K1 / (8 cell), K2 / (8 cell), cos K3."""
        with np.errstate(over="ignore", invalid="ignore"):  # an overflow is no prediction: see `files.check`
            return (self.basis.columns(warped(u, self.warps, self.scales)) * self.weights).sum(axis=1)


def rule_columns(steep: Array) -> Array:
    """Return 1 and max(steep - knot, 0) for the knots 0, 0.1, 0.2, 0.3, 0.5, (n, 6), no unit.

    With weights >= 0 their sum is the simple rule that the flattest cell is the best, bent upwards as slips are.
    `steep`: K2 / (8 cell), (n,), no unit.
    """
    return np.column_stack((np.ones(len(steep)), *(np.maximum(steep - knot, 0.0) for knot in KNOTS)))


@dataclass(frozen=True, eq=False)
class LearnedModel:
    """Slip model learned from the steps of one robot: terms fitted to bins of slips, a simple rule beside them."""

    title: str
    """Name of the model without its version."""
    conditions: Conditions
    terms: Terms
    lattice: Lattice
    bins: dict[Key, Bin]
    ranges: tuple[tuple[float, float], ...]
    """Smallest and largest K1 / (8 cell), K2 / (8 cell) and cos K3 of the samples, no unit; the slip P is not predicted
    outside."""
    distance_weight: float
    landing_error: float
    support: int = 0
    """Number of samples that a cell's bin needs for a prediction; 0: a cell only has to lie in `ranges`."""
    relief: bool = False
    """True: coefficients come from fitted planes, and the slip blends into the rule `base` where samples are few;
    False: coefficients come from 3 x 3 cells."""
    enough: float = math.inf
    """Number of samples near a point at which terms and simple rule have equal weights; infinite: the rule alone."""
    base: tuple[float, ...] = ()
    """Weights >= 0 of the simple rule: of 1 and of max(K2 / (8 cell) - knot, 0) for five knots."""
    trials: tuple[str, ...] = ()
    """Identities (hashes) of the trials that the samples are from, sorted."""
    seed: int = 0
    choice: dict[str, float] = field(default_factory=dict)
    """Numbers of the fit by name: terms, ridge, error of the folds."""
    provenance: tuple[str, ...] = ()
    """Sources of the samples that the model was learned from, one line each."""

    @property
    def name(self) -> str:
        """Name of the model: title/samples, with +rounds once it was learned again while walking."""
        rounds = round(self.choice.get(ROUNDS, 0.0))
        return f"{self.title}/{self.size}{f'+{rounds}' * (rounds > 0)}"

    @property
    def size(self) -> int:
        """Number of samples that the model was learned from, rounded."""
        return round(math.fsum(each.count for each in self.bins.values()))

    def unfit(self, cell: float, smooth: bool, foot_radius: float) -> str:
        """Return the reason why the model does not hold on a map, empty if it does.

        `cell`: edge of a cell, m; `smooth`: True if a 3 x 3 median filters the map; `foot_radius`: of a foot sphere, m.
        """
        c = self.conditions
        if abs(cell - c.cell) > CELL_TOLERANCE * c.cell:
            return f"learned on cells of {1e3 * c.cell:g} mm, the map has {1e3 * cell:g} mm"
        if smooth != c.smooth:
            with_, without = "through the median filter", "without filter"
            return f"learned {with_ if c.smooth else without}, the map comes {with_ if smooth else without}"
        if abs(foot_radius - c.foot_radius) > CELL_TOLERANCE * c.foot_radius:
            return f"learned with feet of {1e3 * c.foot_radius:g} mm, the robot has {1e3 * foot_radius:g} mm"
        return ""

    def scaled(self, factor: float) -> Self:
        """Return the model for a robot of `factor` times the size, on cells of `factor` times the edge.

        Inputs and slip have no unit, so the terms stay: on ground of the same shape relative to the size of the foot, a
        foot slides by the same share of its stroke. That is an assumption about weight and friction, not a measurement.
        """
        c = self.conditions
        larger = replace(c, cell=factor * c.cell, foot_radius=factor * c.foot_radius, robot="", robot_hash="")
        return replace(
            self, title=f"{self.title} x {factor:g}", conditions=larger, landing_error=factor * self.landing_error,
            distance_weight=self.distance_weight / factor,
        )  # fmt: skip

    def predict(self, features: Features, cell: float) -> Layer:
        """Return the slip per stroke P of every cell, (ny, nx) float32, no unit, >= 0; -1 outside what was learned.

        `features`: ground coefficients K1 (m), K2 (m), cos K3, (ny, nx) each; `cell`: edge of a cell, m.
        """
        k1, k2, cos_k3 = features
        out = np.empty(k1.shape, dtype=np.float32)
        _interpolated(k1, k2, cos_k3, np.float32(0.125 / cell), self.table, self._support, out)
        return out

    def spread(self, features: Features, cell: float) -> Layer:
        """Return the standard deviation of the slip of single steps in each cell, (ny, nx) float32, no unit.

        It is NaN without a predicted slip P. A bin of n samples and sum of squared deviations M2 leans on the spread of
        all:

            sd^2 = (M2 + m (c P)^2) / (n - 1 + m),   m = 10,   c^2 = sum M2 / sum (n - 1) mean^2 over all bins

        `features`: ground coefficients K1 (m), K2 (m), cos K3, (ny, nx) each; `cell`: edge of a cell, m.
        """
        p = self.predict(features, cell).astype(np.float64)
        places = self._places(features, cell)
        n, m2 = (values[places] for values in self._outcomes)
        sd = np.sqrt((m2 + BROAD * self._c2 * p * p) / (np.maximum(n, 1.0) - 1.0 + BROAD))
        return np.where(p >= 0.0, sd, np.nan).astype(np.float32)

    def support_of(self, features: Features, cell: float) -> Layer:
        """Return n / (n + 10), n the number of samples near each cell's coefficients, (ny, nx) float32.

        `features`: ground coefficients K1 (m), K2 (m), cos K3, (ny, nx) each; `cell`: edge of a cell, m.
        """
        k1, k2, cos_k3 = (layer.astype(np.float64).ravel() for layer in features)
        x = coordinates(k1, k2, cos_k3, cell)
        known = np.isfinite(x).all(axis=1)
        out = np.full(len(x), np.nan)
        n = self._near(x[known])
        out[known] = n / (n + HALF_SUPPORT)
        return out.reshape(features.k1.shape).astype(np.float32)

    def _places(self, features: Features, cell: float) -> tuple[NDArray[np.int64], ...]:
        """Return the element of the dense arrays of bins in which each cell lies, three indices of (ny, nx).

        `features`: ground coefficients K1 (m), K2 (m), cos K3, (ny, nx) each; `cell`: edge of a cell, m.
        """
        k1, k2, cos_k3 = np.nan_to_num(np.array(features, dtype=np.float64)).reshape(len(features), -1)
        counts, first, _, _ = self._support
        at = self.lattice.keys(coordinates(k1, k2, cos_k3, cell)) - first + 1
        at = np.clip(at, 0, np.array(counts.shape) + 1).reshape(*features.k1.shape, 3)
        return tuple(np.moveaxis(at, -1, 0))

    @cached_property
    def _outcomes(self) -> tuple[Array, Array]:
        """Numbers of samples, and M2 (sum of squared deviations of slips from the bin's mean), as dense arrays of bins.

        They have one axis for each coefficient, and a border of empty bins.
        """
        counts, first, _, _ = self._support
        n, m2 = np.zeros(np.array(counts.shape) + 2), np.zeros(np.array(counts.shape) + 2)
        for key, each in self.bins.items():
            at = tuple(np.array(key) - first + 1)
            n[at], m2[at] = each.count, each.m2
        return n, m2

    @cached_property
    def _c2(self) -> float:
        freedom = math.fsum((each.count - 1.0) * each.mean**2 for each in self.bins.values() if each.count > 1.0)
        return math.fsum(each.m2 for each in self.bins.values()) / max(1e-12, freedom)

    def _near(self, x: Array) -> Array:
        """Return the number of samples near n points on the lattice's axes, (n,), interpolated between centres of bins.

        `x`: K1 / K2, K2 / (8 cell), cos K3, (n, 3), no unit.
        """
        counts, first, _, _ = self._support
        n = np.pad(counts.astype(np.float64), 1)
        at = (x - np.array(self.lattice.origin)) / np.array(self.lattice.width) - 0.5 - first + 1.0
        at = np.clip(at, 0.0, np.array(n.shape) - 1.0)
        low = np.minimum(at.astype(np.int64), np.array(n.shape) - 2)
        rest, found = at - low, np.zeros(len(x))
        sides, (a, b, c) = (1.0 - rest, rest), low.T
        for i, j, k in np.ndindex(2, 2, 2):
            share = sides[i][:, 0] * sides[j][:, 1] * sides[k][:, 2]
            found += share * n[a + i, b + j, c + k]
        return found

    @cached_property
    def table(self) -> Table:
        """Predictions at the nodes of a grid over the coefficients, between which all others are interpolated."""
        axes = self._nodes()
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        steps = [[axis[0], (len(axis) - 1) / (axis[-1] - axis[0])] for axis in axes]
        with np.errstate(over="ignore"):
            found = self.exact(points).reshape(NODES).astype(np.float32)
        rise = math.fsum(self.base[1:]) if self.relief else -1.0
        return found, np.array(steps, dtype=np.float32), np.array(self.ranges, dtype=np.float32), rise

    def exact(self, x: Array) -> Array:
        """Return the slip per stroke P at points of the lattice, (n,), no unit, by its formula instead of the table.

        With `relief` P = t (terms) + (1 - t) (simple rule) with t = n / (n + enough), n the samples near the point.
        `x`: K1 / K2, K2 / (8 cell), cos K3, (n, 3), no unit; they are brought into the ranges.
        """
        low, high = np.array(self.ranges).T
        values = self.terms.values(np.clip(inputs(x), low, high))
        if self.relief:
            n = self._near(x)
            trust = n / (n + self.enough)
            values = trust * np.clip(values, 0.0, 1.0) + (1.0 - trust) * (rule_columns(x[:, 1]) * self.base).sum(axis=1)
        return np.maximum(values, 0.0)

    def table_error(self, count: int = 2000, seed: int = 0) -> float:
        """Return the largest error of the table, as slip per stroke, at `count` random points within the ranges."""
        rng = np.random.default_rng(seed)
        low, high = np.array(self.ranges).T
        b = rng.uniform(max(low[1], FLAT), high[1], count)
        x = np.column_stack((rng.uniform(-1.0, 1.0, count), b, rng.uniform(low[2], high[2], count)))
        u = inputs(x)
        inside = ((u >= low) & (u <= high)).all(axis=1)
        k = u[inside] * np.array([8.0 * self.conditions.cell, 8.0 * self.conditions.cell, 1.0])
        features = Features(*(np.ascontiguousarray(v[None], dtype=np.float32) for v in k.T))
        found = self.predict(features, self.conditions.cell)[0]
        known = found != UNLEARNED
        return float(np.abs(found[known] - self.exact(x[inside])[known]).max()) if known.any() else math.nan

    def _nodes(self) -> tuple[Array, Array, Array]:
        spans = [(-1.0, 1.0)]
        for low, high in self.ranges[1:]:
            spans.append((low, max(high, low + LEAST_RANGE)))
        return tuple(  # type: ignore[return-value]
            low + (high - low) * np.arange(n, dtype=np.float64) / (n - 1)
            for (low, high), n in zip(spans, NODES, strict=True)
        )

    @cached_property
    def _support(self) -> Support:
        pairs = zip(self.lattice.origin, self.lattice.width, strict=True)
        axes = np.array([[origin, 1.0 / width] for origin, width in pairs], dtype=np.float32)
        keys = np.array(list(self.bins), dtype=np.int64).reshape(-1, 3)
        if not len(keys):
            return np.zeros((1, 1, 1), dtype=np.int32), np.zeros(3, dtype=np.int64), axes, self.support
        first, last = keys.min(axis=0), keys.max(axis=0)
        counts = np.zeros(tuple(last - first + 1), dtype=np.int32)
        for key, each in self.bins.items():
            counts[tuple(np.array(key) - first)] = min(int(each.count), 2**31 - 1)
        return counts, first, axes, self.support


@row_kernel
def _interpolated(
    k1: Layer, k2: Layer, cos_k3: Layer, scale: np.float32, table: Table, held: Support, out: Layer
) -> None:
    """Write the slip P of every cell to `out` (ny, nx), interpolated linearly between the nodes of a table.

    Args:
        k1: K1, (ny, nx) m.
        k2: K2, (ny, nx) m.
        cos_k3: cos K3, (ny, nx), no unit.
        scale: 1 / (8 cell), 1/m.
        table: P at the nodes, axes, ranges, rise of P above the range of K2.
        held: samples of each bin, and how many a bin needs.
        out: written; NaN where a coefficient is, -1 outside what was learned.
    """
    values, axes, ranges, rise = table
    counts, first, lattice, support = held
    zero, one, flat, unlearned = np.float32(0.0), np.float32(1.0), np.float32(FLAT), np.float32(UNLEARNED)
    nt, nb, nc = values.shape
    t0, ts, b0, bs, c0, cs = axes[0, 0], axes[0, 1], axes[1, 0], axes[1, 1], axes[2, 0], axes[2, 1]
    low1, high1, low2, high2, low3, high3 = (
        ranges[0, 0], ranges[0, 1], ranges[1, 0], ranges[1, 1], ranges[2, 0], ranges[2, 1]
    )  # fmt: skip
    last_t, last_b, last_c = np.float32(nt - 1), np.float32(nb - 1), np.float32(nc - 1)
    for i in range(out.shape[0]):
        row1, row2, row3, target = k1[i], k2[i], cos_k3[i], out[i]
        for j in range(out.shape[1]):
            a, b, c = row1[j] * scale, row2[j] * scale, row3[j]
            if math.isnan(b + c):
                target[j] = np.float32(np.nan)
                continue
            t = a / b if b >= flat else zero
            beyond = zero
            if rise >= zero:
                beyond = np.float32(rise) * max(b - high2, zero)
            elif a < low1 or a > high1 or b < low2 or b > high2 or c < low3 or c > high3:
                target[j] = unlearned
                continue
            if support > 0:
                x = math.floor((t - lattice[0, 0]) * lattice[0, 1]) - first[0]
                y = math.floor((b - lattice[1, 0]) * lattice[1, 1]) - first[1]
                z = math.floor((c - lattice[2, 0]) * lattice[2, 1]) - first[2]
                within = x >= 0 and y >= 0 and z >= 0
                within = within and x < counts.shape[0] and y < counts.shape[1] and z < counts.shape[2]
                if not within or counts[x, y, z] < support:
                    target[j] = unlearned
                    continue
            u = min(max((t - t0) * ts, zero), last_t)
            v = min(max((b - b0) * bs, zero), last_b)
            w = min(max((c - c0) * cs, zero), last_c)
            p, q, r = min(int(u), nt - 2), min(int(v), nb - 2), min(int(w), nc - 2)
            u, v, w = u - np.float32(p), v - np.float32(q), w - np.float32(r)
            e00 = values[p, q, r] * (one - w) + values[p, q, r + 1] * w
            e01 = values[p, q + 1, r] * (one - w) + values[p, q + 1, r + 1] * w
            e10 = values[p + 1, q, r] * (one - w) + values[p + 1, q, r + 1] * w
            e11 = values[p + 1, q + 1, r] * (one - w) + values[p + 1, q + 1, r + 1] * w
            found = (e00 * (one - v) + e01 * v) * (one - u) + (e10 * (one - v) + e11 * v) * u + beyond
            target[j] = min(found, one) if rise >= zero else found
