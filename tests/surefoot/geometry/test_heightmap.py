"""The height map: orientation, heights, dilation, median filter, wire."""

import json
import math
import re
from decimal import Decimal
from fractions import Fraction
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surefoot.geometry import heightmap
from surefoot.geometry.heightmap import HeightMap, HeightMapError
from tests.surefoot.expect import expect_error
from tests.surefoot.geometry.maps import CELL, bumpy, same, with_hole

NAN, ABSENT = float("nan"), object()
POINT = st.tuples(st.floats(-0.01, 0.11), st.floats(-0.01, 0.08))


def test_rows_run_along_y_and_columns_along_x() -> None:
    ground = HeightMap(z=np.array([[0, 1, 2], [10, 11, 12]], dtype=np.float32), cell=0.1, origin=(1.0, 2.0))
    assert ground.shape == (2, 3)
    assert ground.index(1.2, 2.1) == (1, 2)
    assert ground.centre(1, 2) == pytest.approx((1.2, 2.1))
    assert float(ground.height(1.2, 2.0)) == pytest.approx(2.0)
    assert ground.height_at(1.0, 2.1) == pytest.approx(10.0)
    assert ground.bounds == pytest.approx((1.0, 2.0, 1.2, 2.1))
    assert ground.xs() == pytest.approx([1.0, 1.1, 1.2])
    assert ground.ys() == pytest.approx([2.0, 2.1])


def test_same_surface_as_a_mujoco_height_field() -> None:
    ground = bumpy(origin=(0.3, -0.2))
    low, high = float(ground.z.min()), float(ground.z.max())
    ny, nx = ground.shape
    x0, y0, x1, y1 = ground.bounds
    spec = mujoco.MjSpec()
    data = ((ground.z - low) / (high - low)).ravel()
    spec.add_hfield(
        name="ground", nrow=ny, ncol=nx, userdata=data.tolist(), size=[(x1 - x0) / 2, (y1 - y0) / 2, high - low, 0.01]
    )
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname="ground", pos=[(x0 + x1) / 2, (y0 + y1) / 2, low]
    )
    model = spec.compile()
    world = mujoco.MjData(model)
    mujoco.mj_forward(model, world)
    geom = np.zeros(1, dtype=np.int32)
    for row in range(1, ny - 1, 3):
        for col in range(1, nx - 1, 3):
            # a hair beside the vertex: a ray exactly through it may slip between two triangles
            x, y = ground.centre(row, col)
            start = np.array([x + 1e-7, y + 2e-7, 1.0])
            way = mujoco.mj_ray(model, world, start, np.array([0.0, 0.0, -1.0]), None, 1, -1, geom)
            assert 1.0 - way == pytest.approx(ground.height_at(x, y), abs=1e-5)


@given(POINT)
def test_height_is_bilinear(point: tuple[float, float]) -> None:
    ground = bumpy()
    x, y = point
    u, v = x / CELL, y / CELL
    inside = -0.5 <= u < 20.5 and -0.5 <= v < 14.5
    got = ground.height_at(x, y)
    assert float(ground.height(x, y)) == pytest.approx(got, nan_ok=True)
    if not inside:
        assert math.isnan(got)
        return
    u, v = min(max(u, 0.0), 20.0), min(max(v, 0.0), 14.0)
    i, j = min(int(v), 13), min(int(u), 19)
    a, b = u - j, v - i
    z = ground.z.astype(float)
    low = (1 - a) * z[i, j] + a * z[i, j + 1]
    high = (1 - a) * z[i + 1, j] + a * z[i + 1, j + 1]
    assert got == pytest.approx((1 - b) * low + b * high, abs=1e-12)


def test_masked_heights_are_unknown() -> None:
    """Rasters of other libraries are masked where they have no data; the value below the mask counts nowhere."""
    z = np.ma.masked_equal([[0, 1], [9, 3]], 9)
    assert np.isnan(HeightMap(z=z, cell=0.1, origin=(0.0, 0.0)).z).tolist() == [[False, False], [True, False]]  # pyright: ignore[reportArgumentType]


def test_unknown_corner_counts_only_with_weight() -> None:
    ground = HeightMap(z=np.array([[1, NAN], [1, 1]], dtype=np.float32), cell=1.0)
    assert ground.height_at(0.0, 0.0) == pytest.approx(1.0)
    assert ground.height_at(0.0, 0.7) == pytest.approx(1.0)
    assert math.isnan(ground.height_at(0.1, 0.0))
    assert np.isnan(ground.height([0.9, NAN, 5.0], 0.0, method="nearest")).all()
    assert float(ground.height(0.4, 0.4, method="nearest")) == 1.0


def test_height_keeps_the_shape() -> None:
    ground = bumpy()
    assert ground.height(np.zeros((2, 1)), np.zeros((1, 3))).shape == (2, 3)
    assert ground.height(0.0, 0.0).shape == ()


def test_patch_is_nan_outside() -> None:
    ground = bumpy()
    patch = ground.patch(0.0, 0.0, 5)
    assert np.isnan(patch[:2]).all()
    assert np.isnan(patch[:, :2]).all()
    np.testing.assert_array_equal(patch[2:, 2:], ground.z[:3, :3])
    assert np.isnan(ground.patch(NAN, 0.0, 3)).all()
    with expect_error(HeightMapError, field="n"):
        ground.patch(0.0, 0.0, 4)


def test_dilation_is_the_height_of_a_resting_sphere() -> None:
    ground, radius = bumpy(), 0.012
    got = ground.dilated(radius).z
    ny, nx = ground.shape
    for i in range(ny):
        for j in range(nx):
            best = -math.inf
            for r in range(ny):
                for c in range(nx):
                    d2 = CELL**2 * ((r - i) ** 2 + (c - j) ** 2)
                    if d2 <= radius**2:
                        best = max(best, float(ground.z[r, c]) + math.sqrt(radius**2 - d2))
            assert got[i, j] == pytest.approx(best, abs=1e-7)


def test_dilation_of_flat_ground_and_of_unknown_cells() -> None:
    z = np.zeros((5, 5), dtype=np.float32)
    z[2, 2] = np.nan
    got = HeightMap(z=z, cell=CELL).dilated(0.008).z
    assert math.isnan(got[2, 2])
    assert np.nanmax(np.abs(got - 0.008)) < 1e-8
    with pytest.raises(HeightMapError):
        HeightMap(z=z, cell=CELL).dilated(-1.0)


def test_median_filters_spikes_keeps_edges_and_fills_drop_outs() -> None:
    z = np.zeros((9, 9), dtype=np.float32)
    z[:, 5:] = 0.03
    z[2, 2] = 0.5
    z[6, 2] = np.nan
    z[4:8, 6:9] = np.nan
    got = HeightMap(z=z, cell=CELL).smoothed().z
    assert got[2, 2] == 0.0
    assert got[6, 2] == 0.0
    assert (got[1:-1, 4] == 0.0).all()
    assert got[1:3, 5] == pytest.approx(0.03)
    assert np.isnan(got[5:7, 7]).all()
    assert np.isnan(HeightMap(z=z, cell=CELL).smoothed(min_known=9).z[6, 2])


@pytest.mark.parametrize(
    ("field", "changes"),
    [
        ("z", {"z": np.zeros(3)}),
        ("z", {"z": np.array([[0.0, np.inf]])}),
        ("z", {"z": np.zeros((0, 3))}),
        ("z", {"z": "ab"}),
        ("cell", {"cell": "a"}),
        ("cell", {"cell": 0.0}),
        ("origin", {"origin": (0.0,)}),
        ("cell", {"cell": NAN}),
        ("origin", {"origin": (NAN, 0.0)}),
        ("version", {"version": -1}),
        ("version", {"version": 1.5}),
        ("version", {"version": np.inf}),
    ],
)
def test_wrong_maps_are_refused_by_field(field: str, changes: dict[str, object]) -> None:
    good: dict[str, object] = {"z": np.zeros((2, 2)), "cell": CELL, "origin": (0.0, 0.0), "version": 0}
    with expect_error(HeightMapError, field=field):
        HeightMap(**(good | changes))


@pytest.mark.parametrize("version", [3, 3.0, np.float32(3.0), np.uint8(3)])
def test_versions_may_be_floats_that_are_whole(version: Any) -> None:
    found = HeightMap(np.zeros((2, 2), np.float32), CELL, version=version).version
    assert (type(found), found) == (int, 3)


def test_maps_do_not_change() -> None:
    z = np.zeros((2, 2), dtype=np.float32)
    ground = HeightMap(z=z, cell=CELL)
    z[0, 0] = 1.0
    assert ground.z[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        ground.z[0, 0] = 1.0


def test_wire_round_trip() -> None:
    ground = with_hole()
    header = json.loads(json.dumps(ground.header()))
    assert len(ground.to_bytes()) == 4 * 15 * 21
    same(HeightMap.from_wire(header, ground.to_bytes()), ground)
    # byte order and place: little-endian float32, row by row from y-min
    assert np.frombuffer(ground.to_bytes(), "<f4")[21 * 2 + 5] == ground.z[2, 5]


@pytest.mark.parametrize(
    ("field", "changes"),
    [
        ("frame", {"frame": "odom"}),
        ("rows, cols", {"rows": 0}),
        ("rows, cols", {"rows": 10**9, "cols": 10**9}),
        ("payload", {"cols": 5}),
        ("header", {"cell": "wide"}),
        ("cell", {"cell": -1.0}),
        ("header", {"origin": [1.0]}),
        ("cell", {"cell": ABSENT}),
    ],
)
def test_wrong_headers_are_refused_by_field(field: str, changes: dict[str, object]) -> None:
    ground = with_hole()
    with expect_error(HeightMapError, field=field):
        header = {key: value for key, value in (ground.header() | changes).items() if value is not ABSENT}
        HeightMap.from_wire(header, ground.to_bytes())


def test_cells_outside_of_any_side_are_not_inside() -> None:
    ground = HeightMap(z=np.zeros((2, 3), np.float32), cell=0.1)
    for row in range(-1, 3):
        for col in range(-1, 4):
            assert ground.inside(row, col) == (row in (0, 1) and col in (0, 1, 2))


def test_maps_have_as_many_cells_as_are_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(heightmap, "MAX_CELLS", 6)
    assert HeightMap(z=np.zeros((2, 3), np.float32), cell=0.1).z.size == 6
    for shape in ((7, 1), (0, 3), (3, 0)):
        with pytest.raises(HeightMapError, match=re.escape(f"got shape {shape}")):
            HeightMap(z=np.zeros(shape, np.float32), cell=0.1)


@pytest.mark.parametrize(("rows", "cols"), [(0, 1), (1, 0), (-1, -1), (1 << 20, 1 << 20)])
def test_a_header_of_no_cells_or_too_many_is_refused(rows: int, cols: int) -> None:
    header = {"frame": "map", "rows": rows, "cols": cols, "cell": 0.1, "origin": [0.0, 0.0]}
    with pytest.raises(HeightMapError, match="rows, cols"):
        HeightMap.from_wire(header, b"")


def test_text_that_is_no_base64_is_refused() -> None:
    header = {"frame": "map", "rows": 1, "cols": 1, "cell": 0.1, "origin": [0.0, 0.0]}
    with pytest.raises(HeightMapError, match="no base64"):
        HeightMap.from_base64(header, "?")


@pytest.mark.parametrize("value", ["1", 1j, np.datetime64("2026-01-01"), None, [[1], [1, 2]]], ids=repr)
def test_places_that_are_no_numbers_and_shapes_that_do_not_go_together_are_refused(value: Any) -> None:
    ground = HeightMap(z=np.zeros((2, 3), np.float32), cell=0.1)
    for x, y in ((value, 0.0), (0.0, value)):
        with pytest.raises(HeightMapError, match="expected numbers"):
            ground.height(x, y)
        with pytest.raises(HeightMapError, match="expected"):
            ground.height_at(x, y)
    with pytest.raises(HeightMapError, match="go together"):
        ground.height(np.zeros(2), np.zeros(3))


def test_a_number_of_another_kind_is_the_same_place() -> None:
    ground = HeightMap(z=np.arange(6, dtype=np.float32).reshape(2, 3), cell=0.5)
    kinds: tuple[Any, ...] = (Decimal, Fraction, np.float32, np.float64)
    for kind in kinds:
        assert ground.height_at(kind(0.75), kind(0.25)) == ground.height_at(0.75, 0.25)
