"""Height maps in files: `.npz` with a `.json` file of header and digest, ESRI ASCII grids, grey PNG."""

import hashlib
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.disk import whole
from surefoot.geometry.heightmap import FRAME, HeightMap, HeightMapError
from surefoot.npz import BROKEN_NPZ

SCHEMA = "surefoot.geometry.heightmap/1"
MAX_FILE_BYTES = 256_000_000
"""Largest size of a map file, and of the unpacked content of a `.npz`, bytes; a larger one is refused."""


def save(heightmap: HeightMap, path: str | Path, **extra: str | int | float) -> Path:
    """Write `<path>.npz` (z, cell, origin, version, frame, extras) and `<path>.json` (header and sha256 of the file).

    Args:
        heightmap: the map to write.
        path: the file, with or without `.npz`.
        extra: how the map came to be, such as kind and seed; kept in both files.

    Returns:
        The path of the `.npz` file.
    """
    target = Path(path)
    ours = target.suffix in (".npz", ".json")  # any other dot belongs to the name
    target = target.with_suffix(".npz") if ours else target.with_name(f"{target.name}.npz")
    arrays: dict[str, NDArray[Any]] = {key: np.asarray(value) for key, value in extra.items()}
    arrays |= {
        "z": heightmap.z.astype("<f4", copy=False),
        "cell": np.asarray(heightmap.cell),
        "origin": np.asarray(heightmap.origin),
        "version": np.asarray(heightmap.version),
        "frame": np.asarray(FRAME),
    }
    with whole(target) as part, whole(target.with_suffix(".json")) as beside:
        with part.open("wb") as stream:
            np.savez_compressed(stream, allow_pickle=False, **arrays)
        sidecar = {
            "schema": SCHEMA,
            "file": target.name,
            "sha256": hashlib.sha256(part.read_bytes()).hexdigest(),
            "content_sha256": heightmap.sha256,
            "header": heightmap.header(),
            "extra": extra,
        }
        beside.write_text(json.dumps(sidecar, indent=2, sort_keys=True) + "\n", encoding="utf-8")
    return target


def load(path: str | Path) -> HeightMap:
    """Read a `.npz` map (checked against its sidecar when there is one) or an ESRI `.asc` grid.

    Raises:
        HeightMapError: the file is no map, is too large, or differs from its sidecar.
        FileNotFoundError: there is no such file.
    """
    source = Path(path)
    if source.suffix.lower() == ".asc":
        return load_asc(source)
    check_size(source)
    sidecar = source.with_suffix(".json")
    if sidecar.exists():
        _check_sidecar(source, sidecar)
    try:
        with source.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            unpacked = sum(member.file_size for member in archive.zip.infolist())
            if unpacked > MAX_FILE_BYTES:
                raise HeightMapError("file", f"{source.name} unpacks to {unpacked} bytes, more than {MAX_FILE_BYTES}")
            z, origin = archive["z"], archive["origin"]
            cell, version, frame = float(archive["cell"]), int(archive["version"]), str(archive["frame"])
    except HeightMapError:
        raise
    except KeyError as error:
        raise HeightMapError("file", f"{source.name} lacks an array: {error}") from error
    except (OSError, *BROKEN_NPZ) as error:
        raise HeightMapError("file", f"{source.name} is no .npz height map, or damaged") from error
    if frame != FRAME:
        raise HeightMapError("frame", f"must be {FRAME!r}, got {frame!r}")
    if origin.shape != (2,):
        raise HeightMapError("origin", f"must be two metres, got shape {origin.shape}")
    return HeightMap(z=z, cell=cell, origin=(float(origin[0]), float(origin[1])), version=version)


def load_asc(path: str | Path, version: int = 0) -> HeightMap:
    """Read an ESRI ASCII grid: a header of `key value` lines, then rows of heights, m, from NORTH to south.

    `xllcorner`/`yllcorner` name the corner of the lower left cell, `xllcenter`/`yllcenter` its centre; `NODATA_value`
    (default -9999) becomes NaN. `version`: the version the map gets.

    Raises:
        HeightMapError: a header key is absent or the number of heights is wrong.
    """
    source = Path(path)
    check_size(source)
    head: dict[str, float] = {}
    lines = source.read_text(encoding="ascii", errors="replace").splitlines()
    body = 0
    for body, line in enumerate(lines):  # noqa: B007 - the first line of heights is wanted below
        words = line.split()
        if len(words) != 2 or not words[0][0].isalpha() or words[0].lower() in ("nan", "inf"):
            break
        head[words[0].lower()] = _number(words[1], words[0])
    for key in ("ncols", "nrows", "cellsize"):
        if key not in head:
            raise HeightMapError(key, f"absent from the header of {source.name}")
        if math.isnan(head[key]):
            raise HeightMapError(key, "must be a number, got nan")
    nx, ny, cell = int(head["ncols"]), int(head["nrows"]), head["cellsize"]
    words = " ".join(lines[body:]).split()
    if len(words) != nx * ny:
        raise HeightMapError("z", f"{source.name} names {ny} x {nx} cells and holds {len(words)} heights")
    z = np.array([_number(word, "z") for word in words], dtype=np.float64).reshape(ny, nx)
    z[z == head.get("nodata_value", -9999.0)] = np.nan
    x0 = head["xllcenter"] if "xllcenter" in head else head.get("xllcorner", 0.0) + 0.5 * cell
    y0 = head["yllcenter"] if "yllcenter" in head else head.get("yllcorner", 0.0) + 0.5 * cell
    return HeightMap(z=z[::-1].astype(np.float32), cell=cell, origin=(x0, y0), version=version)


def load_png(
    path: str | Path, cell: float, z_low: float, z_high: float, origin: tuple[float, float] = (0.0, 0.0),
    version: int = 0,
) -> HeightMap:  # fmt: skip
    """Read a grey PNG of 8 or 16 bits: black is `z_low`, white is `z_high`, the top row is y-max.

    Args:
        path: the image.
        cell: edge of a pixel, m.
        z_low: height of value 0, m.
        z_high: height of the largest value, m.
        origin: centre of the LOWER LEFT pixel, m, frame `map`.
        version: the version the map gets.

    Raises:
        HeightMapError: the image is not grey, or no image.
    """
    from PIL import Image, UnidentifiedImageError

    source = Path(path)
    check_size(source)
    try:
        with Image.open(source) as image:
            pixels: NDArray[Any] = np.asarray(image)
    except (UnidentifiedImageError, SyntaxError, Image.DecompressionBombError) as error:
        raise HeightMapError("file", f"{source.name} is no PNG image: {error}") from error
    if pixels.ndim != 2 or pixels.dtype.kind not in "iu":
        raise HeightMapError("file", f"{source.name} must be grey with integer values, got {pixels.shape}")
    white = 255.0 if pixels.dtype == np.uint8 else 65535.0
    z = z_low + (z_high - z_low) * pixels[::-1].astype(np.float64) / white
    return HeightMap(z=z.astype(np.float32), cell=cell, origin=origin, version=version)


def check_size(source: Path) -> None:
    """Raise HeightMapError for a file that is too large or no regular file: reading a pipe or device may never end."""
    if source.exists() and not source.is_file():
        raise HeightMapError("file", f"{source.name} is no regular file")
    size = source.stat().st_size
    if size > MAX_FILE_BYTES:
        raise HeightMapError("file", f"{source.name} has {size} bytes, more than {MAX_FILE_BYTES}")


def _check_sidecar(source: Path, sidecar: Path) -> None:
    """Raise HeightMapError if the `.json` file `sidecar` is damaged, or its digest not that of the map `source`."""
    check_size(sidecar)
    try:
        entries: Any = json.loads(sidecar.read_text(encoding="utf-8"))
        schema, digest = str(entries["schema"]), str(entries["sha256"])
    except (ValueError, KeyError, TypeError) as error:
        raise HeightMapError("sidecar", f"{sidecar.name} is no height-map sidecar: {error!r}") from error
    if schema != SCHEMA:
        raise HeightMapError("schema", f"must be {SCHEMA!r}, got {schema!r}")
    found = hashlib.sha256(source.read_bytes()).hexdigest()
    if found != digest:
        raise HeightMapError("sha256", f"{source.name} has {found}, its sidecar names {digest}")


def _number(word: str, field: str) -> float:
    """Return a word of a file as a number; NaN is allowed, infinite values are not.

    `field`: part of the map, for errors.

    Raises:
        HeightMapError: it is none.
    """
    try:
        value = float(word)
    except ValueError:
        value = math.inf
    if math.isinf(value):
        raise HeightMapError(field, f"must be a number, got {word!r}")
    return value
