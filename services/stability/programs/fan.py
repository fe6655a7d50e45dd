"""A fan of support directions around a region: inner and outer polygon, refined where it matters.

Region C (convex), support value h(a) = max over C of a'c, support point y(a). For neighbours a_k, a_l of the fan the
border of C runs inside the triangle (y_k, o, y_l), o the crossing of the two support lines: inner polygon = hull of
the y_k, outer = the support lines (Bretl and Lall 2008). All in the scaled frame of `reduced`.
"""

import math
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array, Ints
from surefoot.geometry.polygon import area, half_planes, hull
from surefoot.kernels.jit import row_kernel

from .chords import beyond_chords
from .interior import FAILED, SOLVED, solve_lanes
from .lanes import LANES
from .reduced import THIN, Reduced

PARALLEL = 1e-9  # neighbours whose directions differ by less are not split further
NEAR = 0.98  # share of the neighbours' answers in the start of a direction between them
FEW, FEW_AT_ONCE = 16, 4  # with no more directions than that the batches are small, to use what the last one showed
SLIM = 1e-5  # area / diameter^2 below which the width is looked at
UNSETTLED = 1e-8  # of the largest support value: a margin further from its lower bound is not taken for an answer
SAME = 1e-13  # support points nearer than that are one point


class Fan(NamedTuple):
    """Solved directions a of a region: support values h(a), points and forces, in order of request, scaled frame."""

    direction: Array  # (cap, 2) unit
    value: Array  # (cap,) h(a)
    point: Array  # (cap, 2) y(a)
    unknown: Array  # (cap, 4) solution of the reduced dual
    force: Array  # (cap, n, 3) cone coordinates
    error: Array  # (cap,) largest of residuals and gap
    status: Ints  # (cap,) as in `interior`
    order: Ints  # (cap,)


ANSWER, ENCLOSE, APPROACH = 0, 1, 2
"""Kinds of goals: `ANSWER`: the given directions only; `ENCLOSE`: outer polygon close to inner; `APPROACH`: edge
nearest to a point."""


class FanGoal(NamedTuple):
    """Aim of the choice of further directions: ANSWER (none), ENCLOSE (close polygons), APPROACH (nearest edge)."""

    kind: int
    tolerance: float
    """Largest accepted distance of outer from inner polygon (ENCLOSE), of best value from bound (APPROACH), scaled."""
    x: float
    y: float
    """Coordinates x and y of the point p to approach, scaled frame; read for the goal APPROACH only."""


class Outlook(NamedTuple):
    """Progress of a fan of directions towards its goal: best value so far, bound on it, and best direction."""

    best: float
    """Largest distance of outer from inner polygon (ENCLOSE); smallest h(a) - a'p of support values h (APPROACH)."""
    bound: float
    """Lower bound of the smallest h(a) - a'p over all unit directions a, h the support value, p the goal's point."""
    arg: int
    """Index of the direction of the fan to which `best` belongs (APPROACH)."""


ASKED = FanGoal(ANSWER, 0.0, 0.0, 0.0)


@row_kernel
def new_fan(capacity: int, contacts: int) -> Fan:
    """Return a fan (answers of a region by direction) with room for `capacity` directions and `contacts` contacts."""
    return Fan(
        np.empty((capacity, 2)),
        np.empty(capacity),
        np.empty((capacity, 2)),
        np.empty((capacity, 4)),
        np.empty((capacity, contacts, 3)),
        np.empty(capacity),
        np.empty(capacity, dtype=np.int64),
        np.empty(capacity, dtype=np.int64),
    )


@row_kernel
def evaluate(r: Reduced, fan: Fan, begin: int, end: int) -> bool:
    """Solve programs `r` for directions begin .. end - 1 of `fan`, write the answers there; True if all are solved."""
    a, h, c = r.a, r.h, r.c
    n = a.shape[0]
    lanes = LANES if end - begin > 2 else end - begin  # eight cost as much as two: a row is one vector
    rhs, x = np.empty((n, 3, lanes)), np.empty((n, 3, lanes))
    lam, error, status = np.empty((4, lanes)), np.empty(lanes), np.empty(lanes, dtype=np.int64)
    fine = True
    for first in range(begin, end, LANES):
        share = NEAR
        for k in range(lanes):
            s = min(first + k, end - 1)  # spare lanes repeat the last direction
            if share > 0.0 and not _between(fan, begin, s, lam, x, k):
                share = 0.0
            ax, ay = fan.direction[s, 0], fan.direction[s, 1]
            for i in range(n):
                for q in range(3):
                    rhs[i, q, k] = ax * h[i, q, 0] + ay * h[i, q, 1]
        solve_lanes(a, rhs, c, lam, x, error, status, share)
        for k in range(min(lanes, end - first)):
            s = first + k
            fan.status[s], fan.error[s] = status[k], error[k]
            if status[k] == FAILED:
                fine = False
                continue
            fine = fine and status[k] == SOLVED
            value = 0.0
            for j in range(4):
                fan.unknown[s, j] = lam[j, k]
                value += c[j] * lam[j, k]
            px, py = 0.0, 0.0
            for i in range(n):
                for q in range(3):
                    fan.force[s, i, q] = x[i, q, k]
                    px += h[i, q, 0] * x[i, q, k]
                    py += h[i, q, 1] * x[i, q, k]
            fan.value[s], fan.point[s, 0], fan.point[s, 1] = value, px, py
    return fine


@row_kernel
def _between(fan: Fan, solved: int, s: int, lam: Array, x: Array, lane: int) -> bool:
    """Write a feasible start for direction `s` of a fan, made of the answers on both sides of it, into column `lane`.

    With unit directions a_s = p a_k + q a_m, p, q >= 0, of neighbours k and m, p lam_k + q lam_m is feasible, and so is
    any mean of forces. lam (4, lanes): twists; x (n, 3, lanes): forces. False: none among the `solved` ones.
    """
    if solved < 3:
        return False
    ax, ay = fan.direction[s, 0], fan.direction[s, 1]
    angle, j = _angle(ax, ay), 0
    while j < solved and _angle(fan.direction[fan.order[j], 0], fan.direction[fan.order[j], 1]) < angle:
        j += 1
    k, m = fan.order[j - 1 if j > 0 else solved - 1], fan.order[j if j < solved else 0]
    bx, by, dx, dy = fan.direction[k, 0], fan.direction[k, 1], fan.direction[m, 0], fan.direction[m, 1]
    det = bx * dy - by * dx
    if det < PARALLEL or bx * dx + by * dy < 0.0:
        return False
    p, q = (ax * dy - ay * dx) / det, (bx * ay - by * ax) / det
    for i in range(4):
        lam[i, lane] = p * fan.unknown[k, i] + q * fan.unknown[m, i]
    p, q = p / (p + q), q / (p + q)
    for i in range(x.shape[0]):
        for d in range(3):
            x[i, d, lane] = p * fan.force[k, i, d] + q * fan.force[m, i, d]
    return True


@row_kernel
def _angle(x: float, y: float) -> float:
    """Return a number from 0 to 4 that grows with the angle of the vector (x, y), counter-clockwise from 0 at +x."""
    t = y / (abs(x) + abs(y))
    if x < 0.0:
        return 2.0 - t
    return t if y >= 0.0 else 4.0 + t


@row_kernel
def insert(fan: Fan, begin: int, end: int) -> None:
    """Sort directions begin .. end - 1 of a fan, by rising angle, into the indices fan.order, sorted up to `begin`."""
    for s in range(begin, end):
        angle, j = _angle(fan.direction[s, 0], fan.direction[s, 1]), s
        while j > 0:
            k = fan.order[j - 1]
            if _angle(fan.direction[k, 0], fan.direction[k, 1]) <= angle:
                break
            fan.order[j] = k
            j -= 1
        fan.order[j] = s


@row_kernel
def triangle(fan: Fan, k: int, m: int) -> tuple[float, float, float, float]:
    """Return outward normal x, y, height and area of the triangle over the edge between points k and m, or zeros."""
    ax, ay, bx, by = fan.direction[k, 0], fan.direction[k, 1], fan.direction[m, 0], fan.direction[m, 1]
    ex, ey = fan.point[m, 0] - fan.point[k, 0], fan.point[m, 1] - fan.point[k, 1]
    length, det = math.hypot(ex, ey), ax * by - ay * bx
    if length < SAME or det < PARALLEL:
        return 0.0, 0.0, 0.0, 0.0
    nx, ny = ey / length, -ex / length
    u, v = fan.value[k], fan.value[m]
    ox, oy = (u * by - v * ay) / det, (v * ax - u * bx) / det
    height = nx * (ox - fan.point[k, 0]) + ny * (oy - fan.point[k, 1])
    size, along = 0.5 * height * length, nx * (oy - fan.point[k, 1]) - ny * (ox - fan.point[k, 0])
    if along < 0.0 or along > length:  # o lies over none of the edge but beyond its end
        height = math.hypot(height, max(-along, along - length))
    return nx, ny, height, size


@row_kernel
def wide_triangles(fan: Fan, count: int, goal: FanGoal, pick: Array, room: int) -> tuple[int, Outlook]:
    """Write outward unit normals of the inner polygon's edges with the largest triangles over them to `pick` (8, 2).

    Triangles lie between an edge and the support lines of the fan's `count` answers, higher than the goal's tolerance.
    Return the number of normals, at most `room`, and the outlook: `best` is the largest height.
    """
    rank, gap, wanted = np.empty(LANES), 0.0, 0
    for i in range(count):
        nx, ny, height, size = triangle(fan, fan.order[i], fan.order[(i + 1) % count])
        gap = max(gap, height)
        if height <= goal.tolerance or room == 0 or (wanted == room and size <= rank[wanted - 1]):
            continue
        j = min(wanted, room - 1)
        wanted = min(wanted + 1, room)
        while j > 0 and rank[j - 1] < size:
            rank[j], pick[j, 0], pick[j, 1] = rank[j - 1], pick[j - 1, 0], pick[j - 1, 1]
            j -= 1
        rank[j], pick[j, 0], pick[j, 1] = size, nx, ny
    return wanted, Outlook(gap, 0.0, 0)


@row_kernel
def near_arcs(fan: Fan, count: int, goal: FanGoal, pick: Array, room: int) -> tuple[int, Outlook]:
    """Find the unit direction a of least h(a) - a'p: distance of p, the goal's point, to the border, negative outside.

    Between neighbours of the fan's `count` directions the edge between their points bounds it from below; arcs with a
    bound below the best are split. Return the number of directions put to `pick` (8, 2), at most `room`; best value,
    bound, index.
    """
    rank, best, arg, wanted = np.empty(LANES), math.inf, 0, 0
    for s in range(count):
        value = fan.value[s] - fan.direction[s, 0] * goal.x - fan.direction[s, 1] * goal.y
        if value < best:
            best, arg = value, s
    bound = best
    for i in range(count):
        dx, dy, low = _arc_bound(fan, fan.order[i], fan.order[(i + 1) % count], goal.x, goal.y)
        bound = min(bound, low)
        if low >= best - goal.tolerance or room == 0 or (wanted == room and low >= rank[wanted - 1]):
            continue
        j = min(wanted, room - 1)
        wanted = min(wanted + 1, room)
        while j > 0 and rank[j - 1] > low:
            rank[j], pick[j, 0], pick[j, 1] = rank[j - 1], pick[j - 1, 0], pick[j - 1, 1]
            j -= 1
        rank[j], pick[j, 0], pick[j, 1] = low, dx, dy
    if wanted > 0:
        for k in range(room - wanted):  # spare lanes: ever closer to the most promising direction, on both sides
            turn = math.ldexp(0.25, -3 * (k // 2)) * (1.0 if k % 2 == 0 else -1.0)
            dx, dy = pick[0, 0] - turn * pick[0, 1], pick[0, 1] + turn * pick[0, 0]
            norm = math.hypot(dx, dy)
            pick[wanted + k, 0], pick[wanted + k, 1] = dx / norm, dy / norm
        wanted = room
    return wanted, Outlook(best, bound, arg)


@row_kernel
def _arc_bound(fan: Fan, k: int, m: int, px: float, py: float) -> tuple[float, float, float]:
    """Return a unit d (x, y) where h(d) - d'p can be least between neighbours k, m, and the bound; p = (px, py)."""
    ax, ay, bx, by = fan.direction[k, 0], fan.direction[k, 1], fan.direction[m, 0], fan.direction[m, 1]
    ux, uy = fan.point[k, 0] - px, fan.point[k, 1] - py
    vx, vy = fan.point[m, 0] - px, fan.point[m, 1] - py
    if ax * by - ay * bx < PARALLEL:
        return ax, ay, math.inf
    ex, ey = vx - ux, vy - uy
    length = math.hypot(ex, ey)
    nx, ny = (ax + bx), (ay + by)
    low = math.inf
    if length > SAME:
        nx, ny = ey / length, -ex / length
        if ax * ny - ay * nx < 0.0:  # rounding: the edge was found already, its normal is one of the neighbours
            nx, ny = ax, ay
        elif nx * by - ny * bx < 0.0:
            nx, ny = bx, by
        low = nx * ux + ny * uy
    else:
        norm = math.hypot(nx, ny)
        nx, ny = nx / norm, ny / norm
        low = min(ax * ux + ay * uy, bx * ux + by * uy)
    dx, dy = nx, ny
    for side in range(2):
        wx, wy = (ux, uy) if side == 0 else (vx, vy)
        norm = math.hypot(wx, wy)
        if norm < SAME or -norm >= low:
            continue
        tx, ty = -wx / norm, -wy / norm
        lx, ly, rx, ry = (ax, ay, nx, ny) if side == 0 else (nx, ny, bx, by)
        if length <= SAME:
            lx, ly, rx, ry = ax, ay, bx, by
        if lx * ty - ly * tx > 0.0 and tx * ry - ty * rx > 0.0:
            low, dx, dy = -norm, tx, ty
    return dx, dy, low


@row_kernel
def wide(fan: Fan, count: int) -> tuple[bool, Array, float]:
    """Return True if the first `count` points of a fan span an area, their hull (e, 2) and its diameter, scaled."""
    inner, size = hull(fan.point[:count]), 0.0
    for k in range(inner.shape[0]):
        for j in range(k):
            size = max(size, math.hypot(inner[j, 0] - inner[k, 0], inner[j, 1] - inner[k, 1]))
    return size > THIN and area(inner) > SLIM * size * size, inner, size


@row_kernel
def heights(fan: Fan, count: int) -> Array:
    """Return height and area of the triangle over each inner edge, (count, 2), by rising angle, scaled lengths."""
    out = np.empty((count, 2))
    for i in range(count):
        _, _, out[i, 0], out[i, 1] = triangle(fan, fan.order[i], fan.order[(i + 1) % count])
    return out


@row_kernel
def settled(fan: Fan, count: int, outlook: Outlook) -> bool:
    """Return True if the margin of a point p is as close to its lower bound, in `outlook`, as the solver is exact.

    The margin is the smallest h(a) - a'p over unit directions a, with h(a) the support value of the region.
    True also where the fan is full, with `count` answers (the middle of a circle: all directions are equally near).
    """
    if count == fan.value.size:
        return True
    size = 1.0
    for k in range(count):
        size = max(size, abs(fan.value[k]))
    return outlook.best - outlook.bound <= UNSETTLED * size


@row_kernel
def explore(
    r: Reduced, fan: Fan, solved: int, count: int, goal: FanGoal, limit: int, batch: int
) -> tuple[int, bool, Outlook]:
    """Solve for the directions of a fan, then for those that a goal requires; the only kernel with the solver.

    Args:
        r: cone programs of the contact set.
        fan: its first `solved` directions have answers and an order; the rest up to `count` are to be answered.
        solved: number of directions with an answer.
        count: number of directions given.
        goal: aim of further directions.
        limit: most directions in the end, <= capacity of the fan.
        batch: most directions at once, <= 8: with fewer each choice uses more answers, with more the solver is faster.

    Returns:
        Number of answers, True if all given ones are solved, and the progress towards the goal.
    """
    pick, fine, outlook = np.empty((LANES, 2)), False, Outlook(math.inf, -math.inf, 0)
    while True:
        if count > solved:
            if not evaluate(r, fan, solved, count):
                break  # later than at first it is numerically at the end: what was there stays valid
            insert(fan, solved, count)
        solved, fine = count, True
        room = min(batch, limit - count)
        if goal.kind == ANSWER:
            break
        if goal.kind == ENCLOSE:
            wanted, outlook = wide_triangles(fan, count, goal, pick, room)
        else:
            wanted, outlook = near_arcs(fan, count, goal, pick, room)
        if wanted == 0:
            break
        for k in range(wanted):
            fan.direction[count + k, 0], fan.direction[count + k, 1] = pick[k, 0], pick[k, 1]
        count += wanted
    return solved, fine, outlook


@row_kernel
def enclose(
    r: Reduced, fan: Fan, solved: int, count: int, goal: FanGoal, limit: int, batch: int
) -> tuple[int, bool, float, Array, Array]:
    """Solve for `count` directions of a fan, `solved` of which are, and those a goal requires; return the polygons.

    At most `limit` directions are answered, `batch` at once. ENCLOSE adds points beyond edges to the inner polygon.
    Returned are the number of answers, True if the region has an area, `best` of the outlook (ENCLOSE: largest height
    between the polygons), inner (e, 2) and outer polygon (o, 2), scaled lengths.
    """
    count, fine, outlook = explore(r, fan, solved, count, goal, limit, batch)
    if not fine:
        return count, False, outlook.best, fan.point[:0], fan.point[:0]
    over = heights(fan, count)
    fine, inner, size = wide(fan, count)
    if not fine:
        return count, False, outlook.best, inner, inner
    if goal.kind == ENCLOSE:
        more = beyond_chords(r, fan.order, fan.point, fan.force, over, goal.tolerance, area(inner))
        if more.shape[0] > 0:
            inner = hull(np.concatenate((inner, more)))
    far = 0.0
    for k in range(count):
        far = max(far, abs(fan.value[k]))
    outer = hull(half_planes(fan.direction[:count], fan.value[:count], 8.0 * (size + far)))
    return count, True, outlook.best, inner, outer


def with_room(fan: Fan, count: int, capacity: int) -> Fan:
    """Return a copy of a fan with its first `count` answers, and room for `capacity` of them."""
    copy = new_fan(capacity, fan.force.shape[1])
    for mine, theirs in zip(copy, fan, strict=True):
        mine[:count] = theirs[:count]
    return copy
