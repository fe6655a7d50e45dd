"""Routes over a grid: the cheapest path of cells (A*), straightened, as waypoints within viewing distance."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from surefoot.arrays import Array
from surefoot.errors import Refusal

from . import astar, straighten
from .costs import Costs, nearest_free
from .grid import Point

FARTHEST = 1e6
"""Largest coordinate of a start, goal or waypoint, m; a larger one is refused."""


class RouteError(Refusal):
    """Refusal of a route: `bad_point`, `outside` of the map, `blocked` start or goal, or `unreachable` goal."""

    def __init__(self, code: str, message: str, field: str, nearest: Point | None = None) -> None:
        super().__init__(code, message, field)
        self.nearest = nearest
        """Centre of the free cell nearest to the refused place, x, y in m, frame map; None = there is none.

        Where a goal is refused it is the nearest that the robot can reach."""


@dataclass(frozen=True)
class RouteLimits:
    """Limits of route planning, positive numbers."""

    leg: float = 1.0
    """Largest distance between consecutive waypoints, m: the viewing distance of the camera."""
    slack: float = 0.3
    """Largest distance of the start from the free cell at which a route begins, m; beyond it no route is planned. A
    robot beside a wall may leave it."""


@dataclass(frozen=True, eq=False)
class PlannedRoute:
    """Route to a goal in frame `map`: start and waypoints, m, length, m, cost, and clearance from obstacles, m."""

    start: Point
    """Start of the route, x, y in m, frame map."""
    waypoints: Array
    """Places to walk to in order, (n, 2) m, frame map; the last one is the goal."""
    length: float
    """Length of the route from the start over all waypoints, m."""
    cost: float
    """Cost of the path of cells, m, each step weighted by the nearness of obstacles (1 = far)."""
    clearance: float
    """Least distance from an obstacle, m; at most `Clearance.comfort`.

    Of a route by `surefoot.navigation.plan` it is exact; of a service's it is that of the cells that the route was
    straightened from."""


def plan(costs: Costs, start: Point, goal: Point, limits: RouteLimits | None = None) -> PlannedRoute:
    """Return the cheapest route from start to goal.

    Args:
        costs: costs of walking over the cells of a floor.
        start: x, y in m, frame map.
        goal: x, y in m, frame map.
        limits: distance of waypoints and of the start from free ground; None = the defaults.

    Raises:
        RouteError: a point is not finite, outside of the grid, or blocked, or the goal is out of reach; names the
            nearest free cell, of a goal the nearest that can be reached.
    """
    limits = limits or RouteLimits()
    start, goal = _checked(start, "start"), _checked(goal, "goal")
    begin, entry = _entry(costs, start, goal, limits)
    region = int(costs.region[begin])
    end = _free(costs, goal, "goal", region)
    if int(costs.region[end]) != region:
        near = _nearest(costs, goal, region)
        there = "none" if near is None else _shown(near)
        text = f"no way leads from {_shown(start)} to {_shown(goal)}; the nearest place that can be reached is {there}"
        raise RouteError("unreachable", text, "goal", near)
    wide, g = costs.weight.shape[1], costs.scratch
    marks = costs.marks if region == costs.marked else costs.marks[:, :0]
    first, last = begin[0] * wide + begin[1], end[0] * wide + end[1]
    astar.search(costs.weight, first, last, marks, g)
    path = astar.trace(costs.weight, first, last, g)
    ends = _padded(costs, entry), _padded(costs, goal)
    corners = straighten.pull(costs.weight, path, *ends[0], *ends[1])
    kept = straighten.kept_off(costs.wall, path, corners, ends, costs.clearance.radius / costs.grid.cell)
    centres = [_centre(costs, int(cell) // wide, int(cell) % wide) for cell in path[kept]]
    points = [*([start] if entry != start else ()), entry, *centres, goal]
    waypoints, length = _legs(points, limits.leg)
    cost = astar.cost_of(int(g[last])) / (2 * astar.STRAIGHT * astar.UNIT) * costs.grid.cell
    return PlannedRoute(start, waypoints, length, cost, costs.clearance_of(path))


def plan_out(
    around: Costs, through: Costs, start: Point, goal: Point, limits: RouteLimits | None = None
) -> PlannedRoute:
    """Return a route from a start in a part of the floor that is kept out of: the cheapest way out, then to the goal.

    Args:
        around: costs of walking over the cells of a floor; what is kept out of counts as an obstacle.
        through: costs of walking over the same cells without it.
        start: x, y in m, frame map.
        goal: x, y in m, frame map.
        limits: distance of waypoints and of the start from free ground; None = the defaults.

    Raises:
        RouteError: as `plan`; `unreachable` also if no way leads out.
    """
    limits = limits or RouteLimits()
    start, goal = _checked(start, "start"), _checked(goal, "goal")
    wanted = int(around.region[_free(around, goal, "goal")])
    begin, wide = _entry(through, start, goal, limits)[0], through.weight.shape[1]
    g = through.scratch
    astar.search(through.weight, begin[0] * wide + begin[1], astar.NOWHERE, through.marks[:, :0], g)
    costs = np.where(g < 0, -g.astype(np.int64) - 1, g)
    costs[around.region.ravel() != wanted] = astar.UNSEEN
    out = int(costs.argmin())
    if costs[out] == astar.UNSEEN:
        text = f"no way leads from {_shown(start)}, which is kept out of, to {_shown(goal)}"
        raise RouteError("unreachable", text, "goal")
    edge = _centre(around, out // wide, out % wide)
    first, rest = plan(through, start, edge, limits), plan(around, edge, goal, limits)
    return PlannedRoute(
        start, np.vstack((first.waypoints, rest.waypoints)), first.length + rest.length, first.cost + rest.cost,
        min(first.clearance, rest.clearance),
    )  # fmt: skip


def _checked(point: Point, field: str) -> Point:
    if len(point) != 2 or not all(math.isfinite(value) and abs(value) <= FARTHEST for value in point):
        raise RouteError("bad_point", f"{field} is two finite coordinates within {FARTHEST:g} m, got {point!r}", field)
    return (float(point[0]), float(point[1]))


def _entry(costs: Costs, start: Point, goal: Point, limits: RouteLimits) -> tuple[tuple[int, int], Point]:
    """Return padded cell (row, column) and position (m, frame map) at which a route begins.

    It is the start, or a free cell within `limits.slack` m of it, see `_way_out`.

    Raises:
        RouteError: the start is outside of the map, or blocked without such a cell.
    """
    try:
        return _free(costs, start, "start"), start
    except RouteError as error:
        near = error.nearest
        if error.code != "blocked" or near is None or math.dist(near, start) > limits.slack:
            raise
        row, col = costs.grid.index(*goal)
        wanted = int(costs.region[row + 1, col + 1]) if costs.grid.inside(row, col) else 0
        found = _way_out(costs, start, wanted, limits.slack)
        if found is None:
            raise
        return found, _centre(costs, *found)


def _way_out(costs: Costs, start: Point, wanted: int, slack: float) -> tuple[int, int] | None:
    """Return the padded free cell by which a blocked start is left, at most `slack` m away; None = walls are between.

    A straight line leads there that crosses no obstacle but, from its beginning on, one that holds the start itself. It
    is the nearest such cell of the region of the goal, else of any; where an obstacle holds the start and there is no
    such cell, the nearest of all.

    Args:
        costs: costs of walking over the cells of a floor.
        start: x, y in m, frame map.
        wanted: number of the goal's region, 0 = none.
        slack: m.
    """
    (r, c), reach = _padded(costs, start), slack / costs.grid.cell
    r0, c0 = max(0, int(r - reach)), max(0, int(c - reach))
    part = np.s_[r0 : int(r + reach) + 2, c0 : int(c + reach) + 2]
    passable = np.where(costs.wall[part], 0, astar.UNIT).astype(np.uint8)
    region = costs.region[part]
    rows, cols = np.nonzero(region)
    apart = np.hypot(rows + (r0 + 0.5) - r, cols + (c0 + 0.5) - c)
    for k in np.lexsort((apart, region[rows, cols] != wanted)).tolist():
        row, col = int(rows[k]), int(cols[k])
        if apart[k] <= reach + 1e-9 and straighten.leads_out(passable, r - r0, c - c0, row + 0.5, col + 0.5):
            return row + r0, col + c0
    if passable[int(r) - r0, int(c) - c0] > 0 or not rows.size:
        return None
    nearest = int(apart.argmin())
    return int(rows[nearest]) + r0, int(cols[nearest]) + c0


def _free(costs: Costs, point: Point, field: str, region: int = 0) -> tuple[int, int]:
    """Return row and column, in the padded arrays, of the cell that holds a point.

    Args:
        costs: costs of walking over the cells of a floor.
        point: x, y in m, frame map.
        field: name of the point in a refusal.
        region: number of the region of which a refusal names the nearest cell, 0 = any.

    Raises:
        RouteError: the point is outside of the map or blocked.
    """
    grid = costs.grid
    row, col = grid.index(*point)
    if not grid.inside(row, col):
        near = _nearest(costs, point, region)
        x0, y0, x1, y1 = grid.bounds
        text = f"{field} {_shown(point)} is outside of the map, x {x0:g} to {x1:g} m and y {y0:g} to {y1:g} m"
        raise RouteError("outside", text + _hint(near, region), field, near)
    if costs.weight[row + 1, col + 1] == 0:
        near, value = _nearest(costs, point, region), int(grid.cells[row, col])
        inside = value >= costs.clearance.obstacle
        unknown = value < 0 and not costs.clearance.through_unknown
        why = "in an obstacle" if inside else "unknown ground" if unknown else "too close to an obstacle"
        text = f"{field} {_shown(point)} is {why}; the robot needs {costs.clearance.radius:g} m around it"
        raise RouteError("blocked", text + _hint(near, region), field, near)
    return row + 1, col + 1


def _nearest(costs: Costs, point: Point, region: int) -> Point | None:
    row, col = _padded(costs, point)
    free = costs.region == region if region else costs.region > 0
    r, c, distance = nearest_free(free, row - 0.5, col - 0.5)
    return None if math.isinf(distance) else _centre(costs, r, c)


def _hint(near: Point | None, region: int) -> str:
    where = "place that can be reached" if region else "free cell"
    return "; there is no free cell" if near is None else f"; the nearest {where} is at {_shown(near)}"


def _padded(costs: Costs, point: Point) -> tuple[float, float]:
    """Return row and column of a point (m, frame map) in padded cells, cell i reaching from i to i + 1."""
    (x0, y0), cell = costs.grid.origin, costs.grid.cell
    x, y = costs.grid.aligned(*point)
    return (y - y0) / cell + 1.0, (x - x0) / cell + 1.0


def _centre(costs: Costs, row: int, col: int) -> Point:
    """Return the centre of a padded cell, m, frame map."""
    return costs.grid.centre(row - 1, col - 1)


def _shown(point: Point) -> str:
    return f"({point[0]:.3f}, {point[1]:.3f})"


def _legs(points: list[Point], leg: float) -> tuple[Array, float]:
    """Return waypoints on the lines through points, at most `leg` m apart, (n, 2) m, and the length of the lines, m.

    The first of the points, m, frame map, is where the robot is and no waypoint.
    """
    out: list[Point] = []
    total = 0.0
    for (ax, ay), (bx, by) in pairwise(points):
        length = math.hypot(bx - ax, by - ay)
        total += length
        pieces = max(1, math.ceil(length / leg - 1e-9))
        for i in range(1, pieces):
            out.append((ax + (bx - ax) * i / pieces, ay + (by - ay) * i / pieces))
        if length > 0.0 or not out:
            out.append((bx, by))
    return np.array(out), total
