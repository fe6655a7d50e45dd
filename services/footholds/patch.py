"""Choice of a foothold on a patch of heights, for any robot: without leg, map or service.

model = load(shipped("ragno")).scaled(2.5)
found = choose_on_patch(z, 0.0125, model, PatchStep(stroke=(-0.06, 0.0, 0.0), foot_radius=0.02))
found.foothold, found.slip, found.spread, found.rectangle
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.errors import SurefootError
from surefoot.geometry.heightmap import HeightMap, HeightMapError

from .features import Layer
from .ground import build_ground, ground_features
from .masks import REASONS, Limits, count_reasons, mask_window
from .models.protocol import SlipModel
from .rectangles import in_metres, largest_rectangle
from .select import SelectParams, best_cell, window_costs

MAX_SIDE = 301
"""Largest number of cells along an edge of a patch; a larger patch is refused."""


class PatchStep(NamedTuple):
    """Step of a foot onto a patch, as it is planned; axes and origin are those of the patch."""

    stroke: Sequence[float]
    """Movement of the foot relative to the body while it stands, (3,) m."""
    foot_radius: float
    """Radius of the foot sphere, m."""
    nominal: tuple[float, float] = (0.0, 0.0)
    """Where the foot would land without a choice, x and y from the middle of the patch, m."""


@dataclass(frozen=True, slots=True)
class PatchFoothold:
    """A foothold on a patch; lengths in m, in the frame of the patch."""

    foothold: tuple[float, float, float] | None
    """Foot centre, (x, y, z) m from the middle of the patch; None when no cell is free."""
    slip: float
    """Predicted slip per stroke, no unit; NaN without a foothold."""
    spread: float
    """Standard deviation of the slip of single steps, per stroke, no unit; NaN = not known."""
    rectangle: tuple[float, float, float, float] | None
    """Largest rectangle of free cells that holds the foothold, (x_min, y_min, x_max, y_max) m; None without a
    foothold."""
    counts: dict[str, int]
    """Number of cells excluded per reason (reach, collision, unknown, steep, slip, unlearned), and `free`."""


def choose_on_patch(
    z: NDArray[np.floating], cell: float, model: SlipModel, step: PatchStep, *, limits: Limits | None = None,
    allowed: NDArray[np.bool_] | None = None, smooth: bool = True, distance_weight: float | None = None,
) -> PatchFoothold:  # fmt: skip
    """Return the best foothold on a patch whose middle is the origin of its frame.

    Args:
        z: heights, (ny, nx) m, row along y, column along x, NaN = unknown; 3 to 301 cells a side.
        cell: edge of a cell, m.
        model: predicts the slip; a learned one holds for its own cell and foot, or scaled for a robot of another size.
        step: stroke, foot and nominal foothold.
        limits: slope, slip and how deep a foot may wedge; None = the usual ones.
        allowed: True for cells that the leg can reach, (ny, nx); None = all.
        smooth: 3 x 3 median over the heights first.
        distance_weight: k, 1/m, of the cost Q = P + k K4 by slip P and distance K4 (m) from the nominal foothold; None
            = that of the model.

    Raises:
        SurefootError: heights, sizes or numbers that cannot be, or a model of another cell, filter or foot.
    """
    heights = np.asarray(z, dtype=np.float32)
    _check_arguments(heights, step, allowed, distance_weight)
    surface = _surface(heights, cell)
    unfit = model.unfit(cell, smooth, step.foot_radius)
    if unfit:
        raise SurefootError("unfit", f"{model.name}: {unfit}", "model")
    ground = build_ground(surface, step.foot_radius, smooth)
    ny, nx = heights.shape
    push, params = np.array(step.stroke, dtype=np.float64), SelectParams(distance_weight=distance_weight)
    costs = window_costs(ground, model, (0, 0, ny, nx), push, step.nominal, params)
    mask = mask_window(ground, 0, 0, costs.slip, limits or Limits(), None)
    if allowed is not None:
        mask[~allowed] |= 1
    counts = np.zeros(len(REASONS) + 1, dtype=np.int64)
    count_reasons(mask, counts)
    cells = dict(zip((*REASONS, "free"), counts.tolist(), strict=True))
    at = best_cell(mask, costs)
    if at < 0:
        return PatchFoothold(None, math.nan, math.nan, None, cells)
    row, col = divmod(at, nx)
    x, y = surface.centre(row, col)
    lone = ground_features(ground, model.relief, (row, col, 1, 1), push)
    return PatchFoothold(
        foothold=(x, y, float(ground.centres.z[row, col])),
        slip=float(costs.mean[row, col]),
        spread=float(model.spread(lone, cell)[0, 0]),
        rectangle=in_metres(surface, largest_rectangle(mask == 0, row, col)),
        counts=cells,
    )


def _check_arguments(
    z: Layer, step: PatchStep, allowed: NDArray[np.bool_] | None, distance_weight: float | None
) -> None:
    """Raise SurefootError if an argument for the choice on a patch is out of range or has the wrong shape."""
    if z.ndim != 2 or not all(3 <= n <= MAX_SIDE for n in z.shape):
        raise SurefootError("invalid", f"z must have 3 to {MAX_SIDE} cells a side, got shape {z.shape}", "z")
    stroke, foot_radius, nominal = step
    if not (math.isfinite(foot_radius) and foot_radius > 0.0):
        raise SurefootError("invalid", f"must be > 0 m, got {foot_radius!r}", "foot_radius")
    if len(stroke) != 3 or not all(map(math.isfinite, (*stroke, *nominal))):
        raise SurefootError("invalid", f"must be finite, got {tuple(stroke)!r} and {nominal!r}", "stroke, nominal")
    if distance_weight is not None and not (math.isfinite(distance_weight) and distance_weight >= 0.0):
        raise SurefootError("invalid", f"must be >= 0, got {distance_weight!r}", "distance_weight")
    if allowed is not None and allowed.shape != z.shape:
        raise SurefootError("invalid", f"must have the shape of z {z.shape}, got {allowed.shape}", "allowed")


def _surface(z: Layer, cell: float) -> HeightMap:
    """Return the patch as a map whose middle is the origin of its frame."""
    ny, nx = z.shape
    try:
        return HeightMap(z=z, cell=cell, origin=(-0.5 * (nx - 1) * cell, -0.5 * (ny - 1) * cell))
    except HeightMapError as error:
        raise SurefootError("invalid", str(error), error.field) from None
