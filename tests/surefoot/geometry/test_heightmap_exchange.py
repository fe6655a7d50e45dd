"""Maps of other programs come back as they went, whatever way round they are stored."""

from pathlib import Path

import numpy as np
import pytest

from surefoot.geometry.heightmap import HeightMap, HeightMapError
from surefoot.geometry.heightmap_exchange import load_any, load_own_png, save_png
from surefoot.geometry.heightmap_files import load_asc, save
from tests.surefoot.geometry.maps import save_asc


def made(seed: int = 0) -> HeightMap:
    rng = np.random.default_rng(seed)
    z = rng.uniform(-0.05, 0.1, (6, 9)).astype(np.float32)
    z[2, 3] = np.nan
    return HeightMap(z=z, cell=0.005, origin=(-0.31, 0.12), version=4)


def test_png_keeps_grid_and_heights_to_a_65534th(tmp_path: Path) -> None:
    heights = made()
    again = load_own_png(save_png(heights, tmp_path / "m.png"))
    assert (again.cell, again.origin, again.version) == (heights.cell, heights.origin, 4)
    assert np.array_equal(np.isnan(again.z), np.isnan(heights.z))
    np.testing.assert_allclose(again.z, heights.z, atol=0.15 / 65534)


@pytest.mark.parametrize("z", [np.full((2, 3), np.nan), np.full((2, 3), 0.25)])
def test_png_of_nothing_known_and_of_a_plane(z: np.ndarray, tmp_path: Path) -> None:
    heights = HeightMap(z=z.astype(np.float32), cell=0.01)
    np.testing.assert_array_equal(load_own_png(save_png(heights, tmp_path / "m.png")).z, heights.z)


def test_text_grid_comes_back_exactly(tmp_path: Path) -> None:
    heights = made()
    again = load_asc(save_asc(heights, tmp_path / "m.asc"), version=4)
    np.testing.assert_array_equal(again.z, heights.z)
    assert again.sha256 == heights.sha256


def test_a_png_of_others_without_a_scale_or_without_an_image_is_refused(tmp_path: Path) -> None:
    from PIL import Image

    Image.fromarray(np.zeros((2, 2), dtype=np.uint16)).save(tmp_path / "bare.png")
    (tmp_path / "text.png").write_text("no image")
    for name in ("bare.png", "text.png"):
        with pytest.raises(HeightMapError):
            load_own_png(tmp_path / name)


def test_any_format_comes_back(tmp_path: Path) -> None:
    heights = made()
    for path in (save(heights, tmp_path / "a.npz"), save_asc(heights, tmp_path / "b.asc")):
        np.testing.assert_array_equal(load_any(path).z, heights.z)
    png = load_any(save_png(heights, tmp_path / "c.png"))
    np.testing.assert_allclose(png.z, heights.z, atol=0.15 / 65534)
    assert png.origin == heights.origin


def grey(path: Path, scale: str | None) -> Path:
    from PIL import Image

    Image.fromarray(np.array([[0, 65535], [13107, 0]], dtype=np.uint16)).save(path)
    if scale is not None:
        path.with_suffix(".json").write_text(scale)
    return path


def test_a_png_of_others_has_its_scale_beside_it(tmp_path: Path) -> None:
    found = load_any(grey(tmp_path / "a.png", '{"cell": 0.005, "z_low": -0.1, "z_high": 0.4, "origin": [1, 2]}'))
    np.testing.assert_allclose(found.z, [[0.0, -0.1], [-0.1, 0.4]], atol=1e-6)  # the top row of an image is y-max
    assert (found.cell, found.origin) == (0.005, (1.0, 2.0))


@pytest.mark.parametrize(
    "scale",
    [
        None,
        "no json",
        "[]",
        '{"cell": 0.005, "z_low": 0}',
        '{"cell": 0.005, "z_low": 0, "z_high": NaN}',
        '{"cell": -1, "z_low": 0, "z_high": 1}',
        '{"cell": 0.005, "z_low": 0, "z_high": 1, "origin": [0]}',
        '{"cell": "wide", "z_low": 0, "z_high": 1}',
    ],
)
def test_a_png_without_a_scale_is_refused(tmp_path: Path, scale: str | None) -> None:
    with pytest.raises(HeightMapError):
        load_any(grey(tmp_path / "a.png", scale))
