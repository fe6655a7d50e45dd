"""Choice of a foothold for each landing leg (Walas & Belter 2011, sections 2.3, 3.3, 3.4).

A foothold has two points: `foothold` is the foot CENTRE, taken from the map dilated by the foot sphere, to which the
leg is sent; `contact` is the point of the ground, one foot radius below along the normal.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.heightmap import HeightMap
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.kernels.jit import kernel
from surefoot.robot.description import Robot

from .features import Layer
from .footing import add_unsupported, average_landings
from .ground import FootholdGround, ground_features
from .masks import (
    REASONS,
    Limits,
    Mask,
    Placement,
    Reason,
    count_reasons,
    gradient,
    mask_window,
)
from .models.protocol import SlipModel
from .reach import leg_table
from .rectangles import in_metres, largest_rectangle
from .rolled_reach import LegTable

Point = tuple[float, float, float]
Flat = tuple[float, float]
Status = Literal["ok", "raise_trunk", "infeasible"]
BY_MODEL = np.uint8(Reason.SLIP | Reason.UNLEARNED)
"""Bits of a mask that only the slip model sets: slip over the limit, and ground outside what was learned."""
TIE = 1e-7
"""Difference of the cost Q (no unit), and of the distance K4 (m), below which two cells count as equal."""
MAX_BORDER = 6
"""Largest number of cells on each side of a cell over which the predicted slip is averaged."""


@dataclass(frozen=True, slots=True)
class SelectParams:
    """Parameters of the choice of footholds: search window, weight of distance, averaging, trunk heights, limits."""

    size: int = 15
    """Number of cells along an edge of the search window, odd (Walas & Belter 2011, 3.4)."""
    distance_weight: float | None = None
    """Weight k, 1/m, of the distance K4 from the nominal place in the cost slip + k K4; None = that of the model."""
    robust: bool = True
    """True: average the slip over the model's landing error, or the cost over free cells of 3 x 3; False: do not."""
    seed: int | None = None
    """Seed of a random choice of cell for every leg, to collect samples; None = the best cell. With a seed the slip
    model excludes no cell, or nothing could be learned where it is wrong; all other reasons do."""
    trunk_step: float = 0.005
    """Step between trunk heights that are tried to make a cell reachable, m."""
    trunk_range: float = 0.040
    """Largest change of trunk height that is proposed, either way, m."""
    limits: Limits = field(default_factory=Limits)
    region: bool = False
    """True: also return the largest rectangle of free cells that holds the foothold; False: the foothold only."""

    def weight(self, model: SlipModel) -> float:
        """Return the weight k, 1/m, of the distance K4 from the nominal foothold in the cost Q = slip + k K4."""
        return model.distance_weight if self.distance_weight is None else self.distance_weight


@dataclass(frozen=True, slots=True)
class TrunkPose:
    """Pose of base_link when the feet land, map frame."""

    position: Point
    """Origin of base_link, map frame, (3,) m."""
    quat_wxyz: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    """Rotation from base_link to map as a unit quaternion w, x, y, z."""


@dataclass(frozen=True, slots=True)
class Landing:
    """Leg about to land, with the nominal landing of its foot and the stroke of the coming stance."""

    leg: int
    """Index of the leg in the robot description."""
    nominal: Point
    """Foot centre the gait would land on, map frame, m; the height is not used."""
    stroke: Point
    """Movement of the foot relative to the body in the coming stance, map axes, m."""


@dataclass(frozen=True, slots=True)
class Foothold:
    """Foothold of one leg, or the reason why there is none."""

    status: Status
    foothold: Point | None = None
    """Centre of the foot on landing, map frame, m; None = infeasible."""
    contact: Point | None = None
    """Point where the foot touches the ground, map frame, m; None = infeasible."""
    normal: Point | None = None
    """Unit normal of the ground under the foothold, map axes; None = infeasible."""
    trunk_shift: float = 0.0
    """Change of trunk height that makes the foothold reachable, m, up positive; 0 = none is needed."""
    score: float = math.nan
    """Cost Q = P + k K4 of the chosen cell, predicted slip P plus weighted distance K4, no unit; NaN = infeasible."""
    slip: float = math.nan
    """Predicted slip P of the chosen cell per stroke, no unit; NaN = infeasible."""
    spread: float = math.nan
    """Standard deviation of the slip of single stances in the chosen cell, per stroke, no unit; NaN = not known."""
    counts: tuple[int, ...] = (0,) * (len(REASONS) + 1)
    """Number of cells excluded per reason (in the order of `REASONS`), then of free cells."""
    reason: str = ""
    """Reason in words why the foothold is not ok; empty = it is."""
    region: tuple[Flat, ...] = ()
    """Corners of the largest rectangle of free cells that holds the foothold, counterclockwise, map frame, m; empty:
    infeasible or not requested."""


def select(
    ground: FootholdGround,
    robot: Robot,
    model: SlipModel,
    base: TrunkPose,
    landings: Sequence[Landing],
    params: SelectParams = SelectParams(),
) -> tuple[Foothold, ...]:
    """Return the footholds of all legs that land together, in their order; wrong numbers are infeasible, not raised."""
    return tuple(select_leg(ground, robot, model, base, landing, params) for landing in landings)


def select_leg(
    ground: FootholdGround, robot: Robot, model: SlipModel, base: TrunkPose, landing: Landing, params: SelectParams
) -> Foothold:
    """Return the foothold of one leg: ok, raise_trunk with the change of height, or infeasible with the reason."""
    finite = (*base.position, *base.quat_wxyz, *landing.nominal[:2], *landing.stroke)
    if not all(math.isfinite(value) for value in finite):
        return Foothold("infeasible", reason="base, nominal or stroke holds a number that is not finite")
    x0, y0 = landing.nominal[0], landing.nominal[1]
    if not ground.near(x0, y0):
        return Foothold("infeasible", reason="the nominal foothold is far outside the map")
    placed = placement(robot, landing.leg, base, landing.stroke)
    if placed is None:
        return Foothold("infeasible", reason="the base has a zero quaternion")
    surface, n = ground.surface, params.size
    row, col = surface.index(x0, y0)
    row, col = row - n // 2, col - n // 2
    costs = window_costs(ground, model, (row, col, n, n), placed.stroke, (x0, y0), params)
    counts = np.zeros(len(REASONS) + 1, dtype=np.int64)
    first: tuple[int, ...] = ()
    known = not math.isnan(placed.leg[0])  # the reach of other legs is left to the walker
    steps = round(params.trunk_range / params.trunk_step) if params.trunk_step > 0.0 else 0
    for change in _changes(steps):
        shift = change * params.trunk_step
        at = placed if shift == 0.0 else placed._replace(base=placed.base + np.array((0.0, 0.0, shift)))
        mask = mask_window(ground, row, col, costs.slip, params.limits, at if known else None)
        if not first:
            count_reasons(mask, counts)
            first = tuple(int(value) for value in counts)
        index = best_cell(mask, costs) if params.seed is None else draw(mask, (params.seed, landing.leg))
        if index >= 0:
            found = _answer(ground, landing, (row, col, index), shift, model, costs, mask, first)
            return replace(found, region=_region(surface, (row, col), mask, index)) if params.region else found
        if not _hopeful(mask):
            break  # no trunk height frees a cell that the ground itself excludes
    return Foothold("infeasible", counts=first, reason=_why(first, params))


def placement(robot: Robot, leg: int, base: TrunkPose, stroke: Sequence[float]) -> Placement | None:
    """Return a leg and its base, frame map, as arrays; None if the quaternion is no rotation. `stroke`: (3,) m."""
    norm = math.sqrt(math.fsum(value * value for value in base.quat_wxyz))
    if not (norm > 1e-6 and math.isfinite(norm)):
        return None
    rot = matrix_from_quat(np.array(base.quat_wxyz) / norm)
    return Placement(
        _table(robot, leg), np.array(base.position, dtype=np.float64), rot, np.array(stroke, dtype=np.float64)
    )


class WindowCosts(NamedTuple):
    """Values that the choice in a window rests on: predicted slip P, distance K4, and how they make the cost Q."""

    slip: Layer
    """Predicted slip P of each single cell per stroke, no unit, (rows, cols); the masks are made from it."""
    mean: Layer
    """Mean of the slip P over the cells on which the foot may land, no unit, (rows, cols); P if landings are exact."""
    away: Layer
    """Distance K4 of each cell from the nominal foothold, (rows, cols) m."""
    weight: float
    """Weight k, 1/m, of the distance K4 in the cost Q = P + k K4, P the slip."""
    block: bool
    """True if the cost Q is the mean of P + k K4 over the free cells of 3 x 3, False if that of the single cell."""
    raised: Layer | None = None
    """`mean` with unknown ground under the disc of the foot as slip 1, P + U (1 - P), which takes the place of P in Q,
    no unit, (rows, cols); None = `mean` stays."""

    def q(self, mask: Mask) -> Layer:
        """Return the cost Q of every cell, no unit, (rows, cols): the choice is the free cell of the least one.

        `mask`: reasons against each cell, (rows, cols), 0 = free.
        """
        out = np.empty(self.slip.shape, dtype=np.float32)
        _q(mask, self.mean if self.raised is None else self.raised, self.away, self.weight, self.block, out)
        return out


def window_costs(
    ground: FootholdGround, model: SlipModel, window: tuple[int, int, int, int], stroke: Array,
    nominal: tuple[float, float] | None, params: SelectParams,
) -> WindowCosts:  # fmt: skip
    """Return predicted slip and distance from the nominal foothold of each cell of a window.

    Args:
        ground: layers of the map.
        model: predicts the slip.
        window: first row, first column, rows and columns; may leave the map.
        stroke: movement of the foot relative to the body while it stands, map axes, (3,) m.
        nominal: x, y of the nominal foothold, map frame, m; None: the distance is 0.
        params: weight of the distance, and whether slip is averaged over landings.
    """
    surface, (row, col, rows, cols) = ground.surface, window
    blur = landing_weights(model.landing_error, surface.cell) if params.robust else ALONE
    b = blur.shape[0] // 2
    features = ground_features(ground, model.relief, (row - b, col - b, rows + 2 * b, cols + 2 * b), stroke)
    around = model.predict(features, surface.cell)
    slip = around if b == 0 else np.ascontiguousarray(around[b:-b, b:-b])
    mean = slip if b == 0 else np.empty_like(slip)
    if b > 0:
        average_landings(around, blur, mean)
    raised = mean.copy()
    add_unsupported(ground, window, raised)
    away = np.zeros((rows, cols), dtype=np.float32)
    if nominal is not None:
        x, y = surface.centre(row, col)
        _distances((surface.cell, x - nominal[0], y - nominal[1]), away)
    return WindowCosts(slip, mean, away, params.weight(model), params.robust and b == 0, raised)


def best_cell(mask: Mask, costs: WindowCosts) -> int:
    """Return the flat index of the free cell of least cost, among equals nearest to the nominal foothold; -1: none.

    `mask`: reasons against each cell, (rows, cols), 0 = free.
    """
    return _least(mask, costs.q(mask), costs.away)


@kernel
def _distances(offset: Point, away: Layer) -> None:
    """Write distances, m, to `away` (r, c). `offset`: edge of a cell, x and y from the nominal to the first, m."""
    cell, shift_x, shift_y = offset
    for i in range(away.shape[0]):
        y = shift_y + i * cell
        for j in range(away.shape[1]):
            x = shift_x + j * cell
            away[i, j] = math.sqrt(x * x + y * y)


@kernel
def _q(mask: Mask, mean: Layer, away: Layer, weight: float, block: bool, out: Layer) -> None:
    """Write costs `mean` + `weight` (1/m) * `away` (m) of cells (r, c) to `out`; `block`: averaged over free 3 x 3."""
    rows, cols = mask.shape
    for i in range(rows):
        for j in range(cols):
            value, n = float(mean[i, j]) + weight * float(away[i, j]), 1
            if block and mask[i, j] == 0:
                value, n = 0.0, 0
                for r in range(max(0, i - 1), min(rows, i + 2)):
                    for c in range(max(0, j - 1), min(cols, j + 2)):
                        if mask[r, c] == 0:
                            value += float(mean[r, c]) + weight * float(away[r, c])
                            n += 1
            out[i, j] = value / n


@kernel
def _least(mask: Mask, q: Layer, away: Layer) -> int:
    """Return the flat index of the free cell (mask (r, c) = 0) of least q, of equals the least `away`; -1: none."""
    found, best_value, best_distance = -1, math.inf, math.inf
    for i in range(mask.shape[0]):
        for j in range(mask.shape[1]):
            if mask[i, j] != 0:
                continue
            value, distance = float(q[i, j]), float(away[i, j])
            tie = abs(value - best_value) <= TIE and distance < best_distance - TIE
            if value < best_value - TIE or tie:
                found, best_value, best_distance = i * mask.shape[1] + j, value, distance
    return found


ALONE = np.ones((1, 1))
"""Weights of the cells that a foot lands on if landings have no error: only the chosen one, (1, 1)."""


@lru_cache(maxsize=64)
def landing_weights(error: float, cell: float) -> Array:
    """Return the weights, no unit, of the cells a foot may land on, (2 b + 1, 2 b + 1) about the chosen one.

    Cells beyond two standard deviations are left out; the weights do not sum to 1.

    Args:
        error: standard deviation of the landing along each axis, m.
        cell: edge of a cell, m.
    """
    border = min(int(2.0 * error / cell), MAX_BORDER) if cell > 0.0 else 0
    if border == 0:
        return ALONE
    line = [math.exp(-0.5 * (k * cell / error) ** 2) for k in range(-border, border + 1)]
    return np.array([[a * b for b in line] for a in line])


def draw(mask: Mask, seed: Sequence[int]) -> int:
    """Return the flat index of a random cell that nothing but the slip model excludes, -1 if there is none.

    `mask`: reasons against each cell, (rows, cols), 0 = free; `seed`: of the draw.
    """
    free = np.flatnonzero((mask & ~BY_MODEL).ravel() == 0)
    return int(free[np.random.default_rng(seed).integers(free.size)]) if free.size else -1


def _changes(steps: int) -> list[int]:
    """Return changes of trunk height in steps, by size and upwards first: 0, 1, -1, 2, -2, ..."""
    return [0, *(sign * k for k in range(1, steps + 1) for sign in (1, -1))]


def _hopeful(mask: Mask) -> bool:
    """Return True if another trunk height may free a cell of mask (r, c): one that only reach and collision exclude."""
    return bool((mask < 4).any())


def _answer(
    ground: FootholdGround, landing: Landing, at: tuple[int, int, int], shift: float, model: SlipModel,
    costs: WindowCosts, mask: Mask, counts: tuple[int, ...],
) -> Foothold:  # fmt: skip
    index, n = at[2], mask.shape[1]
    row, col = at[0] + index // n, at[1] + index % n
    slip, score = float(costs.mean.flat[index]), float(costs.q(mask).flat[index])
    surface, stroke = ground.surface, np.array(landing.stroke, dtype=np.float64)
    alone = ground_features(ground, model.relief, (row, col, 1, 1), stroke)
    x, y = surface.centre(row, col)
    if (row, col) == surface.index(landing.nominal[0], landing.nominal[1]):
        x, y = float(landing.nominal[0]), float(landing.nominal[1])  # the nominal cell: no reason to move within it
    z = ground.centres.height_at(x, y)
    if math.isnan(z):
        z = float(ground.centres.z[row, col])
    gx, gy = (g if math.isfinite(g) else 0.0 for g in gradient(surface.z, surface.cell, row, col))  # level at gaps
    length = math.sqrt(gx * gx + gy * gy + 1.0)
    normal = (-gx / length, -gy / length, 1.0 / length)
    r = ground.foot_radius
    return Foothold(
        status="ok" if shift == 0.0 else "raise_trunk",
        foothold=(x, y, z),
        contact=(x - r * normal[0], y - r * normal[1], z - r * normal[2]),
        normal=normal,
        trunk_shift=shift,
        score=score if slip >= 0.0 else math.nan,
        slip=slip if slip >= 0.0 else math.nan,
        spread=float(model.spread(alone, surface.cell)[0, 0]),
        counts=counts,
        reason="" if shift == 0.0 else f"no free cell at this trunk height, one with the trunk {1e3 * shift:+.0f} mm",
    )


def _region(surface: HeightMap, corner: tuple[int, int], mask: Mask, index: int) -> tuple[Flat, ...]:
    """Return the corners, m, map frame, of the free rectangle about cell `index` of a window begun at `corner`."""
    (row, col), cells = corner, largest_rectangle(mask == 0, *divmod(index, mask.shape[1]))
    left, low, right, high = in_metres(surface, (row + cells[0], row + cells[1], col + cells[2], col + cells[3]))
    return (left, low), (right, low), (right, high), (left, high)


def _why(counts: tuple[int, ...], params: SelectParams) -> str:
    cells = params.size**2
    listed = ", ".join(f"{name} {count}" for name, count in zip(REASONS, counts, strict=False) if count)
    if counts[REASONS.index("unknown")] == cells:
        return f"all {cells} cells are unknown or outside the map"
    span = f"{1e3 * params.trunk_range:.0f} mm"
    return f"none of {cells} cells is free, nor with the trunk moved by up to +-{span}; excluded by: {listed}"


@lru_cache(maxsize=64)
def _table(robot: Robot, leg: int) -> LegTable:
    return leg_table(robot.model, leg)
