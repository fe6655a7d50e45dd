"""Zones against brute force: what they touch, routes around and out of them, speed limits, files that are refused."""

import math
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

from surefoot.errors import Refusal
from surefoot.services.navigator.config import NavigatorConfig
from surefoot.services.navigator.maps import Maps
from surefoot.services.navigator.planning.grid import FloorGrid, Point
from surefoot.services.navigator.planning.map_files import MapFileError
from surefoot.services.navigator.planning.zone_files import load
from surefoot.services.navigator.planning.zones import FREELY, KeptOut, SpeedLimit, Zone, Zones
from tests.services.refusals import refused

CELL, RADIUS = 0.1, 0.15
POLYGON = "polygon: [[0, 0], [1, 0], [1, 1]]"


def angle_in(polygon: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return whether a polygon holds points, by the angle that it turns around each, (n,)."""
    away = polygon[None] - points[:, None]
    angles = np.arctan2(away[..., 1], away[..., 0])
    turn = np.angle(np.exp(1j * (np.roll(angles, -1, axis=1) - angles))).sum(axis=1)
    return np.abs(turn) > math.pi


def star(rng: np.random.Generator, centre: np.ndarray, size: float) -> np.ndarray:
    """A polygon of 3 to 8 corners around a centre, seldom convex."""
    angles = np.sort(rng.uniform(0.0, 2.0 * math.pi, int(rng.integers(3, 9))))
    angles[:3] = 0.1, 2.2, 4.3  # the centre is inside
    away = size * rng.uniform(0.3, 1.0, len(angles))
    return centre + away[:, None] * np.stack((np.cos(np.sort(angles)), np.sin(np.sort(angles))), axis=1)


def floor_of(seed: int) -> tuple[FloorGrid, Zones, np.random.Generator]:
    """A random floor of 4 x 5 m with walls and up to four keepout zones; every third is turned."""
    rng = np.random.default_rng((seed, 12))
    cells = np.zeros((40, 50), dtype=np.int8)
    for _ in range(8):
        r, c = int(rng.integers(38)), int(rng.integers(48))
        cells[r : r + 1 + int(rng.integers(6)), c : c + 1 + int(rng.integers(6))] = 100
    grid = FloorGrid(cells, CELL, (-1.0, 2.0), yaw=0.4 if seed % 3 == 0 else 0.0)
    zones = []
    for k in range(int(rng.integers(1, 5))):
        centre = np.array(grid.centre(int(rng.integers(40)), int(rng.integers(50))))
        zones.append(Zone(f"zone {k}", "keepout", star(rng, centre, rng.uniform(0.3, 1.2))))
    return grid, Zones(tuple(zones)), rng


def maps_of(grid: FloorGrid, zones: Zones) -> Maps:
    maps = Maps(NavigatorConfig(robot="nao", robot_radius=RADIUS, viewing_distance=10.0))
    maps.grid, maps.zones = grid, zones
    return maps


def held(grid: FloorGrid, zones: Zones, spread: float) -> np.ndarray:
    """Cells with a point in a zone, of 7 x 7 points up to `spread` times the edge from the centre, (rows, cols)."""
    rows, cols = np.mgrid[: grid.shape[0], : grid.shape[1]]
    found = np.zeros(grid.shape, dtype=bool)
    for dr in spread * np.linspace(-0.5, 0.5, 7):
        for dc in spread * np.linspace(-0.5, 0.5, 7):
            x = grid.origin[0] + (cols.ravel() + 0.5 + dc) * CELL
            y = grid.origin[1] + (rows.ravel() + 0.5 + dr) * CELL
            points = np.stack(grid.turned(x, y), axis=1)
            for zone in zones.keepout:
                found |= angle_in(zone.polygon, points).reshape(grid.shape)
    return found


def labels(walls: np.ndarray) -> np.ndarray:
    """Connected regions of the cells whose centres keep the robot's radius from the centres of walls less half a cell,
    by flood fill."""
    apart = cast(Any, ndimage.distance_transform_edt)(~np.pad(walls, 1, constant_values=True))[1:-1, 1:-1]
    return np.asarray(cast(Any, ndimage.label)(CELL * (apart - 0.5) >= RADIUS - 1e-9)[0])


def along(points: list[tuple[float, float]]) -> np.ndarray:
    """Points on the legs of a route, 5 mm apart, (n, 2) m."""
    parts = [np.linspace(a, b, 2 + int(math.dist(a, b) / 0.005)) for a, b in pairwise(points)]
    return np.vstack(parts)


def tried(maps: Maps, start: Point, goal: Point) -> tuple[tuple[Point, ...], Refusal | None]:
    """The way to a goal, or the refusal of it."""
    try:
        return maps.ways(start, (goal,))[0], None
    except Refusal as refusal:
        return (), refusal


@pytest.mark.parametrize("seed", range(50))
def test_no_route_enters_a_zone_and_one_is_found_where_there_is_any(seed: int) -> None:
    grid, zones, rng = floor_of(seed)
    maps, walls = maps_of(grid, zones), grid.cells >= 65
    least, most = labels(walls | held(grid, zones, 1.1)), labels(walls | held(grid, zones, 0.9))
    free, done = np.argwhere(labels(walls) > 0), 0
    for _ in range(20):
        a, b = free[rng.integers(len(free), size=2)]
        start, goal = grid.centre(int(a[0]), int(a[1])), grid.centre(int(b[0]), int(b[1]))
        if most[tuple(a)] == 0:
            continue
        way, refusal = tried(maps, start, goal)
        if refusal is not None:
            assert refusal.code in ("keepout", "unreachable")
            assert not least[tuple(a)] or least[tuple(a)] != least[tuple(b)]
            assert any(zone.name in refusal.message for zone in zones.all)
            continue
        assert most[tuple(a)] == most[tuple(b)]
        points = along([start, *way])
        assert not any(angle_in(zone.polygon, points).any() for zone in zones.keepout)
        done += 1
    assert done > 0


@pytest.mark.parametrize("seed", range(50))
def test_a_start_in_a_zone_leads_out_by_a_short_way_and_through_no_wall(seed: int) -> None:
    grid, zones, rng = floor_of(seed)
    maps, walls = maps_of(grid, zones), grid.cells >= 65
    kept, open_floor = maps.kept, labels(walls)
    assert kept is not None
    inside, out = np.argwhere(kept.cells & (open_floor > 0)), np.argwhere(labels(walls | kept.cells) > 0)
    for _ in range(8 if len(inside) and len(out) else 0):
        a, b = inside[rng.integers(len(inside))], out[rng.integers(len(out))]
        start, goal = grid.centre(int(a[0]), int(a[1])), grid.centre(int(b[0]), int(b[1]))
        if open_floor[tuple(a)] != open_floor[tuple(b)]:
            with refused(Refusal, "unreachable", "position"):
                maps.ways(start, (goal,))
            continue
        (way,) = maps.ways(start, (goal,))
        points = along([start, *way])
        cells = np.array([grid.index(float(x), float(y)) for x, y in points])
        assert not walls[tuple(cells.T)].any()
        region = labels(walls | kept.cells) == labels(walls | kept.cells)[tuple(b)]
        first = int(np.argmax(region[tuple(cells.T)]))
        assert not kept.cells[tuple(cells.T)][first:].any()  # never in a zone again
        steps = shortest(open_floor > 0, a, region)
        assert 0.005 * first <= 1.5 * steps * CELL + 3 * CELL  # ways beside walls are dearer


def shortest(free: np.ndarray, a: np.ndarray, ends: np.ndarray) -> float:
    """Number of steps over edges from a cell to the nearest of `ends`, by a flood."""
    seen, steps = np.zeros_like(free), 0
    seen[tuple(a)] = True
    while not (seen & ends).any():
        grown = np.asarray(cast(Any, ndimage.binary_dilation)(seen)) & free
        assert (grown != seen).any()
        seen, steps = grown, steps + 1
    return steps


def corridor() -> tuple[FloorGrid, Zones]:
    """5 x 2 m, and a zone across it but for the upper 0.6 m."""
    square = np.array([(2.0, 0.0), (3.0, 0.0), (3.0, 1.4), (2.0, 1.4)])
    return FloorGrid(np.zeros((20, 50), dtype=np.int8), CELL), Zones((Zone("stairs", "keepout", square),))


@pytest.mark.parametrize(
    ("goal", "code", "words"),
    [((2.5, 0.7), "keepout", "in the keepout zone 'stairs'"), ((3.05, 0.7), "keepout", "too close to")],
)
def test_a_goal_in_a_zone_is_refused_by_its_name(goal: tuple[float, float], code: str, words: str) -> None:
    maps = maps_of(*corridor())
    for place in (goal, (0.5, 0.5)):
        if place is goal:
            with refused(Refusal, code, "positions.0") as caught:
                maps.ways((0.5, 0.5), (place,), "positions")
            assert words in str(caught.value)
            assert "stairs" in str(caught.value)
            assert "nearest place" in str(caught.value)
    with refused(Refusal, code, "position"):  # from inside of the zone, too
        maps.ways((2.2, 0.5), (goal,))


def test_zones_close_nothing_else() -> None:
    """The robot's place, echoes and walls are those of the map; without a map nothing can be planned."""
    grid, zones = corridor()
    maps = maps_of(grid, zones)
    assert maps.costs is not None
    assert maps.grid is grid
    maps.refuse_blocked((2.5, 0.7), "pose")
    assert not maps.enterable((1.9, 0.5), (2.5, 0.7))
    maps.grid = maps._costs = maps._kept = None
    with refused(Refusal, "no_map", "position"):
        maps.ways((0.0, 0.0), ((1.0, 0.0),))


def test_a_way_may_lead_away_from_a_zone_but_not_nearer_to_it() -> None:
    maps = maps_of(*corridor())
    assert maps.keeps_out((1.5, 0.5), (1.85, 0.5))
    assert not maps.keeps_out((1.5, 0.5), (1.95, 0.5))
    assert not maps.keeps_out((1.5, 0.5), (3.5, 0.5))
    assert maps.keeps_out((1.95, 0.5), (1.5, 0.5))
    assert not maps.keeps_out((1.95, 0.5), (1.97, 0.5))
    assert maps.keeps_out((2.5, 0.5), (1.5, 0.5))  # out of it
    assert not maps.free((1.5, 0.5), ((3.5, 0.5),))
    assert maps.free((1.5, 0.5), ((1.7, 0.5), (3.5, 0.5)))  # only the way to the next waypoint counts


def write(folder: Path, text: str, name: str = "zones.yaml") -> Path:
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


def mask(folder: Path, cells: np.ndarray, mode: str = "scale") -> None:
    """A map_server mask of cells in %, row 0 = least y, 0.5 m each, as mask.yaml."""
    levels = np.rint(255.0 - 2.55 * cells[::-1]).astype(np.uint8)
    Image.fromarray(levels).save(folder / "mask.png")
    write(
        folder,
        f"image: mask.png\nresolution: 0.5\norigin: [0, 0, 0]\nmode: {mode}\noccupied_thresh: 1.0\nfree_thresh: 0.0\n",
        "mask.yaml",
    )


def test_speed_limits_in_percent_and_metres_and_by_masks(tmp_path: Path) -> None:
    mask(tmp_path, np.array([[0, 20], [80, 100]]))
    text = (
        "zones:\n - {name: half, type: speed_limit, speed_limit: 50, polygon: [[0, 0], [1, 0], [1, 1], [0, 1]]}\n"
        " - {name: ramp, type: speed_limit, speed_limit: 0.03, percentage: false, polygon: [[2, 0], [3, 0], [3, 1]]}\n"
        " - {name: hall, type: speed_limit, mask: mask.yaml, base: 100, multiplier: -1}\n"
    )
    zones = load(write(tmp_path, text))
    assert zones.pace((5.0, 5.0)) == FREELY
    assert zones.pace((0.2, 0.2)) == SpeedLimit(share=0.5)  # 0 in the mask is no limit
    assert zones.pace((0.7, 0.2)) == SpeedLimit(share=0.5)  # 80 % of the mask is the weaker one
    assert zones.pace((0.2, 0.7)).share == pytest.approx(0.2, abs=0.01)
    assert zones.pace((0.7, 0.7)).share == pytest.approx(0.5)  # base + multiplier v = 0 is no limit, as in Nav2
    assert zones.pace((2.9, 0.1)) == SpeedLimit(most=0.03)
    assert zones.pace((0.2, 0.2), (2.9, 0.1)) == SpeedLimit(0.5, 0.03)
    assert SpeedLimit(0.5, 0.03).of(0.1) == 0.03
    assert SpeedLimit(0.5, 0.03).of(0.04) == 0.02


@pytest.mark.parametrize("cell", [0.05, 0.3, 0.7])
def test_a_keepout_mask_touches_the_cells_that_it_overlaps(tmp_path: Path, cell: float) -> None:
    cells = np.array([[0, 100, 0], [0, 0, 0], [100, 40, 70]])
    mask(tmp_path, cells)
    zones = load(write(tmp_path, "zones:\n - {name: lab, type: keepout, mask: mask.yaml}\n"))
    grid = FloorGrid(np.zeros((math.ceil(2.4 / cell), math.ceil(2.4 / cell)), dtype=np.int8), cell, (-0.4, -0.3))
    found, inner = KeptOut(zones, grid), 0.5 * np.argwhere(cells >= 65)
    for row in range(grid.shape[0]):
        for col in range(grid.shape[1]):
            x0, y0 = -0.4 + col * cell, -0.3 + row * cell
            near = np.maximum(np.array((y0, x0)) - (inner + 0.5), inner - np.array((y0 + cell, x0 + cell))).max(axis=1)
            if abs(near.min()) > 1e-3:
                assert found.cells[row, col] == (near.min() < 0.0)
    assert found.name_at((0.7, 0.2)) == "lab"


def test_the_file_of_a_map_holds_its_zones(tmp_path: Path) -> None:
    mask(tmp_path, np.zeros((4, 4)), "trinary")
    path = tmp_path / "mask.yaml"
    assert not load(path, required=False)
    path.write_text(path.read_text(encoding="utf-8") + f"zones:\n - {{name: a, type: keepout, {POLYGON}}}\n")
    maps = Maps(NavigatorConfig(robot="nao", map=str(path)))
    assert [zone.name for zone in maps.zones.all] == ["a"]
    other = write(tmp_path, f"zones:\n - {{name: b, type: keepout, {POLYGON}}}\n")
    assert [z.name for z in Maps(NavigatorConfig(robot="nao", map=str(path), zones=str(other))).zones.all] == ["b"]


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("image: a.pgm", "zones"),
        ("zones: []", "zones"),
        ("zones: {name: a}", "zones"),
        ("zones: [1]", "zones.0"),
        ("zones: [{name: a, type: keepout}]", "zones.0"),
        (f"zones: [{{name: a, type: keepout, mask: m.yaml, {POLYGON}}}]", "zones.0"),
        (f"zones: [{{type: keepout, {POLYGON}}}]", "zones.0.name"),
        (f"zones: [{{name: '', type: keepout, {POLYGON}}}]", "zones.0.name"),
        (f"zones: [{{name: {'a' * 65}, type: keepout, {POLYGON}}}]", "zones.0.name"),
        (f"zones: [{{name: a, type: stairs, {POLYGON}}}]", "zones.0.type"),
        ("zones: [{name: a, type: speed_limit, mask: m.yaml, base: 1001}]", "zones.0.base"),
        ("zones: [{name: a, type: speed_limit, mask: m.yaml, base: -1001}]", "zones.0.base"),
        ("zones: [{name: a, type: speed_limit, mask: m.yaml, multiplier: 1001}]", "zones.0.multiplier"),
        ("zones: [{name: a, type: speed_limit, mask: m.yaml, multiplier: -1001}]", "zones.0.multiplier"),
        ("zones: [{name: a, type: speed_limit, mask: m.yaml, multiplier: .nan}]", "zones.0.multiplier"),
        (f"zones: [{{name: a, type: keepout, colour: red, {POLYGON}}}]", "zones.0.colour"),
        (f"zones: [{{name: a, type: keepout, speed_limit: 50, {POLYGON}}}]", "zones.0"),
        (f"zones: [{{name: a, type: speed_limit, {POLYGON}}}]", "zones.0"),
        (f"zones: [{{name: a, type: speed_limit, speed_limit: 0, {POLYGON}}}]", "zones.0.speed_limit"),
        (f"zones: [{{name: a, type: speed_limit, speed_limit: 101, {POLYGON}}}]", "zones.0.speed_limit"),
        (f"zones: [{{name: a, type: speed_limit, speed_limit: .nan, {POLYGON}}}]", "zones.0.speed_limit"),
        (f"zones: [{{name: a, type: speed_limit, speed_limit: 50, base: 1, {POLYGON}}}]", "zones.0"),
        ("zones: [{name: a, type: keepout, polygon: [[0, 0], [1, 0]]}]", "zones.0.polygon"),
        ("zones: [{name: a, type: keepout, polygon: [[0, 0], [1, 1], [2, 2]]}]", "zones.0"),
        ("zones: [{name: a, type: keepout, polygon: [[0, 0], [1, .inf], [2, 2]]}]", "zones.0.polygon.1.1"),
        ("zones: [{name: a, type: keepout, polygon: [[0, 0], [1, 0, 3], [2, 2]]}]", "zones.0.polygon.1"),
        ("zones: [{name: a, type: keepout, mask: ../mask.yaml}]", "zones.0.mask"),
        ("zones: [{name: a, type: keepout, mask: none.yaml}]", "yaml"),
        (f"zones: [{{name: a, type: keepout, {POLYGON}}}, {{name: a, type: keepout, {POLYGON}}}]", "zones.1.name"),
        ("zones: &a [*a]", "yaml"),
        ("\tzones: 1", "yaml"),
    ],
    ids=str,
)
def test_files_that_are_no_zones_are_refused_by_their_field(tmp_path: Path, text: str, field: str) -> None:
    with refused(MapFileError, field=field):
        load(write(tmp_path, text))


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with refused(MapFileError, "not_found", "yaml"):
        load(tmp_path / "none.yaml")
