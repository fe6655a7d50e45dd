"""Slip as the robot measures it beside the true one, stance by stance."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surefoot.services.estimator.feet.kinematics import foot_mount
from surefoot.services.estimator.feet.slip import FinishedStance, StanceSlip, feet_in_odom

from .walks import JoinedWalk

Array = NDArray[np.float64]
LIFTED_TICKS = 5
"""Time after the last sample with contact in which a foot may still slide, ticks."""


@dataclass(frozen=True, slots=True)
class MeasuredStance:
    """Slip of one stance, measured and true."""

    leg: int
    """Index in the robot description."""
    own: float
    """Slip as the robot measured it, m."""
    inside: float
    """True sliding between its first and its last sample with contact, m."""
    whole: float
    """True sliding since the stance before, m; it includes that of a foot too light for its switch."""
    begin: tuple[float, float, float]
    """Foot centre at the begin of the stance, frame `odom`, m."""


class SlipFollower:
    """Meter of slip in a walk, as in the estimator service, with the truth beside it."""

    def __init__(self, joined: JoinedWalk) -> None:
        self.joined = joined
        self.mount = foot_mount(joined.robot)
        n = joined.robot.nlegs
        self.meter = StanceSlip(n, self.mount.radius)
        self.found: list[MeasuredStance] = []
        self._total, self._before = np.zeros(n), np.zeros(n)
        self._rows: list[Array] = []
        """True way of each foot so far, at each sample of the joints, (L,) m."""
        self._trail: list[Array] = []
        """True way of each foot so far, at each tick, (L,) m."""
        self._ticks: list[int] = []
        self._counted = np.zeros(n)

    def look(self) -> list[MeasuredStance]:
        """Read the tick that has passed; returns the stances that have ended."""
        world, estimator = self.joined.world, self.joined.estimator
        sliding = world.tracker.feet.sliding.copy()
        self._total += np.where(sliding >= self._before, sliding - self._before, sliding)
        self._before = sliding
        self._trail.append(self._total.copy())
        joints, contacts = world.samples.joints, world.samples.contacts
        if joints is None or contacts is None or not estimator.initialised:
            return []
        touch = np.array([any(foot) for foot in contacts.touch])
        behind_s = 1e-9 * (estimator.stamp_ns - joints.stamp_ns)
        feet = feet_in_odom(self.mount, joints.position, estimator.pose(), behind_s)
        self._rows.append(self._total.copy())
        self._ticks.append(len(self._trail) - 1)
        ended = [self._beside(each) for each in self.meter.update(touch, *feet)]
        self.found += ended
        return ended

    def _beside(self, stance: FinishedStance) -> MeasuredStance:
        leg, row = stance.leg, len(self._rows) - 1
        last = row - stance.since
        first = last - stance.samples + 1
        until = min(self._ticks[last] + LIFTED_TICKS, len(self._trail) - 1)
        whole = float(self._trail[until][leg])
        out = MeasuredStance(
            leg, stance.slip, float(self._rows[last][leg] - self._rows[first][leg]),
            whole - float(self._counted[leg]), stance.begin,
        )  # fmt: skip
        self._counted[leg] = whole
        return out


def auc(score: Array, positive: NDArray[np.bool_]) -> float:
    """Return the area under the receiver operating curve: share of pairs in which the positive scores higher.

    Ties count half.

    Args:
        score: value of each item, (n,).
        positive: class of each item, (n,); NaN is returned if all or none are positive.
    """
    from scipy.stats import rankdata

    n = int(positive.sum())
    if n in (0, len(positive)):
        return float("nan")
    ranks = rankdata(score)
    return float((ranks[positive].sum() - n * (n + 1) / 2) / (n * (len(positive) - n)))


def rms(values: Sequence[float] | Array) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))
