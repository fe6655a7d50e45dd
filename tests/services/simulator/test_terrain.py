"""Terrains: pure, bounded, flat at the start, and the map has the heights of the boxes."""

import math
from functools import cache

import numpy as np
import pytest

from surefoot.geometry import heightmap_files
from surefoot.geometry.heightmap import HeightMap
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.services.simulator.ground import elevation, shapes
from surefoot.services.simulator.ground.elevation import elevation_file
from surefoot.services.simulator.ground.grid import box_heights
from surefoot.services.simulator.ground.terrain import (
    KINDS,
    MAP_PROFILES,
    TerrainError,
    make_terrain,
    observed_map,
    terrain_from_map,
)
from tests.services.refusals import refused

RANDOM = ("hills", "rough", "flagstones", "mixed", "elevation", "demo")
if elevation_file() is None:
    KINDS = tuple(kind for kind in KINDS if kind != "elevation")  # its data is not installed here

known = cache(make_terrain)
"""Terrains that several tests look at."""


@pytest.mark.parametrize("kind", KINDS)
def test_equal_arguments_give_equal_bits(kind: str) -> None:
    a, b = known(kind, 7), make_terrain(kind, 7)
    assert a.map.sha256 == b.map.sha256
    assert a.boxes == b.boxes or all(x.position == y.position for x, y in zip(a.boxes, b.boxes, strict=True))
    assert (make_terrain(kind, 8).map.sha256 == a.map.sha256) == (kind not in RANDOM)


@pytest.mark.parametrize("kind", [k for k in KINDS if k not in ("slope", "primitive")])
def test_the_start_is_flat(kind: str) -> None:
    terrain = known(kind, 7)
    start = terrain.map.xs() < shapes.PAD_END - 1e-9
    x, y = np.meshgrid(terrain.map.xs()[start], terrain.map.ys())
    behind = ~terrain.on_floor(np.column_stack((x.ravel(), y.ravel()))).reshape(x.shape)
    assert not terrain.map.z[:, start][~behind].any()


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("amp", [0.06, 0.087])
def test_demo_holds_what_it_promises(seed: int, amp: float) -> None:
    terrain = make_terrain("demo", seed, amp)
    scale = amp / 0.06
    z = terrain.ground.z[:, terrain.map.xs() < shapes.DEMO_STEPS_AT]
    assert amp - 0.01 * scale <= z.max() <= amp + 0.01 * scale
    assert z.min() >= -0.01 * scale
    assert len(terrain.boxes) == 3
    heights = [terrain.map.height_at(shapes.DEMO_STEPS_AT + 0.25 * k + 0.1, 0.0) for k in range(3)]
    assert heights == pytest.approx([0.025 * scale, 0.05 * scale, 0.075 * scale], abs=1e-6)


def test_hills_reach_their_height_in_the_lane() -> None:
    for seed in range(5):
        terrain = make_terrain("hills", seed)
        lane = np.abs(terrain.map.ys()) <= shapes.CORRIDOR
        assert terrain.map.z[lane].max() == pytest.approx(0.06, abs=1e-3)


def box_top(box: shapes.TerrainBox, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Height of a box's top face over the points (x, y), NaN beside it; m."""
    rot = matrix_from_quat(np.array(box.quat_wxyz))
    top = np.array(box.position) + box.half_size[2] * rot[:, 2]
    dx, dy = x - top[0], y - top[1]
    z = top[2] - (rot[0, 2] * dx + rot[1, 2] * dy) / rot[2, 2]
    rel = np.stack((dx, dy, z - top[2]), axis=-1) @ rot
    inside = (np.abs(rel[..., 0]) <= box.half_size[0] + 1e-9) & (np.abs(rel[..., 1]) <= box.half_size[1] + 1e-9)
    return np.where(inside, z, np.nan)


@pytest.mark.parametrize("kind", ["steps", "flagstones", "mixed", "demo"])
def test_boxes_are_where_the_map_has_them(kind: str) -> None:
    terrain = known(kind, 2)
    rng = np.random.default_rng(0)
    rows = rng.integers(0, terrain.map.shape[0], 300)
    cols = rng.integers(int(1.0 / terrain.map.cell), terrain.map.shape[1], 300)
    x, y = terrain.map.xs()[cols], terrain.map.ys()[rows]
    if kind == "flagstones":  # a point on the joint of two tiles may belong to either
        u, v = (((c + 0.004) / shapes.TILE) % 1.0 for c in (x - shapes.PAD_END, y))
        inner = (u > 0.08) & (v > 0.08)
        x, y, rows, cols = x[inner], y[inner], rows[inner], cols[inner]
    tops = np.array([box_top(box, x, y) for box in terrain.boxes])
    top = np.max(np.where(np.isnan(tops), -1.0, tops), axis=0)
    if terrain.ground is not None:
        top = np.maximum(top, terrain.ground.z[rows, cols])
    top = np.maximum(top, 0.0) if kind == "flagstones" else top
    off = np.abs(terrain.map.z[rows, cols] - top) > 1e-6
    # a tilted stone shows a little of its side faces, which are higher than what lies under them
    assert off.mean() <= (0.02 if kind == "mixed" else 0.0)
    assert (terrain.map.z[rows, cols] >= top - 1e-6).all()


@pytest.mark.parametrize("seed", range(4))
def test_mixed_ground_has_the_heights_of_the_paper_and_all_its_parts(seed: int) -> None:
    terrain = known("mixed", seed)
    assert -0.0035 - 1e-7 <= terrain.map.z.min() <= -0.003
    assert 0.065 <= terrain.map.z.max() <= 0.087 + 1e-7
    assert terrain.ground is not None
    edges = np.array([2.0 * min(box.half_size[:2]) for box in terrain.boxes])
    assert (edges > 0.065).sum() > 20
    assert (edges < 0.045).sum() > 60
    stones = terrain.map.z > terrain.ground.z + 1e-6
    assert 0.1 < stones[:, terrain.map.xs() > 0.4].mean() < 0.4
    steep = np.abs(np.diff(terrain.ground.z, axis=1)) / terrain.map.cell
    assert 0.5 < steep.max() < 1.6  # small pointed hills
    assert np.abs(np.diff(terrain.map.z, axis=1)).max() > 0.009  # sharp edges


def test_mixed_ground_is_the_same_in_other_cells_and_scales() -> None:
    fine, coarse, low = known("mixed", 2), make_terrain("mixed", 2, cell=0.01), make_terrain("mixed", 2, 0.0435)
    assert low.ground is not None
    np.testing.assert_allclose(fine.ground.z[::2, ::2], coarse.ground.z, atol=1e-6)
    np.testing.assert_allclose(low.ground.z, 0.5 * fine.ground.z, atol=1e-6)
    assert not make_terrain("mixed", 2, 0.0).boxes


@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_box_heights_are_those_of_points_in_the_box(yaw: float) -> None:
    box = shapes.slab(0.01, -0.02, 0.03, (0.3, -0.2), 0.02, (0.05, 0.08), yaw)
    x, y = np.linspace(-0.06, 0.08, 57)[None, :], np.linspace(-0.09, 0.05, 57)[:, None]
    found = box_heights(box, x, y)
    levels = np.linspace(-0.06, 0.06, 601)
    points = np.stack(np.broadcast_arrays(x[..., None], y[..., None], levels), axis=-1) - np.array(box.position)
    inside = (np.abs(points @ matrix_from_quat(np.array(box.quat_wxyz))) <= box.half_size).all(axis=-1)
    highest = np.where(inside, levels, -np.inf).max(axis=-1)
    sure = inside.sum(axis=-1) > 2
    np.testing.assert_allclose(found[sure], highest[sure], atol=3e-4)
    assert (found[~np.isfinite(highest)] == -np.inf).mean() > 0.95
    middle = box_heights(box, np.array([[0.01]]), np.array([[-0.02]]))
    assert middle[0, 0] == pytest.approx(0.03)


@pytest.mark.skipif(elevation_file() is None, reason="matplotlib is installed without its sample data")
def test_elevation_model_is_the_file_scaled() -> None:
    path = elevation_file()
    assert path is not None
    land = np.load(path)["elevation"].astype(np.float64)
    terrain = make_terrain("elevation", 3, amp=0.05, size=(5.5, 5.5), start_x=0.0)
    z = terrain.map.z[:, terrain.map.xs() > shapes.PAD_END + shapes.BLEND].astype(np.float64)
    assert (z.min(), z.max()) == (pytest.approx(0.0, abs=1e-3), pytest.approx(0.05, abs=1e-3))
    across = np.sort(np.abs(np.diff(land, axis=0)).ravel()) * 0.05 / np.ptp(land)
    here = np.sort(np.abs(np.diff(z, axis=0)).ravel())
    assert np.median(here) == pytest.approx(np.median(across), rel=0.25)


def test_elevation_model_that_is_absent_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(elevation, "ELEVATION_FILE", "nowhere.npz")
    with refused(TerrainError, field="kind"):
        make_terrain("elevation", 1)


@pytest.mark.parametrize("kind", ["room", "corridor", "corner"])
def test_walls_stand_around_the_floor_and_nowhere_on_it(kind: str) -> None:
    terrain = make_terrain(kind)
    rng = np.random.default_rng(0)
    outline = np.array(terrain.floor)
    points = rng.uniform(outline.min(axis=0) - 0.049, outline.max(axis=0) + 0.049, (4000, 2))
    tops = np.array([box_top(box, points[:, 0], points[:, 1]) for box in terrain.boxes])
    in_wall = np.isfinite(tops).any(axis=0)
    on_floor = terrain.on_floor(points)
    assert not (in_wall & on_floor).any()
    edges = zip(outline, np.roll(outline, -1, axis=0), strict=True)
    near = np.zeros(len(points), dtype=np.bool_)
    for a, b in edges:  # what is nearer to the outline than the wall is thick and not on the floor is wall
        near |= (np.abs(points - np.clip(points, np.minimum(a, b), np.maximum(a, b))) < 0.049).all(axis=1)
    assert (in_wall[near] ^ on_floor[near]).all()
    heights = terrain.map.height(points[:, 0], points[:, 1])
    known = np.isfinite(heights)
    assert np.all(heights[known & on_floor & ~near] == 0.0)
    area = 0.5 * abs(np.sum(outline[:, 0] * np.roll(outline[:, 1], -1) - np.roll(outline[:, 0], -1) * outline[:, 1]))
    drawn = float(np.prod(np.ptp(outline, axis=0) + 0.098))
    assert on_floor.mean() * drawn == pytest.approx(area, rel=0.05)


def test_a_corridor_is_seven_and_a_half_by_two_metres_and_a_corner_leads_to_the_left() -> None:
    corridor, corner = make_terrain("corridor"), make_terrain("corner")
    assert corridor.map.bounds == pytest.approx((-1.05, -1.05, 6.55, 1.05))
    assert corner.map.bounds == pytest.approx((-1.05, -1.05, 5.05, 5.05))
    way = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (3.1, 3.0), (4.9, 3.0), (2.9, 3.0), (5.1, 3.0), (0.0, 1.1)])
    assert corner.on_floor(way).tolist() == [True, True, True, True, True, False, False, False]
    assert make_terrain("corridor", size=(2.0, 1.0)).map.shape == (201, 401)


def test_slope_is_an_exact_plane() -> None:
    terrain = make_terrain("slope", amp=math.tan(math.radians(15.0)))
    assert terrain.ground is None
    x, z = terrain.map.xs(), terrain.map.z[0]
    n = terrain.normal
    assert n[2] == pytest.approx(math.cos(math.radians(15.0)))
    np.testing.assert_allclose(n[0] * x + n[2] * z, 0.0, atol=1e-7)


@pytest.mark.parametrize("number", range(1, 8))
def test_primitives_turn_with_yaw(number: int) -> None:
    a = make_terrain("primitive", number=number, amp=0.03, size=(0.2, 0.2))
    b = make_terrain("primitive", number=number, amp=0.03, size=(0.2, 0.2), yaw=math.pi / 2)
    assert np.abs(a.map.z).max() <= 0.03 + 1e-6
    np.testing.assert_allclose(b.map.z[1:-1, 1:-1], np.rot90(a.map.z, 3)[1:-1, 1:-1], atol=1e-6)


@pytest.mark.parametrize("profile", MAP_PROFILES)
def test_observed_map_is_seeded(profile: str) -> None:
    terrain = make_terrain("demo", 1)
    a, b, c = (observed_map(terrain, profile, seed) for seed in (5, 5, 6))
    assert a.sha256 == b.sha256
    assert (a.sha256 == c.sha256) == (profile == "exact")


def test_noisy_map_has_its_noise_and_its_holes() -> None:
    terrain = make_terrain("demo", 1)
    found = observed_map(terrain, "noise", 5)
    known = np.isfinite(found.z)
    assert 0.01 < 1.0 - known.mean() < 0.03
    assert np.std((found.z - terrain.map.z)[known]) == pytest.approx(0.003, rel=0.02)


def test_shifted_map_is_the_same_surface_elsewhere() -> None:
    terrain = make_terrain("demo", 1)
    found = observed_map(terrain, "shifted", 5)
    dz = found.z.astype(np.float64) - terrain.map.z
    assert np.ptp(dz) < 1e-6
    assert 0.0 < math.hypot(found.origin[0] - terrain.map.origin[0], found.origin[1] - terrain.map.origin[1]) < 0.05


def test_file_round_trip(tmp_path: object) -> None:
    ground = make_terrain("hills", 4, size=(1.4, 0.4)).map
    path = heightmap_files.save(ground, f"{tmp_path}/hills", kind="hills", seed=4)
    again = terrain_from_map(heightmap_files.load(path))
    assert again.map.sha256 == ground.sha256
    assert again.ground is not None


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        ({"kind": "moon"}, "kind"),
        ({"kind": "hills", "amp": float("nan")}, "amp"),
        ({"kind": "hills", "cell": 0.0}, "cell"),
        ({"kind": "hills", "seed": -1}, "seed"),
        ({"kind": "hills", "size": (1e6, 1.0)}, "size"),
        ({"kind": "hills", "size": (0.6, 1.0)}, "size"),
        ({"kind": "primitive", "number": 8}, "number"),
    ],
)
def test_refusals_name_the_field(arguments: dict[str, object], field: str) -> None:
    with refused(TerrainError, field=field):
        make_terrain(**arguments)  # type: ignore[arg-type]


def test_unknown_map_profile_and_empty_map() -> None:
    with pytest.raises(TerrainError):
        observed_map(make_terrain("flat"), "dream", 0)
    with pytest.raises(TerrainError):
        terrain_from_map(HeightMap(z=np.full((4, 4), np.nan, dtype=np.float32), cell=0.01))
