"""Layers of the scored ground, as the choice of footholds uses them: for people and planners."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from surefoot.geometry.heightmap_cells import patch

from .features import Features, Layer, distance, map_features, window_features
from .ground import FootholdGround
from .masks import REASONS, Placement, count_reasons, mask_window
from .models.protocol import SlipModel
from .select import SelectParams

LAYERS = ("z", "centre", "k1", "k2", "cos_k3", "k4", "p", "q", "mask")


@dataclass(frozen=True, slots=True)
class Window:
    """Rectangle of cells; may reach beyond the map."""

    row: int
    """First row; may lie outside the map."""
    col: int
    """First column; may lie outside the map."""
    rows: int
    cols: int


@dataclass(frozen=True, eq=False)
class Assessment:
    """Layers of one window, and counts of its cells."""

    layers: Layer
    """Layers in the order of the request, (number of layers, rows, cols) float32."""
    counts: tuple[int, ...]
    """Cells excluded per reason, then free cells."""


def window_about(ground: FootholdGround, x: float, y: float, size: int) -> Window:
    """Return the window of size x size cells about the cell that holds a point, map frame, m."""
    row, col = ground.surface.index(x, y)
    return Window(row - size // 2, col - size // 2, size, size)


def whole_map(ground: FootholdGround) -> Window:
    """Return the window of all cells of the map."""
    return Window(0, 0, *ground.surface.shape)


def assess(
    ground: FootholdGround,
    model: SlipModel,
    window: Window,
    nominal: tuple[float, float] | None,
    stroke: Sequence[float],
    names: Sequence[str],
    params: SelectParams,
    placement: Placement | None = None,
) -> Assessment:
    """Return the score of every cell of a window.

    Args:
        ground: the prepared map.
        model: the slip model.
        window: cells to score.
        nominal: zero of K4, map frame, m; None: K4 = 0 everywhere, so q = p.
        stroke: movement of the foot relative to the body in stance, map axes, (3,) m.
        names: layers wanted, of `LAYERS`.
        params: limits of a foothold, and k of Q = P + k K4.
        placement: the leg for the reach and collision tests; None tests the ground alone.
    """
    surface = ground.surface
    push = np.asarray(stroke, dtype=np.float64)
    features = _features(surface.z, window, push, surface.cell)
    slip = model.predict(features, surface.cell)
    mask = mask_window(ground, window.row, window.col, slip, params.limits, placement)
    counts = np.zeros(len(REASONS) + 1, dtype=np.int64)
    count_reasons(mask, counts)
    away = np.zeros(slip.shape, dtype=np.float32)
    if nominal is not None:
        xs = surface.origin[0] + surface.cell * (window.col + np.arange(window.cols, dtype=np.float64))
        ys = surface.origin[1] + surface.cell * (window.row + np.arange(window.rows, dtype=np.float64))
        away = distance(xs, ys, *nominal).astype(np.float32)
    out = np.empty((len(names), window.rows, window.cols), dtype=np.float32)
    for k, name in enumerate(names):
        if name == "z":
            patch(surface.z, window.row, window.col, out[k])
        elif name == "centre":
            patch(ground.centres.z, window.row, window.col, out[k])
        elif name == "p":
            out[k] = slip
        elif name == "q":
            out[k] = slip + np.float32(params.weight(model)) * away
        elif name == "k4":
            out[k] = away
        elif name == "mask":
            out[k] = mask
        else:
            out[k] = getattr(features, name)
    return Assessment(out, tuple(int(value) for value in counts))


def _features(z: Layer, window: Window, stroke: np.ndarray, cell: float) -> Features:
    if window == Window(0, 0, z.shape[0], z.shape[1]):
        return map_features(z, stroke, cell)
    return window_features(z, window.row, window.col, window.rows, window.cols, stroke, cell)
