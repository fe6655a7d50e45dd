"""Reading of height maps of any supported format, chosen by the suffix of the file, and of GeoTIFF."""

import json
import math
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.heightmap import HeightMap, HeightMapError
from surefoot.geometry.heightmap_files import check_size, load, load_png

GEOTIFF = (".tif", ".tiff")
SUFFIXES = (".npz", ".asc", ".png", *GEOTIFF)
"""Suffixes of the files from which height maps can be read."""
PIXEL_SCALE, TIE_POINT, GEO_KEYS, NO_DATA = 33550, 33922, 34735, 42113
"""`PIXEL_SCALE`: number of the GeoTIFF 1.1 tag (OGC 19-008) with the edges of a pixel; `TIE_POINT`: of the tag with a
pixel and its coordinates; `GEO_KEYS`: of the tag with the keys; `NO_DATA`: of GDAL's tag of the value for unknown
heights."""
MODEL_TYPE, RASTER_TYPE = 1024, 1025
"""`MODEL_TYPE`: key in the GeoTIFF tag `GEO_KEYS` whose value 2 means degrees of latitude and longitude; `RASTER_TYPE`:
key whose value 2 means that a pixel is a point, not an area."""
UNITS, METRE = {3076: "ProjLinearUnits", 4099: "VerticalUnits"}, 9001
"""`UNITS`: names of the GeoTIFF keys of the units of coordinates and heights, by number; `METRE`: code of the metre,
the only unit accepted for both."""


def load_any(path: str | Path) -> HeightMap:
    """Read a map of any format: `.npz`, `.asc`, `.png`, or a GeoTIFF in m, `.tif` or `.tiff`.

    A PNG has its scale in a `.json` file of the same name: `cell`, `z_low` and `z_high`, the heights of black and
    white, in m, and optionally `origin`, the centre of the lower left pixel, and `version`.

    Raises:
        HeightMapError: the file is no map, or its scale is absent or wrong.
        FileNotFoundError: there is no such file.
    """
    source = Path(path)
    if source.suffix.lower() in GEOTIFF:
        return load_geotiff(source)
    if source.suffix.lower() != ".png":
        return load(source)
    sidecar = source.with_suffix(".json")
    check_size(source)
    if not sidecar.exists():
        raise HeightMapError("file", f"{source.name} has no scale: give it in a file of that name, .json")
    check_size(sidecar)
    scale = _scale(sidecar.read_text(encoding="utf-8", errors="replace"), sidecar.name)
    return load_png(source, scale.cell, scale.z_low, scale.z_high, scale.origin, scale.version)


class _Scale(NamedTuple):
    """Scale of a PNG in m: edge of a pixel, heights of black and white, centre of the lower left pixel; version."""

    cell: float
    z_low: float
    z_high: float
    origin: tuple[float, float]
    version: int


def _scale(text: str, source: str) -> _Scale:
    """Return the scale in the text of a `.json` file beside a PNG; `source`: name of that file, for errors.

    Raises:
        HeightMapError: an entry is absent or no finite number.
    """
    try:
        entries: Any = json.loads(text)
        numbers = [float(entries[name]) for name in ("cell", "z_low", "z_high")]
        numbers += [float(value) for value in entries.get("origin", (0.0, 0.0))]
        version = int(entries.get("version", 0))
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise HeightMapError("file", f"{source} cannot be read: {error!r}") from error
    if not all(map(math.isfinite, numbers)) or len(numbers) != 5:
        raise HeightMapError("file", f"{source} must hold finite numbers, got {entries!r}")
    cell, low, high, x0, y0 = numbers
    return _Scale(cell, low, high, (x0, y0), version)


def load_geotiff(path: str | Path) -> HeightMap:
    """Read a GeoTIFF of one band whose rows run from north to south and whose coordinates are in m.

    Raises:
        HeightMapError: the file is no such image; names the field.
    """
    from PIL import Image, UnidentifiedImageError

    source = Path(path)
    check_size(source)
    try:
        with warnings.catch_warnings(action="error"), Image.open(source) as image:  # it warns of tags that are cut off
            tags: dict[int, Any] = dict(getattr(image, "tag_v2", {}))
            pixels: NDArray[Any] = np.asarray(image)
    except (UnidentifiedImageError, Image.DecompressionBombError, *_BROKEN_TIFF) as error:
        raise HeightMapError("file", f"{source.name} is no TIFF image, or damaged: {error}") from error
    if pixels.ndim != 2 or pixels.dtype.kind not in "iuf":
        raise HeightMapError("file", f"{source.name} must have one band of numbers, got {pixels.shape} {pixels.dtype}")
    cell, corner = _geometry(tags, source.name)
    z = pixels.astype(np.float32)
    if NO_DATA in tags:
        none = _numbers((str(tags[NO_DATA]).strip("\0 "),), "GDAL_NODATA", inf=True)
        with np.errstate(over="ignore"):  # -1.8e308 is -inf in pixels of 32 bits
            z[z == np.float32(none[0])] = np.nan
    return HeightMap(z=z[::-1], cell=cell, origin=(corner[0], corner[1] - (len(z) - 1) * cell))


_BROKEN_TIFF = (OSError, SyntaxError, ValueError, TypeError, LookupError, OverflowError, EOFError, Warning)
"""Exceptions that the reader of TIFF images may raise for a damaged file."""


def _geometry(tags: dict[int, Any], name: str) -> tuple[float, tuple[float, float]]:
    """Return the edge of a pixel and x, y of the centre of the upper left one, m, by the tags of a GeoTIFF.

    Args:
        tags: values of the tags of the file by their number.
        name: of the file, for errors.

    Raises:
        HeightMapError: a tag is absent or wrong, or the unit is not m.
    """
    if PIXEL_SCALE not in tags or TIE_POINT not in tags:
        raise HeightMapError("file", f"{name} has no ModelPixelScale and ModelTiepoint: it is no GeoTIFF, or is turned")
    entries = _numbers(tags[GEO_KEYS], "GeoKeyDirectory", 4) if GEO_KEYS in tags else []
    keys = {entries[i]: entries[i + 3] for i in range(4, len(entries) - 3, 4)}
    if keys.get(MODEL_TYPE) == 2:
        raise HeightMapError("file", f"{name} is in degrees of latitude and longitude, wanted is m")
    for key, field in UNITS.items():
        if (unit := keys.get(key, METRE)) != METRE:
            raise HeightMapError(field, f"{name} is not in m: got {unit:g}, allowed is {METRE} (m), or no such key")
    dx, dy, *_ = _numbers(tags[PIXEL_SCALE], "ModelPixelScale", 2)
    column, row, _, x, y, *_ = _numbers(tags[TIE_POINT], "ModelTiepoint", 6)
    if not math.isclose(dx, dy, rel_tol=1e-6):
        raise HeightMapError("cell", f"pixels of {name} must be square, got {dx:g} x {dy:g} m")
    half = 0.0 if keys.get(RASTER_TYPE) == 2 else 0.5
    return dx, (x + (half - column) * dx, y - (half - row) * dx)


def _numbers(values: Any, field: str, least: int = 1, inf: bool = False) -> list[float]:
    """Return the numbers of a tag of a GeoTIFF; NaN is allowed, and infinite ones are if `inf`.

    Args:
        values: of the tag.
        field: name of the tag, for errors.
        least: least number of values.
        inf: infinite values are allowed.

    Raises:
        HeightMapError: there are fewer numbers, or one is not allowed.
    """
    try:
        found = [float(value) for value in values]
    except (TypeError, ValueError):
        found = []
    if len(found) < least or (not inf and any(map(math.isinf, found))):
        raise HeightMapError(field, f"must be {least} finite numbers or more, got {values!r}")
    return found
