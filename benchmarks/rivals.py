"""Rules that the choice of footholds is compared with: two from the literature, and landing where the gait would."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from surefoot.lab.footholds.walks import Rule
from surefoot.robot.description import Robot
from surefoot.services.footholds.features import Features, Layer
from surefoot.services.footholds.ground import FootholdGround
from surefoot.services.footholds.models.score import AnywhereModel
from surefoot.services.footholds.select import Foothold, Landing, TrunkPose


class _NoWeight(AnywhereModel):
    """Common part of rules from the literature, which state no weight of the distance: a walk states it."""

    @property
    def distance_weight(self) -> float:
        """Weight k, 1/m, of the distance K4 in the cost Q = P + k K4, P the slip: 0, as each walk states its own."""
        return 0.0


@dataclass(frozen=True, slots=True)
class MinK2(_NoWeight):
    """Rule of the flattest cell: the predicted slip P is K2 / (8 cell), the mean slope, no unit."""

    @property
    def name(self) -> str:
        """Name of the rule of the flattest cell."""
        return "min-k2"

    def predict(self, features: Features, cell: float) -> Layer:
        """Return the mean slope K2 / (8 cell) of each cell in place of its slip, at most 1, no unit, (ny, nx)."""
        return np.minimum(features.k2 / np.float32(8.0 * cell), np.float32(1.0))


@dataclass(frozen=True, slots=True)
class GridMapRule(_NoWeight):
    """Rule of grid_map's example filters, traversability 1 - [.5 (1 - slope / .6) + .5 (1 - roughness / .1)].

    The slope is in rad. Only K1 and K2 are at hand: the slope of a plane is K2 / (7 cell) within 15 % in any
    direction, and half the mean deviation of the centre from its neighbours stands for the roughness in m.
    """

    @property
    def name(self) -> str:
        """Name of the rule of grid_map's example filters."""
        return "grid-map"

    def predict(self, features: Features, cell: float) -> Layer:
        """Return one minus the traversability of each cell, 0 to 1, (ny, nx)."""
        slope = np.arctan((features.k2 - np.abs(features.k1)) / np.float32(7.0 * cell))
        rough = np.abs(features.k1) / np.float32(16.0)
        free = 0.5 * np.maximum(1.0 - slope / 0.6, 0.0) + 0.5 * np.maximum(1.0 - rough / 0.1, 0.0)
        return (1.0 - free).astype(np.float32)


def nominal_rule() -> Rule:
    """Return the rule that lands every leg on its nominal foothold, at the height of the map."""

    def rule(
        ground: FootholdGround, robot: Robot, base: TrunkPose, landings: Sequence[Landing], step: int
    ) -> Sequence[Foothold]:
        return [Foothold("ok", foothold=each.nominal) for each in landings]

    return rule
