"""Sarsa(lambda) on the augmented MDP of Osswald et al. (2010): d, phi and entropy h on a grid, interpolated linearly.

delta = r + gamma Q(s', a') - Q(s, a), Q(s', .) = 0 at the goal; E[c, a] = max(E[c, a], w_c) (replacing traces); T +=
alpha delta E; E *= gamma lambda; equation (3) and section V-B of the paper. Corrected: the greedy action is taken with
probability 1 - eps, not eps. An episode that is cut off at the time limit of 700 s ends in no terminal state: its last
value is estimated like that of any state.
"""

import math
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array, Flags, Ints, Record
from surefoot.kernels.jit import free_kernel
from surefoot.services.navigator.environment.draws import Stream, below, seed, stream, uniform
from surefoot.services.navigator.environment.model import EpisodeRoom, EpisodeState, episode_room, episode_state
from surefoot.services.navigator.environment.world import act, begin
from surefoot.services.navigator.policy import arrays as slots
from surefoot.services.navigator.policy.arrays import Arrays, ModelTables
from surefoot.services.navigator.policy.choose import (
    NUMBERS,
    SARSA,
    ChoiceRoom,
    PolicyTables,
    choose,
    features,
    room_to_choose,
)
from surefoot.services.navigator.policy.grids import D_MAX, D_MIN, LAYER_MAX, LAYER_MIN, MIRRORED, place

ALPHA_FIRST, ALPHA_LAST, EPS_FIRST, EPS_LAST, LAMBDA, ACCUMULATE, AVERAGE_FROM = 0, 1, 2, 3, 4, 5, 6
"""Indices into the training settings: `ALPHA_*`: step size and `EPS_*`: exploration at first and last episode;
`LAMBDA`: trace decay; `ACCUMULATE`: 1 = accumulating traces, 0 = replacing; `AVERAGE_FROM`: share of the episodes
after which tables are averaged."""
SETTINGS = 7
LEAST_TRACE = 1e-4
EXPLORE = 1_000_000  # purpose of the stream of exploration, beyond all steps


@free_kernel
def corners(table: Array, grid: Array, d: float, phi: float, h: float, cells: Ints, weights: Array) -> float:
    """Write the 8 grid points around a state, as indices of action 0 in the flat table, and their weights.

    Args:
        table: action values, s, (layers, distances, bearings, actions).
        grid: ends of the table's axes, (GRID,), in the slots LAYER_MIN to D_MAX and MIRRORED.
        d: distance of the goal, m.
        phi: bearing of the goal relative to the robot's heading, rad.
        h: entropy of the pose belief, nats.
        cells: indices of the 8 points, (8,), written.
        weights: weights of the 8 points, sum 1, (8,), written.

    Returns:
        1.0 if the state was mirrored (left and right exchanged), else 0.0.
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


class Lessons(NamedTuple):
    """Action-value tables that a Sarsa(lambda) training changes, its settings, and the durations of its episodes."""

    table: Array
    """Action values, s, (layers, nd, nphi, A): entropy layers, distances, bearings, actions."""
    mean_table: Array
    """Sum of the action-value tables of the episodes to average, s, (layers, nd, nphi, A)."""
    grid: Array
    """Ends of the axes of the action-value table, (GRID,), indexed by the slots of the module `grids`."""
    settings: Array
    """Settings of the training, (SETTINGS,), indexed by `ALPHA_FIRST` ... `AVERAGE_FROM`."""
    seconds: Array
    """Simulated duration of each training episode, s, (episodes,)."""


class EligibilityTraces(NamedTuple):
    """Eligibility traces of one Sarsa episode, and the grid points around its present state."""

    place_of: Ints
    """Index in `active` of each cell of the flat action-value table, (cells,); -1 = the cell has no trace."""
    active: Ints
    """Indices of the flat action-value table's cells that have an eligibility trace, (cells,)."""
    eligibility: Array
    """Eligibility of each cell listed in `active`, (cells,), dimensionless."""
    cells: Ints
    """Indices of the flat table's cells of action 0 at the 8 grid points around the state, (8,)."""
    weights: Array
    """Interpolation weights of the 8 grid points around the state, (8,), sum 1."""


class LearningRoom(NamedTuple):
    """Work arrays of the kernel `learn` for one episode of Sarsa(lambda)."""

    state: EpisodeState
    room: EpisodeRoom
    choice: ChoiceRoom
    explore: Stream
    """State of the random generator that draws exploratory actions, (4,) uint64."""
    traces: EligibilityTraces


def learning_room(world: Arrays, size: int) -> LearningRoom:
    """Return the work arrays of `learn` for a model and an action-value table of `size` elements."""
    traces = EligibilityTraces(
        np.full(size, -1, dtype=np.int64),
        np.zeros(size, dtype=np.int64),
        np.zeros(size),
        np.zeros(8, dtype=np.int64),
        np.zeros(8),
    )
    choice = room_to_choose(world.states, len(world.names))
    return LearningRoom(episode_state(world), episode_room(world.states), choice, stream(), traces)


@free_kernel
def _explored(chosen: int, eps: float, status: Record, mask: Flags, explore: Stream) -> int:
    """Return the chosen action, or, with probability eps and unless blocked, an allowed one drawn at random.

    `status`: record STATUS of the episode; `mask` (A,): True for allowed actions; `explore` (4,) uint64: random stream.
    """
    if uniform(explore) < eps and status.blocked == 0.0:
        chosen = below(explore, mask.size)
        while not mask[chosen]:
            chosen = below(explore, mask.size)
    return chosen


@free_kernel
def _credit(flat: Array, traces: EligibilityTraces, count: int, step: float, decay: float) -> int:
    """Add step * trace to the cells of a table `flat` (size,) with a trace, decay the traces; return their new number.

    `count`: number of traces before; `decay`: factor on each trace, 0 to 1; traces below `LEAST_TRACE` are removed.
    """
    kept = 0
    for i in range(count):
        cell = traces.active[i]
        flat[cell] += step * traces.eligibility[i]
        left = traces.eligibility[i] * decay
        if left > LEAST_TRACE:
            traces.active[kept], traces.eligibility[kept] = cell, left
            traces.place_of[cell] = kept
            kept += 1
        else:
            traces.place_of[cell] = -1
    return kept


@free_kernel
def _mark(flat: Array, traces: EligibilityTraces, own: int, count: int, accumulate: bool) -> tuple[float, int]:
    """Set eligibility traces of action `own` at the points around a state; return the action's value and trace count.

    `flat`: action-value table, flattened; `count`: number of traces before; `accumulate`: True: add to a trace, False:
    replace it if the new one is larger.
    """
    value = 0.0
    for c in range(8):
        cell, w = traces.cells[c] + own, traces.weights[c]
        value += w * flat[cell]
        if w > LEAST_TRACE:
            at = traces.place_of[cell]
            if at < 0:
                traces.place_of[cell] = count
                traces.active[count], traces.eligibility[count] = cell, w
                count += 1
            elif accumulate:
                traces.eligibility[at] += w
            else:
                traces.eligibility[at] = max(traces.eligibility[at], w)
    return value, count


@free_kernel
def _learn_episode(
    lessons: Lessons, policy: PolicyTables, model: ModelTables, run: int, e: int, part: float, room: LearningRoom
) -> None:
    """Update the action values by episode e, in place; `part`: finished share of the training, 0 to 1."""
    scene, settings, state, traces = model.scene[0], lessons.settings, room.state, room.traces
    status, values, gx, gy = state.status, room.choice.values, scene.goal_x, scene.goal_y
    flat, gamma = lessons.table.reshape(-1), scene.gamma
    decay = gamma * settings[LAMBDA]
    alpha = settings[ALPHA_FIRST] * (settings[ALPHA_LAST] / settings[ALPHA_FIRST]) ** part
    eps = settings[EPS_FIRST] * (settings[EPS_LAST] / settings[EPS_FIRST]) ** part
    begin(scene, run, e, state)
    seed(room.explore, run, e, EXPLORE)
    count, reward, value, started = 0, 0.0, 0.0, False
    while True:
        chosen, following = 0, 0.0
        if status.outcome != slots.REACHED:
            chosen = choose(policy, model, state.ahead_mean, state.ahead_cov, gx, gy, status, room.choice)
            chosen = _explored(chosen, eps, status, room.choice.mask, room.explore)
            following = values[chosen]
        if started:
            delta = reward + gamma * following - value
            count = _credit(flat, traces, count, alpha * delta, decay)
        if status.outcome != slots.RUNNING:
            break
        started = True
        d, phi, h = features(state.ahead_mean, state.ahead_cov, gx, gy)
        flip = corners(lessons.table, lessons.grid, d, phi, h, traces.cells, traces.weights)
        own = int(model.actions[chosen].mirror) if flip > 0.0 else chosen
        value, count = _mark(flat, traces, own, count, settings[ACCUMULATE] > 0.0)
        reward = act(model, run, e, chosen, state, room.room)
    for i in range(count):
        traces.place_of[traces.active[i]] = -1
    lessons.seconds[e] = status.time


@free_kernel
def learn(lessons: Lessons, model: ModelTables, run: int, start: int, end: int, room: LearningRoom) -> None:
    """Update the action values by Sarsa(lambda) over episodes start .. end - 1, in place.

    Args:
        lessons: tables to change; `seconds` has an element for each episode of the whole training.
        model: tables of actions and scene.
        run: index of the random stream of the training.
        start: index of the first episode.
        end: index of the last episode + 1.
        room: work arrays.
    """
    policy = PolicyTables(SARSA, np.zeros(NUMBERS), lessons.table, lessons.grid, np.eye(3))
    table, mean_table = lessons.table.reshape(-1), lessons.mean_table.reshape(-1)
    for e in range(start, end):
        part = e / max(1, lessons.seconds.size - 1)
        _learn_episode(lessons, policy, model, run, e, part, room)
        if part >= lessons.settings[AVERAGE_FROM]:
            for i in range(table.size):
                mean_table[i] += table[i]
