"""Zones in files: the list `zones` in the YAML of a map_server map, which ignores it, or in a YAML of its own.

zones:
  - {name: stairs, type: keepout, polygon: [[1.0, 0.2], [1.6, 0.2], [1.6, 1.0]]}
  - {name: kitchen, type: speed_limit, speed_limit: 50, polygon: [[2, 0], [3, 0], [3, 1], [2, 1]]}
  - {name: ramp, type: speed_limit, speed_limit: 0.03, percentage: false, polygon: [[4, 0], [5, 0], [5, 1]]}
  - {name: lab, type: keepout, mask: keepout_mask.yaml}
  - {name: hall, type: speed_limit, mask: speed_mask.yaml, base: 100.0, multiplier: -1.0}
"""

import math
from pathlib import Path
from typing import Annotated, Any, Self, cast

import numpy as np
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError, model_validator
from pydantic.dataclasses import dataclass

from . import map_files
from .map_files import Coordinate, MapFileError, Number
from .zones import Kind, Zone, Zones

MOST_ZONES = 200
THINNEST = 1e-3
"""Least spread of a polygon's corners across the line that fits them best, m; a smaller one is refused."""


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class ZoneInfo:
    """Entry of the list `zones` of a file."""

    name: Annotated[str, Field(min_length=1, max_length=64)]
    """Name of the zone, in refusals and logs."""
    type: Kind
    """keepout, or speed_limit."""
    polygon: Annotated[tuple[tuple[Coordinate, Coordinate], ...], Field(min_length=3)] | None = None
    """Corners in order, x and y in m, frame map; None = the zone is a mask."""
    mask: str | None = None
    """YAML of a map_server map in the folder of the file, or below it."""
    speed_limit: Annotated[Number, Field(gt=0.0, le=100.0)] | None = None
    """Largest speed in a polygon, in % or m/s."""
    percentage: bool = True
    """True: speeds are in % of that of the action that is walked; False: in m/s."""
    base: Annotated[Number, Field(ge=-1e3, le=1e3)] | None = None
    """Speed limit that a mask's value of 0 % would give, in % or m/s; None = 0."""
    multiplier: Annotated[Number, Field(ge=-1e3, le=1e3)] | None = None
    """Speed limit added for each % of a mask's value, in % or m/s; None = 1."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if (self.polygon is None) == (self.mask is None):
            raise ValueError("a zone has a polygon or a mask")
        slow = self.type == "speed_limit"
        if (self.speed_limit is not None) != (slow and self.mask is None):
            raise ValueError("speed_limit goes with a polygon of type speed_limit")
        if (self.base, self.multiplier) != (None, None) and not (slow and self.mask is not None):
            raise ValueError("base and multiplier go with a mask of type speed_limit")
        if self.polygon is not None and _width(np.array(self.polygon)) < THINNEST:
            raise ValueError("the corners of polygon lie on a line")
        return self


INFO = TypeAdapter(ZoneInfo)


def load(path: str | Path, *, required: bool = True) -> Zones:
    """Return the zones of a YAML file.

    Args:
        path: file with a list `zones`.
        required: True = a file without the list is refused; False = it has no zones.

    Raises:
        MapFileError: a file is missing, no such list, or has an entry that cannot be used; `field` names it.
    """
    source = Path(path)
    table = map_files.table_of(map_files.text_of(source), source)
    if "zones" not in table and not required:
        return Zones()
    entries = table.get("zones")
    if not isinstance(entries, list) or not 1 <= len(cast("list[Any]", entries)) <= MOST_ZONES:
        raise MapFileError("malformed", f"{source.name}: zones is a list of 1 to {MOST_ZONES} zones", "zones")
    found: dict[str, Zone] = {}
    for i, entry in enumerate(cast("list[Any]", entries)):
        zone = _zone(entry, source, f"zones.{i}")
        if zone.name in found:
            raise MapFileError("malformed", f"{source.name}: two zones are called {zone.name!r}", f"zones.{i}.name")
        found[zone.name] = zone
    return Zones(tuple(found.values()))


def _zone(entry: Any, source: Path, field: str) -> Zone:
    """Return the zone of an entry of the list; `source`: the file, `field`: the entry, for a refusal."""
    try:
        info = INFO.validate_python(entry)
    except ValidationError as error:
        first = error.errors()[0]
        at = ".".join((field, *(str(part) for part in first["loc"])))
        got = "" if first["type"] == "missing" else f", got {str(first['input'])[:120]!r}"
        why = first["msg"].removeprefix("Value error, ")
        raise MapFileError("malformed", f"{source.name}: {at}: {why}{got}", at) from None
    polygon, mask = np.array(info.polygon or np.zeros((0, 2))), None
    if info.mask is not None:
        folder = source.resolve().parent
        file = (folder / info.mask).resolve() if "\0" not in info.mask else folder.parent
        if not file.is_relative_to(folder):
            text = (
                f"{source.name}: {field}.mask must be in the folder of the file, or below it, got {info.mask[:120]!r}"
            )
            raise MapFileError("malformed", text, f"{field}.mask")
        mask = map_files.load(file)
    return Zone(
        info.name, info.type, polygon, mask, info.speed_limit or 0.0, info.percentage, info.base or 0.0,
        1.0 if info.multiplier is None else info.multiplier,
    )  # fmt: skip


def _width(corners: np.ndarray) -> float:
    """Return how far corners spread across the line that fits them best, m; `corners`: (n, 2) m."""
    x, y = (corners - corners.mean(axis=0)).T
    xx, yy, xy = float((x * x).sum()), float((y * y).sum()), float((x * y).sum())
    return math.sqrt(max(0.0, 0.5 * (xx + yy) - math.hypot(0.5 * (xx - yy), xy)))  # no LAPACK: the same bits everywhere
