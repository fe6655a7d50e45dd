"""Whole episodes of a policy, one after the other in a kernel."""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import free_kernel

from ..belief.ukf import wrap
from ..policy.arrays import (
    GOAL_X,
    GOAL_Y,
    KIND,
    OUTCOME,
    RUNNING,
    STAND,
    STATUS,
    STEPS,
    TIME,
    TURNING,
    Arrays,
)
from ..policy.choose import choose, work_space_to_choose
from ..policy.policies import Policy
from .draws import stream
from .world import act, begin, cells, room_for, work_space_of

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
State = NDArray[np.uint64]
Flags = NDArray[np.bool_]

SECONDS_TAKEN, ENDED_AS, DECISIONS, STANDS_MADE, TURNS_MADE, ERROR, NEES_SUM, NEES_AT = 0, 1, 2, 3, 4, 5, 6, 7
RESULTS = 8
NEES_DECISION = 20
"""Columns of the result of an episode: s, REACHED or CUT_OFF, number of actions, of stands, of turns, final error of
the estimate in m, sum over decisions of the NEES of the pose (3 degrees of freedom), NEES after NEES_DECISION."""


@free_kernel
def nees(truth: Array, mean: Array, cov: Array) -> float:
    """Return e^T P^-1 e of the pose, e = truth - mean with the heading wrapped, P the 3x3 marginal."""
    e0, e1, e2 = truth[0] - mean[0], truth[1] - mean[1], wrap(truth[2] - mean[2])
    l00 = math.sqrt(cov[0, 0])
    l10, l20 = cov[1, 0] / l00, cov[2, 0] / l00
    l11 = math.sqrt(cov[1, 1] - l10 * l10)
    l21 = (cov[2, 1] - l20 * l10) / l11
    l22 = math.sqrt(cov[2, 2] - l20 * l20 - l21 * l21)
    y0 = e0 / l00
    y1 = (e1 - l10 * y0) / l11
    y2 = (e2 - l20 * y0 - l21 * y1) / l22
    return y0 * y0 + y1 * y1 + y2 * y2


@free_kernel
def _run(
    kind: int,
    numbers: Array,
    table: Array,
    grid: Array,
    shown: Array,
    knows: bool,
    actions: Array,
    scene: Array,
    switching: Array,
    run: int,
    start: int,
    results: Array,
    rng: State,
    marks: Array,
    first: Ints,
    truth: Array,
    mean: Array,
    cov: Array,
    ahead_mean: Array,
    ahead_cov: Array,
    status: Array,
    noise: Array,
    gain: Array,
    work: Array,
    values: Array,
    mask: Flags,
    work_choose: Array,
    sure: Array,
) -> None:
    for e in range(results.shape[0]):
        begin(scene, run, start + e, rng, marks, first, truth, mean, cov, ahead_mean, ahead_cov, status)
        stands, turns, total = 0, 0, 0.0
        while status[OUTCOME] == RUNNING:
            if knows:
                for i in range(4):
                    ahead_mean[i] = truth[i]
            chosen = choose(
                kind,
                numbers,
                table,
                grid,
                shown,
                actions,
                scene,
                switching,
                ahead_mean,
                sure if knows else ahead_cov,
                scene[GOAL_X],
                scene[GOAL_Y],
                status,
                values,
                mask,
                work_choose,
            )
            act(
                scene,
                actions,
                switching,
                run,
                start + e,
                chosen,
                rng,
                marks,
                first,
                truth,
                mean,
                cov,
                ahead_mean,
                ahead_cov,
                status,
                noise,
                gain,
                work,
            )
            stands += actions[chosen, KIND] == STAND
            turns += actions[chosen, KIND] == TURNING
            error = nees(truth, mean, cov)
            total += error
            if status[STEPS] == NEES_DECISION:
                results[e, NEES_AT] = error
        results[e, SECONDS_TAKEN], results[e, ENDED_AS], results[e, DECISIONS] = (
            status[TIME],
            status[OUTCOME],
            status[STEPS],
        )
        results[e, STANDS_MADE], results[e, TURNS_MADE] = stands, turns
        results[e, ERROR] = math.sqrt((truth[0] - mean[0]) ** 2 + (truth[1] - mean[1]) ** 2)
        results[e, NEES_SUM] = total


def run_episodes(world: Arrays, policy: Policy, run: int, start: int, count: int, knows: bool = False) -> Array:
    """Return the results (count, RESULTS) of episodes start .. start + count - 1 of seed `run`.

    Args:
        world: the model.
        policy: who decides.
        run: seed; the same seed and episode have the same floor, drift and start whatever the policy.
        start: number of the first episode.
        count: number of episodes.
        knows: the policy gets true pose and drift instead of the belief: the limit that no filter can beat.
    """
    n, a = world.states, len(world.names)
    nx, ny = cells(world.scene)
    results = np.zeros((count, RESULTS))
    _run(
        policy.kind,
        policy.numbers,
        policy.table,
        policy.grid,
        policy.shown,
        knows,
        world.actions,
        world.scene,
        world.switching,
        run,
        start,
        results,
        stream(),
        np.zeros((room_for(world.scene), 2)),
        np.zeros(nx * ny + 1, dtype=np.int64),
        np.zeros(6),
        np.zeros(n),
        np.zeros((n, n)),
        np.zeros(max(n, 4) if knows else n),
        np.zeros((n, n)),
        np.zeros(STATUS),
        np.zeros(4),
        np.zeros((2, max(0, n - 4))),
        work_space_of(n),
        np.zeros(a),
        np.zeros(a, dtype=np.bool_),
        work_space_to_choose(max(n, 4), a),
        np.zeros((4, 4)),
    )
    return results
