"""Height maps for other programs: 16-bit PNG with its scale inside or beside it, and any format read by its name."""

import json
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from surefoot.geometry.heightmap import HeightMap, HeightMapError
from surefoot.geometry.heightmap_files import check_size, load, load_png

KEY = "surefoot.heightmap"
"""Name of the text in a PNG that holds cell, origin, version and the heights of black and white."""
UNKNOWN = 0
"""Value of an unknown cell in a PNG; known heights are 1 to 65535."""


def save_png(heights: HeightMap, path: str | Path) -> Path:
    """Write a 16-bit grey PNG, top row = y-max, with everything needed to read it back; unknown cells are black."""
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    known = np.isfinite(heights.z)
    low = float(heights.z[known].min()) if known.any() else 0.0
    high = float(heights.z[known].max()) if known.any() else 0.0
    step = (high - low) / 65534.0
    pixels = np.zeros(heights.shape, dtype=np.uint16)
    if known.any():
        rise = heights.z[known].astype(np.float64) - low
        pixels[known] = 1 + (np.rint(rise / step) if step > 0.0 else np.zeros_like(rise)).astype(np.uint16)
    note = PngInfo()
    scale = {"cell": heights.cell, "origin": heights.origin, "version": heights.version, "z_low": low, "z_high": high}
    note.add_text(KEY, json.dumps(scale))
    target = Path(path)
    Image.fromarray(np.ascontiguousarray(pixels[::-1])).save(target, pnginfo=note)
    return target


def load_own_png(path: str | Path) -> HeightMap:
    """Read what `save_png` wrote; `load_png` reads images without the text.

    Raises:
        HeightMapError: no image, or one without the text.
    """
    from PIL import Image, UnidentifiedImageError

    source = Path(path)
    check_size(source)
    try:
        with Image.open(source) as image:
            text = getattr(image, "text", {}).get(KEY)
    except (UnidentifiedImageError, SyntaxError, Image.DecompressionBombError) as error:
        raise HeightMapError("file", f"{source.name} is no PNG image: {error}") from error
    if text is None:
        raise HeightMapError(
            "file", f"{source.name} holds no text {KEY!r}: give its scale in a file of that name, .json"
        )
    scale = _scale(text, f"{source.name}: text {KEY!r}")
    low, high = scale.z_low, scale.z_high
    counts = load_png(source, scale.cell, 0.0, 65535.0, scale.origin, scale.version)
    value = np.rint(counts.z.astype(np.float64))
    z = np.where(value == UNKNOWN, np.nan, low + (high - low) / 65534.0 * (value - 1.0))
    return counts.with_z(z.astype(np.float32))


def load_any(path: str | Path) -> HeightMap:
    """Read a map of any format: `.npz`, `.asc`, or a `.png` of `save_png` or of another program.

    The PNG of another program has its scale in a `.json` file of the same name: `cell`, `z_low` and `z_high`, the
    heights of black and white, in m, and optionally `origin`, the centre of the lower left pixel, and `version`.

    Raises:
        HeightMapError: the file is no map, or its scale is absent or wrong.
        FileNotFoundError: there is no such file.
    """
    source = Path(path)
    if source.suffix.lower() != ".png":
        return load(source)
    sidecar = source.with_suffix(".json")
    if not sidecar.exists():
        return load_own_png(source)
    check_size(sidecar)
    scale = _scale(sidecar.read_text(encoding="utf-8", errors="replace"), sidecar.name)
    return load_png(source, scale.cell, scale.z_low, scale.z_high, scale.origin, scale.version)


class _Scale(NamedTuple):
    """Scale of a PNG: edge of a pixel, heights of black and white, centre of the lower left pixel, all in m."""

    cell: float
    z_low: float
    z_high: float
    origin: tuple[float, float]
    version: int


def _scale(text: str, source: str) -> _Scale:
    try:
        entries: Any = json.loads(text)
        numbers = [float(entries[name]) for name in ("cell", "z_low", "z_high")]
        numbers += [float(value) for value in entries.get("origin", (0.0, 0.0))]
        version = int(entries.get("version", 0))
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise HeightMapError("file", f"{source} cannot be read: {error!r}") from error
    if not all(map(math.isfinite, numbers)) or len(numbers) != 5:
        raise HeightMapError("file", f"{source} must hold finite numbers, got {entries!r}")
    cell, low, high, x0, y0 = numbers
    return _Scale(cell, low, high, (x0, y0), version)
