"""Search over beliefs with simulated observations: what a planner gains that knows what it will see and decide later.

Both peers know the floor's landmarks and the model exactly. `rollouts` compares actions by whole simulated episodes
that a base policy ends (one step of policy iteration; Bertsekas and Castanon 1999). `tree` is PFT-DPW (Sunberg and
Kochenderfer, ICAPS 2018) with the navigator's own filter in place of the particles: a search tree over beliefs, of
which each action keeps at most k n^alpha successors, leaves valued by the planner's table. Beliefs have four states.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import free_kernel
from surefoot.services.navigator.belief.ukf import spread
from surefoot.services.navigator.environment.draws import below, normal_pair, seed, stream
from surefoot.services.navigator.environment.model import EpisodeState, episode_room
from surefoot.services.navigator.environment.world import act, copy_belief
from surefoot.services.navigator.policy.arrays import (
    GOAL_RADIUS,
    GOAL_X,
    GOAL_Y,
    OUTCOME,
    RUNNING,
    STATUS,
    TIME,
    Arrays,
)
from surefoot.services.navigator.policy.choose import allow, choose, room_to_choose

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

DRAW = 9
"""Purpose of the random streams of drawn truths; those of the environment are smaller."""
ACTIONS_MOST = 150
"""Actions of a simulated episode."""
WIDEN, POWER = 4.0, 0.35
"""An action that was tried n times has at most WIDEN n^POWER successors."""
CHILDREN = 64


def scratch_of(world: Arrays) -> tuple[Any, ...]:
    """Return the arrays that the kernels here overwrite."""
    n = 4
    return (
        stream(),
        np.zeros(n),
        np.zeros((n, n)),
        episode_room(n),
        room_to_choose(n, len(world.names)),
        np.zeros((n, n)),
    )


@free_kernel
def _draw(scene: Array, mean: Array, cov: Array, rng: Any, low: Array, truth: Array) -> None:
    """Draw a truth from a belief whose robot has not reached the goal, in place."""
    spread(cov, low)
    for _ in range(50):
        a, b = normal_pair(rng)
        c, d = normal_pair(rng)
        for i in range(4):
            truth[i] = mean[i] + 0.5 * (low[i, 0] * a + low[i, 1] * b + low[i, 2] * c + low[i, 3] * d)
        if math.hypot(scene[GOAL_X] - truth[0], scene[GOAL_Y] - truth[1]) >= scene[GOAL_RADIUS]:
            break
    truth[4] = truth[5] = 0.0


@free_kernel
def _decide(policy: Any, world: Any, mean: Array, cov: Array, status: Array, scratch: Any) -> int:
    return choose(policy, world, mean, cov, world.scene[GOAL_X], world.scene[GOAL_Y], status, scratch[4])


@free_kernel
def _act(
    world: Any, floor: Any, run: int, sample: int, chosen: int, truth: Array, mean: Array, cov: Array, status: Array,
    scratch: Any,
) -> None:  # fmt: skip
    state = EpisodeState(scratch[0], floor[0], floor[1], truth, mean, cov, scratch[1], scratch[2], status)
    act(world, run, sample, chosen, state, scratch[3])


@free_kernel
def rollouts(
    policy: Any, world: Any, floor: Any, run: int, mean: Array, cov: Array, status: Array, tried: Flags, scratch: Any,
    costs: Array,
) -> None:  # fmt: skip
    """Write the seconds to the goal of each action and sample, (A, samples): the action first, then the base policy.

    Args:
        policy: the base policy, see `PolicyTables`.
        world: see `ModelTables`.
        floor: landmarks and where those of a square begin.
        run: seed of the simulated episodes, of no other use.
        mean: belief, (4,).
        cov: its covariance, (4, 4).
        status: of the real episode.
        tried: actions that are compared, (A,).
        scratch: see `scratch_of`.
        costs: result; actions that are not tried stay as they are.
    """
    truth, drawn, m, c, own = np.zeros(6), np.zeros(6), np.zeros(4), np.zeros((4, 4)), np.zeros(STATUS)
    for k in range(costs.shape[1]):
        seed(scratch[0], run, k, DRAW)
        _draw(world.scene, mean, cov, scratch[0], scratch[5], drawn)
        for a in range(costs.shape[0]):
            if not tried[a]:
                continue
            copy_belief(mean, cov, m, c)
            truth[:], own[:] = drawn, status
            _act(world, floor, run, k, a, truth, m, c, own, scratch)
            for _ in range(ACTIONS_MOST):
                if own[OUTCOME] != RUNNING:
                    break
                chosen = _decide(policy, world, m, c, own, scratch)
                _act(world, floor, run, k, chosen, truth, m, c, own, scratch)
            costs[a, k] = own[TIME] - status[TIME]


@free_kernel
def tree(
    policy: Any, world: Any, floor: Any, run: int, mean: Array, cov: Array, status: Array, scratch: Any, sims: int,
    depth: int, explore: float, values: Array,
) -> None:  # fmt: skip
    """Write how often a search tree over beliefs tried each action, (A,): the most tried one is its choice.

    Args:
        policy: the planner; its values at a leaf are what is left.
        world: see `ModelTables`.
        floor: landmarks and where those of a square begin.
        run: seed of the search.
        mean: belief, (4,).
        cov: its covariance, (4, 4).
        status: of the real episode.
        scratch: see `scratch_of`.
        sims: simulations.
        depth: actions of the longest path.
        explore: s, weight of what was tried seldom.
        values: result.
    """
    count, size = values.size, sims + 1
    means, covs, states = np.zeros((size, 4)), np.zeros((size, 4, 4)), np.zeros((size, STATUS))
    tries, sums, born = np.zeros((size, count)), np.zeros((size, count)), np.zeros((size, count), dtype=np.int64)
    child = np.zeros((size, count, CHILDREN), dtype=np.int64)
    open_ = np.zeros((size, count), dtype=np.bool_)
    truth, nodes, taken = np.zeros(6), np.zeros(depth + 1, dtype=np.int64), np.zeros(depth + 1, dtype=np.int64)
    means[0], covs[0], states[0] = mean, cov, status
    allow(world, states[0], open_[0])
    used = 1
    for s in range(sims):
        node, level, cost = 0, 0, 0.0
        while True:
            if states[node, OUTCOME] != RUNNING:
                break
            if level == depth:
                cost = -_worth(policy, world, means[node], covs[node], states[node], scratch)
                break
            total, best, chosen = 1.0 + tries[node].sum(), math.inf, -1
            for a in range(count):
                if open_[node, a]:
                    score = -math.inf
                    if tries[node, a] > 0.0:
                        score = sums[node, a] / tries[node, a]
                        score -= explore * math.sqrt(math.log(total) / tries[node, a])
                    if chosen < 0 or score < best:
                        best, chosen = score, a
            nodes[level], taken[level] = node, chosen
            level += 1
            have = born[node, chosen]
            seed(scratch[0], run, s * (depth + 1) + level, DRAW)
            if have < CHILDREN and have < WIDEN * (tries[node, chosen] + 1.0) ** POWER:
                _draw(world.scene, means[node], covs[node], scratch[0], scratch[5], truth)
                copy_belief(means[node], covs[node], means[used], covs[used])
                states[used] = states[node]
                _act(world, floor, run, used, chosen, truth, means[used], covs[used], states[used], scratch)
                allow(world, states[used], open_[used])
                child[node, chosen, have] = used
                born[node, chosen] = have + 1
                node = used
                used += 1
                if states[node, OUTCOME] == RUNNING:
                    cost = -_worth(policy, world, means[node], covs[node], states[node], scratch)
                break
            node = child[node, chosen, below(scratch[0], have)]
        end = states[node, TIME] + cost
        for i in range(level):
            tries[nodes[i], taken[i]] += 1.0
            sums[nodes[i], taken[i]] += end - states[nodes[i], TIME]
    values[:] = tries[0]


@free_kernel
def _worth(policy: Any, world: Any, mean: Array, cov: Array, status: Array, scratch: Any) -> float:
    """Return the planner's value of a belief, s (negative)."""
    chosen = _decide(policy, world, mean, cov, status, scratch)
    return min(0.0, scratch[4].values[chosen])
