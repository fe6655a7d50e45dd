"""Episode of Osswald et al.'s simulated world, step by step: true and estimated pose, state features, actions.

The kernels are those of training and evaluation, so that an episode here equals theirs bit for bit.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array, Flags, Record
from surefoot.lab.train.evaluation import EVALUATION
from surefoot.services.navigator.belief.ukf import DRIFT
from surefoot.services.navigator.environment.model import EpisodeState, episode_room, episode_state
from surefoot.services.navigator.environment.world import act, begin
from surefoot.services.navigator.policy import arrays as slots
from surefoot.services.navigator.policy.arrays import Arrays
from surefoot.services.navigator.policy.choose import choose, features, room_to_choose
from surefoot.services.navigator.policy.decider import Policy

Decide = Callable[[Array, Array, Record, float], int]
"""Function that returns the index of an action for mean (n,), covariance (n, n), status (a record STATUS) and the
reward, s, since the last decision."""


@dataclass(frozen=True)
class Episode:
    """Course of an episode of k actions; in arrays with k + 1 rows, row 0 is the start.

    Attributes:
        time: s, (k + 1,).
        truth: x, y (m) and heading (rad) in the map, (k + 1, 3).
        mean: estimated x, y (m) and heading (rad), (k + 1, 3).
        cov: covariance of the estimate, (k + 1, 3, 3).
        features: d (m), phi (rad) and h (nats) of equations (4) to (6) of Osswald et al., (k + 1, 3).
        blocked: a wall is close ahead, (k + 1,).
        actions: index of each action, (k,).
        stands: actions that stand, (k,).
        turns: actions that turn on the spot, left 1, right -1, others 0, (k,).
        drift: rad per m walked, left positive.
        marks: landmarks of the floor, (M, 2), m.
        reached: the goal was reached in time.
    """

    time: Array
    truth: Array
    mean: Array
    cov: Array
    features: Array
    blocked: Flags
    actions: NDArray[np.int64]
    stands: Flags
    turns: NDArray[np.int64]
    drift: float
    marks: Array
    reached: bool

    @property
    def seconds(self) -> float:
        """Time of the whole episode, s."""
        return float(self.time[-1])

    @property
    def way(self) -> float:
        """Length of the true path of the robot, m."""
        return float(np.hypot(*np.diff(self.truth[:, :2], axis=0).T).sum())


def follow(world: Arrays, decide: Decide, run: int, episode: int) -> Episode:
    """Run episode `episode` of seed `run` with the actions that `decide` returns, and return its course.

    `decide` is called once more at the end, with the last reward; that action is not done.
    """
    scene, room = world.tables.scene[0], episode_room(world.states)
    state = _begun(world, run, episode)
    truth, mean, cov, status = state.truth, state.ahead_mean, state.ahead_cov, state.status
    rows: list[tuple[Array, Array, Array, tuple[float, float, float], float, bool]] = []
    actions: list[int] = []
    reward = 0.0
    while True:
        seen = features(mean, cov, scene.goal_x, scene.goal_y)
        rows.append(
            (
                truth[:3].copy(),
                mean[:3].copy(),
                cov[:3, :3].copy(),
                seen,
                float(status.time),
                status.blocked > 0.0,
            )
        )
        chosen = decide(mean, cov, status, reward)
        if status.outcome != slots.RUNNING:
            break
        actions.append(chosen)
        reward = act(world.tables, run, episode, chosen, state, room)
    done = np.array(actions, dtype=np.int64)
    kinds, turn = world.tables.actions["kind"][done], world.tables.actions["turn"][done]
    true, estimate, spread, seen_all, time, blocked = zip(*rows, strict=True)
    return Episode(
        np.array(time),
        np.array(true),
        np.array(estimate),
        np.array(spread),
        np.array(seen_all),
        np.array(blocked),
        done,
        kinds == slots.STAND,
        np.where(kinds == slots.TURNING, np.sign(turn), 0.0).astype(np.int64),
        float(truth[DRIFT]),
        state.marks[: state.first[-1]].copy(),
        status.outcome == slots.REACHED,
    )


def drift_of(world: Arrays, episode: int, run: int = EVALUATION) -> float:
    """Return the drift of an episode, rad per m, left positive."""
    return float(_begun(world, run, episode).truth[DRIFT])


def _begun(world: Arrays, run: int, episode: int) -> EpisodeState:
    """Return the arrays of episode `episode` of seed `run` at its start."""
    state = episode_state(world)
    begin(world.tables.scene[0], run, episode, state)
    return state


def deciding(world: Arrays, policy: Policy) -> Decide:
    """Return the function `decide` for `follow` that takes the actions of a policy."""
    room, scene = room_to_choose(world.states, len(world.names)), world.tables.scene[0]

    def decide(mean: Array, cov: Array, status: Record, reward: float) -> int:
        return choose(policy.tables, world.tables, mean, cov, float(scene.goal_x), float(scene.goal_y), status, room)

    return decide


def follow_all(world: Arrays, policy: Policy, run: int, first: int, count: int) -> tuple[Episode, ...]:
    """Run episodes first .. first + count - 1 of seed `run` with a policy; return their courses."""
    return tuple(follow(world, deciding(world, policy), run, e) for e in range(first, first + count))
