"""Rules that choose footholds: those of the service under any slip model, random draws, two from the literature."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from surefoot.robot.description import Robot
from surefoot.services.footholds.features import Features, Layer
from surefoot.services.footholds.ground import FootholdGround
from surefoot.services.footholds.models.protocol import SlipModel
from surefoot.services.footholds.models.score import HandScore
from surefoot.services.footholds.select import Foothold, Landing, SelectParams, TrunkPose, select

from .walks import Rule

DRAWS = 100_003
"""Distance of the seeds of two walks: steps of a walk count up from its seed times this."""


class _AnywhereModel:
    """Common part of rules from the literature: they hold anywhere, without spread or landing error."""

    @property
    def distance_weight(self) -> float:
        """Weight k of Q = P + k K4, 1/m: 0, a walk states its own."""
        return 0.0

    @property
    def landing_error(self) -> float:
        """Landing error, m: 0, the choice takes the mean over the free cells of the 3 x 3 block."""
        return 0.0

    def unfit(self, cell: float, smooth: bool, foot_radius: float) -> str:
        """Return nothing: the rule holds for any cell, filter and foot."""
        return ""

    def spread(self, features: Features, cell: float) -> Layer:
        """Return NaN for every cell, (ny, nx) float32."""
        return np.full(features.k1.shape, np.nan, dtype=np.float32)


@dataclass(frozen=True, slots=True)
class MinK2(_AnywhereModel):
    """Rule of the flattest cell: P is K2 / (8 cell), the mean rise per way."""

    @property
    def name(self) -> str:
        """Name of the rule."""
        return "min-k2"

    def predict(self, features: Features, cell: float) -> Layer:
        """Return the mean roughness of each cell, at most 1, (ny, nx)."""
        return np.minimum(features.k2 / np.float32(8.0 * cell), np.float32(1.0))


@dataclass(frozen=True, slots=True)
class GridMapRule(_AnywhereModel):
    """Rule of grid_map's example filters, traversability 1 - [.5 (1 - slope / .6) + .5 (1 - roughness / .1)].

    The slope is in rad. Only K1 and K2 are at hand: the slope of a plane is K2 / (7 cell) within 15 % in any
    direction, and half the mean deviation of the centre from its neighbours stands for the roughness in m.
    """

    @property
    def name(self) -> str:
        """Name of the rule."""
        return "grid-map"

    def predict(self, features: Features, cell: float) -> Layer:
        """Return one minus the traversability of each cell, 0 to 1, (ny, nx)."""
        slope = np.arctan((features.k2 - np.abs(features.k1)) / np.float32(7.0 * cell))
        rough = np.abs(features.k1) / np.float32(16.0)
        free = 0.5 * np.maximum(1.0 - slope / 0.6, 0.0) + 0.5 * np.maximum(1.0 - rough / 0.1, 0.0)
        return (1.0 - free).astype(np.float32)


def model_rule(model: SlipModel, params: SelectParams) -> Rule:
    """Return the choice of the service with this model."""

    def rule(
        ground: FootholdGround, robot: Robot, base: TrunkPose, landings: Sequence[Landing], step: int
    ) -> Sequence[Foothold]:
        return select(ground, robot, model, base, landings, params)

    return rule


def nominal_rule() -> Rule:
    """Return the rule that lands every leg on its nominal foothold, at the height of the map."""

    def rule(
        ground: FootholdGround, robot: Robot, base: TrunkPose, landings: Sequence[Landing], step: int
    ) -> Sequence[Foothold]:
        return [Foothold("ok", foothold=each.nominal) for each in landings]

    return rule


def random_rule(seed: int) -> Rule:
    """Return the rule that draws a cell of the window for each leg; equal seeds give equal draws."""
    return exploring_rule(seed, 1.0, model_rule(HandScore(), SelectParams()))


def exploring_rule(seed: int, share: float, rule: Rule) -> Rule:
    """Return `rule`, with a share of steps whose footholds are drawn at random."""
    if not (math.isfinite(share) and 0.0 <= share <= 1.0):
        raise ValueError(f"share must be between 0 and 1, got {share!r}")

    def either(
        ground: FootholdGround, robot: Robot, base: TrunkPose, landings: Sequence[Landing], step: int
    ) -> Sequence[Foothold]:
        if share < 1.0 and np.random.default_rng((seed, step, 1)).random() >= share:
            return rule(ground, robot, base, landings, step)
        return select(ground, robot, HandScore(), base, landings, SelectParams(seed=seed * DRAWS + step))

    return either
