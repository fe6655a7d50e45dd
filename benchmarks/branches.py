"""Comparison of footholds from one state: the same step with several candidates.

At every n-th request of a walk the process forks once for each candidate. A child holds the whole state of world,
estimator and walker, takes its candidate, walks on by the rule of the walk until the stances of the legs in question
are over, and reports them; the parent then goes on with its own choice. Children run one at a time.
"""

import os
import pickle
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NoReturn

import numpy as np

from surefoot.arrays import Array
from surefoot.lab.footholds.walks import ChosenStance, JoinedWalk, Rule, Setting
from surefoot.robot.description import Robot
from surefoot.services.footholds.ground import FootholdGround
from surefoot.services.footholds.select import Foothold, Landing, TrunkPose

PATIENCE_TICKS = 400
"""Number of ticks after which a child process stops walking and reports the stances that have ended."""


@dataclass(frozen=True)
class Arm:
    """Outcome of one candidate rule of footholds that took the same step as the others."""

    name: str
    stances: tuple[ChosenStance, ...]
    """Ended stances of the legs under comparison; fewer than legs when the walker refused the step or the robot
    fell."""
    fallen: bool = False


@dataclass(frozen=True)
class PairedState:
    """Outcomes of all candidate rules of footholds from one state of a walk."""

    step: int
    """Number of the foothold request in the walk."""
    legs: tuple[int, ...]
    """Indices of the legs whose footholds differ between the candidates."""
    arms: tuple[Arm, ...]

    def sliding(self, arm: Arm) -> float:
        """Return the mean sliding of an arm's stances, mm; NaN where one is missing."""
        if len(arm.stances) < len(self.legs):
            return float("nan")
        return 1e3 * float(np.mean([stance.sliding for stance in arm.stances]))


@dataclass(eq=False)
class Branching:
    """Rule of a walk that forks at some of its requests.

    Args:
        rule: rule that chooses the footholds of the walk itself.
        candidates: rules that are compared with each other, by name.
        every: a state at every n-th request; odd, or a tripod gait leaves one group of legs out.
        alone: candidates differ in one leg, drawn at random; otherwise in all legs that land.
        seed: seed of the draw of the leg.
    """

    rule: Rule
    candidates: Mapping[str, Rule]
    every: int = 3
    alone: bool = True
    seed: int = 0
    states: list[PairedState] = field(default_factory=list)
    legs: tuple[int, ...] = ()
    """Indices of the legs under comparison, in a child process; empty in the parent."""
    _write: int = -1
    """File descriptor of the pipe to the parent, in a child process; -1 in the parent."""
    _step: int = 0
    _landing: tuple[int, ...] = ()

    def __call__(
        self, ground: FootholdGround, robot: Robot, base: TrunkPose, landings: Sequence[Landing], step: int
    ) -> Sequence[Foothold]:
        own = self.rule(ground, robot, base, landings, step)
        landing = tuple(each.leg for each in landings)
        if self.child:
            if step == self._step + 1 and landing == self._landing:
                self.end([], fallen=False)  # the walker refused the step and requests another one
            return own
        if step % self.every or any(each.status != "ok" for each in own):
            return own
        picked = int(np.random.default_rng((self.seed, step)).integers(len(landings)))
        places = (picked,) if self.alone else tuple(range(len(landings)))
        answers: dict[str, Sequence[Foothold]] = {}
        for name, rule in self.candidates.items():
            found = rule(ground, robot, base, landings, step)
            if all(found[k].status == "ok" for k in places):
                answers[name] = [found[k] if k in places else own[k] for k in range(len(own))]
        legs, arms = tuple(landing[k] for k in places), dict[tuple[object, ...], Arm]()
        named: list[Arm] = []
        for name, answer in answers.items():
            key = tuple(each.foothold for each in answer)
            if key not in arms:
                found_arm = self._fork(step, legs, landing)
                if found_arm is None:
                    return answer
                arms[key] = found_arm
            named.append(replace(arms[key], name=name))
        self.states.append(PairedState(step, legs, tuple(named)))
        return own

    @property
    def child(self) -> bool:
        """True in a forked process, which walks the step of one candidate; False in the parent."""
        return self._write >= 0

    def end(self, stances: Sequence[ChosenStance], fallen: bool) -> NoReturn:
        """Report the stances of a child process, and whether it fell, to the parent, and end the process."""
        with os.fdopen(self._write, "wb") as stream:
            pickle.dump((tuple(stances), fallen), stream)
        os._exit(0)

    def finished(self, stances: Sequence[ChosenStance]) -> list[ChosenStance]:
        """Return the stances that began with the compared step, of the legs whose footholds differ."""
        return [each for each in stances if each.step == self._step and each.leg in self.legs]

    def _fork(self, step: int, legs: tuple[int, ...], landing: tuple[int, ...]) -> Arm | None:
        """Fork; return the outcome that the child process reports, and in the child itself None.

        Raises:
            RuntimeError: the child ended without a report.
        """
        read, write = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(read)
            self._write, self._step, self.legs, self._landing = write, step, legs, landing
            return None
        os.close(write)
        with os.fdopen(read, "rb") as stream:
            report = stream.read()
        os.waitpid(child, 0)
        if not report:
            raise RuntimeError(f"a candidate of step {step} ended without a report; its error stands above")
        stances, fallen = pickle.loads(report)
        return Arm("", stances, fallen)


def paired_steps(
    seed: int, setting: Setting, rule: Rule, candidates: Mapping[str, Rule], every: int = 3, alone: bool = True
) -> tuple[JoinedWalk, list[PairedState]]:
    """Walk by a rule and compare the candidates at every n-th request; returns the walk and its states."""
    branching = Branching(rule, candidates, every, alone, seed)
    joined = JoinedWalk(seed, setting, branching)
    try:
        ticks = 0
        while joined.tick():
            if branching.child:
                ticks += 1
                found = branching.finished(joined.stances.found)
                if len(found) == len(branching.legs) or ticks > PATIENCE_TICKS:
                    branching.end(found, fallen=False)
        if branching.child:
            branching.end(branching.finished(joined.stances.found), bool(joined.world.truth().fallen))
    except BaseException:
        if not branching.child:
            raise
        traceback.print_exc()
        os._exit(1)
    return joined, branching.states


def gap_share(random: Sequence[Array], chosen: Array, best: Array, mean: Callable[[Array], float] = np.mean) -> float:
    """Return the share of the possible gain in sliding that a selector reaches, 1 = as the best candidate.

    It is (random - chosen) / (random - best) of the means over states.

    Args:
        random: sliding of the random candidates of each state, (n,) m each.
        chosen: sliding of the selector's candidate, (n,) m.
        best: least sliding of all candidates of the state, (n,) m.
        mean: over states.
    """
    drawn = mean(np.array([each.mean() for each in random]))
    return float((drawn - mean(chosen)) / (drawn - mean(best)))


def trimmed(values: Array, share: float = 0.05) -> float:
    """Return the mean of values (n,), in their unit, without a share of them at each end."""
    cut = int(share * len(values))
    return float(np.sort(values)[cut : len(values) - cut].mean())
