"""Occupancy grids in files as map_server reads them: a YAML beside an 8-bit PGM or PNG.

Of a pixel with brightness s in 0 to 1 (mean of its colours; in mode trinary of its colours and its opacity where the
image has any) and occ = 1 - s, or s with `negate`:

    trinary   100 if occ > occupied_thresh, 0 if occ < free_thresh, else -1
    scale     as trinary, but between the thresholds 100 (occ - free)/(occupied - free) rounded to even, and -1 where
              the pixel is not opaque
    raw       round(255 s) where that is 0 to 100, else -1; neither thresholds nor negate matter

The top row of the image is y-max. (ROS 2 Navigation, nav2_map_server, map_io.)
"""

import io
import struct
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image
from pydantic import BeforeValidator, Field, TypeAdapter, ValidationError, ValidationInfo, field_validator
from pydantic.dataclasses import dataclass

from surefoot.errors import Refusal
from surefoot.files import FileError, read_regular
from surefoot.geometry.heightmap import MAX_CELLS

from .grid import FREE, MOST_TURNED, OCCUPIED, UNKNOWN, FloorGrid

Mode = Literal["trinary", "scale", "raw"]
MODES: tuple[Mode, ...] = ("trinary", "scale", "raw")
MAX_SIDE = 20_000
"""Largest width or height of a map image, pixels; a larger one is refused by its header, before decoding."""
MAX_YAML_BYTES = 64 * 1024
DEEPEST = 8
"""Largest depth of nested lists and tables in a map's YAML file; a valid map has two."""
MAX_IMAGE_BYTES = 128_000_000
PNG_MAGIC, PNG_END = b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"


Number = Annotated[float, BeforeValidator(str)]
"""Number of a map's YAML file, which may be text, as YAML 1.1 reads 5e-2 as text; booleans are refused."""
Coordinate = Annotated[Number, Field(ge=-1e6, le=1e6)]


class MapFileError(Refusal):
    """Error for a map file that cannot be used; `field` names the key or file."""


def _malformed(text: str, field: str = "image") -> MapFileError:
    return MapFileError("malformed", text, field)


@dataclass(frozen=True)
class MapInfo:
    """Contents of the YAML file of a map_server map."""

    image: Path
    """Path of the map's image file; `load` checks that it exists."""
    resolution: Annotated[Number, Field(ge=1e-4, le=10.0)]
    """Edge length on the floor of a pixel of the map's image, m."""
    origin: tuple[Coordinate, Coordinate]
    """Lower-left corner of the lower-left pixel, x and y in m, frame map."""
    occupied_thresh: Annotated[Number, Field(ge=0.0, le=1.0)]
    """Occupancy above which a pixel becomes an occupied cell, 0 to 1."""
    free_thresh: Annotated[Number, Field(ge=0.0)]
    """Occupancy below which a pixel becomes a free cell, 0 to 1."""
    negate: bool = False
    """True if bright pixels are occupied, False if dark ones are."""
    mode: Mode = "trinary"
    """Rule that converts pixels to occupancy, a mode of map_server: trinary, scale or raw."""
    yaw: Annotated[Number, Field(ge=-MOST_TURNED, le=MOST_TURNED)] = 0.0
    """Angle by which the image is turned about its corner `origin`, rad, left positive; the file has it in origin."""

    @field_validator("free_thresh")
    @classmethod
    def _below(cls, free: float, info: ValidationInfo) -> float:
        if free >= info.data.get("occupied_thresh", 1.0):
            raise ValueError("allowed is less than occupied_thresh")
        return free


INFO = TypeAdapter(MapInfo)


def load(path: str | Path) -> FloorGrid:
    """Return the occupancy grid of a map in files, given the path of its YAML.

    Raises:
        MapFileError: a file is missing, truncated, too large, no such map, or the image lies outside of the folder.
    """
    source = Path(path)
    info = parse(text_of(source), source)
    levels, opacity = _pixels(info.image)
    cells = occupancy(levels, opacity, info)
    return FloorGrid(cells[::-1], info.resolution, info.origin, source.name, info.yaw)


def text_of(path: Path) -> str:
    """Return the text of a map's YAML file.

    Raises:
        MapFileError: it is missing, too large, or not UTF-8.
    """
    try:
        return _content(path, MAX_YAML_BYTES, "yaml").decode()
    except UnicodeDecodeError:
        raise _malformed(f"{path.name} is not UTF-8 text", "yaml") from None


def table_of(text: str, path: Path) -> dict[str, Any]:
    """Return the table of keys of a map's YAML text; `path` names it in a refusal.

    Raises:
        MapFileError: it is no table of YAML, is nested too deep, or uses anchors or aliases.
    """
    depth = 0
    try:
        for event in yaml.parse(text, Loader=yaml.SafeLoader):
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > DEEPEST:
                raise _malformed(f"{path.name}: is nested more than {DEEPEST} deep", "yaml")
            if getattr(event, "anchor", None) is not None:
                raise _malformed(f"{path.name}: anchors and aliases are not allowed in a map", "yaml")
        read: Any = yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise _malformed(f"{path.name} is no YAML: {' '.join(str(error).split())[:200]}", "yaml") from None
    if not isinstance(read, dict):
        raise _malformed(f"{path.name}: a map is a table of keys, got {str(read)[:80]!r}", "yaml")
    return cast("dict[str, Any]", read)


def parse(text: str, path: Path) -> MapInfo:
    """Return the contents of a map's YAML text; the image is searched beside `path`.

    Raises:
        MapFileError: it is no YAML of a map, uses anchors or aliases, or names an image outside of its folder.
    """
    table = table_of(text, path)
    try:
        (x, y), yaw = _origin(table)
        return INFO.validate_python({**table, "image": _image(table, path), "origin": (x, y), "yaw": yaw})
    except ValidationError as error:
        first = error.errors()[0]
        key, got = str(first["loc"][0]), "" if first["type"] == "missing" else f", got {str(first['input'])[:120]!r}"
        field = "origin" if key == "yaw" else key
        raise _malformed(f"{key}: {first['msg']}{got}", field) from None


def occupancy(levels: NDArray[np.uint8], opacity: NDArray[np.uint8] | None, info: MapInfo) -> NDArray[np.int8]:
    """Return the occupancy of the pixels of an image, (h, w), top row first: 0 free to 100 occupied, -1 unknown.

    Args:
        levels: grey (h, w), or colours (h, w, 3), 0 to 255.
        opacity: 0 transparent to 255 opaque, (h, w); None = the image has none.
        info: thresholds, mode, and whether bright pixels are occupied.
    """
    colours = levels[..., None] if levels.ndim == 2 else levels
    total, parts = colours.astype(np.float64).sum(axis=2), colours.shape[2]
    if info.mode == "trinary" and opacity is not None:
        if parts == 1:
            total, parts = 3.0 * total, 3
        total, parts = total + opacity, parts + 1
    shade = total / (255.0 * parts)
    if info.mode == "raw":
        value = np.floor(255.0 * shade + 0.5)
        return np.where(value <= OCCUPIED, value, UNKNOWN).astype(np.int8)
    occ = shade if info.negate else 1.0 - shade
    cells = np.full(occ.shape, UNKNOWN, dtype=np.int8)
    if info.mode == "scale":
        part = (occ - info.free_thresh) / (info.occupied_thresh - info.free_thresh)
        cells = np.clip(np.rint(part * 100.0), FREE, OCCUPIED).astype(np.int8)
    cells[occ > info.occupied_thresh] = OCCUPIED
    cells[occ < info.free_thresh] = FREE
    if info.mode == "scale" and opacity is not None:
        cells[opacity < 255] = UNKNOWN
    return cells


def _content(path: Path, most: int, field: str) -> bytes:
    try:
        return read_regular(path, most)
    except FileError as error:
        raise MapFileError("not_found" if error.code == "not_found" else "malformed", str(error), field) from None


def _origin(table: dict[str, Any]) -> tuple[tuple[Any, Any], Any]:
    value = table.get("origin")
    if not isinstance(value, list) or len(cast("list[Any]", value)) != 3:
        raise _malformed(f"origin must be [x, y, yaw] in m and rad, got {str(value)[:120]!r}", "origin")
    return (value[0], value[1]), value[2]


def _image(table: dict[str, Any], path: Path) -> Path:
    name, folder = table.get("image"), path.resolve().parent
    if not isinstance(name, str) or not name or "\0" in name:
        raise _malformed(f"image must be the name of a PGM or PNG file, got {str(name)[:120]!r}")
    image = (folder / name).resolve()
    if not image.is_relative_to(folder):
        raise _malformed(f"image must be in the folder of the YAML, or below it, got {name[:120]!r}")
    return image


def _pixels(path: Path) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """Return the pixels of an image, 0 to 255: grey (h, w) or colours (h, w, 3), and opacity (h, w) if it has any.

    The header is checked before anything is decoded.

    Raises:
        MapFileError: the file is missing, too large, cut off, damaged, or no PGM or PNG of 8 bits.
    """
    content = _content(path, MAX_IMAGE_BYTES, "image")
    is_png = content.startswith(PNG_MAGIC)
    width, height, most = _png_head(content, path) if is_png else _pgm_head(content, path)
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE and width * height <= MAX_CELLS):
        allowed = f"1 to {MAX_SIDE} pixels a side and at most {MAX_CELLS} in all"
        raise _malformed(f"{path.name} is {width} x {height}, allowed are {allowed}")
    if not 1 <= most <= 255:
        raise _malformed(f"{path.name}: the largest value must be 1 to 255, got {most}")
    if is_png and PNG_END not in content[-4096:]:
        raise _malformed(f"{path.name} is cut off: a PNG ends with IEND")
    if content.startswith(b"P5") and len(content) < width * height:
        raise _malformed(f"{path.name} is cut off: {width} x {height} pixels do not fit into it")
    try:
        with Image.open(io.BytesIO(content), formats=("PNG", "PPM")) as picture:
            if picture.mode in ("LA", "RGBA", "PA") or "transparency" in picture.info:
                whole = np.asarray(picture.convert("RGBA"))
                return whole[..., :3], whole[..., 3]
            return np.asarray(picture.convert("L" if picture.mode in ("1", "L") else "RGB")), None
    except (OSError, SyntaxError, ValueError, EOFError, struct.error) as error:
        raise _malformed(f"{path.name} is damaged or cut off: {error}") from None


def _png_head(content: bytes, path: Path) -> tuple[int, int, int]:
    """Return width and height in pixels and largest value of a PNG by its header; `path` names it in a refusal."""
    if len(content) < 33 or content[12:16] != b"IHDR":
        raise _malformed(f"{path.name} is cut off in its header")
    width, height, bits = struct.unpack_from(">IIB", content, 16)
    return width, height, 2**bits - 1


def _pgm_head(content: bytes, path: Path) -> tuple[int, int, int]:
    """Return width and height in pixels and largest value of a PGM by its header; `path` names it in a refusal."""
    if content[:2] not in (b"P2", b"P5"):
        raise _malformed(f"{path.name} must be a PGM (P2, P5) or PNG, it begins with {content[:8]!r}")
    words: list[bytes] = []
    for line in content[2:4096].split(b"\n"):
        words += line.split(b"#", 1)[0].split()[: 3 - len(words)]
        if len(words) == 3:
            break
    if len(words) < 3 or not all(word.isdigit() and len(word) < 10 for word in words):
        raise _malformed(f"{path.name} has no width, height and largest value in its header")
    width, height, most = (int(word) for word in words)
    return width, height, most
