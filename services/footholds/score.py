"""A transparent hand-made slip model: five numbers, each with its reason.

With the mean convexity a = K1 / (8 cell) and the mean roughness b = K2 / (8 cell) (both heights of the neighbours per
cell, without unit), s(x) = x / (1 + x) and c = cos K3,

    P = flat + peak s(a - dead)+ - hole s(-a - dead)+ + face c (half of it when c < 0) + rough s(b - dead)+,

clipped to [0, 1]; (x)+ = max(x, 0). It agrees in order with the paper's Figs. 8-9 and with single-foot trials:
holes < flat < slopes < ridges and peaks.
"""

from dataclasses import astuple, dataclass, fields
from functools import lru_cache

import numpy as np

from services.footholds.features import Features, Layer
from surefoot.jit import row_kernel


@dataclass(frozen=True, slots=True)
class HandScore:
    """Weights of the hand-made score; none has a unit."""

    flat: float = 0.04
    """Slip on flat ground: servo and body errors drag a foot by about 4 % of a stroke (single-foot trials, mu 0.4)."""
    peak: float = 0.60
    """A peak or top edge holds on one side only. A top edge of 10 mm in 5 mm cells costs 0.25, seven cells of way;
    one of 25 mm passes the slip limit."""
    hole: float = 0.10
    """A hole or the foot of a wall holds on all sides; more than the flat slip cannot be gained, and a weight well
    under `peak` keeps feet out of deep holes that are worth a detour of no more than a cell."""
    face: float = 0.30
    """Ground that falls away from the push slips: 30 deg cost 0.15. Ground that faces the push gains half as much,
    as gravity then loads the contact, yet the body still slides sideways."""
    rough: float = 0.10
    """Edges in profile and broken ground have K1 near 0 and a high K2; also tilts the choice from slopes to flats."""
    dead: float = 0.05
    """Noise of the map that is not ground: 1 mm of filtered noise at 5 mm cells gives a and b of this size."""

    def __post_init__(self) -> None:
        for field, value in zip(fields(self), astuple(self), strict=True):
            if not (np.isfinite(value) and 0.0 <= value <= 10.0):
                raise ValueError(f"{field.name} must be between 0 and 10, got {value!r}")

    @property
    def name(self) -> str:
        """Name and version of the formula."""
        return "hand-made/1"

    def predict(self, features: Features, cell: float) -> Layer:
        """P of every cell, (ny, nx) float32 in [0, 1], NaN where the coefficients are; holds for any cell size."""
        k1, k2, cos_k3 = features.k1, features.k2, features.cos_k3
        out = np.empty(k1.shape, dtype=np.float32)
        _predict(k1, k2, cos_k3, _weights(self), np.float32(0.125 / cell), out)
        return out


@lru_cache(maxsize=16)
def _weights(score: HandScore) -> Layer:
    return np.array(astuple(score), dtype=np.float32)


@row_kernel
def _predict(k1: Layer, k2: Layer, cos_k3: Layer, weights: Layer, scale: np.float32, out: Layer) -> None:
    zero, one, half = np.float32(0.0), np.float32(1.0), np.float32(0.5)
    flat, peak, hole, face, rough, dead = weights[0], weights[1], weights[2], weights[3], weights[4], weights[5]
    for i in range(out.shape[0]):
        row1, row2, row3, target = k1[i], k2[i], cos_k3[i], out[i]
        for j in range(out.shape[1]):
            a, b, c = row1[j] * scale, row2[j] * scale, row3[j]
            up, low, edge = max(a - dead, zero), max(-a - dead, zero), max(b - dead, zero)
            value = flat + peak * up / (one + up) - hole * low / (one + low) + rough * edge / (one + edge)
            value += face * max(c, zero) + half * face * min(c, zero)
            # b + c carries a NaN of the coefficients past max and min
            target[j] = min(max(value, zero), one) + zero * (b + c)


def warm() -> None:
    """Compile the kernel for whole layers and for windows (views without contiguous rows)."""
    whole = np.zeros((3, 3), dtype=np.float32)
    HandScore().predict(Features(whole, whole, whole), 0.005)
    part = whole[1:-1, 1:-1]
    HandScore().predict(Features(part, part, part), 0.005)
