"""One episode in the paper's world, step by step: true pose, belief, features of the state, actions.

The kernels are those of training and evaluation, so an episode here is the one that they count, bit for bit.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surefoot.lab.train.evaluation import EVALUATION
from surefoot.services.navigator.environment.draws import stream
from surefoot.services.navigator.environment.world import act, begin, cells, room_for, work_space_of
from surefoot.services.navigator.policy.arrays import (
    BLOCKED,
    GOAL_X,
    GOAL_Y,
    KIND,
    OUTCOME,
    REACHED,
    RUNNING,
    STAND,
    STATUS,
    TIME,
    TURN,
    TURNING,
    Arrays,
)
from surefoot.services.navigator.policy.choose import features, work_space_to_choose
from surefoot.services.navigator.policy.policies import Policy, choose_with

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

Decide = Callable[[Array, Array, Array, float], int]
"""Return an action for mean (n,), covariance (n, n), status (STATUS,) and the reward since the last decision."""


@dataclass(frozen=True)
class Episode:
    """An episode of k actions; row 0 of what has k + 1 rows is the start.

    Attributes:
        time: s, (k + 1,).
        truth: x, y (m) and heading (rad) in the map, (k + 1, 3).
        mean: the same as estimated, (k + 1, 3).
        cov: covariance of the estimate, (k + 1, 3, 3).
        features: d (m), phi (rad) and h (nats) of equations (4) to (6), (k + 1, 3).
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
        """Length of the true path, m."""
        return float(np.hypot(*np.diff(self.truth[:, :2], axis=0).T).sum())


def follow(world: Arrays, decide: Decide, run: int, episode: int) -> Episode:
    """Return episode `episode` of seed `run` with the actions that `decide` returns.

    It is called once more at the end, with the last reward, and what it then returns is not done.
    """
    n, scene = world.states, world.scene
    room = np.zeros(4), np.zeros((2, max(0, n - 4))), work_space_of(n)
    floor, truth, belief, status = _begun(world, run, episode)
    mean, cov = belief[2:]
    rows: list[tuple[Array, Array, Array, tuple[float, float, float], float, bool]] = []
    actions: list[int] = []
    reward = 0.0
    while True:
        seen = features(mean, cov, scene[GOAL_X], scene[GOAL_Y])
        rows.append(
            (truth[:3].copy(), mean[:3].copy(), cov[:3, :3].copy(), seen, float(status[TIME]), status[BLOCKED] > 0.0)
        )
        chosen = decide(mean, cov, status, reward)
        if status[OUTCOME] != RUNNING:
            break
        actions.append(chosen)
        reward = act(scene, world.actions, world.switching, run, episode, chosen, *floor, truth, *belief, status, *room)
    done = np.array(actions, dtype=np.int64)
    kinds, turn = world.actions[done, KIND], world.actions[done, TURN]
    true, estimate, spread, seen_all, time, blocked = zip(*rows, strict=True)
    return Episode(
        np.array(time),
        np.array(true),
        np.array(estimate),
        np.array(spread),
        np.array(seen_all),
        np.array(blocked),
        done,
        kinds == STAND,
        np.where(kinds == TURNING, np.sign(turn), 0.0).astype(np.int64),
        float(truth[3]),
        floor[1][: floor[2][-1]].copy(),
        status[OUTCOME] == REACHED,
    )


def drift_of(world: Arrays, episode: int, run: int = EVALUATION) -> float:
    """Return the drift of an episode, rad per m, left positive."""
    return float(_begun(world, run, episode)[1][3])


def _begun(
    world: Arrays, run: int, episode: int
) -> tuple[tuple[NDArray[np.uint64], Array, NDArray[np.int64]], Array, tuple[Array, Array, Array, Array], Array]:
    """Return (random stream, landmarks, their index by square), truth, belief and status at the start."""
    n, (nx, ny), scene = world.states, cells(world.scene), world.scene
    floor = stream(), np.zeros((room_for(scene), 2)), np.zeros(nx * ny + 1, dtype=np.int64)
    truth, status = np.zeros(6), np.zeros(STATUS)
    belief = np.zeros(n), np.zeros((n, n)), np.zeros(n), np.zeros((n, n))
    begin(scene, run, episode, *floor, truth, *belief, status)
    return floor, truth, belief, status


def deciding(world: Arrays, policy: Policy) -> Decide:
    """Return what `follow` needs to follow a policy."""
    count = len(world.names)
    values, mask = np.zeros(count), np.zeros(count, dtype=np.bool_)
    work = work_space_to_choose(max(world.states, 4), count)
    goal = float(world.scene[GOAL_X]), float(world.scene[GOAL_Y])

    def decide(mean: Array, cov: Array, status: Array, reward: float) -> int:
        return choose_with(policy, world, mean, cov, goal, status, values, mask, work)

    return decide


def follow_all(world: Arrays, policy: Policy, run: int, first: int, count: int) -> tuple[Episode, ...]:
    """Return episodes first .. first + count - 1 of seed `run` with the actions of a policy."""
    return tuple(follow(world, deciding(world, policy), run, e) for e in range(first, first + count))
