"""Layers of a terrain map by which footholds are chosen: ground coefficients, slip, cost, reasons against cells."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from surefoot.geometry.heightmap_cells import patch

from .features import Layer
from .ground import FootholdGround, ground_features
from .masks import REASONS, Mask, Placement, count_reasons, mask_window
from .models.protocol import SlipModel
from .select import SelectParams, window_costs

LAYERS = ("z", "centre", "k1", "k2", "cos_k3", "k4", "p", "q", "mask", "spread", "support", "clear")
"""Names of the layers that a request may ask for: ground height `z` and foot-centre height `centre` (m), coefficients
`k1`, `k2` (m), `cos_k3`, distance `k4` from the nominal foothold (m), mean predicted slip `p`, cost `q`, bits of
reasons against a cell `mask`, standard deviation of single slips `spread`, share of p that was learned `support`,
radius of the free disc `clear` (m)."""


@dataclass(frozen=True, slots=True)
class Window:
    """Rectangle of cells of a height map, by its first row and column and its size; it may reach beyond the map."""

    row: int
    """First row of the window on the map; may lie outside the map."""
    col: int
    """First column of the window on the map; may lie outside the map."""
    rows: int
    cols: int


@dataclass(frozen=True, eq=False)
class Assessment:
    """Result of `assess`: requested layers of a window of the map, and number of its cells by reason of exclusion."""

    layers: Layer
    """Requested layers of the window in the order of their names, (number of layers, rows, cols) float32."""
    counts: tuple[int, ...]
    """Number of cells excluded per reason (reach, collision, unknown, steep, slip, unlearned), then of free cells,
    (7,)."""


def window_about(ground: FootholdGround, x: float, y: float, size: int) -> Window:
    """Return the window of size x size cells about the cell that holds a point x, y, map frame, m."""
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
    """Return layers of every cell of a window: predicted slip, cost of stepping there, and reasons against it.

    Args:
        ground: layers of the map.
        model: predicts the slip P of a cell.
        window: cells to score.
        nominal: place from which the distance K4 counts, map frame, m; None: K4 = 0 everywhere, so the cost is P.
        stroke: movement of the foot relative to the body while it stands, map axes, (3,) m.
        names: layers wanted: z, centre, k1, k2, cos_k3, k4, p, q, mask, spread, support, clear.
        params: limits of a foothold, and weight k of the cost Q = P + k K4.
        placement: the leg for the reach and collision tests; None tests the ground alone.
    """
    surface, cell = ground.surface, ground.surface.cell
    push, cells = np.asarray(stroke, dtype=np.float64), (window.row, window.col, window.rows, window.cols)
    costs = window_costs(ground, model, cells, push, nominal, params)
    mask = mask_window(ground, window.row, window.col, costs.slip, params.limits, placement)
    counts = np.zeros(len(REASONS) + 1, dtype=np.int64)
    count_reasons(mask, counts)
    own = ground_features(ground, model.relief, cells, push)
    paper = ground_features(ground, False, cells, push)
    made: dict[str, Callable[[], Layer]] = {
        "z": lambda: _patch(surface.z, window), "centre": lambda: _patch(ground.centres.z, window),
        "p": lambda: costs.mean, "q": lambda: costs.q(mask), "k4": lambda: costs.away,
        "mask": lambda: mask.astype(np.float32), "spread": lambda: model.spread(own, cell),
        "support": lambda: model.support_of(own, cell), "clear": lambda: _clear(mask, cell),
    }  # fmt: skip
    out = np.empty((len(names), window.rows, window.cols), dtype=np.float32)
    for k, name in enumerate(names):
        out[k] = made[name]() if name in made else getattr(paper, name)
    return Assessment(out, tuple(int(value) for value in counts))


def _patch(z: Layer, window: Window) -> Layer:
    """Return the cells of a window of a layer (ny, nx), NaN outside the map."""
    out = np.empty((window.rows, window.cols), dtype=np.float32)
    patch(z, window.row, window.col, out)
    return out


def _clear(mask: Mask, cell: float) -> Layer:
    """Return the radius of the disc of free cells about each cell, m: the distance of the nearest that is not free.

    `mask`: reasons against each cell, (r, c), 0 = free; beyond the window nothing is. `cell`: edge of a cell, m.
    """
    from scipy.ndimage import distance_transform_edt

    free = np.pad(mask == 0, 1)  # beyond the window nothing is free
    return cell * np.asarray(distance_transform_edt(free), dtype=np.float32)[1:-1, 1:-1]
