"""Height maps of any format, read by the name of the file; a PNG has its scale beside it."""

import json
import math
from pathlib import Path
from typing import Any, NamedTuple

from surefoot.geometry.heightmap import HeightMap, HeightMapError
from surefoot.geometry.heightmap_files import check_size, load, load_png


def load_any(path: str | Path) -> HeightMap:
    """Read a map of any format: `.npz`, `.asc` or `.png`.

    A PNG has its scale in a `.json` file of the same name: `cell`, `z_low` and `z_high`, the heights of black and
    white, in m, and optionally `origin`, the centre of the lower left pixel, and `version`.

    Raises:
        HeightMapError: the file is no map, or its scale is absent or wrong.
        FileNotFoundError: there is no such file.
    """
    source = Path(path)
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
