"""Maps whose rows are turned in frame map: the same floor, described with and without a yaw, gives the same answers."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from surefoot import navigation
from surefoot.errors import SurefootError
from surefoot.schemas.hw import Range
from surefoot.services.navigator.aside import _free
from surefoot.services.navigator.config import NavigatorConfig
from surefoot.services.navigator.maps import Maps
from surefoot.services.navigator.planning.costs import prepare
from surefoot.services.navigator.planning.grid import FloorGrid
from surefoot.services.navigator.planning.map_files import load
from surefoot.services.navigator.planning.route import RouteError, plan
from surefoot.services.navigator.planning.seen import expected_echo

CELL, CORNER = 0.05, (-3.0, 2.0)
YAWS = (math.radians(30.0), -2.4, math.pi)


def floor(seed: int) -> FloorGrid:
    """Random boxes on a floor of 2 m by 3 m; some ground is unknown."""
    rng = np.random.default_rng(seed)
    cells = np.zeros((40, 60), dtype=np.int8)
    for value in (100, 100, 100, 100, 100, 100, 100, -1):
        r, c, h, w = rng.integers(40), rng.integers(60), rng.integers(1, 8), rng.integers(1, 8)
        cells[r : r + h, c : c + w] = value
    return FloorGrid(cells, CELL, CORNER)


def turned(point: tuple[float, float], yaw: float) -> tuple[float, float]:
    """A point turned about the corner of the grid, by complex numbers."""
    at = complex(*CORNER) + (complex(*point) - complex(*CORNER)) * complex(math.cos(yaw), math.sin(yaw))
    return at.real, at.imag


@pytest.mark.parametrize("yaw", YAWS)
def test_cells_keep_their_places_on_a_turned_floor(yaw: float) -> None:
    plain = floor(0)
    grid = replace(plain, yaw=yaw)
    for cell in ((0, 0), (0, 59), (39, 0), (39, 59), (17, 31)):
        assert grid.centre(*cell) == pytest.approx(turned(plain.centre(*cell), yaw), abs=1e-12)
        assert grid.index(*grid.centre(*cell)) == cell
    edges = [turned((x, y), yaw) for x in (-3.0, 0.0) for y in (2.0, 4.0)]
    assert grid.bounds == pytest.approx((*np.min(edges, axis=0), *np.max(edges, axis=0)))


def planned(grid: FloorGrid, start: tuple[float, float], goal: tuple[float, float]) -> Any:
    """The route, or the refusal of one."""
    try:
        return navigation.plan(grid, start, goal)
    except RouteError as error:
        return error


@pytest.mark.parametrize("yaw", YAWS)
def test_a_route_is_the_same_up_to_the_turn(yaw: float) -> None:
    routes = refusals = 0
    for seed in range(12):
        rng, plain = np.random.default_rng((1, seed)), floor(seed)
        grid = replace(plain, yaw=yaw)
        for _ in range(4):
            start, goal = (tuple(CORNER + rng.uniform((-0.1, -0.1), (3.1, 2.1))) for _ in range(2))
            ends = turned(start, yaw), turned(goal, yaw)
            want: Any = planned(plain, start, goal)
            got: Any = planned(grid, *ends)
            if isinstance(want, RouteError) or isinstance(got, RouteError):
                refusals += 1
                assert (got.code, got.field) == (want.code, want.field)
                assert got.nearest == pytest.approx(turned(want.nearest or (0.0, 0.0), yaw), abs=1e-9)
                continue
            routes += 1
            assert got.waypoints == pytest.approx(np.array([turned(tuple(p), yaw) for p in want.waypoints]), abs=1e-9)
            assert (got.length, got.cost, got.clearance) == pytest.approx((want.length, want.cost, want.clearance))
    assert routes > 10
    assert refusals > 5


@pytest.mark.parametrize("yaw", YAWS)
def test_echoes_of_a_turned_floor_are_the_same(yaw: float) -> None:
    rng = np.random.default_rng(3)
    for seed in range(5):
        plain = floor(seed)
        for _ in range(20):
            x, y, heading = (*(CORNER + rng.uniform((0.0, 0.0), (3.0, 2.0))), rng.uniform(-4.0, 4.0))
            half = (rng.uniform(0.1, 1.0), rng.uniform(0.0, 0.2))
            want = expected_echo(plain, (x, y, heading), half, 1.2, 65)
            at = (*turned((x, y), yaw), heading + yaw)
            assert expected_echo(replace(plain, yaw=yaw), at, half, 1.2, 65) == pytest.approx(want, abs=1e-9)


def files(tmp_path: Path, yaw: float) -> NavigatorConfig:
    """A free floor of 2 m by 3 m as files of map_server."""
    (tmp_path / "map.pgm").write_bytes(b"P5 60 40 255\n" + bytes([254]) * 2400)
    text = f"image: map.pgm\nresolution: {CELL}\norigin: [-3.0, 2.0, {yaw!r}]\noccupied_thresh: 0.65\nfree_thresh: 0.2"
    (tmp_path / "map.yaml").write_text(text)
    return NavigatorConfig(map=str(tmp_path / "map.yaml"))


@pytest.mark.parametrize("yaw", [0.0, *YAWS])
def test_a_file_with_a_yaw_is_walked_and_looked_at_like_one_without(tmp_path: Path, yaw: float) -> None:
    maps = Maps(files(tmp_path, yaw))
    message = maps.message()
    assert (message.origin, message.yaw) == ((-3.0, 2.0), pytest.approx(yaw))
    here, place, ahead = (turned(p, yaw) for p in ((-2.5, 3.0), (-0.5, 3.0), (-1.0, 3.0)))
    assert maps.ways(here, (place,))[0][-1] == pytest.approx(place)
    assert maps.enterable(here, ahead)
    reading = Range(distance=0.8, shortest=0.1, longest=2.0, field_of_view=0.6, bump=())
    assert maps.see(reading, (*here, yaw), (0.01, 0.01), 1.0)  # of nothing in the map, 0.8 m ahead
    assert not maps.free(here, (place,))
    aside = [turned(p, yaw) for p in ((-2.5, 3.5), (-0.5, 3.8))]
    assert maps.free(here, tuple(aside))
    (round_it,) = maps.ways(here, (place,))
    box = turned((-1.7, 3.0), yaw)
    assert min(math.dist(box, point) for point in round_it) > 0.2
    assert load(tmp_path / "map.yaml").yaw == pytest.approx(yaw)


@pytest.mark.parametrize("yaw", YAWS)
def test_walks_aside_of_a_lost_robot_are_free_on_a_turned_floor_where_they_are_on_the_plain_one(yaw: float) -> None:
    rng, plain = np.random.default_rng(8), floor(2)
    costs, other = prepare(plain), prepare(replace(plain, yaw=yaw))
    ends = np.array([(d * math.cos(a), d * math.sin(a)) for d in (0.4, 1.2) for a in np.linspace(-3.0, 3.0, 11)])
    found = set()
    for _ in range(20):
        x, y, heading = (*(CORNER + rng.uniform((0.2, 0.2), (2.8, 1.8))), rng.uniform(-3.0, 3.0))
        free = _free(np.array((x, y, heading)), ends, costs)
        assert (_free(np.array((*turned((x, y), yaw), heading + yaw)), ends, other) == free).all()
        found |= set(free.tolist())
    assert found == {True, False}


def test_an_array_may_be_turned_as_well() -> None:
    grid = navigation.grid(floor(0).cells, CELL, (*CORNER, 0.5))
    assert (grid.origin, grid.yaw) == (CORNER, 0.5)
    wrong: Any = ((0.0, 0.0, 30.0), (0.0, 0.0, math.nan), (0.0, 0.0, "0"), (0.0,), (0.0, 0.0, 0.0, 0.0))
    for origin in wrong:
        with pytest.raises(SurefootError) as found:
            navigation.grid(floor(0).cells, CELL, origin)
        assert found.value.field == "origin"


def test_routes_are_straight_and_end_where_asked_on_a_turned_floor() -> None:
    costs = prepare(FloorGrid(np.zeros((40, 60), dtype=np.int8), CELL, CORNER, yaw=0.7))
    start, goal = turned((-2.5, 3.0), 0.7), turned((-0.4, 3.4), 0.7)
    route = plan(costs, start, goal)
    assert route.length == pytest.approx(math.dist(start, goal))
    assert costs.clearance_along(np.array([start, turned((-2.9, 3.0), 0.7)])) == pytest.approx(0.1)
