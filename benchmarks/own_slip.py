"""Slip as the robot measures it beside the true one, and evaluation of learning again from it.

Edges are withheld from a first model, and exploring walks bring their outcomes. The gap is the mean square error on
withheld ground of the first model minus that of a model of all training data; a re-learned model closes a share of it.
Errors are those on stances of walks that no model was made of.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.lab.footholds.rules import exploring_rule, model_rule
from surefoot.lab.footholds.walks import JoinedWalk, Rule, Setting
from surefoot.lab.studies import Line
from surefoot.robot.description import Robot
from surefoot.schemas.footholds import LegFoothold, LegRequest, StanceOutcome
from surefoot.services.estimator.feet.faulty import leg_faults
from surefoot.services.estimator.feet.mount import feet_in_imu, foot_mount
from surefoot.services.estimator.feet.slip import FinishedStance, StanceSlip, feet_in_odom
from surefoot.services.footholds.ground import FootholdGround
from surefoot.services.footholds.learning.fit import Candidate, LearnOptions, learn
from surefoot.services.footholds.learning.samples import SampleSet, StanceSample, gather
from surefoot.services.footholds.models.lattice import inputs
from surefoot.services.footholds.models.learned import LearnedModel
from surefoot.services.footholds.outcomes import sample_at
from surefoot.services.footholds.select import Foothold, Landing, SelectParams, TrunkPose
from surefoot.services.walker.outcomes import Outcomes

WITHHELD = 0.3
"""K2 / (8 cell), no unit, above which ground is withheld from the first model: edges and slopes of more than about 20
deg."""
LIFTED_TICKS = 5
"""Number of ticks after the last sample with contact in which a foot may still slide."""


@dataclass(frozen=True, slots=True)
class MeasuredStance:
    """Slip of one stance of a foot: as the robot measured it, and by truth."""

    leg: int
    """Index of the leg in the robot description."""
    own: float
    """Slip of the stance as the robot measured it, m."""
    inside: float
    """True sliding between the first and the last sample with contact of the stance, m."""
    whole: float
    """True sliding since the end of the foot's previous stance, m, including that while its switch is open."""
    begin: tuple[float, float, float]
    """Foot centre at the beginning of the stance, frame `odom`, (3,) m."""
    healthy: bool
    """False if the robot has found a sensor of the leg at fault, True if it has not."""


Spoil = Callable[[Array, NDArray[np.bool_], int], None]
"""Function that changes joint angles (nj,), rad, and foot switches (L,) of a sample in place; its third argument is the
tick."""


class SlipFollower:
    """Meter of slip in a walk, as in the estimator service, with the truth beside it.

    Args:
        joined: the walk.
        spoil: fault of what the meter reads; None = there is none.
    """

    def __init__(self, joined: JoinedWalk, spoil: Spoil | None = None) -> None:
        self.joined, self.spoil = joined, spoil
        self.mount = foot_mount(joined.robot)
        n = joined.robot.nlegs
        self.faults = leg_faults(joined.robot)
        self.meter = StanceSlip(n, self.mount.radius)
        self.found: list[MeasuredStance] = []
        self._total, self._before = np.zeros(n), np.zeros(n)
        self._rows: list[Array] = []
        """True sliding of each foot since the start at each joint sample, (L,) m each."""
        self._trail: list[Array] = []
        """True sliding of each foot since the start at each tick, (L,) m each."""
        self._ticks: list[int] = []
        self._counted = np.zeros(n)

    def look(self) -> list[MeasuredStance]:
        """Process the samples of the last tick; return the stances that have ended in it."""
        world, estimator = self.joined.world, self.joined.estimator
        sliding = world.tracker.feet.sliding.copy()
        self._total += np.where(sliding >= self._before, sliding - self._before, sliding)
        self._before = sliding
        self._trail.append(self._total.copy())
        joints, contacts = world.samples.joints, world.samples.contacts
        if joints is None or contacts is None or not estimator.initialised:
            return []
        touch = np.array([any(foot) for foot in contacts.touch])
        angles = np.array(joints.position)
        if self.spoil is not None:
            self.spoil(angles, touch, world.tick)
        behind_s = 1e-9 * (estimator.stamp_ns - joints.stamp_ns)
        feet = feet_in_odom(self.mount, feet_in_imu(self.mount, angles), estimator.pose(), behind_s)
        faulty = self.faults.update(angles, joints.stamp_ns, touch, self.meter.risen(feet[0]))
        self._rows.append(self._total.copy())
        self._ticks.append(len(self._trail) - 1)
        ended = [self._beside(each) for each in self.meter.update(touch, *feet, faulty)]
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
            whole - float(self._counted[leg]), stance.begin, stance.healthy,
        )  # fmt: skip
        self._counted[leg] = whole
        return out


FAULTS = ("none", "frozen", "jumping", "closed", "open")
"""Faults of a leg's sensors: `frozen`: an encoder that stands still; `jumping`: one that jumps in a fifth of the
samples; `closed`, `open`: a stuck foot switch."""


def faulty_walk(seed: int, fault: str, setting: Setting, rule: Rule | None) -> Line:
    """Walk with a sensor of one leg at fault from a moment on; count its stances that would be learned from.

    The estimator, which has its own checks, and the walker have sound sensors: only the meter of slip is tested.
    """
    rng = np.random.default_rng(seed)
    joined = JoinedWalk(seed, setting, rule)
    leg, since = int(rng.integers(joined.robot.nlegs)), int(rng.integers(500, 900))
    joint, held = int(rng.choice(joined.robot.legs[leg].joints)), np.zeros(1)

    def spoil(angles: Array, touch: NDArray[np.bool_], tick: int) -> None:
        if tick < since:
            held[0] = angles[joint]
        elif fault == "frozen":
            angles[joint] = held[0]
        elif fault == "jumping" and rng.random() < 0.2:
            angles[joint] += float(rng.choice((-1.0, 1.0))) * rng.uniform(0.4, 1.0)
        elif fault in ("closed", "open"):
            touch[leg] = fault == "closed"

    follower, soon, later, others, sound = SlipFollower(joined, spoil), 0, 0, 0, 0
    while joined.tick():
        for each in follower.look():
            after = joined.world.tick - since
            if each.leg != leg:
                others, sound = others + (after > 0), sound + (after > 0 and each.healthy)
            elif after > 0 and each.healthy:
                soon, later = soon + (after <= 50), later + (after > 50)
    return {"soon": soon, "later": later, "others": others, "sound": sound}


def rms(values: Sequence[float] | Array) -> float:
    """Return the root of the mean square of values (n,), in their unit."""
    return float(np.sqrt(np.mean(np.square(values))))


def rough(sample: StanceSample) -> bool:
    """Return True if a stance was on ground as rough as that which is withheld from the first model."""
    return sample.k2 / (8.0 * sample.cell) >= WITHHELD


@dataclass(frozen=True, eq=False)
class HeldOutModels:
    """Slip model made without rough ground, one made of all samples, and the stances on which errors are measured."""

    first: LearnedModel
    """Model of the training samples without those on withheld ground."""
    full: LearnedModel
    """Model of all training samples."""
    held: SampleSet
    """Stances of walks that were used for neither model."""


def start(samples: Sequence[StanceSample], candidate: Candidate, share: float = 0.25, seed: int = 0) -> HeldOutModels:
    """Return a model made without the rough stances of a sample set, and one made of all.

    `share` of the trials is held back for the errors, drawn by `seed`; `candidate`: settings of the fits.
    """
    names = sorted({each.trial for each in samples})
    np.random.default_rng(seed).shuffle(names)
    held = set(names[: round(share * len(names))])
    training = [each for each in samples if each.trial not in held]
    options = LearnOptions(title="walked", candidates=(candidate,), distance_weight=0.5)
    return HeldOutModels(
        learn(gather(each for each in training if not rough(each)), options), learn(gather(training), options),
        gather(each for each in samples if each.trial in held),
    )  # fmt: skip


def squared_errors(model: LearnedModel, held: SampleSet) -> tuple[float, float]:
    """Return mean square errors of predicted slip on the ground withheld from the first model, and on all other ground.

    Args:
        model: predicts the slip of a stance from its inputs.
        held: stances of walks from which no model has learned, on both grounds; slips over 1 count as 1.
    """
    u = inputs(held.x)
    low, high = np.array(model.ranges).T
    away = np.clip(model.terms.values(np.clip(u, low, high)), 0.0, 1.0) - np.minimum(held.r, 1.0)
    new = held.x[:, 1] >= WITHHELD
    return float(np.mean(away[new] ** 2)), float(np.mean(away[~new] ** 2))


def closed(model: LearnedModel, begin: HeldOutModels) -> tuple[float, float]:
    """Return how much of the error on withheld ground re-learning has removed, and the error on other ground.

    The first is (first - new) / (first - full) of the mean square errors, the second the rms error over that of the
    first model; `begin` holds the first model and the full one.
    """
    (new, old), (first, first_old) = squared_errors(model, begin.held), squared_errors(begin.first, begin.held)
    full, _ = squared_errors(begin.full, begin.held)
    return (first - new) / (first - full), float(np.sqrt(old / first_old))


def explored(
    seed: int, setting: Setting, model: LearnedModel, share: float
) -> tuple[list[StanceSample], list[StanceSample]]:
    """Walk with a model and random footholds in a share of its choices; return the stances as samples.

    They come twice: with the slip that the robot measured, and with the true one.
    """
    own, true = Outcomes(), Outcomes()
    rule = exploring_rule(seed, share, model_rule(model, SelectParams()))
    joined = JoinedWalk(seed, setting, _reported(rule, (own, true)))
    follower, names = SlipFollower(joined), joined.robot.leg_names
    measured: list[StanceOutcome] = []
    exact: list[StanceOutcome] = []
    while joined.tick():
        for each in follower.look():
            own.ended(names[each.leg], each.own)
            true.ended(names[each.leg], each.whole)
            measured += own.take()
            exact += true.take()
    ground, trial = joined.selector.ground, f"{setting.terrain} {seed}"
    return (
        [_sample(each, ground, joined.robot, trial, k) for k, each in enumerate(measured)],
        [_sample(each, ground, joined.robot, trial, k) for k, each in enumerate(exact)],
    )


def _reported(rule: Rule, listeners: Sequence[Outcomes]) -> Rule:
    """Return the rule with its choices reported to `listeners`, as the walker service does."""

    def chosen(
        ground: FootholdGround, robot: Robot, base: TrunkPose, landings: Sequence[Landing], step: int
    ) -> Sequence[Foothold]:
        found = rule(ground, robot, base, landings, step)
        for landing, each in zip(landings, found, strict=True):
            leg = robot.leg_names[landing.leg]
            asked = LegRequest(leg=leg, nominal=landing.nominal, stroke=landing.stroke)
            for listener in listeners:
                listener.chose(asked, LegFoothold(leg=leg, status=each.status, foothold=each.foothold))
        return found

    return chosen


def _sample(outcome: StanceOutcome, ground: FootholdGround, robot: Robot, trial: str, number: int) -> StanceSample:
    name = (trial, robot.leg_names.index(outcome.leg), number)
    sample = sample_at(ground, outcome.foothold, outcome.nominal, outcome.stroke, outcome.slip, name)
    return replace(sample, robot=robot.name, robot_hash=robot.hash, source="exploring walks")
