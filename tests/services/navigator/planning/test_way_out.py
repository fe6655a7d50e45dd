"""Where a route begins whose start is blocked: by a cell on the robot's side of the walls, that leads to the goal."""

import math
from typing import Any, cast

import numpy as np
import pytest
from scipy import ndimage

from surefoot.services.navigator.planning.costs import Clearance, Costs, prepare
from surefoot.services.navigator.planning.grid import FloorGrid
from surefoot.services.navigator.planning.route import RouteError, RouteLimits, plan

CELL, SLACK = 0.05, 0.3


def crosses(walls: np.ndarray, begin: np.ndarray, end: np.ndarray, grown: float) -> bool:
    """Return True if a line enters a wall, each of its squares grown by a part of a cell, after it has left the first.

    Sampled at 150 points; `begin`, `end`: x, y in cells.
    """
    points = begin + np.linspace(0.0, 1.0, 150)[:, None] * (end - begin)
    squares = np.argwhere(walls)[:, ::-1] + 0.5
    squares = squares[np.abs(squares - begin).max(axis=1) < SLACK / CELL + 1.0]
    inside = (np.abs(points[:, None] - squares).max(axis=2) < 0.5 + grown).any(axis=1)
    return bool(inside[int(np.argmin(inside)) :].any()) if not inside.all() else True


def ways(costs: Costs, start: np.ndarray, region: np.ndarray, grown: float) -> np.ndarray:
    """Distance, m, of the nearest free cell in each region that a line leads to within the slack; inf = none."""
    found = np.full(int(region.max()) + 1, math.inf)
    walls = costs.grid.cells >= 65
    cells = np.argwhere(region > 0)
    apart = CELL * np.hypot(*(cells[:, ::-1] + 0.5 - start).T)
    for k in np.argsort(apart):
        row, col = cells[k]
        open_yet = math.isinf(found[region[row, col]]) and apart[k] < SLACK + 1e-9
        if open_yet and not crosses(walls, start, np.array((col + 0.5, row + 0.5)), grown):
            found[region[row, col]] = apart[k]
    return found


def test_a_blocked_start_is_left_on_its_side_of_the_walls_towards_the_goal() -> None:
    """Against a flood fill and sampled lines, on random floors of thin walls and posts."""
    counts = {"there": 0, "not nearest": 0, "cut off": 0, "walled in": 0}
    for seed in range(60):
        rng = np.random.default_rng((seed, 7))
        cells = np.where(rng.random((24, 24)) < 0.02, 100, 0).astype(np.int8)
        cells[rng.integers(6, 18)], cells[:, rng.integers(6, 18)] = 100, 100
        costs = prepare(FloorGrid(cells, CELL), Clearance(radius=CELL * float(rng.choice([1.2, 2.2]))))
        free = costs.weight[1:-1, 1:-1] > 0
        region = np.asarray(cast(Any, ndimage.label(free))[0])  # a flood fill over edges
        if not free.any():
            continue
        for _ in range(10):
            start = rng.uniform(1.0, 23.0, 2)
            row, col = (int(v) for v in start[::-1])
            goal = np.argwhere(free)[rng.integers(free.sum())][::-1] + 0.5
            if free[row, col] or cells[row, col]:
                continue
            wanted = region[int(goal[1]), int(goal[0])]
            strict, lax = (ways(costs, start, region, grown) for grown in (1e-3, -1e-3))
            try:
                route = plan(costs, tuple(CELL * start), tuple(CELL * goal), RouteLimits(slack=SLACK, leg=10.0))
            except RouteError as error:
                assert math.isinf(strict[wanted]), seed
                counts["cut off" if error.code == "unreachable" else "walled in"] += 1
                if error.code == "blocked":
                    assert math.isinf(strict.min())
                continue
            entry = route.waypoints[0]
            assert lax[wanted] - 1e-9 <= math.dist(entry, CELL * start) <= strict[wanted] + 1e-9, seed
            counts["there"] += 1
            counts["not nearest"] += strict.min() < strict[wanted]
    assert min(counts.values()) > 3, counts


@pytest.mark.parametrize("turn", range(4))
def test_a_start_inside_a_wall_is_left_towards_the_goal(turn: int) -> None:
    """The wall is 0.1 m thick and parts the floor; the side that is nearer does not lead to the goal."""
    cells = np.zeros((40, 40), dtype=np.int8)
    cells[:, 20:22] = 100
    cells = np.rot90(cells, turn).copy()
    costs = prepare(FloorGrid(cells, CELL), Clearance(radius=0.1))
    for x in (1.01, 1.04, 1.06, 1.09):
        for goal in ((0.4, 0.4), (1.6, 0.4)):
            points = [np.array((x, 1.0)), np.array(goal)]
            for _ in range(turn):
                points = [np.array((p[1], 2.0 - p[0])) for p in points]
            route = plan(costs, tuple(points[0]), tuple(points[1]))
            assert route.waypoints[-1] == pytest.approx(points[1])
            assert route.length < 1.2 * math.dist(*points) + 0.1
