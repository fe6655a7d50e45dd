"""Decisions as kernels on arrays; the same ones serve training, evaluation and the live navigator.

A policy is a kind, its numbers (parameters), a table of action values with its grid, and what standing shows. All of
them get the belief (mean, cov), the goal, and the status: last action, stands and turns in a row, blocked.
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import row_kernel

from ..belief.ukf import entropy, spread, wrap
from .arrays import (
    BLOCKED,
    FORWARD,
    GOAL_RADIUS,
    KIND,
    LAST,
    MAX_STANDS,
    MAX_TURNS,
    SECONDS,
    STAND,
    STANDS,
    TURN,
    TURNING,
    TURNS,
)
from .grids import add_values

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

HAND, STEER, PLANNER, SARSA = 0, 1, 2, 3  # kinds of policy

# numbers of hand and steer
STAND_ABOVE, STAND_SLOPE, TURN_BEYOND, STEER_GAIN = 0, 1, 2, 3
# numbers of the planner
SPREAD_XY, SPREAD_HEADING, SPREAD_DRIFT, SIGHT_SHARE = 0, 1, 2, 3
NUMBERS = 8

POINTS = 8  # sigma points of (x, y, heading, drift)


def work_space_to_choose(states: int, actions: int) -> Array:
    """Return the scratch array that `choose` needs."""
    return np.zeros((40 + 2 * states, max(states, 4, actions)))


@row_kernel
def allow(actions: Array, scene: Array, status: Array, mask: Flags) -> None:
    """Mark the actions that may be chosen: turns only while blocked; not too many stands or turns in a row."""
    blocked = status[BLOCKED] > 0.0
    for a in range(actions.shape[0]):
        kind = actions[a, KIND]
        if blocked:
            mask[a] = kind == TURNING
        elif kind == STAND:
            mask[a] = status[STANDS] < scene[MAX_STANDS]
        elif kind == TURNING:
            mask[a] = status[TURNS] < scene[MAX_TURNS]
        else:
            mask[a] = True


@row_kernel
def best(values: Array, mask: Flags) -> int:
    """Return the allowed action of the largest value (the first of equals)."""
    chosen = -1
    for a in range(values.size):
        if mask[a] and (chosen < 0 or values[a] > values[chosen]):
            chosen = a
    return chosen


@row_kernel
def features(mean: Array, cov: Array, gx: float, gy: float) -> tuple[float, float, float]:
    """Return d (m), phi (rad, wrapped) and h (nats) of equations (4) to (6)."""
    dx, dy = gx - mean[0], gy - mean[1]
    return math.sqrt(dx * dx + dy * dy), wrap(math.atan2(dy, dx) - mean[2]), entropy(cov)


@row_kernel
def _by_hand(
    kind: int, numbers: Array, actions: Array, d: float, phi: float, h: float, drift: float, mask: Flags, values: Array
) -> None:
    """Dual-mode controller: stand when unsure, else turn to the goal when it is far aside, else walk.

    Values are 1 for the choice of the rules and less for the others, in the order the rules would come to them. steer
    takes the arc that comes nearest to STEER_GAIN phi, what the drift will turn left out.
    """
    unsure = h > numbers[STAND_ABOVE] + numbers[STAND_SLOPE] * d
    aside = abs(phi) > numbers[TURN_BEYOND]
    for a in range(actions.shape[0]):
        what, turn = actions[a, KIND], actions[a, TURN]
        if what == STAND:
            values[a] = 1.0 if unsure else -1.0
        elif what == TURNING:
            towards = turn * phi > 0.0
            values[a] = (0.9 if aside else -0.5) if towards else -0.8
        elif kind == STEER:
            off = abs(turn + drift * actions[a, FORWARD] - numbers[STEER_GAIN] * phi)
            values[a] = 0.5 - 0.05 * off
        else:
            values[a] = 0.5 - 0.05 * abs(turn)


@row_kernel
def _at(
    table: Array, grid: Array, actions: Array, x: Array, gx: float, gy: float, radius: float, weight: float, out: Array
) -> None:
    """Add weight * values of a known state x (4,) to out (A,)."""
    dx, dy = gx - x[0], gy - x[1]
    d = max(math.sqrt(dx * dx + dy * dy), radius)
    add_values(table, grid, actions, d, wrap(math.atan2(dy, dx) - x[2]), x[3], weight, out)


@row_kernel
def _average(
    numbers: Array,
    table: Array,
    grid: Array,
    actions: Array,
    mean: Array,
    low: Array,
    gx: float,
    gy: float,
    radius: float,
    out: Array,
) -> None:
    """Average the table over the 8 sigma points mean +- column of low (4, 4), into out (A,).

    A point inside the goal is moved to its edge: the goal has not been reached, or nothing would be decided.
    """
    for a in range(out.size):
        out[a] = 0.0
    drift = mean[3] if mean.size > 3 else 0.0
    for j in range(4):
        for half in range(2):
            sign = 1.0 - 2.0 * half
            dx = gx - mean[0] - sign * low[0, j] * numbers[SPREAD_XY]
            dy = gy - mean[1] - sign * low[1, j] * numbers[SPREAD_XY]
            theta = mean[2] + sign * low[2, j] * numbers[SPREAD_HEADING]
            d = math.sqrt(dx * dx + dy * dy)
            phi = wrap(math.atan2(dy, dx) - theta)
            b = drift + sign * low[3, j] * numbers[SPREAD_DRIFT]
            add_values(table, grid, actions, max(d, radius), phi, b, 0.125, out)


@row_kernel
def _top4(mean: Array, cov: Array, work: Array) -> None:
    """Write the covariance of x, y, heading and drift into rows 0 .. 3 of work (drift without variance: zeros)."""
    n = min(mean.size, 4)
    for i in range(4):
        for j in range(4):
            work[i, j] = cov[i, j] if i < n and j < n else 0.0


@row_kernel
def after_sight(heading: float, shown: Array, work: Array) -> None:
    """Split the covariance P (rows 0 .. 3 of work) by what a stand would show.

    shown (3, 3) is the covariance of a pose seen from the frames of one stand, x ahead. With S = P33 + shown, turned
    into the map, P - P+ = P[:, :3] S^-1 P[:3, :] is how far the mean will move (rows 8 .. 11), P+ is left (4 .. 7).
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
def _planned(
    numbers: Array,
    table: Array,
    grid: Array,
    shown: Array,
    actions: Array,
    switching: Array,
    mean: Array,
    cov: Array,
    gx: float,
    gy: float,
    radius: float,
    last: int,
    values: Array,
    work: Array,
) -> None:
    """Write the values of all actions, s (negative): the table averaged over a share of the belief's spread.

    Value of a stand: -its seconds, -what stopping and starting cost, + SIGHT_SHARE * gain + the best value of going on
    after it. The gain is that of deciding after the look: the mean over where the estimate may then be of the best
    value there, less the best of the actions' means over the same places; it is >= 0, and > 0 where what is seen can
    change the choice.
    """
    na = actions.shape[0]
    left4, moved4, average, there, single = work[20:24], work[24:28], work[30, 0:na], work[31, 0:4], work[32, 0:na]
    _top4(mean, cov, work)
    spread(work[0:4], left4)
    _average(numbers, table, grid, actions, mean, left4, gx, gy, radius, values)
    can_stand, later = -1, -math.inf  # value of going on after a stand
    for a in range(na):
        kind = int(actions[a, KIND])
        if kind == STAND:
            can_stand = a
        else:
            later = max(later, values[a] - switching[STAND, kind])
        values[a] -= switching[last, kind]
    if can_stand < 0:
        return
    stand = later - actions[can_stand, SECONDS] - switching[last, STAND]
    if numbers[SIGHT_SHARE] > 0.0:
        after_sight(mean[2], shown, work)
        spread(work[8:12], moved4)
        chosen_later = 0.0
        for a in range(na):
            average[a] = 0.0
        for j in range(4):
            for half in range(2):
                sign = 1.0 - 2.0 * half
                for i in range(4):
                    there[i] = (mean[i] if i < mean.size else 0.0) + sign * moved4[i, j]
                for a in range(na):
                    single[a] = 0.0
                _at(table, grid, actions, there, gx, gy, radius, 1.0, single)
                top = -math.inf
                for a in range(na):
                    if int(actions[a, KIND]) != STAND:
                        value = single[a] - switching[STAND, int(actions[a, KIND])]
                        average[a] += 0.125 * value
                        top = max(top, value)
                chosen_later += 0.125 * top
        chosen_now = -math.inf
        for a in range(na):
            if int(actions[a, KIND]) != STAND:
                chosen_now = max(chosen_now, average[a])
        stand += numbers[SIGHT_SHARE] * (chosen_later - chosen_now)
    values[can_stand] = stand


@row_kernel
def choose(
    kind: int,
    numbers: Array,
    table: Array,
    grid: Array,
    shown: Array,
    actions: Array,
    scene: Array,
    switching: Array,
    mean: Array,
    cov: Array,
    gx: float,
    gy: float,
    status: Array,
    values: Array,
    mask: Flags,
    work: Array,
) -> int:
    """Return the chosen action, and write the values of all (A,) and which are allowed (A,).

    Args:
        kind: HAND, STEER, PLANNER or SARSA.
        numbers: parameters of the policy, (NUMBERS,).
        table: action values, (layers, nd, nphi, A), see `grids`.
        grid: its axes, (GRID,).
        shown: covariance of a pose seen from one stand, robot axes, (3, 3).
        actions: (A, COLUMNS).
        scene: (ELEMENTS,); goal radius and guards are read.
        switching: s, (3, 3).
        mean: belief, (n,).
        cov: its covariance, (n, n).
        gx: goal in the map, m.
        gy: m.
        status: (STATUS,); last action, stands, turns and blocked are read.
        values: result, (A,).
        mask: result, (A,).
        work: scratch of `work_space_to_choose`.
    """
    allow(actions, scene, status, mask)
    last = int(status[LAST])
    last_kind = STAND if last < 0 else int(actions[last, KIND])
    d, phi, h = features(mean, cov, gx, gy)
    if kind == PLANNER:
        _planned(
            numbers,
            table,
            grid,
            shown,
            actions,
            switching,
            mean,
            cov,
            gx,
            gy,
            scene[GOAL_RADIUS],
            last_kind,
            values,
            work,
        )
    elif kind == SARSA:
        for a in range(values.size):
            values[a] = 0.0
        add_values(table, grid, actions, d, phi, h, 1.0, values)
    else:
        drift = mean[3] if mean.size > 3 else 0.0
        _by_hand(kind, numbers, actions, d, phi, h, drift, mask, values)
    if status[BLOCKED] > 0.0 and last_kind == TURNING:
        return last  # turn on: to and fro would never lead away from the wall
    return best(values, mask)
