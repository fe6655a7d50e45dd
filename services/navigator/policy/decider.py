"""Policies as arrays for kernels, and a decider that gives its reasons."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from surefoot.arrays import Array, Record, record
from surefoot.schemas.navigation import Decision

from ..belief.ukf import entropy, wrap
from . import arrays as slots
from .arrays import STATUS, Arrays
from .choose import (
    HAND,
    NUMBERS,
    PLANNER,
    SARSA,
    SIGHT_SHARE,
    SPREAD_DRIFT,
    SPREAD_HEADING,
    SPREAD_XY,
    STAND_ABOVE,
    STAND_SLOPE,
    STEER,
    STEER_GAIN,
    TURN_BEYOND,
    PolicyTables,
    choose,
    features,
    room_to_choose,
)
from .grids import GRID

KIND_NAMES = {HAND: "hand", STEER: "steer", PLANNER: "planner", SARSA: "sarsa"}

PAPER_TURN_DEG = 35.0  # deg, threshold of the paper's controller
PAPER_STAND_ABOVE = -2.0  # nats; least time at full success with PAPER_TURN_DEG on stream 1, normal and blurred
PAPER_STAND_ABOVE_3 = -3.0  # as above with a filter of three states, as in the paper
TUNED_TURN_DEG = 18.5  # deg; least time on stream 1, 4000 episodes, of 11 .. 28 deg
TUNED_STAND_ABOVE = -2.5  # nats at the goal
TUNED_STAND_SLOPE = 0.2  # nats per m; least time blurred; normal vision has no preference
STEER_TURN_DEG = 60.0  # deg; least time blurred of 35, 60, 90
STEER_STAND_ABOVE = -2.0  # nats; least time blurred of -3 .. -2
STEER_SHARE = 1.0  # of the bearing that is steered out in one arc; of .5 .. 1.2


@dataclass(frozen=True)
class Policy:
    """A policy (the rule that chooses the next action) as arrays, with the names of its actions and its origin."""

    name: str
    """Name of the policy, by which goals request it."""
    actions: tuple[str, ...]
    """Names of the actions, in the order of the action axis of the table."""
    tables: PolicyTables
    """Kind, parameters and action values of the policy as arrays for compiled kernels."""
    provenance: Mapping[str, str] = field(default_factory=dict[str, str])
    """Origin of the policy: model, hash, seed, version."""
    sha256: str = ""
    """SHA-256 digest of the policy's file; empty = not from a file."""


class Decider:
    """Chooser of the next action by one policy; it keeps the counts of stands and turns that a decision needs.

    Args:
        world: the model's arrays; the action names must be the policy's.
        policy: policy that decides.
    """

    def __init__(self, world: Arrays, policy: Policy) -> None:
        self.world, self.policy = world, policy
        self._room = room_to_choose(8, len(world.names))
        self.begin()

    def begin(self) -> None:
        """Discard the counts of past actions, for a new goal."""
        self.status = record(STATUS)
        self.status.last = slots.NO_ACTION

    def decide(self, mean: Array, cov: Array, goal: tuple[float, float], *, blocked: bool) -> Decision:
        """Return the next action, with values and a reason, for the belief predicted to when the action begins.

        Args:
            mean: x, y (m), heading (rad), and from n = 4 on the drift (rad per m), frame map, (n,).
            cov: covariance of `mean`, (n, n).
            goal: x, y in m, frame map.
            blocked: a wall is close ahead, only turns are allowed.
        """
        self.status.blocked, names, room = float(blocked), self.world.names, self._room
        x, y = float(goal[0]), float(goal[1])
        index = int(choose(self.policy.tables, self.world.tables, mean, cov, x, y, self.status, room))
        dx, dy = x - float(mean[0]), y - float(mean[1])
        able = [a for a in range(len(names)) if room.mask[a] and math.isfinite(room.values[a])]
        decision = Decision(
            number=0, action=names[index], reason=self._reason(index, mean, cov, goal, blocked),
            values={names[a]: float(room.values[a]) for a in able}, distance=math.hypot(dx, dy),
            bearing=float(wrap(math.atan2(dy, dx) - float(mean[2]))), entropy=max(float(entropy(cov)), -1e3),
        )  # fmt: skip
        self.did(index)
        return decision

    def did(self, index: int) -> None:
        """Record that the action of this index was executed; `decide` does so for the action it returns."""
        kind, status = self.world.tables.actions[index].kind, self.status
        status.last = index
        status.stands = status.stands + 1.0 if kind == slots.STAND else 0.0
        status.turns = status.turns + 1.0 if kind == slots.TURNING else 0.0

    def _reason(self, index: int, mean: Array, cov: Array, goal: tuple[float, float], blocked: bool) -> str:
        name, policy, values = self.world.names[index], self.policy.tables, self._room.values
        if blocked:
            return f"a wall is close ahead, only turns are allowed: {name}"
        d, phi, h = features(mean, cov, goal[0], goal[1])
        if policy.kind in (HAND, STEER):
            return _rule(policy, name, self.world.tables.actions[index], d, math.degrees(phi), h)
        others = [i for i in range(len(values)) if i != index and self._room.mask[i]]
        if not others:
            return f"{name} is the only action allowed"
        second = max(others, key=lambda i: values[i])
        ahead = values[index] - values[second]
        if policy.kind == SARSA:
            return f"{name}: return {values[index]:.1f}, {ahead:.1f} more than {self.world.names[second]}"
        if self.world.tables.actions[index].kind == slots.STAND:
            cost = self.world.tables.actions[index].seconds
            return f"{name}: a look of {cost:.1f} s may change the way and saves {ahead:.2f} s on average (h {h:.1f})"
        return f"{name}: {-values[index]:.1f} s to the goal, {ahead:.2f} s less than {self.world.names[second]}"


def _rule(policy: PolicyTables, name: str, action: Record, d: float, phi_deg: float, h: float) -> str:
    limit = policy.numbers[STAND_ABOVE] + policy.numbers[STAND_SLOPE] * d
    side, beyond = "left" if phi_deg > 0 else "right", math.degrees(policy.numbers[TURN_BEYOND])
    if action.kind == slots.STAND:
        return f"{name}: entropy {h:.1f} is above {limit:.1f} nats"
    where = f"goal {abs(phi_deg):.0f} deg to the {side}"
    return f"{name}: {where}, {'beyond' if abs(phi_deg) > beyond else 'within'} {beyond:.0f} deg"


def hand(
    world: Arrays,
    name: str = "hand",
    *,
    turn_deg: float = PAPER_TURN_DEG,
    stand_above: float = PAPER_STAND_ABOVE,
    slope: float = 0.0,
    steer: float = 0.0,
) -> Policy:
    """Return a hand-made controller: it stands while uncertain, turns to a goal far aside, else walks.

    Args:
        world: the model's arrays.
        name: name of the policy.
        turn_deg: deg, it turns to a goal farther aside than this.
        stand_above: nats, it stands while the entropy of the belief is above this.
        slope: nats per m of distance to the goal, added to `stand_above`.
        steer: share of the bearing that an arc corrects; 0 = it walks straight, as in Osswald et al.
    """
    numbers = np.zeros(NUMBERS)
    numbers[STAND_ABOVE], numbers[STAND_SLOPE] = stand_above, slope
    numbers[TURN_BEYOND], numbers[STEER_GAIN] = math.radians(turn_deg), steer
    kind, table = (STEER if steer > 0.0 else HAND), np.zeros((1, 1, 1, len(world.names)))
    return Policy(name, world.names, PolicyTables(kind, numbers, table, np.zeros(GRID), np.eye(3)))


def by_rule(name: str, world: Arrays) -> Policy | None:
    """Return the policy `hand`, `tuned` or `steer`, which need no table, for a model `world`; None for other names."""
    if name == "hand":
        return hand(world, stand_above=PAPER_STAND_ABOVE_3 if world.states == 3 else PAPER_STAND_ABOVE)
    if name == "tuned":
        return hand(world, name, turn_deg=TUNED_TURN_DEG, stand_above=TUNED_STAND_ABOVE, slope=TUNED_STAND_SLOPE)
    if name == "steer":
        return hand(world, name, turn_deg=STEER_TURN_DEG, stand_above=STEER_STAND_ABOVE, steer=STEER_SHARE)
    return None


def planner_numbers(world: Arrays) -> Array:
    """Return the parameters by which the planner allows for uncertainty, (8,), no unit, tuned in simulation.

    They are the shares of the belief's standard deviations (position, heading, drift) over which values are averaged,
    and the weight of what a stand (pause for the camera) gains; the rest is 0. Averaging over the full belief makes the
    robot turn too late, because each value supposes that the pose is known after one action. A stand serves several
    decisions, more of them on arcs, and most of them if stands are rare as changes of action cost time. The numbers
    were chosen on random stream 1 with the robot of Osswald et al., drift 0 to 8 deg, normal and blurred.
    """
    numbers = np.zeros(NUMBERS)
    numbers[[SPREAD_XY, SPREAD_HEADING, SPREAD_DRIFT, SIGHT_SHARE]] = 0.5, 0.4, 0.8, 2.0
    if any(row.kind == slots.WALK and row.turn != 0.0 for row in world.tables.actions):
        numbers[[SPREAD_XY, SPREAD_HEADING, SPREAD_DRIFT, SIGHT_SHARE]] = 0.6, 0.6, 0.6, 3.0
        if world.tables.switching.any():
            numbers[SIGHT_SHARE] = 5.0
    return numbers
