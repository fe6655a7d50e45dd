"""Routes against scipy: distances, regions, cheapest costs; what a route has to be; points that are refused."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy import ndimage, sparse
from scipy.sparse.csgraph import dijkstra

from surefoot.errors import Refusal
from surefoot.services.navigator.planning import astar
from surefoot.services.navigator.planning import costs as costs_module
from surefoot.services.navigator.planning.costs import Clearance, prepare
from surefoot.services.navigator.planning.grid import FloorGrid
from surefoot.services.navigator.planning.route import RouteError, RouteLimits, plan
from tests.services.refusals import refused

TIGHT = Clearance(radius=0.0, comfort=0.3)


def random_grid(seed, rows=40, cols=60, share=0.1, cell=0.05):
    rng = np.random.default_rng(seed)
    cells = np.zeros((rows, cols), dtype=np.int8)
    for _ in range(int(share * rows * cols / 12)):
        r, c, h, w = rng.integers(rows), rng.integers(cols), rng.integers(1, 6), rng.integers(1, 6)
        cells[r : r + h, c : c + w] = 100
    return FloorGrid(cells, cell, (-1.0, 2.0))


def free_pair(costs, rng):
    """Two random points in free cells of one region."""
    while True:
        at = np.argwhere(costs.region > 0)
        a, b = at[rng.integers(len(at), size=2)]
        if costs.region[tuple(a)] == costs.region[tuple(b)]:
            shift = rng.uniform(-0.49, 0.49, 4) * costs.grid.cell
            p, q = costs.grid.centre(a[0] - 1, a[1] - 1), costs.grid.centre(b[0] - 1, b[1] - 1)
            return (p[0] + shift[0], p[1] + shift[1]), (q[0] + shift[2], q[1] + shift[3])


def graph(weight):
    """All steps with their costs, as a matrix."""
    w = (weight & astar.FACTOR).astype(np.int64)
    rows, cols, wide = *w.shape, w.shape[1]
    free, entries = w > 0, []
    for r, c in np.argwhere(free):
        for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
            a, b = r + dr, c + dc
            if 0 <= a < rows and 0 <= b < cols and free[a, b] and free[r, b] and free[a, c]:
                factor = astar.DIAGONAL if dr and dc else astar.STRAIGHT
                entries.append((r * wide + c, a * wide + b, factor * (w[r, c] + w[a, b])))
    i, j, cost = zip(*entries, strict=True)
    return sparse.csr_matrix((cost, (i, j)), shape=(w.size, w.size))


@pytest.mark.parametrize("seed", range(3))
def test_distances_are_those_of_scipy(seed):
    grid = random_grid(seed)
    wall = np.pad(grid.cells >= 65, 1, constant_values=True)
    expected = ndimage.distance_transform_edt(~wall)
    for most in (1, 5, 60):
        found = 0.5 * np.sqrt(costs_module.squared_distance(wall, most, 0))
        near = expected <= most
        assert found[near] == pytest.approx(expected[near])
        assert np.all(found[~near] > most)


def test_distances_from_squares_are_those_from_the_nearest_of_all():
    wall = np.pad(random_grid(0).cells >= 65, 1, constant_values=True)
    places = np.stack(np.indices(wall.shape), axis=-1)[:, :, None]
    apart = np.maximum(np.abs(places - np.argwhere(wall)) - 0.5, 0.0)
    expected = np.hypot(apart[..., 0], apart[..., 1]).min(axis=2)
    for most in (1, 5, 60):
        found = 0.5 * np.sqrt(costs_module.squared_distance(wall, most, 1))
        near = expected <= most - 0.5
        assert found[near] == pytest.approx(expected[near])
        assert np.all(found[~near] > most - 0.5)


@pytest.mark.parametrize("seed", range(3))
def test_regions_are_those_of_scipy(seed):
    costs = prepare(random_grid(seed, share=1.5), TIGHT)
    expected, count = ndimage.label(costs.weight > 0)
    assert costs.region.max() == count > 3
    pairs = np.unique(np.stack((expected.ravel(), costs.region.ravel())), axis=1)
    assert pairs.shape[1] == count + 1  # a one-to-one renaming


@pytest.mark.parametrize("marks", [False, True])
@pytest.mark.parametrize("share", [0.003, 0.02, 0.1, 0.3])
def test_no_path_is_cheaper(marks, share, monkeypatch):
    monkeypatch.setattr(costs_module, "LARGE", 10 if marks else 10**9)
    rng = np.random.default_rng(1)
    for seed in range(6):
        costs = prepare(random_grid(seed, share=share), TIGHT)
        assert costs.marks.shape[1] == (4 if marks else 0)
        steps, wide = graph(costs.weight), costs.weight.shape[1]
        for _ in range(6):
            start, goal = free_pair(costs, rng)
            a, b = ((r + 1) * wide + c + 1 for r, c in (costs.grid.index(*start), costs.grid.index(*goal)))
            expected = dijkstra(steps, directed=False, indices=a)[b]
            there, back = plan(costs, start, goal), plan(costs, goal, start)
            unit = 2 * astar.STRAIGHT * astar.UNIT
            assert there.cost * unit / costs.grid.cell == pytest.approx(expected, abs=1e-6)
            assert back.cost == pytest.approx(there.cost, abs=1e-9)


def test_every_leg_is_clear_and_within_viewing_distance():
    rng, radius = np.random.default_rng(2), 0.08
    for seed in range(10):
        costs = prepare(random_grid(seed, 80, 120), Clearance(radius=radius, comfort=0.3))
        walls = np.argwhere(costs.grid.cells >= 65) + 0.5
        walls = costs.grid.origin + walls[:, ::-1] * costs.grid.cell
        for _ in range(5):
            start, goal = free_pair(costs, rng)
            route = plan(costs, start, goal, RouteLimits(leg=0.7))
            points = np.vstack((start, route.waypoints))
            assert points[-1] == pytest.approx(goal)
            legs = np.hypot(*np.diff(points, axis=0).T)
            assert legs.max() <= 0.7 + 1e-9
            assert legs.sum() == pytest.approx(route.length)
            assert math.dist(start, goal) - 1e-9 <= route.length <= route.cost * 1.003 + 2 * costs.grid.cell
            for a, b in pairwise(points):
                line = a + np.linspace(0, 1, 40)[:, None] * (b - a)
                gap = np.sqrt(((line[:, None] - walls) ** 2).sum(axis=2)).min()
                assert gap > radius - 0.5 * math.sqrt(2) * costs.grid.cell  # of cell centres: half a diagonal less


@pytest.mark.parametrize("exact", [False, True])
def test_straightened_routes_keep_as_far_off_as_their_cells(exact):
    rng, bent = np.random.default_rng(3), 0
    for seed in range(25):
        costs = prepare(random_grid(seed, 50, 70, share=0.05), Clearance(radius=0.07, exact=exact))
        for _ in range(4):
            start, goal = free_pair(costs, rng)
            route = plan(costs, start, goal, RouteLimits(leg=1e3))
            ends = min(costs.clearance_along(np.array([point])) for point in (start, goal))
            beside = 0.0 if exact else (math.sqrt(0.5) - 0.5) * costs.grid.cell  # a corner
            assert costs.clearance_along(np.vstack((start, route.waypoints))) >= min(0.07, ends) - beside - 1e-9
            bent += len(route.waypoints) > 1
    assert bent > 20


@pytest.mark.parametrize("exact", [False, True])
def test_a_robot_that_keeps_its_radius_only_has_equal_costs_everywhere(exact):
    costs = prepare(random_grid(1), Clearance(radius=0.12, comfort=0.12, exact=exact))
    assert set((costs.weight & astar.FACTOR).ravel().tolist()) == {0, astar.UNIT}
    wall = np.pad(costs.grid.cells >= 65, 1, constant_values=True)
    assert not costs.weight[wall].any()


def test_in_the_open_the_route_is_straight():
    costs = prepare(FloorGrid(np.zeros((200, 200), dtype=np.int8), 0.05))
    route = plan(costs, (1.0, 1.0), (8.7, 5.3), RouteLimits(leg=100.0))
    assert route.waypoints.tolist() == [[8.7, 5.3]]
    assert route.length == pytest.approx(math.hypot(7.7, 4.3))
    assert route.clearance == pytest.approx(0.35)
    assert plan(costs, (1.0, 1.0), (1.0, 1.0)).waypoints.tolist() == [[1.0, 1.0]]
    assert plan(costs, (1.0, 1.0), (1.01, 1.01)).length == pytest.approx(0.01 * math.sqrt(2))


def test_a_wide_way_is_preferred_to_a_narrow_one():
    cells = np.zeros((60, 100), dtype=np.int8)
    cells[:, 48:52] = 100
    cells[26:35, 48:52] = 0  # 0.45 m wide, on the straight line
    cells[40:57, 48:52] = 0  # 0.85 m wide, a little aside
    costs = prepare(FloorGrid(cells, 0.05))
    through = [y for x, y in plan(costs, (1.5, 1.5), (3.5, 1.5), RouteLimits(leg=0.1)).waypoints if 2.4 < x < 2.6]
    assert min(through) > 2.0
    short = prepare(FloorGrid(cells, 0.05), Clearance(dearest=1.0))
    through = [y for x, y in plan(short, (1.5, 1.5), (3.5, 1.5), RouteLimits(leg=0.1)).waypoints if 2.4 < x < 2.6]
    assert max(through) < 1.8


def test_equal_requests_have_equal_routes():
    rng = np.random.default_rng(3)
    one, two = prepare(random_grid(4)), prepare(random_grid(4))
    for _ in range(5):
        start, goal = free_pair(one, rng)
        a, b = plan(one, start, goal), plan(two, start, goal)
        assert a.waypoints.tobytes() == b.waypoints.tobytes()


def corridor():
    """5 x 2 m with a wall across at x = 3 to 3.2 m."""
    cells = np.zeros((40, 100), dtype=np.int8)
    cells[:, 60:64] = 100
    cells[35:, 80:] = -1
    return prepare(FloorGrid(cells, 0.05))


@pytest.mark.parametrize(
    ("start", "goal", "code", "field", "nearest"),
    [
        ((1.0, 1.0), (4.0, 1.0), "unreachable", "goal", (2.825, 0.975)),
        ((1.0, 1.0), (3.1, 1.0), "blocked", "goal", (2.825, 0.975)),
        ((1.0, 1.0), (2.95, 1.0), "blocked", "goal", (2.825, 0.975)),
        ((1.0, 1.0), (4.5, 1.9), "blocked", "goal", None),
        ((1.0, 1.0), (7.0, 1.0), "outside", "goal", (2.825, 0.975)),
        ((1.0, 1.0), (1e9, 1.0), "bad_point", "goal", None),
        ((1.0, 1.0), (math.nan, 1.0), "bad_point", "goal", None),
        ((math.inf, 1.0), (1.0, 1.0), "bad_point", "start", None),
        ((-1.0, 1.0), (1.0, 1.0), "outside", "start", (0.175, 0.975)),
        ((5.1, 1.0), (1.0, 1.0), "outside", "start", (4.825, 0.975)),
    ],
)
def test_points_without_a_route_are_refused_with_the_nearest_that_has_one(start, goal, code, field, nearest):
    with refused(RouteError, code, field) as error:
        plan(corridor(), start, goal)
    if nearest is not None:
        assert error.value.nearest == pytest.approx(nearest)
        assert f"{nearest[0]:.3f}" in error.value.message
        plan(corridor(), error.value.nearest, error.value.nearest)


@pytest.mark.parametrize("seed", range(4))
def test_the_place_named_for_a_refused_goal_is_the_nearest_that_a_way_leads_to(seed):
    rng, seen, apart = np.random.default_rng(seed), set(), 0
    for _ in range(40):
        cells = np.where(rng.random((12, 12)) < 0.3, 100, 0).astype(np.int8)
        costs = prepare(FloorGrid(cells, 0.1), Clearance(radius=0.04, comfort=0.05))
        centres = [costs.grid.centre(*cell) for cell in np.argwhere(cells == 0).tolist()]
        start, goal = centres[rng.integers(len(centres))], tuple(rng.uniform(-0.2, 1.4, 2).tolist())
        try:
            plan(costs, start, goal)
        except RouteError as error:
            seen.add(error.code)
            found = error.nearest
        else:
            continue
        assert found is not None
        reached = [place for place in centres if leads(costs, start, place)]
        assert found in reached
        assert math.dist(found, goal) == pytest.approx(min(math.dist(place, goal) for place in reached))
        apart += math.dist(found, goal) > min(math.dist(place, goal) for place in centres) + 1e-9
    assert seen == {"blocked", "outside", "unreachable"}
    assert apart > 3


def leads(costs, start, goal):
    """Return whether there is a route."""
    try:
        plan(costs, start, goal)
    except RouteError:
        return False
    return True


def test_a_robot_beside_a_wall_may_walk_away_from_it():
    costs = corridor()
    route = plan(costs, (2.95, 1.0), (1.0, 1.0))
    assert (route.start, route.length) == ((2.95, 1.0), pytest.approx(1.95, abs=0.02))
    with refused(RouteError, "blocked", "start"):
        plan(costs, (2.95, 1.0), (1.0, 1.0), RouteLimits(slack=0.05))


def test_a_robot_between_walls_does_not_leave_through_one():
    cells = np.zeros((40, 60), dtype=np.int8)
    cells[:, [20, 25]] = 100  # 0.2 m between thin walls
    costs = prepare(FloorGrid(cells, 0.05), Clearance(radius=0.15))
    with pytest.raises(RouteError) as caught:
        plan(costs, (1.10, 1.20), (0.3, 0.6))  # the nearest free cell is behind the left wall
    assert caught.value.code == "blocked"
    assert plan(costs, (1.02, 1.20), (0.3, 0.6)).waypoints[-1].tolist() == [0.3, 0.6]  # in the wall: any way out
    cells[:] = 0
    cells[0:12, 20] = 100
    cells[:, 25] = 100
    niche = prepare(FloorGrid(cells, 0.05), Clearance(radius=0.12))
    route = plan(niche, (1.11, 0.55), (0.3, 0.3))  # free cells behind the wall are as near as those beyond its end
    assert niche.clearance_along(np.vstack((route.start, route.waypoints))) > 0.03


@pytest.mark.parametrize("seed", range(6))
def test_no_route_crosses_an_obstacle_unless_its_start_lies_in_one(seed):
    rng, left = np.random.default_rng(seed), 0
    for _ in range(60):
        cells = np.where(rng.random((24, 24)) < 0.05, 100, 0).astype(np.int8)
        costs = prepare(FloorGrid(cells, 0.05), Clearance(radius=0.05 * rng.choice([0.7, 1.5, 2.2])))
        start, goal = rng.uniform(0.0, 1.2, (2, 2)).tolist()
        try:
            route = plan(costs, start, goal)
        except RouteError:
            continue
        row, col = costs.grid.index(*start)
        if cells[row, col] == 0:
            left += costs.weight[row + 1, col + 1] == 0
            assert costs.clearance_along(np.vstack((start, route.waypoints))) > 0.0
    assert left > 2


def test_a_map_without_free_cells_refuses_everything():
    costs = prepare(FloorGrid(np.full((10, 10), -1, dtype=np.int8), 0.05))
    with pytest.raises(RouteError) as error:
        plan(costs, (0.2, 0.2), (0.3, 0.3))
    assert error.value.nearest is None
    unknown = FloorGrid(np.full((40, 40), -1, dtype=np.int8), 0.05)
    assert plan(prepare(unknown, Clearance(through_unknown=True)), (1, 1), (1, 1)).length == 0.0


@pytest.mark.parametrize(
    "bad",
    [
        {"radius": -0.1}, {"radius": math.nan}, {"comfort": 0.1}, {"dearest": 5.0}, {"dearest": 0.5}, {"obstacle": 0},
        {"comfort": math.inf},
    ],
)  # fmt: skip
def test_clearances_that_cannot_be_are_refused(bad):
    with pytest.raises(Refusal):
        Clearance(**bad)


@pytest.mark.parametrize("cell", [0.001, 0.05])
def test_the_widest_comfort_is_the_one_that_a_refusal_names(cell):
    grid = FloorGrid(np.zeros((10, 10), dtype=np.int8), cell)
    prepare(grid, Clearance(radius=0.0, comfort=200 * cell))
    with pytest.raises(Refusal, match=f"at most 200 cells, {200 * cell:g} m, got"):
        prepare(grid, Clearance(radius=0.0, comfort=200.01 * cell))
