"""Reasons why a cell is no foothold: one bit per reason, several may be set."""

import math
from dataclasses import dataclass
from enum import IntFlag
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.kernels.jit import kernel, row_kernel

from .features import Layer
from .ground import FootholdGround
from .models.protocol import UNLEARNED
from .reach import solve
from .rolled_reach import LEG_NUMBERS, LegTable

Mask = NDArray[np.uint8]
Vector = tuple[float, float, float]
Rotation = tuple[float, float, float, float, float, float, float, float, float]
"""Elements of the rotation matrix rot_map_from_base, row by row: a tuple, which kernels handle faster than arrays."""


class Reason(IntFlag):
    """Reasons why a cell is no foothold, as bits of a mask; replies use the same names."""

    REACH = 1
    """Bit of value 1: the leg does not reach the cell with the required margin, at landing or at the stroke's end."""
    COLLISION = 2
    """Bit of value 2: the foot sphere would wedge against an edge, or the leg would cut the ground."""
    UNKNOWN = 4
    """Bit of value 4: the 3 x 3 cells around the cell are not all known, or the slip model has no valid prediction."""
    STEEP = 8
    """Bit of value 8: the slope of the ground is above `Limits.slope`."""
    SLIP = 16
    """Bit of value 16: the predicted slip per stroke is above `Limits.slip`."""
    UNLEARNED = 32
    """Bit of value 32: the ground coefficients of the cell lie outside what the slip model has learned."""


REASONS: tuple[str, ...] = tuple(str(reason.name).lower() for reason in Reason)
"""Names of the bits of a mask of `Reason`, lowest first."""

_REACH, _COLLISION, _UNKNOWN, _STEEP, _SLIP, _UNLEARNED = (int(reason) for reason in Reason)


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of slip, slope, wedging and reach that a foothold must keep; a cell beyond one is excluded."""

    slip: float = 0.4
    """Largest predicted slip, distance slid per length of stroke (no unit); a guess, not measured."""
    slope: float = 0.9
    """Largest slope of the ground, dz/dx, no unit; 0.9 = 42 deg. Above the friction angle of most ground (mu 0.35 to
    0.7) on a plane; a foot that faces the push still stands. A vertical step of 10 mm has slope 1 in 5 mm cells."""
    wedge: float = 0.5
    """Largest height by which a neighbour cell may lift the foot off its own cell, as a share of the foot radius; above
    it the cell is excluded, since the foot would hang on an edge."""
    reach_margin: float = 0.010
    """Least distance of the foot from the edge of the leg's workspace at landing and lift-off, m: body error plus one
    cell."""
    leg_radius: float = 0.005
    """Radius of the leg around its centre line, m; ground closer than this to the centre line counts as a collision."""


class _HeightGrid(NamedTuple):
    """Map of ground heights and the position of its cells, for kernels."""

    z: Layer
    """Ground heights, row along y, column along x, (ny, nx) m."""
    cell: float
    """Edge of a cell, m."""
    x0: float
    """x of the centre of cell [0, 0], map frame, m."""
    y0: float
    """y of the centre of cell [0, 0], map frame, m."""


class Placement(NamedTuple):
    """Leg about to land, with the pose of base_link then and the stroke, for the tests of reach and collision."""

    leg: LegTable
    """The leg as 32 numbers (hip, lengths, joint limits) for kernels; NaN = a leg without closed form."""
    base: Array
    """Position of base_link at landing, map frame, (3,) m."""
    rot: Array
    """Rotation matrix rot_map_from_base at landing, (3, 3)."""
    stroke: Array
    """Movement of the foot relative to the body while it stands, map axes, (3,) m."""


NO_LEG = Placement((math.nan,) * LEG_NUMBERS, np.zeros(3), np.eye(3), np.zeros(3))
"""Placement without a leg: neither reach nor the leg's collisions are tested."""


def mask_window(
    ground: FootholdGround, row: int, col: int, slip: Layer, limits: Limits, placement: Placement | None
) -> Mask:
    """Return the reasons against each cell of the window that starts at (row, col).

    Args:
        ground: layers of the map.
        row: first row of the window; may lie outside the map, such cells are unknown.
        col: first column.
        slip: predicted slip per stroke, no unit, (rows, cols), NaN = unknown, -1 = outside what the model has learned.
        limits: what a foothold must keep.
        placement: the leg and the pose it lands from; None tests the ground alone.

    Returns:
        (rows, cols) uint8, sum of bits: 1 reach, 2 collision, 4 unknown, 8 steep, 16 slip, 32 unlearned; 0 = free.
    """
    out = np.empty(slip.shape, dtype=np.uint8)
    surface = ground.surface
    grid = (surface.cell, surface.origin[0], surface.origin[1], ground.foot_radius)
    numbers = (limits.slip, limits.slope, limits.wedge * ground.foot_radius, limits.reach_margin, limits.leg_radius)
    leg, base, rot, stroke = NO_LEG if placement is None else placement
    placed = (leg, base, rot, stroke)
    _mask(surface.z, ground.centres.z, grid, (row, col), slip, (*numbers, placement is not None), placed, out)
    return out


@kernel
def count_reasons(mask: Mask, counts: NDArray[np.int64]) -> None:
    """Write the number of cells with each bit of a mask to `counts`.

    Args:
        mask: sums of bits (1 reach, 2 collision, 4 unknown, 8 steep, 16 slip, 32 unlearned), (rows, cols), 0 = free.
        counts: written, (7,): cells with each bit, lowest first, then free cells.
    """
    counts[:] = 0
    for i in range(mask.shape[0]):
        for j in range(mask.shape[1]):
            bits = mask[i, j]
            if bits == 0:
                counts[6] += 1
            for k in range(6):
                if bits >> k & 1:
                    counts[k] += 1


@row_kernel
def gradient(z: Layer, cell: float, row: int, col: int) -> tuple[float, float]:
    """Return the slope dz/dx and dz/dy, no unit, of the plane through the 3 x 3 cells around a cell; NaN = unknown.

    Args:
        z: heights, (ny, nx) m, row along y, column along x, NaN = unknown.
        cell: edge of a cell, m.
        row: row of the middle cell; at the border of the map the slope is unknown.
        col: column of the middle cell.
    """
    ny, nx = z.shape
    if row < 1 or col < 1 or row >= ny - 1 or col >= nx - 1:
        return math.nan, math.nan
    gx, gy, known = 0.0, 0.0, 0.0
    for k in range(-1, 2):
        gx += float(z[row + k, col + 1]) - float(z[row + k, col - 1])
        gy += float(z[row + 1, col + k]) - float(z[row - 1, col + k])
    known = float(z[row, col]) - float(z[row, col])
    return gx / (6.0 * cell) + known, gy / (6.0 * cell) + known


@row_kernel
def _cuts(ground: _HeightGrid, a: Vector, b: Vector, first: float, radius: float) -> bool:
    """Return True if the segment from a to b comes closer to the ground than a radius; checked at least once a cell.

    Args:
        ground: heights of the map.
        a: one end, map frame, m.
        b: the other end, map frame, m.
        first: share of the way from a to b that is left out.
        radius: radius of the leg, m, measured vertically.
    """
    ax, ay, az = a
    bx, by, bz = b
    z = ground.z
    per_cell, x0, y0 = 1.0 / ground.cell, ground.x0, ground.y0
    ny, nx = z.shape
    du, dv, dh = (bx - ax) * per_cell, (by - ay) * per_cell, bz - az
    steps = int((1.0 - first) * max(abs(du), abs(dv))) + 2
    step = (1.0 - first) / (steps - 1)
    u, v, h = (ax - x0) * per_cell + 0.5 + first * du, (ay - y0) * per_cell + 0.5 + first * dv, az + first * dh
    du, dv, dh = du * step, dv * step, dh * step
    h -= radius
    for _ in range(steps):
        if u >= 0.0 and u < nx and v >= 0.0 and v < ny and h < z[np.uint32(v), np.uint32(u)]:
            return True
        u += du
        v += dv
        h += dh
    return False


@row_kernel
def _leg_bits(
    ground: _HeightGrid, leg: LegTable, base: Vector, rot: Rotation, foot: Vector, keep: tuple[float, float, float]
) -> int:
    """Return 1 if a leg does not reach a foot place with margin, 2 if it would cut the ground, else 0.

    Args:
        ground: heights of the map.
        leg: 32 numbers of the leg for kernels.
        base: position of base_link, map frame, m.
        rot: rot_map_from_base, row by row.
        foot: centre of the foot, map frame, m.
        keep: reach margin, radius of the leg and highest ground under it, m.
    """
    bx, by, bz = base
    x, y, height = foot
    margin, leg_radius, top = keep
    dx, dy, dz = x - bx, y - by, height - bz
    xx, xy, xz, yx, yy, yz, zx, zy, zz = rot
    reached, jx, jy, jz, nx, ny, nz = solve(
        leg, xx * dx + yx * dy + zx * dz, xy * dx + yy * dy + zy * dz, xz * dx + yz * dy + zz * dz
    )
    if not reached >= margin:
        return _REACH
    hx, hy, hz = bx + xx * jx + xy * jy + xz * jz, by + yx * jx + yy * jy + yz * jz, bz + zx * jx + zy * jy + zz * jz
    kx, ky, kz = bx + xx * nx + xy * ny + xz * nz, by + yx * nx + yy * ny + yz * nz, bz + zx * nx + zy * ny + zz * nz
    # the foot's own end is left out: the sphere rests on the dilated map there; most legs pass above all ground
    low = height + 0.2 * (kz - height)
    if min(low, kz) < top + leg_radius and _cuts(ground, foot, (kx, ky, kz), 0.2, leg_radius):
        return _COLLISION
    low = kz + 0.25 * (hz - kz)
    if min(low, hz) < top + leg_radius and _cuts(ground, (kx, ky, kz), (hx, hy, hz), 0.25, leg_radius):
        return _COLLISION
    return 0


@row_kernel
def _highest(
    ground: _HeightGrid, corner: tuple[int, int], shape: tuple[int, int], leg: LegTable, base: Array, rot: Array,
    stroke: Array,
) -> float:  # fmt: skip
    """Return the highest known ground under any pose of the leg, m: over the window and a knee's reach about the hip.

    NaN is returned for a leg without closed form, which reaches nothing.

    Args:
        ground: heights of the map.
        corner: first row and column of the window.
        shape: rows and columns of the window.
        leg: 32 numbers of the leg for kernels.
        base: position of base_link at landing, map frame, (3,) m.
        rot: rot_map_from_base, (3, 3).
        stroke: movement of the foot relative to the body while it stands, map axes, (3,) m.
    """
    z, cell, x0, y0 = ground.z, ground.cell, ground.x0, ground.y0
    row0, col0 = corner
    ny, nx = z.shape
    hx = base[0] + rot[0, 0] * leg[0] + rot[0, 1] * leg[1] + rot[0, 2] * leg[2]
    hy = base[1] + rot[1, 0] * leg[0] + rot[1, 1] * leg[1] + rot[1, 2] * leg[2]
    knee = leg[5] + leg[6]
    if not abs(hx) + abs(hy) + knee < 1e6:
        return math.nan
    rows, cols = shape
    first_row = max(0, min(row0, math.floor((hy - knee - max(stroke[1], 0.0) - y0) / cell)))
    last_row = min(ny, max(row0 + rows, math.ceil((hy + knee - min(stroke[1], 0.0) - y0) / cell) + 1))
    first_col = max(0, min(col0, math.floor((hx - knee - max(stroke[0], 0.0) - x0) / cell)))
    last_col = min(nx, max(col0 + cols, math.ceil((hx + knee - min(stroke[0], 0.0) - x0) / cell) + 1))
    top = np.float32(-np.inf)
    for row in range(first_row, last_row):
        line = z[row, first_col : max(first_col, last_col)]
        for col in range(line.shape[0]):
            top = line[col] if line[col] > top else top
    return float(top)


@row_kernel
def _mask(
    z: Layer, centres: Layer, grid: tuple[float, float, float, float], corner: tuple[int, int], slip: Layer,
    limits: tuple[float, float, float, float, float, bool], placement: tuple[LegTable, Array, Array, Array], out: Mask,
) -> None:  # fmt: skip
    """Write the reasons against the cells of a window to `out`.

    Args:
        z, centres: heights of the ground, and of the centre of a foot that rests on it, (ny, nx) m, NaN = unknown.
        grid: edge of a cell, x and y of the centre of cell [0, 0] and radius of the foot, m.
        corner: first row and column of the window.
        slip: predicted slip per stroke, (rows, cols), NaN = unknown, -1 = outside what the model has learned.
        limits: largest slip, slope, lift of the foot (m), reach margin (m), radius of the leg (m), whether there is a
            leg.
        placement: numbers of the leg, position and rotation of base_link, stroke, in a tuple, which kernels take
            faster.
        out: written, (rows, cols): sums of the bits 1 reach, 2 collision, 4 unknown, 8 steep, 16 slip, 32 unlearned.
    """
    slip_limit, slope_limit, wedge, margin, leg_radius, test_leg = limits
    cell, x0, y0, foot_radius = grid
    ground = _HeightGrid(z, cell, x0, y0)
    leg, base, rot, stroke = placement
    row0, col0 = corner
    ny, nx = z.shape
    bx, by, bz = base[0], base[1], base[2]
    turn = (rot[0, 0], rot[0, 1], rot[0, 2], rot[1, 0], rot[1, 1], rot[1, 2], rot[2, 0], rot[2, 1], rot[2, 2])
    ex, ey, ez = bx - stroke[0], by - stroke[1], bz - stroke[2]  # the base at lift-off
    top = _highest(ground, corner, out.shape, leg, base, rot, stroke) if test_leg else math.nan
    keep = (margin, leg_radius, top)
    moves = stroke[0] != 0.0 or stroke[1] != 0.0 or stroke[2] != 0.0
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            row, col = row0 + i, col0 + j
            p = float(slip[i, j])
            inside = row >= 0 and row < ny and col >= 0 and col < nx
            height = math.nan
            if inside:
                height = float(centres[row, col])
            bits = 0
            if p == UNLEARNED and not math.isnan(height):
                bits |= _UNLEARNED
            elif not (p >= 0.0 and p <= 1.0) or math.isnan(height):
                bits |= _UNKNOWN
            elif p > slip_limit:
                bits |= _SLIP
            gx, gy = gradient(z, cell, row, col)
            if gx * gx + gy * gy > slope_limit * slope_limit:
                bits |= _STEEP
            if math.isnan(height):  # `unknown` is set; reach and collision need a height
                out[i, j] = bits
                continue
            if height - (float(z[row, col]) + foot_radius) > wedge:
                bits |= _COLLISION
            if test_leg:
                x, y = x0 + col * cell, y0 + row * cell
                hit = _leg_bits(ground, leg, (bx, by, bz), turn, (x, y, height), keep)
                if moves and hit != _REACH:
                    hit |= _leg_bits(ground, leg, (ex, ey, ez), turn, (x, y, height), keep)
                bits |= hit
            out[i, j] = bits
