"""Value iteration for a robot with heading drift on its way to a goal, with pose and drift known.

V(d, phi, b) = max_a { -dt_a + mean_k [s'_k not in the goal] V(s'_k) }, s'_k the state after action a with noise sample
k; d and phi as in (4) and (5) of Osswald et al., b the drift. V is kept for each kind of last action that makes a
difference, because stopping and starting take time. Only b >= 0 is computed: (d, phi, b) and (d, -phi,
-b) are mirror images.
"""

import math
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array, Ints, Record
from surefoot.geometry.linear_kernels import inverse3
from surefoot.kernels.jit import free_kernel

from . import arrays as slots
from .arrays import Arrays
from .choose import PLANNER, PolicyTables
from .decider import Policy, planner_numbers
from .grids import D_MAX, D_MIN, GRID, LAYER_MAX, LAYER_MIN, MIRRORED, PER_M

NOTHING = -1e9
SIGHT_PRICE = 0.05  # s an action that sees nothing costs more than the one that sees best, of 0 .. 0.8 s
VARIANCE_UNSEEN = 1e4  # of a pose where nothing is seen


def noise_samples(count: int) -> Array:
    """Return standard normal samples (count, 3), `count` even: pairs x, -x of a lattice, unit variance by column."""
    plastic = 1.2207440846057596  # x^4 = x + 1: the additive recurrence that fills three dimensions evenly
    half, normal = count // 2, NormalDist()
    steps = [plastic**-1, plastic**-2, plastic**-3]
    points = np.array([[normal.inv_cdf((0.5 + step * (k + 1)) % 1.0) for step in steps] for k in range(half)])
    both = np.concatenate([points, -points])
    return both / np.sqrt((both**2).mean(axis=0))


class PlanRoom(NamedTuple):
    """Constants of the value iteration that computes a planner's table."""

    groups: Ints
    """Index of the value table to use after an action of kind 0 stand, 1 turn, 2 walk, (3,); kinds with equal switching
    times share one."""
    samples: Array
    """Standard normal samples of the motion noise: along, across, heading, (k, 3), no unit."""
    drifts: Array
    """Heading drift of each layer of the value table, rad per m, (nb,)."""
    radius: float
    """Distance from the goal within which it counts as reached, m."""
    d_max: float
    """Largest distance to the goal in the value table, m."""
    per_m: float
    """Time that each metre beyond the table's largest distance adds, s."""


@free_kernel
def _motions(actions: Record, drift: float, samples: Array, moved: Array) -> None:
    """Write the motion of each action and noise sample: forward and left, m, and turn, rad, into `moved` (A, k, 3).

    Args:
        actions: actions of the model, a record each: distance, turn and variances of the motion are read, (A,).
        drift: turn per distance walked, rad per m.
        samples: standard normal deviations along, across and of the heading, (k, 3).
        moved: written, in the axes of the robot before the action.
    """
    for a in range(actions.shape[0]):
        change = actions[a].turn + drift * actions[a].forward
        c, s = math.cos(0.5 * change), math.sin(0.5 * change)
        for k in range(samples.shape[0]):
            along = actions[a].forward + math.sqrt(actions[a].var_along) * samples[k, 0]
            across = math.sqrt(actions[a].var_across) * samples[k, 1]
            moved[a, k, 0] = along * c - across * s
            moved[a, k, 1] = along * s + across * c
            moved[a, k, 2] = change + math.sqrt(actions[a].var_heading) * samples[k, 2]


@free_kernel
def _mean_after(v: Array, gx: float, gy: float, moved: Array, room: PlanRoom) -> float:
    """Return the mean value after an action over the samples of its noise, s; a goal that is reached has the value 0.

    Args:
        v: values by distance and bearing of the goal, (nd, nphi) s.
        gx: x of the goal in the axes of the robot before the action, m.
        gy: y of the goal in these axes, m.
        moved: forward and left, m, and turn, rad, of each sample of the action, (k, 3).
        room: constants: radius of the goal, largest distance, seconds per metre beyond it.
    """
    (nd, nphi), total = v.shape, 0.0
    dx_step, phi_step = room.d_max / (nd - 1), 2.0 * math.pi / nphi
    for k in range(moved.shape[0]):
        x, y = gx - moved[k, 0], gy - moved[k, 1]
        far = math.sqrt(x * x + y * y)
        if far < room.radius:
            continue
        u = min(far, room.d_max) / dx_step
        j0 = min(int(u), nd - 2)
        wd = u - j0
        t = (math.atan2(y, x) - moved[k, 2] + math.pi) / phi_step
        whole = math.floor(t)
        wp = t - whole
        k0 = int(whole) % nphi
        k1 = k0 + 1 if k0 + 1 < nphi else 0
        near = (1.0 - wp) * v[j0, k0] + wp * v[j0, k1]
        beyond = (1.0 - wp) * v[j0 + 1, k0] + wp * v[j0 + 1, k1]
        total += (1.0 - wd) * near + wd * beyond - room.per_m * max(0.0, far - room.d_max)
    return total / moved.shape[0]


@free_kernel
def _sweep(v: Array, q: Array, actions: Record, switching: Array, room: PlanRoom) -> float:
    """Update all values once, from near the goal outwards; return the largest change, s.

    Args:
        v: values of a state by kind of the last action, drift, distance and bearing, (groups, nb, nd, nphi) s, changed.
        q: values of its actions, before the cost of changing the kind, (nb, nd, nphi, A) s, changed.
        actions: actions of the model, a record each, (A,).
        switching: time that an action of kind j costs after kind i (0 stand, 1 turn, 2 walk), (3, 3) s.
        room: constants of the iteration.
    """
    nb, nd, nphi = v.shape[1], v.shape[2], v.shape[3]
    na, worst = actions.shape[0], 0.0
    moved = np.empty((na, room.samples.shape[0], 3))
    for ib in range(nb):
        _motions(actions, room.drifts[ib], room.samples, moved)
        for jd in range(nd):
            d = jd * (room.d_max / (nd - 1))
            for kp in range(nphi):
                phi = -math.pi + kp * (2.0 * math.pi / nphi)
                gx, gy = d * math.cos(phi), d * math.sin(phi)
                for a in range(na):
                    if actions[a].kind == slots.STAND:
                        q[ib, jd, kp, a] = NOTHING
                        continue
                    after = room.groups[int(actions[a].kind)]
                    q[ib, jd, kp, a] = _mean_after(v[after, ib], gx, gy, moved[a], room) - actions[a].seconds
                for kind in range(3):
                    top = NOTHING
                    for a in range(na):
                        top = max(top, q[ib, jd, kp, a] - switching[kind, int(actions[a].kind)])
                    worst = max(worst, abs(top - v[room.groups[kind], ib, jd, kp]))
                    v[room.groups[kind], ib, jd, kp] = top
    return worst


def grid_of(world: Arrays, d_max: float, drift_max: float) -> Array:
    """Return the axes of a planner's table of values, (6,).

    Smallest and largest distance of the goal (0, d_max m), of drift (0, drift_max rad per m walked), 1 = mirrored, and
    minus the seconds that a metre beyond d_max takes.

    Args:
        world: arrays of the model, with its actions.
        d_max: largest distance, m.
        drift_max: largest drift, rad per m.
    """
    grid = np.zeros(GRID)
    grid[[D_MIN, D_MAX, LAYER_MIN, LAYER_MAX, MIRRORED, PER_M]] = 0.0, d_max, 0.0, drift_max, 1.0, -_per_m(world)
    return grid


def _per_m(world: Arrays) -> float:
    """Return the seconds that the fastest action of a model takes for a metre."""
    return min(float(row.seconds / row.forward) for row in world.tables.actions if row.forward > 0.0)


def plan(
    world: Arrays,
    d_max: float = 2.5,
    drift_max: float = math.radians(80.0),
    shape: tuple[int, int, int] = (5, 51, 90),
    samples: int = 24,
    tolerance: float = 0.1,
    most: int = 200,
) -> tuple[Array, Array, int]:
    """Return the table of action values (nb, nd, nphi, A) in s (negative), its axes (6,), and the number of sweeps.

    Args:
        world: arrays of the model.
        d_max: m, largest distance of the table; beyond it the choice depends on bearing and drift only.
        drift_max: rad per m, largest drift.
        shape: number of drifts from 0 on, of distances, of bearings: nb, nd, nphi.
        samples: number of samples of the motion noise, even.
        tolerance: s, largest change of a value in a sweep at which the iteration ends.
        most: largest number of sweeps.
    """
    (nb, nd, nphi), switching = shape, world.tables.switching
    rows = [tuple(row) for row in switching]
    groups = np.array([list(dict.fromkeys(rows)).index(row) for row in rows], dtype=np.int64)
    v = np.zeros((int(groups.max()) + 1, nb, nd, nphi))
    v += _guess(world, np.linspace(0.0, d_max, nd), nphi)
    q = np.zeros((nb, nd, nphi, len(world.names)))
    grid, drifts = grid_of(world, d_max, drift_max), np.linspace(0.0, drift_max, nb)
    radius = float(world.tables.scene[0].goal_radius)
    room = PlanRoom(groups, noise_samples(samples), drifts, radius, d_max, _per_m(world))
    priced, sweeps, worst = _priced(world.tables.actions), 0, math.inf
    while worst > tolerance and sweeps < most:
        sweeps += 1
        worst = _sweep(v, q, priced, switching, room)
    return q, grid, sweeps


def _priced(actions: Record) -> Record:
    """Return the action records, (A,), with `seconds` raised for those that see less than the best one."""
    out, best = actions.copy(), 0.0
    for row in actions:
        best = max(best, float(row.match)) if row.kind != slots.STAND else best
    for row in out:
        if row.kind != slots.STAND and best > 0.0:
            row.seconds += SIGHT_PRICE * (1.0 - row.match / best)
    return out


def _guess(world: Arrays, d: Array, nphi: int) -> Array:
    """Return initial values, (nd, nphi), s: turn to the goal, then walk; `d`: distances of the goal, (nd,) m."""
    turns = [row for row in world.tables.actions if row.forward == 0.0 and row.turn != 0.0]
    per_rad = min(row.seconds / abs(row.turn) for row in turns)
    phi = np.abs(-math.pi + np.arange(nphi) * (2.0 * math.pi / nphi))
    return -(1.1 * _per_m(world) * d[:, None] + per_rad * phi[None, :])


def shown_by_standing(world: Arrays) -> Array:
    """Return the covariance (3, 3) of a pose measured by the camera frames of one stand, robot axes, m and rad.

    Information of the landmarks that are recognised on average: density * match * integral of H^T R^-1 H over the floor
    in view (H: range and bearing by the pose, R their noise), times the frames that arrive before the decision; scaled
    down where more would be seen than are used. A tilt common to all frames moves the pose by height * tilt, which no
    number of landmarks averages out.
    """
    stands = [row for row in world.tables.actions if row.kind == slots.STAND]
    if not stands:
        return np.eye(3) * VARIANCE_UNSEEN
    row, scene = stands[0], world.tables.scene[0]
    info, seen, half = np.zeros((3, 3)), 0.0, math.acos(row.cos_half)
    nr, na = 24, 24
    dr, da = (row.range_max - row.range_min) / nr, 2.0 * half / na
    for i in range(nr):
        r = row.range_min + (i + 0.5) * dr
        for j in range(na):
            a = -half + (j + 0.5) * da
            weight = scene.density * row.match * r * dr * da
            h_range = np.array([-math.cos(a), -math.sin(a), 0.0])
            h_bearing = np.array([math.sin(a) / r, -math.cos(a) / r, -1.0])
            var_range = row.sd_range**2 + (row.sd_share * r) ** 2
            info += weight * np.multiply.outer(h_range, h_range) / var_range
            info += weight * np.multiply.outer(h_bearing, h_bearing) / row.sd_bearing**2
            seen += weight
    frames = max(row.frames - row.late, 0.0)
    if seen <= 0.0 or frames <= 0.0:
        return np.eye(3) * VARIANCE_UNSEEN
    info *= frames * min(1.0, scene.most / seen)
    return inverse3(info)[0] + np.diag([(scene.height * scene.tilt_sd) ** 2] * 2 + [0.0])


def planner(world: Arrays, provenance: dict[str, str] | None = None) -> Policy:
    """Return the policy `planner` of a model, whose table of action values is computed by value iteration.

    `provenance`: texts by key on where the model comes from; None = none.
    """
    table, grid, _ = plan(world)
    tables = PolicyTables(PLANNER, planner_numbers(world), table, grid, shown_by_standing(world))
    return Policy("planner", world.names, tables, provenance or {})
