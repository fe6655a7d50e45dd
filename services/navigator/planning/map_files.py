"""Occupancy grids in files as map_server reads them: a YAML beside an 8-bit PGM or PNG.

Of a pixel with brightness s in 0 to 1 (mean of its colours; in mode trinary of its colours and its opacity where the
image has any) and occ = 1 - s, or s with `negate`:

    trinary   100 if occ > occupied_thresh, 0 if occ < free_thresh, else -1
    scale     as trinary, but between the thresholds 100 (occ - free)/(occupied - free) rounded to even, and -1 where
              the pixel is not opaque
    raw       round(255 s) where that is 0 to 100, else -1; neither thresholds nor negate matter

The top row of the image is y-max. (ROS 2 Navigation, nav2_map_server, map_io.)
"""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image

from surefoot.disk import regular_size
from surefoot.errors import Refusal
from surefoot.geometry.heightmap import MAX_CELLS

from .grid import FREE, OCCUPIED, UNKNOWN, FloorGrid

Mode = Literal["trinary", "scale", "raw"]
MODES: tuple[Mode, ...] = ("trinary", "scale", "raw")
MAX_SIDE = 20_000
"""Largest side of an image, pixels; larger ones are refused by their header, before anything is decoded."""
MAX_YAML_BYTES = 64 * 1024
DEEPEST = 8
"""Levels of lists and tables in a YAML; a map has two."""
MAX_IMAGE_BYTES = 128_000_000
OCCUPIED_THRESH, FREE_THRESH = 0.65, 0.196
"""Thresholds that map_saver writes; with 0.25, as newer ones do, its grey 205 for unknown would be read as free."""
PNG_MAGIC, PNG_END = b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"


class MapFileError(Refusal):
    """A map file that cannot be used; `field` names the key or file."""


@dataclass(frozen=True)
class MapInfo:
    """Contents of the YAML file of a map_server map."""

    image: Path
    """Path of the image; `load` checks that it exists."""
    resolution: float
    """Edge of a pixel of the map's image, m."""
    origin: tuple[float, float]
    """Lower-left corner of the lower-left pixel, x and y in m, frame map."""
    occupied_thresh: float = OCCUPIED_THRESH
    """Occupancy above which a pixel is occupied, 0 to 1."""
    free_thresh: float = FREE_THRESH
    """Occupancy below which a pixel is free, 0 to 1."""
    negate: bool = False
    """True if bright pixels are occupied."""
    mode: Mode = "trinary"
    """Rule that makes cells of pixels."""


def load(path: str | Path) -> FloorGrid:
    """Read a map by the path of its YAML.

    Raises:
        MapFileError: a file is missing, truncated, too large, no such map, or the image lies outside of the folder.
    """
    source = Path(path)
    info = parse(_text(source), source)
    levels, opacity = _pixels(info.image)
    cells = occupancy(levels, opacity, info)
    return FloorGrid(cells[::-1], info.resolution, info.origin, source.name)


def parse(text: str, path: Path) -> MapInfo:
    """Return the contents of a YAML; the image is searched beside `path`.

    Raises:
        MapFileError: it is no YAML of a map, uses anchors or aliases, or names an image outside of its folder.
    """
    depth = 0
    try:
        for event in yaml.parse(text, Loader=yaml.SafeLoader):
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > DEEPEST:
                raise MapFileError("malformed", f"{path.name}: is nested more than {DEEPEST} deep", "yaml")
            if getattr(event, "anchor", None) is not None:
                raise MapFileError("malformed", f"{path.name}: anchors and aliases are not allowed in a map", "yaml")
        read: Any = yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        why = " ".join(str(error).split())[:200]
        raise MapFileError("malformed", f"{path.name} is no YAML: {why}", "yaml") from None
    if not isinstance(read, dict):
        raise MapFileError("malformed", f"{path.name}: a map is a table of keys, got {str(read)[:80]!r}", "yaml")
    table = cast("dict[str, Any]", read)
    occupied = _number(table, "occupied_thresh", 0.0, 1.0)
    free = _number(table, "free_thresh", 0.0, 1.0)
    if free >= occupied:
        raise _bad("free_thresh", free, f"below occupied_thresh, {occupied!r}")
    mode = table.get("mode", "trinary")
    if mode not in MODES:
        raise _bad("mode", mode, " or ".join(MODES))
    return MapInfo(
        image=_image(table, path),
        resolution=_number(table, "resolution", 1e-4, 10.0),
        origin=_origin(table),
        occupied_thresh=occupied,
        free_thresh=free,
        negate=_flag(table, "negate"),
        mode=mode,
    )


def occupancy(levels: NDArray[np.uint8], opacity: NDArray[np.uint8] | None, info: MapInfo) -> NDArray[np.int8]:
    """Return the occupancy of the pixels of an image, (h, w), top row first: 0 free to 100 occupied, -1 unknown.

    Args:
        levels: grey (h, w), or colours (h, w, 3), 0 to 255.
        opacity: 0 transparent to 255 opaque, (h, w); None = the image has none.
        info: thresholds and mode.
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


def _text(path: Path) -> str:
    try:
        size = regular_size(path)
        if size > MAX_YAML_BYTES:
            raise MapFileError(
                "malformed", f"{path.name} has {size} bytes, a map's YAML at most {MAX_YAML_BYTES}", "yaml"
            )
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise MapFileError("not_found", f"{path} cannot be read: {error.strerror}", "yaml") from None
    except UnicodeDecodeError:
        raise MapFileError("malformed", f"{path.name} is not UTF-8 text", "yaml") from None


def _bad(field: str, value: Any, allowed: str) -> MapFileError:
    return MapFileError("malformed", f"{field} must be {allowed}, got {str(value)[:120]!r}", field)


def _number(table: dict[str, Any], key: str, low: float, high: float) -> float:
    if key not in table:
        raise MapFileError("malformed", f"{key} is missing", key)
    return _float(table[key], key, low, high)


def _float(value: Any, key: str, low: float, high: float) -> float:
    allowed = f"a number from {low:g} to {high:g}"
    if isinstance(value, bool):
        raise _bad(key, value, allowed)
    try:
        number = float(value)  # YAML 1.1 takes 5e-2 for a text
    except (TypeError, ValueError, OverflowError):
        raise _bad(key, value, allowed) from None
    if not low <= number <= high:
        raise _bad(key, value, allowed)
    return number


def _flag(table: dict[str, Any], key: str) -> bool:
    value = table.get(key, 0)
    if value not in (0, 1, True, False):
        raise _bad(key, value, "0 or 1")
    return bool(value)


def _origin(table: dict[str, Any]) -> tuple[float, float]:
    value = table.get("origin")
    if not isinstance(value, list) or len(cast("list[Any]", value)) != 3:
        raise _bad("origin", value, "[x, y, yaw]")
    x, y, yaw = (_float(part, "origin", -1e6, 1e6) for part in cast("list[Any]", value))
    if yaw != 0.0:
        raise _bad("origin", yaw, "without rotation: yaw 0")
    return (x, y)


def _image(table: dict[str, Any], path: Path) -> Path:
    name = table.get("image")
    if not isinstance(name, str) or not name or "\0" in name:
        raise _bad("image", name, "the name of a PGM or PNG file")
    folder = path.resolve().parent
    image = (folder / name).resolve()
    if not image.is_relative_to(folder):
        raise _bad("image", name, "in the folder of the YAML, or below it")
    return image


def _pixels(path: Path) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """Return grey (h, w) or colours (h, w, 3), and opacity (h, w) if any; the header is checked before decoding."""
    try:
        size = regular_size(path)
        if size > MAX_IMAGE_BYTES:
            raise MapFileError("malformed", f"{path.name} has {size} bytes, allowed are {MAX_IMAGE_BYTES}", "image")
        with path.open("rb") as file:
            head = file.read(4096)
            file.seek(max(0, size - 4096))
            tail = file.read()
    except OSError as error:
        raise MapFileError("not_found", f"{path.name} cannot be read: {error.strerror}", "image") from None
    width, height, most = _png_head(head, path) if head.startswith(PNG_MAGIC) else _pgm_head(head, path)
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE and width * height <= MAX_CELLS):
        allowed = f"1 to {MAX_SIDE} pixels a side and at most {MAX_CELLS} in all"
        raise MapFileError("malformed", f"{path.name} is {width} x {height}, allowed are {allowed}", "image")
    if most > 255:
        raise MapFileError("malformed", f"{path.name} has values up to {most}, allowed are 8 bits, up to 255", "image")
    if head.startswith(PNG_MAGIC) and PNG_END not in tail:
        raise MapFileError("malformed", f"{path.name} is cut off: a PNG ends with IEND", "image")
    try:
        with Image.open(path, formats=("PNG", "PPM")) as picture:
            clear = picture.mode in ("LA", "RGBA", "PA") or "transparency" in picture.info
            if clear:
                whole = np.asarray(picture.convert("RGBA"))
                return whole[..., :3], whole[..., 3]
            return np.asarray(picture.convert("L" if picture.mode in ("1", "L") else "RGB")), None
    except (OSError, SyntaxError, ValueError, EOFError, struct.error) as error:
        raise MapFileError("malformed", f"{path.name} is damaged or cut off: {error}", "image") from None


def _png_head(head: bytes, path: Path) -> tuple[int, int, int]:
    """Return width, height and largest value of a PNG."""
    if len(head) < 33 or head[12:16] != b"IHDR":
        raise MapFileError("malformed", f"{path.name} is cut off in its header", "image")
    width, height, bits = struct.unpack_from(">IIB", head, 16)
    return width, height, 2**bits - 1


def _pgm_head(head: bytes, path: Path) -> tuple[int, int, int]:
    """Return width, height and largest value of a PGM."""
    if head[:2] not in (b"P2", b"P5"):
        raise MapFileError(
            "malformed", f"{path.name} must be a PGM (P2, P5) or PNG, it begins with {head[:8]!r}", "image"
        )
    words: list[bytes] = []
    for line in head[2:].split(b"\n"):
        words += line.split(b"#", 1)[0].split()[: 3 - len(words)]
        if len(words) == 3:
            break
    if len(words) < 3 or not all(word.isdigit() and len(word) < 10 for word in words):
        raise MapFileError("malformed", f"{path.name} has no width, height and largest value in its header", "image")
    width, height, most = (int(word) for word in words)
    if head[:2] == b"P5" and path.stat().st_size < width * height * (1 if most < 256 else 2):
        raise MapFileError(
            "malformed", f"{path.name} is cut off: {width} x {height} pixels do not fit into it", "image"
        )
    if most < 1:
        raise MapFileError("malformed", f"{path.name}: the largest value must be 1 to 255, got {most}", "image")
    return width, height, most
