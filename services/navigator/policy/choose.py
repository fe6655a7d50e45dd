"""Decisions as kernels on arrays, shared by training, evaluation and the live navigator.

Every kind of policy decides by the belief (mean, cov), the goal and the status: last action, number of stands and of
turns in a row, blocked.
"""

import math
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array, Flags, Record
from surefoot.kernels.jit import row_kernel

from ..belief.ukf import entropy, spread, wrap
from . import arrays as slots
from .arrays import ModelTables
from .grids import add_values

HAND, STEER, PLANNER, SARSA = 0, 1, 2, 3  # kinds of policy

# numbers of hand and steer
STAND_ABOVE, STAND_SLOPE, TURN_BEYOND, STEER_GAIN = 0, 1, 2, 3
# numbers of the planner
SPREAD_XY, SPREAD_HEADING, SPREAD_DRIFT, SIGHT_SHARE = 0, 1, 2, 3
NUMBERS = 8


class PolicyTables(NamedTuple):
    """Arrays of a policy (the rule that chooses the next action) that kernels read."""

    kind: int
    """Kind of policy: 0 = HAND (thresholds), 1 = STEER (thresholds and arcs), 2 = PLANNER (value iteration), 3 = SARSA
    (learned)."""
    numbers: Array
    """Parameters of the policy by kind, (8,).

    HAND and STEER: entropy (nats) above which it stands, its growth by distance (nats per m), bearing (rad) beyond
    which it turns, share of the bearing that an arc corrects. PLANNER: shares of the belief's standard deviations in
    position, heading and drift over which values are averaged, weight of the gain of a stand. The rest is 0."""
    table: Array
    """Action values, s, by layer (drift: PLANNER; entropy: SARSA), distance, bearing, action, (layers, nd, nphi, A)."""
    grid: Array
    """Axes of the table of action values, (6,).

    Distance of its first and last row (m), value of its first and last layer, mirrored (1 layers, -1 bearings), value
    that each m beyond the last row adds."""
    shown: Array
    """Covariance of a pose seen from one stand, (3, 3), robot axes, m and rad."""


class ChoiceRoom(NamedTuple):
    """Arrays for the results of a decision, and its scratch."""

    values: Array
    """Value of each action, (A,), larger is better: s, or no unit by the rules of HAND and STEER."""
    mask: Flags
    """True for each action that is allowed, False for others, (A,)."""
    work: Array
    """Scratch array, (40 + 2 n, max(n, 4, A)) for n filter states and A actions."""


def room_to_choose(states: int, actions: int) -> ChoiceRoom:
    """Return the arrays that a decision writes, for a filter of `states` states and a number of actions."""
    n = max(states, 4)
    return ChoiceRoom(np.zeros(actions), np.zeros(actions, dtype=np.bool_), np.zeros((40 + 2 * n, max(n, actions))))


@row_kernel
def allow(model: ModelTables, status: Record, mask: Flags) -> None:
    """Set which actions are allowed: only turns while blocked, limited numbers of stands and of turns in a row.

    Args:
        model: actions and limits.
        status: record of counters; stands and turns in a row, and blocked (> 0: a wall is close ahead) are read.
        mask: written, (A,), True = allowed.
    """
    actions, scene, blocked = model.actions, model.scene[0], status.blocked > 0.0
    for a in range(actions.shape[0]):
        kind = actions[a].kind
        if blocked:
            mask[a] = kind == slots.TURNING
        elif kind == slots.STAND:
            mask[a] = status.stands < scene.max_stands
        elif kind == slots.TURNING:
            mask[a] = status.turns < scene.max_turns
        else:
            mask[a] = True


@row_kernel
def best(values: Array, mask: Flags) -> int:
    """Return the index of the allowed action of the largest value, the first of equals; -1: none is allowed.

    `values`: of the actions, (A,); `mask`: True = allowed, (A,).
    """
    chosen = -1
    for a in range(values.size):
        if mask[a] and (chosen < 0 or values[a] > values[chosen]):
            chosen = a
    return chosen


@row_kernel
def features(mean: Array, cov: Array, gx: float, gy: float) -> tuple[float, float, float]:
    """Return distance, m, and bearing, rad, of the goal, and entropy of the belief, nats.

    The bearing is in -pi to pi, left of the heading positive. They are (4) to (6) of Osswald et al. (ICRA 2010).

    Args:
        mean: believed x, y (m), heading (rad) and more, frame map, (n,).
        cov: covariance of `mean`, (n, n).
        gx: x of the goal, m, frame map.
        gy: y of the goal, m, frame map.
    """
    dx, dy = gx - mean[0], gy - mean[1]
    return math.sqrt(dx * dx + dy * dy), wrap(math.atan2(dy, dx) - mean[2]), entropy(cov)


@row_kernel
def _by_hand(
    policy: PolicyTables, actions: Record, d: float, phi: float, h: float, drift: float, values: Array
) -> None:
    """Write the values of a rule-based controller: it stands when uncertain, turns to a goal far aside, else walks.

    The choice of the rules has the largest value, the other actions have less, in the order of the rules. A policy of
    the kind STEER takes the arc that comes nearest to a share of the bearing after the turn by the drift.

    Args:
        policy: thresholds of the rules, and share of the bearing.
        actions: actions of the model, a record each: kind, forward (m), turn (rad) are read, (A,).
        d: distance of the goal, m.
        phi: bearing of the goal, rad, left positive.
        h: entropy of the belief, nats.
        drift: believed turn per distance walked, rad/m.
        values: written, (A,), no unit.
    """
    numbers = policy.numbers
    unsure = h > numbers[STAND_ABOVE] + numbers[STAND_SLOPE] * d
    aside = abs(phi) > numbers[TURN_BEYOND]
    for a in range(actions.shape[0]):
        what, turn = actions[a].kind, actions[a].turn
        if what == slots.STAND:
            values[a] = 1.0 if unsure else -1.0
        elif what == slots.TURNING:
            towards = turn * phi > 0.0
            values[a] = (0.9 if aside else -0.5) if towards else -0.8
        elif policy.kind == STEER:
            off = abs(turn + drift * actions[a].forward - numbers[STEER_GAIN] * phi)
            values[a] = 0.5 - 0.05 * off
        else:
            values[a] = 0.5 - 0.05 * abs(turn)


@row_kernel
def _values_at(policy: PolicyTables, model: ModelTables, x: Array, gx: float, gy: float, out: Array) -> None:
    """Write the action values of a state by the policy's table to `out` (A,), s.

    Args:
        policy: table and its axes.
        model: actions, and radius of the goal.
        x: x, y (m), heading (rad), frame map, drift (rad per m), (4,).
        gx: x of the goal, m, frame map.
        gy: y of the goal, m, frame map.
        out: written.
    """
    for a in range(out.size):
        out[a] = 0.0
    dx, dy = gx - x[0], gy - x[1]
    d = max(math.sqrt(dx * dx + dy * dy), model.scene[0].goal_radius)
    add_values(policy.table, policy.grid, model.actions, d, wrap(math.atan2(dy, dx) - x[2]), x[3], 1.0, out)


@row_kernel
def _average(
    policy: PolicyTables, model: ModelTables, mean: Array, low: Array, gx: float, gy: float, out: Array
) -> None:
    """Write the average of the action values over the 8 points mean +- scaled column of `low` to `out` (A,), s.

    A point inside the goal is moved to its edge, where the values differ: the goal has not been reached.

    Args:
        policy: table of values, and shares of the spread in position, heading and drift.
        model: actions, and radius of the goal.
        mean: believed x, y (m), heading (rad), frame map, drift (rad per m) if n > 3, (n,).
        low: lower triangle L with L L^T = 4 times the covariance of these four, (4, 4).
        gx: x of the goal, m, frame map.
        gy: y of the goal, m, frame map.
        out: written.
    """
    for a in range(out.size):
        out[a] = 0.0
    numbers, drift = policy.numbers, mean[3] if mean.size > 3 else 0.0
    for j in range(4):
        for half in range(2):
            sign = 1.0 - 2.0 * half
            dx = gx - mean[0] - sign * low[0, j] * numbers[SPREAD_XY]
            dy = gy - mean[1] - sign * low[1, j] * numbers[SPREAD_XY]
            theta = mean[2] + sign * low[2, j] * numbers[SPREAD_HEADING]
            d = math.sqrt(dx * dx + dy * dy)
            phi = wrap(math.atan2(dy, dx) - theta)
            b = drift + sign * low[3, j] * numbers[SPREAD_DRIFT]
            add_values(policy.table, policy.grid, model.actions, max(d, model.scene[0].goal_radius), phi, b, 0.125, out)


@row_kernel
def _top4(mean: Array, cov: Array, work: Array) -> None:
    """Write the covariance of x, y (m), heading (rad), drift (rad per m) of a belief into rows 0 .. 3 of `work`.

    `mean` (n,), `cov` (n, n): the belief; a state without drift, n = 3, gets zeros.
    """
    n = min(mean.size, 4)
    for i in range(4):
        for j in range(4):
            work[i, j] = cov[i, j] if i < n and j < n else 0.0


@row_kernel
def after_sight(heading: float, shown: Array, work: Array) -> None:
    """Split the covariance P (4, 4) of a belief into the parts that a stand (pause for the camera) removes and leaves.

    With S = P[:3, :3] + shown, turned into the map, P - P+ = P[:, :3] S^-1 P[:3, :] is how far the mean will move, and
    P+ is left.

    Args:
        heading: believed, rad.
        shown: covariance of a pose seen from the frames of one stand, x ahead, (3, 3), m and rad.
        work: scratch, (19 or more, 4 or more): P in rows 0 .. 3, result P+ in rows 4 .. 7 and P - P+ in rows 8 .. 11.
    """
    c, s = math.cos(heading), math.sin(heading)
    # S, lower triangle, in rows 12 .. 14
    xx, xy, yy = shown[0, 0], shown[0, 1], shown[1, 1]
    work[12, 0] = work[0, 0] + c * c * xx - 2.0 * c * s * xy + s * s * yy
    work[13, 0] = work[1, 0] + c * s * (xx - yy) + (c * c - s * s) * xy
    work[13, 1] = work[1, 1] + s * s * xx + 2.0 * c * s * xy + c * c * yy
    work[14, 0] = work[2, 0] + c * shown[0, 2] - s * shown[1, 2]
    work[14, 1] = work[2, 1] + s * shown[0, 2] + c * shown[1, 2]
    work[14, 2] = work[2, 2] + shown[2, 2]
    # Cholesky of S in place, then rows 15 .. 18: P[:, :3] L^-T, so that P - P+ = rows rows^T
    l00 = math.sqrt(work[12, 0])
    l10, l20 = work[13, 0] / l00, work[14, 0] / l00
    l11 = math.sqrt(work[13, 1] - l10 * l10)
    l21 = (work[14, 1] - l20 * l10) / l11
    l22 = math.sqrt(work[14, 2] - l20 * l20 - l21 * l21)
    for i in range(4):
        work[15 + i, 0] = work[i, 0] / l00
        work[15 + i, 1] = (work[i, 1] - work[15 + i, 0] * l10) / l11
        work[15 + i, 2] = (work[i, 2] - work[15 + i, 0] * l20 - work[15 + i, 1] * l21) / l22
    for i in range(4):
        for j in range(4):
            moved = 0.0
            for k in range(3):
                moved += work[15 + i, k] * work[15 + j, k]
            work[8 + i, j] = moved
            work[4 + i, j] = work[i, j] - moved


@row_kernel
def _gain_of_sight(
    policy: PolicyTables, model: ModelTables, mean: Array, gx: float, gy: float, room: ChoiceRoom
) -> float:
    """Return the time that deciding after a stand (pause for the camera) saves, s; > 0 where it changes the choice.

    That is the mean, over the places where the estimate may then be, of the best value there, less the best of the
    actions' means over the same places.

    Args:
        policy: table of values, and what one stand shows of the pose.
        model: actions, and time that a change of their kind costs.
        mean: believed x, y (m), heading (rad), frame map, drift (rad per m), (n,).
        gx: x of the goal, m, frame map.
        gy: y of the goal, m, frame map.
        room: scratch; rows 0 .. 3 of `work` hold the covariance of x, y, heading and drift.
    """
    na, work = model.actions.shape[0], room.work
    moved, average, there, single = work[24:28], work[30, 0:na], work[31, 0:4], work[32, 0:na]
    after_sight(mean[2], policy.shown, work)
    spread(work[8:12], moved)
    chosen_later = 0.0
    for a in range(na):
        average[a] = 0.0
    for j in range(4):
        for half in range(2):
            sign = 1.0 - 2.0 * half
            for i in range(4):
                there[i] = (mean[i] if i < mean.size else 0.0) + sign * moved[i, j]
            _values_at(policy, model, there, gx, gy, single)
            top = -math.inf
            for a in range(na):
                kind = int(model.actions[a].kind)
                if kind != slots.STAND:
                    value = single[a] - model.switching[slots.STAND, kind]
                    average[a] += 0.125 * value
                    top = max(top, value)
            chosen_later += 0.125 * top
    chosen_now = -math.inf
    for a in range(na):
        if int(model.actions[a].kind) != slots.STAND:
            chosen_now = max(chosen_now, average[a])
    return chosen_later - chosen_now


@row_kernel
def _planned(
    policy: PolicyTables, model: ModelTables, mean: Array, cov: Array, gx: float, gy: float, last: int, room: ChoiceRoom
) -> None:
    """Write the values of all actions, s (negative): the table averaged over a share of the belief's spread.

    Value of a stand: -its seconds, -the time that stopping and starting cost, + the weighted gain of its sight, + the
    best value of going on after it.

    Args:
        policy: table of values, shares of the spread, weight of the gain.
        model: actions, and time that a change of their kind costs.
        mean: believed x, y (m), heading (rad), frame map, drift (rad per m), (n,).
        cov: covariance of `mean`, (n, n).
        gx: x of the goal, m, frame map.
        gy: y of the goal, m, frame map.
        last: kind of the last action: 0 stand, 1 turn, 2 walk.
        room: results and scratch; `values` is written.
    """
    values, low = room.values, room.work[20:24]
    _top4(mean, cov, room.work)
    spread(room.work[0:4], low)
    _average(policy, model, mean, low, gx, gy, values)
    can_stand, later = -1, -math.inf  # value of going on after a stand
    for a in range(values.size):
        kind = int(model.actions[a].kind)
        if kind == slots.STAND:
            can_stand = a
        else:
            later = max(later, values[a] - model.switching[slots.STAND, kind])
        values[a] -= model.switching[last, kind]
    if can_stand < 0:
        return
    stand = later - model.actions[can_stand].seconds - model.switching[last, slots.STAND]
    if policy.numbers[SIGHT_SHARE] > 0.0:
        stand += policy.numbers[SIGHT_SHARE] * _gain_of_sight(policy, model, mean, gx, gy, room)
    values[can_stand] = stand


@row_kernel
def choose(
    policy: PolicyTables,
    model: ModelTables,
    mean: Array,
    cov: Array,
    gx: float,
    gy: float,
    status: Record,
    room: ChoiceRoom,
) -> int:
    """Return the index of the chosen action, -1 = none is allowed; values and mask of `room` are written.

    Args:
        policy: policy whose rule or table decides.
        model: actions and scene; goal radius and limits are read.
        mean: belief, (n,): x, y in m and heading in rad, frame map, then the drift in rad per m.
        cov: covariance of `mean`, (n, n).
        gx: x of the goal, m, frame map.
        gy: y of the goal, m, frame map.
        status: record of counters; last action, stands and turns in a row, blocked (a wall is close ahead) are read.
        room: results and scratch.
    """
    allow(model, status, room.mask)
    last = int(status.last)
    last_kind = slots.STAND if last < 0 else int(model.actions[last].kind)
    d, phi, h = features(mean, cov, gx, gy)
    if policy.kind == PLANNER:
        _planned(policy, model, mean, cov, gx, gy, last_kind, room)
    elif policy.kind == SARSA:
        for a in range(room.values.size):
            room.values[a] = 0.0
        add_values(policy.table, policy.grid, model.actions, d, phi, h, 1.0, room.values)
    else:
        drift = mean[3] if mean.size > 3 else 0.0
        _by_hand(policy, model.actions, d, phi, h, drift, room.values)
    if status.blocked > 0.0 and last_kind == slots.TURNING:
        return last  # the same turn again: turns to and fro would never lead away from the wall
    return best(room.values, room.mask)
