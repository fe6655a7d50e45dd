"""Clearance of routes against a search over all obstacle cells, and predicted covariances against drawn motions."""

import math
from itertools import pairwise

import numpy as np
import pytest

import surefoot
from surefoot.errors import SurefootError
from surefoot.services.navigator.planning.gap import PIECE, gap

CELL, ORIGIN, RADIUS = 0.1, (-1.0, 2.0), 0.12


def sampled(start, waypoints, step=0.002):
    """Places on the route, at most `step` m apart."""
    points = [np.array(start)[None]]
    for a, b in pairwise(np.vstack((start, waypoints))):
        points.append(a + np.linspace(0.0, 1.0, 2 + int(math.dist(a, b) / step))[:, None] * (b - a))
    return np.concatenate(points)


def to_squares(places, squares, edge):
    """Least distance of places (n, 2) from squares with these centres (m, 2)."""
    apart = np.maximum(np.abs(places[:, None] - squares) - 0.5 * edge, 0.0)
    return float(np.hypot(apart[..., 0], apart[..., 1]).min())


def obstacles(cells):
    """Centres of the blocked cells, those of a frame around the grid included, (n, 2) m."""
    wall = np.pad((cells >= 65) | (cells < 0), 1, constant_values=True)
    return np.array(ORIGIN) + (np.argwhere(wall)[:, ::-1] - 0.5) * CELL


@pytest.mark.parametrize("seed", range(4))
def test_the_clearance_of_a_route_is_its_exact_distance_from_the_cells_of_obstacles(seed):
    rng = np.random.default_rng(seed)
    seen = 0
    for _ in range(12):
        cells = np.zeros((30, 40))
        at = rng.integers((30, 40), size=(14, 2))
        cells[at[:, 0], at[:, 1]] = rng.choice([100, -1], 14)
        floor = surefoot.navigation.grid(cells, CELL, ORIGIN)
        start, goal = np.array(ORIGIN) + rng.uniform((0.2, 0.2), (3.8, 2.8), (2, 2))
        try:
            route = surefoot.navigation.plan(floor, start, goal, radius=RADIUS, leg=rng.choice([0.3, 1e3]))
        except SurefootError:  # a point in an obstacle
            continue
        seen += 1
        true = to_squares(sampled(start, route.waypoints), obstacles(cells), CELL)
        expected = min(true, RADIUS + 0.2)
        assert expected - 0.001 <= route.clearance <= expected + 1e-12  # the samples lie up to 1 mm from the nearest
    assert seen > 3


def test_beside_a_corner_of_an_obstacle_the_clearance_is_not_longer_than_the_way_to_it():
    cells = np.zeros((40, 40))
    cells[20, 20] = 100
    floor = surefoot.navigation.grid(cells, CELL)
    place = floor.centre(22, 22)  # 1.5 cells right and above of the corner
    route = surefoot.navigation.plan(floor, place, place, radius=0.1)
    assert route.clearance == pytest.approx(0.15 * math.sqrt(2))


def test_the_gap_beside_a_long_line_is_found_and_one_that_crosses_a_cell_has_none():
    wall = np.zeros((2000, 2000), dtype=bool)
    wall[1500, 1490] = True
    ends = [(0.5, 0.5), (1990.5, 1990.5)]
    assert 20 * PIECE < 1990
    assert gap(wall, ends, 100.0) == pytest.approx(9 / math.sqrt(2))
    assert gap(wall, ends, 5.0) == 5.0
    assert gap(wall, [(1500.5, 0.0), (1500.5, 2000.0)], 5.0) == 0.0
    assert gap(wall, [(1500.1, 1490.1)], 5.0) == 0.0
    assert gap(wall, [(1502.0, 1490.5)], 5.0) == pytest.approx(1.0)
    assert gap(wall, [(-50.0, -50.0)], 5.0) == 5.0


@pytest.mark.parametrize(
    ("forward", "left", "turn", "sd"),
    [
        (1.0, 0.0, 0.0, (0.0, 0.0, 0.2)),
        (1.0, 0.0, 0.0, (0.02, 0.01, 0.1)),
        (-0.6, 0.3, 1.1, (0.01, 0.03, 0.15)),
        (0.1, 0.0, 0.2, (0.01, 0.01, 0.02)),
    ],
)
def test_an_unsure_turn_spreads_the_end_of_the_path_as_drawn_motions_do(forward, left, turn, sd):
    rng, n = np.random.default_rng(7), 400_000
    pose, cov = np.array([2.0, -1.0, 0.7]), np.diag([1e-4, 4e-4, 0.01])
    one = surefoot.navigation.PoseFilter(pose, cov)
    one.predict(forward=forward, left=left, turn=turn, sd=sd)
    x, y, theta = (pose + rng.normal(size=(n, 3)) * np.sqrt(np.diag(cov))).T
    ahead, side, by = (np.array([forward, left, turn]) + rng.normal(size=(n, 3)) * sd).T
    half = theta + 0.5 * by
    ends = np.stack((x + ahead * np.cos(half) - side * np.sin(half), y + ahead * np.sin(half) + side * np.cos(half)))
    drawn = np.cov(np.vstack((ends, theta + by)))
    size = np.sqrt(np.diag(drawn))
    assert one.covariance / np.outer(size, size) == pytest.approx(drawn / np.outer(size, size), abs=0.03)
    assert (one.covariance == one.covariance.T).all()


def test_the_position_is_unsure_across_the_path_by_half_the_turns_deviation_times_the_distance():
    one = surefoot.navigation.PoseFilter(covariance=np.zeros((3, 3)))
    one.predict(forward=2.0, sd=(0.0, 0.0, 0.1))
    assert one.covariance == pytest.approx(np.array([[0, 0, 0], [0, 0.01, 0.01], [0, 0.01, 0.01]]), abs=1e-15)
    assert one.pose == pytest.approx([2.0, 0.0, 0.0])


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("radius", [0.0, 0.04, 0.12, 0.27])
def test_no_part_of_a_route_comes_nearer_to_obstacles_than_the_radius_or_its_ends(seed, radius):
    rng, seen = np.random.default_rng((seed, 7)), 0
    for _ in range(30):
        cells = np.zeros((30, 40))
        at = rng.integers((30, 40), size=(10, 2))
        cells[at[:, 0], at[:, 1]] = rng.choice([100, -1], 10)
        floor, squares = surefoot.navigation.grid(cells, CELL, ORIGIN), obstacles(cells)
        start, goal = np.array(ORIGIN) + rng.uniform((0.2, 0.2), (3.8, 2.8), (2, 2))
        try:
            route = surefoot.navigation.plan(floor, start, goal, radius=radius, leg=1e3)
        except SurefootError:  # a point in an obstacle, or no way
            continue
        seen += 1
        ends = min(to_squares(point[None], squares, CELL) for point in (start, goal))
        least = to_squares(sampled(start, route.waypoints, 0.005), squares, CELL)
        assert least >= min(radius, ends) - (1e-9 if ends >= radius + CELL else 0.06 * CELL)
    assert seen > 3


@pytest.mark.parametrize("wide", [3, 5, 6, 9])
@pytest.mark.parametrize("thick", [1, 4])
def test_a_door_is_passed_by_all_robots_that_its_middle_cells_leave_room_for(wide, thick):
    cells = np.zeros((31, 40))
    cells[:, 20 : 20 + thick] = 100
    cells[12 : 12 + wide, 20 : 20 + thick] = 0
    floor = surefoot.navigation.grid(cells, CELL)
    room = 0.5 * CELL * (wide if wide % 2 else wide - 1)  # from the centre of the middle cell to the jambs
    route = surefoot.navigation.plan(floor, (0.95, 1.5), (3.15, 1.2), radius=room, leg=1e3)
    assert route.clearance >= room - 1e-9
    with pytest.raises(SurefootError, match="no way"):
        surefoot.navigation.plan(floor, (0.95, 1.5), (3.15, 1.2), radius=room + 0.001)
