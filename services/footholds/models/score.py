"""Hand-made slip model: seven numbers, each with its reason.

With the mean convexity a = K1 / (8 cell) and the mean roughness b = K2 / (8 cell) (heights over the neighbours per
cell, no unit), s(x) = x / (1 + x), c = cos K3 and (x)+ = max(x, 0),

    P = flat + peak s(a - dead)+ - hole s(-a - dead)+ + rough s(b - |a| - dead)+ + face (c)+ - lean (-c)+,

clipped to [0, 1]. b - |a| is what neither peak nor hole explains: slopes, edges in profile, broken ground. The order
is that of Walas & Belter (Figs. 8-9) and of single-foot trials: holes < flat < slopes < ridges, peaks. The weights were
compared by walks over the demo's ground; with a map of 3 mm noise the feet slid per stance, nominal / selected, mm:
demo 0.31 / 0.25 (10 seeds), demo of 8.7 cm 0.60 / 0.45, and on ground not used for the comparison rough of 4 cm
1.08 / 0.53, flagstones of 6 cm 1.19 / 0.95 (6 seeds each; `python -m benchmarks foothold_walks scores`, with and
without `--nominal`).
"""

from dataclasses import astuple, dataclass, fields
from functools import lru_cache

import numpy as np

from surefoot.kernels.jit import row_kernel

from ..features import Features, Layer


class AnywhereModel:
    """Common part of slip models that were not learned: they hold anywhere, without spread or landing error."""

    @property
    def landing_error(self) -> float:
        """Standard deviation of landings, m: 0, for which the slip is averaged over the free cells of 3 x 3 instead."""
        return 0.0

    @property
    def relief(self) -> bool:
        """False: the ground coefficients are those of 3 x 3 cells, not of planes at the scale of the map."""
        return False

    def unfit(self, cell: float, smooth: bool, foot_radius: float) -> str:
        """Return an empty text, for no reason against a map: the model holds for any cell, filter and foot."""
        return ""

    def spread(self, features: Features, cell: float) -> Layer:
        """Return NaN for every cell, (ny, nx) float32: the model has no spread."""
        return np.full(features.k1.shape, np.nan, dtype=np.float32)

    def support_of(self, features: Features, cell: float) -> Layer:
        """Return 0 for every cell, (ny, nx) float32: nothing was learned."""
        return np.zeros(features.k1.shape, dtype=np.float32)


@dataclass(frozen=True, slots=True)
class HandScore(AnywhereModel):
    """Hand-made slip model of seven weights, none with a unit; the slip P is clipped to [0, 1].

        P = flat + peak s(a - dead) - hole s(-a - dead) + rough s(b - |a| - dead) + face max(c, 0) - lean max(-c, 0)

    with a = K1 / (8 cell), b = K2 / (8 cell), c = cos K3, s(x) = x / (1 + x) for x > 0, else 0.
    """

    flat: float = 0.04
    """Slip per stroke on flat ground, no unit: servo and body errors drag a foot by 4 % of a stroke (single-foot
    trials, mu 0.4)."""
    peak: float = 0.70
    """Weight of peaks and top edges, which hold on one side only. A top edge of 10 mm in 5 mm cells costs 0.26, as much
    as six cells of distance; one of 25 mm exceeds the slip limit."""
    hole: float = 0.05
    """Weight by which a hole or the foot of a wall, which hold on all sides, lowers the slip. Small: no more than the
    flat slip can be gained, and in walks, other than in single-foot trials, holes were not better than flat ground."""
    face: float = 0.30
    """Weight of ground that falls away in the push direction, where a foot slips: a slope of 30 deg costs 0.15."""
    lean: float = 0.10
    """Weight by which ground that faces the push lowers the slip, a third of `face`: less slip than other slopes, not
    than flat ground."""
    rough: float = 0.70
    """Weight of slopes in any direction and of broken ground: stances on the steepest fourth slid twice as far as on
    flat ground."""
    dead: float = 0.15
    """Convexity and roughness, no unit, up to which they count as map noise: 3 mm of noise per cell leave about this
    much after the median filter."""

    def __post_init__(self) -> None:
        for field, value in zip(fields(self), astuple(self), strict=True):
            if not (np.isfinite(value) and 0.0 <= value <= 10.0):
                raise ValueError(f"{field.name} must be between 0 and 10, got {value!r}")

    @property
    def name(self) -> str:
        """Name and version of the hand-made slip formula, as replies state it."""
        return "hand-made/1"

    @property
    def distance_weight(self) -> float:
        """Weight k, 1/m, of the distance K4 from the nominal foothold in the cost Q = P + k K4, P the slip."""
        return 8.0

    def predict(self, features: Features, cell: float) -> Layer:
        """Return the slip per stroke P of every cell, (ny, nx) float32 in [0, 1], NaN where a coefficient is.

        `features`: ground coefficients K1 (m), K2 (m), cos K3, (ny, nx) each; `cell`: edge of a cell, m, of any size.
        """
        k1, k2, cos_k3 = features
        out = np.empty(k1.shape, dtype=np.float32)
        _predict(k1, k2, cos_k3, _weights(self), np.float32(0.125 / cell), out)
        return out


@lru_cache(maxsize=16)
def _weights(score: HandScore) -> Layer:
    return np.array(astuple(score), dtype=np.float32)


@row_kernel
def _predict(k1: Layer, k2: Layer, cos_k3: Layer, weights: Layer, scale: np.float32, out: Layer) -> None:
    """Write the slip P of every cell to `out` (ny, nx).

    Args:
        k1: K1, (ny, nx) m.
        k2: K2, (ny, nx) m.
        cos_k3: cos K3, (ny, nx), no unit.
        weights: flat, peak, hole, face, lean, rough, dead, (7,), no unit.
        scale: 1 / (8 cell), 1/m.
        out: written.
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    flat, peak, hole, face = weights[0], weights[1], weights[2], weights[3]
    lean, rough, dead = weights[4], weights[5], weights[6]
    for i in range(out.shape[0]):
        row1, row2, row3, target = k1[i], k2[i], cos_k3[i], out[i]
        for j in range(out.shape[1]):
            a, b, c = row1[j] * scale, row2[j] * scale, row3[j]
            up, low, edge = max(a - dead, zero), max(-a - dead, zero), max(b - abs(a) - dead, zero)
            value = flat + peak * up / (one + up) - hole * low / (one + low) + rough * edge / (one + edge)
            value += face * max(c, zero) + lean * min(c, zero)
            # b + c keeps a NaN of the coefficients, which max and min drop
            target[j] = min(max(value, zero), one) + zero * (b + c)
