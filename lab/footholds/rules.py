"""Rules that choose footholds in simulated walks: as the service footholds does with a slip model, or at random."""

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
"""Distance between the random seeds of two walks: the foothold draw of step i in walk `seed` has `seed * DRAWS + i`."""


def model_rule(model: SlipModel, params: SelectParams) -> Rule:
    """Return a rule that chooses footholds by a slip model, as the service footholds does."""

    def rule(
        ground: FootholdGround, robot: Robot, base: TrunkPose, landings: Sequence[Landing], step: int
    ) -> Sequence[Foothold]:
        return select(ground, robot, model, base, landings, params)

    return rule


def random_rule(seed: int) -> Rule:
    """Return a rule that draws footholds from the unmasked cells of a leg's search window, reproducibly by seed."""
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
