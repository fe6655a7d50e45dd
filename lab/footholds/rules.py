"""Rules that choose the footholds of simulated walks: the choice of the service by a slip model, or random draws."""

import math
from collections.abc import Sequence

import numpy as np

from surefoot.robot.description import Robot
from surefoot.services.footholds.ground import FootholdGround
from surefoot.services.footholds.models.protocol import SlipModel
from surefoot.services.footholds.models.score import HandScore
from surefoot.services.footholds.select import Foothold, Landing, SelectParams, TrunkPose, select

from .walks import Rule

DRAWS = 100_003
"""Difference of the step seeds of two successive walks: step i of walk `seed` has seed `seed * DRAWS + i`."""


def model_rule(model: SlipModel, params: SelectParams) -> Rule:
    """Return the rule that chooses footholds as the service footholds does, with this slip model."""

    def rule(
        ground: FootholdGround, robot: Robot, base: TrunkPose, landings: Sequence[Landing], step: int
    ) -> Sequence[Foothold]:
        return select(ground, robot, model, base, landings, params)

    return rule


def random_rule(seed: int) -> Rule:
    """Return a rule that picks footholds at random from the free cells of a leg's window, reproducibly by seed."""
    return exploring_rule(seed, 1.0, model_rule(HandScore(), SelectParams()))


def exploring_rule(seed: int, share: float, rule: Rule) -> Rule:
    """Return a rule that follows `rule`, but draws the footholds of a share (0 to 1) of the steps at random."""
    if not (math.isfinite(share) and 0.0 <= share <= 1.0):
        raise ValueError(f"share must be between 0 and 1, got {share!r}")

    def either(
        ground: FootholdGround, robot: Robot, base: TrunkPose, landings: Sequence[Landing], step: int
    ) -> Sequence[Foothold]:
        if share < 1.0 and np.random.default_rng((seed, step, 1)).random() >= share:
            return rule(ground, robot, base, landings, step)
        return select(ground, robot, HandScore(), base, landings, SelectParams(seed=seed * DRAWS + step))

    return either
