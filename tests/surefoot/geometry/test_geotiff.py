"""Height maps from GeoTIFF files, written tag by tag as OGC 19-008 has them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from surefoot.geometry.heightmap import HeightMapError
from surefoot.geometry.heightmap_exchange import load_any
from surefoot.terrain import load

SCALE, TIE, KEYS, NONE, DOUBLE, SHORT, ASCII = 33550, 33922, 34735, 42113, 12, 3, 2


def geotiff(
    path: Path, pixels: np.ndarray, scale: tuple[float, ...] = (0.5, 0.5, 0.0),
    tie: tuple[float, ...] = (0.0, 0.0, 0.0, 100.0, 200.0, 0.0), keys: tuple[int, ...] = (), none: str = "",
    directory: tuple[int, ...] = (),
) -> Path:  # fmt: skip
    """Write an image, row 0 = north, with the tags of its place."""
    tags = ImageFileDirectory_v2()
    for number, kind, value in (
        (SCALE, DOUBLE, scale), (TIE, DOUBLE, tie), (NONE, ASCII, none),
        (KEYS, SHORT, directory or (1, 1, 0, len(keys) // 4, *keys)),
    ):  # fmt: skip
        if value:
            tags.tagtype[number] = kind
            tags[number] = value
    Image.fromarray(pixels).save(path, tiffinfo=tags)
    return path


def heights(kind: str = "f4") -> np.ndarray:
    return np.random.default_rng(4).integers(0, 900, (5, 7)).astype(kind)


@pytest.mark.parametrize("kind", ["u1", "u2", "i4", "f4"])
def test_the_first_pixel_lies_at_the_north_western_corner(tmp_path: Path, kind: str) -> None:
    pixels = heights(kind)
    found = load_any(geotiff(tmp_path / "m.tif", pixels))
    np.testing.assert_array_equal(found.z, pixels[::-1].astype(np.float32))
    assert found.cell == 0.5
    assert found.centre(4, 0) == (100.25, 199.75)  # the upper left pixel is an area half a metre wide
    assert found.origin == (100.25, 197.75)


def test_a_pixel_may_be_a_point_and_the_tie_point_any_pixel(tmp_path: Path) -> None:
    path = geotiff(tmp_path / "m.tiff", heights(), tie=(3.0, 1.0, 0.0, 10.0, 20.0, 0.0), keys=(1025, 0, 1, 2))
    assert load(path).centre(3, 3) == (10.0, 20.0)  # row 1 from the north, column 3


def test_units_that_are_not_metres_are_named(tmp_path: Path) -> None:
    with pytest.raises(HeightMapError, match=r"got 9003, allowed is 9001"):
        load_any(geotiff(tmp_path / "m.tif", heights(), keys=(3076, 0, 1, 9003)))
    assert load_any(geotiff(tmp_path / "n.tif", heights(), keys=(3076, 0, 1, 9001, 4099, 0, 1, 9001))).cell == 0.5


@pytest.mark.parametrize(
    ("none", "value"),
    [
        ("-9999", -9999.0), ("-3.4e+38", -3.4e38), ("nan", np.nan), ("-inf", -np.inf), ("inf", np.inf),
        ("-1.7976931348623157e+308", -np.inf),
    ],
)  # fmt: skip
def test_heights_that_are_none_are_unknown(tmp_path: Path, none: str, value: float) -> None:
    pixels = heights()
    pixels[1, 2] = value
    found = load_any(geotiff(tmp_path / "m.tif", pixels, none=none)).z
    assert np.argwhere(np.isnan(found)).tolist() == [[3, 2]]


@pytest.mark.parametrize(
    ("more", "field"),
    [
        ({"scale": ()}, "file"), ({"tie": ()}, "file"), ({"keys": (1024, 0, 1, 2)}, "file"),
        ({"scale": (0.5, 0.25, 0.0)}, "cell"), ({"scale": (0.0, 0.0, 0.0)}, "cell"), ({"none": "none"}, "GDAL_NODATA"),
        ({"scale": (0.5,)}, "ModelPixelScale"), ({"tie": (0.0, 1.0)}, "ModelTiepoint"),
        ({"directory": (1,)}, "GeoKeyDirectory"), ({"keys": (3076, 0, 1, 9003)}, "ProjLinearUnits"),
        ({"keys": (3076, 0, 1, 9001, 4099, 0, 1, 9002)}, "VerticalUnits"),
    ],
)  # fmt: skip
def test_images_without_a_place_in_metres_are_refused(tmp_path: Path, more: dict[str, Any], field: str) -> None:
    with pytest.raises(HeightMapError) as caught:
        load_any(geotiff(tmp_path / "m.tif", heights(), **more))
    assert caught.value.field == field


def test_images_of_three_bands_and_damaged_files_are_refused(tmp_path: Path) -> None:
    path = geotiff(tmp_path / "m.tif", heights())
    whole = path.read_bytes()
    with pytest.raises(HeightMapError, match="one band"):
        load_any(geotiff(tmp_path / "rgb.tif", np.zeros((4, 4, 3), np.uint8)))
    for size in range(0, len(whole), 7):
        path.write_bytes(whole[:size])
        with pytest.raises(HeightMapError):
            load_any(path)
