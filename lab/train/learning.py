"""Sarsa(lambda) on the augmented MDP of the paper: d, phi and the entropy h on a grid with linear interpolation.

delta = r + gamma Q(s', a') - Q(s, a), Q(s', .) = 0 at the goal; E[c, a] = max(E[c, a], w_c) (replacing traces);
T += alpha delta E; E *= gamma lambda; equation (3) and section V-B. Corrected: the greedy action is taken with
probability 1 - eps, not eps. Being cut off after 700 s is no terminal state: the last value is estimated as ever.
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import free_kernel
from surefoot.services.navigator.environment.draws import below, seed, uniform
from surefoot.services.navigator.environment.world import act, begin
from surefoot.services.navigator.policy.arrays import BLOCKED, GAMMA, GOAL_X, GOAL_Y, MIRROR, OUTCOME, REACHED, RUNNING
from surefoot.services.navigator.policy.arrays import TIME as TIME_AT
from surefoot.services.navigator.policy.choose import SARSA, choose, features
from surefoot.services.navigator.policy.grids import D_MAX, D_MIN, LAYER_MAX, LAYER_MIN, MIRRORED, place

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
State = NDArray[np.uint64]
Flags = NDArray[np.bool_]

ALPHA_FIRST, ALPHA_LAST, EPS_FIRST, EPS_LAST, LAMBDA, ACCUMULATE, AVERAGE_FROM = 0, 1, 2, 3, 4, 5, 6
"""Settings: step size and exploration at the first and last episode (exponential in between), trace decay, 1 =
accumulating traces, share of the episodes after which tables are averaged."""
SETTINGS = 7
LEAST_TRACE = 1e-4
EXPLORE = 1_000_000  # purpose of the stream of exploration, beyond all steps


@free_kernel
def corners(table: Array, grid: Array, d: float, phi: float, h: float, cells: Ints, weights: Array) -> float:
    """Write the 8 points around a state, as indices of action 0 in the flat table, and their weights.

    Returns:
        1.0 where the state was mirrored (left is right), else 0.0.
    """
    flip = grid[MIRRORED] < 0.0 and phi < 0.0
    if flip:
        phi = -phi
    nl, nd, nphi, na = table.shape
    il, wl = place(h, grid[LAYER_MIN], grid[LAYER_MAX], nl)
    jd, wd = place(d, grid[D_MIN], grid[D_MAX], nd)
    u = (phi + math.pi) / (2.0 * math.pi) * nphi
    whole = math.floor(u)
    wp, k0 = u - whole, int(whole) % nphi
    count = 0
    for i in range(2):
        for j in range(2):
            for k in range(2):
                row = (min(il + i, nl - 1) * nd + min(jd + j, nd - 1)) * nphi + (k0 + k) % nphi
                cells[count] = row * na
                weights[count] = (wl if i else 1.0 - wl) * (wd if j else 1.0 - wd) * (wp if k else 1.0 - wp)
                count += 1
    return 1.0 if flip else 0.0


@free_kernel
def learn(
    table: Array,
    mean_table: Array,
    grid: Array,
    settings: Array,
    actions: Array,
    scene: Array,
    switching: Array,
    run: int,
    start: int,
    end: int,
    whole: int,
    seconds: Array,
    rng: State,
    explore: State,
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
    numbers: Array,
    shown: Array,
    place_of: Ints,
    active: Ints,
    traces: Array,
) -> None:
    """Learn from episodes start .. end - 1 of `whole`, in place.

    table becomes the values, mean_table the sum of the tables that are averaged, seconds (whole,) the time of each
    episode, s; what follows explore is scratch.
    """
    flat, na = table.reshape(-1), table.shape[3]
    cells, weights = np.empty(8, dtype=np.int64), np.empty(8)
    gamma = scene[GAMMA]
    decay = gamma * settings[LAMBDA]
    for e in range(start, end):
        part = e / max(1, whole - 1)
        alpha = settings[ALPHA_FIRST] * (settings[ALPHA_LAST] / settings[ALPHA_FIRST]) ** part
        eps = settings[EPS_FIRST] * (settings[EPS_LAST] / settings[EPS_FIRST]) ** part
        begin(scene, run, e, rng, marks, first, truth, mean, cov, ahead_mean, ahead_cov, status)
        seed(explore, run, e, EXPLORE)
        count, reward, value, started = 0, 0.0, 0.0, False
        while True:
            reached = status[OUTCOME] == REACHED
            chosen, following = 0, 0.0
            if not reached:
                chosen = choose(
                    SARSA,
                    numbers,
                    table,
                    grid,
                    shown,
                    actions,
                    scene,
                    switching,
                    ahead_mean,
                    ahead_cov,
                    scene[GOAL_X],
                    scene[GOAL_Y],
                    status,
                    values,
                    mask,
                    work_choose,
                )
                if uniform(explore) < eps and status[BLOCKED] == 0.0:
                    pick = below(explore, na)
                    while not mask[pick]:
                        pick = below(explore, na)
                    chosen = pick
                following = values[chosen]
            if started:
                delta = reward + gamma * following - value
                step = alpha * delta
                kept = 0
                for i in range(count):
                    cell = active[i]
                    flat[cell] += step * traces[i]
                    left = traces[i] * decay
                    if left > LEAST_TRACE:
                        active[kept], traces[kept] = cell, left
                        place_of[cell] = kept
                        kept += 1
                    else:
                        place_of[cell] = -1
                count = kept
            if status[OUTCOME] != RUNNING:
                break
            started = True
            d, phi, h = features(ahead_mean, ahead_cov, scene[GOAL_X], scene[GOAL_Y])
            flip = corners(table, grid, d, phi, h, cells, weights)
            own = int(actions[chosen, MIRROR]) if flip > 0.0 else chosen
            value = 0.0
            for c in range(8):
                cell, w = cells[c] + own, weights[c]
                value += w * flat[cell]
                if w > LEAST_TRACE:
                    at = place_of[cell]
                    if at < 0:
                        place_of[cell] = count
                        active[count], traces[count] = cell, w
                        count += 1
                    elif settings[ACCUMULATE] > 0.0:
                        traces[at] += w
                    else:
                        traces[at] = max(traces[at], w)
            reward = act(
                scene,
                actions,
                switching,
                run,
                e,
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
        for i in range(count):
            place_of[active[i]] = -1
        seconds[e] = status[TIME_AT]
        if part >= settings[AVERAGE_FROM]:
            into = mean_table.reshape(-1)
            for i in range(flat.size):
                into[i] += flat[i]
