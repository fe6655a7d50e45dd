"""Ground: height maps, and where on them a foot should be put.

    ground = terrain.generate("rough", seed=3)
    terrain.foothold(ground.patch(0.3, 0.1, 41), ground.cell, stroke=(-0.05, 0.0, 0.0)).foothold

Heights in m, row along y, column along x, NaN = unknown.
"""

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surefoot.arguments import array, file_path, instance, number, shown, whole
from surefoot.errors import FieldError
from surefoot.geometry.heightmap import HeightMap
from surefoot.geometry.heightmap_exchange import load_any
from surefoot.geometry.heightmap_files import save as save_npz
from surefoot.services.footholds.models.files import load as load_model
from surefoot.services.footholds.models.files import shipped
from surefoot.services.footholds.models.learned import LearnedModel
from surefoot.services.footholds.patch import MAX_SIDE, PatchFoothold, PatchStep, choose_on_patch

__all__ = ["HeightMap", "LearnedModel", "PatchFoothold", "foothold", "generate", "load", "save", "slip_model"]

HIGHEST = 100.0
"""Largest absolute height in a terrain patch, m; a larger one is refused, as probably in millimetres."""
STEEPEST = 5.0
"""Largest difference of two heights of a patch, in sides of the patch; a larger one is refused, as of other units."""
LARGEST_FOOT, LARGEST_CELL, LONGEST_STROKE = 0.5, 0.5, 2.0
"""`LARGEST_FOOT`: largest radius of a foot, m; `LARGEST_CELL`: largest edge of a cell, m; `LONGEST_STROKE`: largest
component of a foot's stroke, m; larger ones are refused."""

RESERVED = ("z", "cell", "origin", "version", "frame", "file", "allow_pickle")
"""Names that `save` refuses for extras: those of the map's arrays, and of arguments of numpy."""


def slip_model(source: str | PathLike[str] = "ragno") -> LearnedModel:
    """Return a learned model of how far feet slip, by the name of its robot or the path of its file.

    Raises:
        SurefootError: there is no such model.
    """
    path = file_path(source, "source")
    return load_model(shipped(source) or path if isinstance(source, str) else path)


def foothold(
    heights: ArrayLike, cell: float, *, stroke: Sequence[float], foot_radius: float | None = None,
    nominal: Sequence[float] = (0.0, 0.0), model: LearnedModel | None = None,
    allowed: NDArray[np.bool_] | None = None,
) -> PatchFoothold:  # fmt: skip
    """Return the best place for a foot on a patch of ground whose middle is the origin.

    Args:
        heights: heights of the patch, (ny, nx) m, NaN = unknown, 3 to 301 cells a side.
        cell: edge of a cell, m.
        stroke: movement of the foot relative to the body in the coming stance, (3,) m.
        foot_radius: radius of the foot sphere, m; None = that of the model.
        nominal: where the foot would land without a choice, (2,) m; on the patch.
        model: model of the slip; None = that of Ragno. It is scaled to the cells of the patch.
        allowed: cells that the leg can reach, (ny, nx); None = all. How deep a cell lies does not count: the bottom of
            a pit is ground like any other unless it is left out here, or unknown.

    Raises:
        FieldError: an argument that cannot be used; a nominal place outside of the patch.
        SurefootError: the model does not fit the foot.
    """
    z = array(heights, "heights", ("ny", "nx"), "m", low=-HIGHEST, high=HIGHEST, nan=True)
    if not all(3 <= n <= MAX_SIDE for n in z.shape):
        raise FieldError("shape", "heights", f"got shape {z.shape}, expected 3 to {MAX_SIDE} cells a side")
    size = number(cell, "cell", "m", low=1e-4, high=LARGEST_CELL)
    rise, side = float(np.nanmax(z) - np.nanmin(z)) if np.isfinite(z).any() else 0.0, max(z.shape) * size
    if rise > STEEPEST * side:
        most = f"allowed are {STEEPEST * side:g}, are these millimetres?"
        raise FieldError("range", "heights", f"got {rise:g} m between two heights of a patch of {side:g} m, {most}")
    x, y = array(nominal, "nominal", (2,), "m").tolist()
    half_x, half_y = 0.5 * z.shape[1] * size, 0.5 * z.shape[0] * size
    if abs(x) > half_x or abs(y) > half_y:
        text = f"got ({x:g}, {y:g}) m, outside of the patch: allowed are +-{half_x:g} and +-{half_y:g} m"
        raise FieldError("range", "nominal", text)
    free = None if allowed is None else array(allowed, "allowed", z.shape, low=0.0, high=1.0) > 0.0
    known = slip_model() if model is None else model
    instance(known, "model", LearnedModel, "the result of `terrain.slip_model`")
    scaled = known.scaled(size / known.conditions.cell) if size != known.conditions.cell else known
    radius = scaled.conditions.foot_radius if foot_radius is None else foot_radius
    push = array(stroke, "stroke", (3,), "m", low=-LONGEST_STROKE, high=LONGEST_STROKE)
    step = PatchStep(push.tolist(), number(radius, "foot_radius", "m", low=1e-3, high=LARGEST_FOOT), (x, y))
    return choose_on_patch(z, size, scaled, step, allowed=free)


def generate(kind: str = "rough", seed: int = 0, amplitude: float | None = None) -> HeightMap:
    """Return the height map of one of the simulator's grounds, exact at the cell centres.

    Equal arguments give maps of equal bits.

    Args:
        kind: name of a ground, e.g. flat, rough, hills, steps, demo.
        seed: seed of the random kinds.
        amplitude: height the kind scales with, m; None = the kind's own.

    Raises:
        FieldError: an unknown kind or a value out of range.
    """
    from surefoot.services.simulator.ground.terrain import make_terrain

    instance(kind, "kind", str, "the name of a ground")
    height = None if amplitude is None else number(amplitude, "amplitude", "m", low=0.0, high=1.0)
    return make_terrain(kind, whole(seed, "seed", low=0), height).map


def save(heightmap: HeightMap, path: str | PathLike[str], **extra: str | int | float) -> Path:
    """Write `<path>.npz` (map and extras) and `<path>.json` (header and digest); return the path of the first.

    Args:
        heightmap: map to write.
        path: path of the file, with or without `.npz`.
        extra: how the map came to be, such as kind and seed; kept in both files.

    Raises:
        FieldError: no height map, no path, one that cannot be written, or an extra that is no text or number, or has
            the name of an array of the map.
    """
    instance(heightmap, "heightmap", HeightMap, "a height map")
    target = file_path(path, "path")
    if not target.name:
        raise FieldError("unwritable", "path", f"got {shown(str(path))}, expected the name of a file")
    given: dict[str, Any] = dict(extra)
    for name, value in given.items():
        if name in RESERVED:
            raise FieldError("reserved", name, f"got {shown(value)}, a name of the map's own: {', '.join(RESERVED)}")
        if not isinstance(value, str | int | float):
            raise FieldError("type", name, f"got {shown(value)}, expected text or a number")
        if isinstance(value, int) and not isinstance(value, bool):
            whole(value, name)
    try:
        return save_npz(heightmap, target, **extra)
    except OSError as error:
        raise FieldError("unwritable", "path", f"{target} cannot be written: {error.strerror}") from None


def load(path: str | PathLike[str]) -> HeightMap:
    """Read a height map, `.npz` of `save`, `.asc`, `.png` or GeoTIFF (raises SurefootError: it cannot be read)."""
    source = file_path(path, "path")
    try:
        return load_any(source)
    except OSError as error:
        raise FieldError("not_found", "path", f"{source} cannot be read: {error.strerror}") from None
