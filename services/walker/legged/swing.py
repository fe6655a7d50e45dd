"""Swing paths: up, across at a height that clears all ground below, quickly down, slowly on to the ground.

With s(a) = 3 a^2 - 2 a^3 (0 below 0, 1 above 1) and the swing phase v in [0, 1]:

* x, y move with s((v - go) / (arrive - go));
* z rises to the top with s(v / rise_end), stays, falls from `fall_start` to `fall_end` by a cubic that ends at
  `approach` above the landing with the speed of the last part, and comes down that last part at constant speed, so
  that a foot switch sampled every 33 ms stops it within a few millimetres.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.geometry.heightmap import HeightMap
from surefoot.kernels.jit import kernel

SAMPLES = 13  # heights taken along a swept path


class SwingShape(NamedTuple):
    """Phases of a swing at which the rise ends and the fall begins and ends, parts of its duration; the slow part."""

    rise_end: float = 0.28
    fall_start: float = 0.50
    fall_end: float = 0.62
    approach: float = 0.006  # m above the landing where the slow part begins; set for each step


GENTLE = SwingShape(fall_end=0.70)
"""Swing while three feet carry the robot: a foot that meets the ground earlier than planned, at 1 m/s, throws it over
two of them."""
GENTLE_TIME = 1.35  # duration of such a swing over that of the usual one: its foot falls at 0.45 of the speed

WINDOWS = ((0.10, 0.66), (0.15, 0.60), (0.20, 0.56), (0.25, 0.52))
"""Pairs of swing phases (go, arrive), 0..1, between which the foot moves sideways; the first pair whose path clears the
ground is used."""


@kernel
def smooth(a: float) -> float:
    """Return 3 a^2 - 2 a^3 with `a` clipped to 0..1: rises from 0 to 1 with zero slope at both ends."""
    a = min(1.0, max(0.0, a))
    return a * a * (3.0 - 2.0 * a)


@kernel
def height(shape: SwingShape, z0: float, top: float, z1: float, v: float) -> float:
    """Return the foot-centre height at swing phase v, m, map; beyond v = 1 it descends at the speed of the last part.

    z0, top, z1: heights of the foot centre at lift-off, on the level part and at landing, m, map.
    """
    if v <= shape.rise_end:
        return z0 + (top - z0) * smooth(v / shape.rise_end)
    if v <= shape.fall_start:
        return top
    span = shape.fall_end - shape.fall_start
    slope = -shape.approach / (1.0 - shape.fall_end)
    if v >= shape.fall_end:
        return z1 + slope * (v - 1.0)
    a = (v - shape.fall_start) / span  # cubic Hermite: level at the top, `slope` at the end
    fall = smooth(a)
    return top + (z1 + shape.approach - top) * fall + (a * a * a - a * a) * span * slope


@kernel
def progress(go: float, arrive: float, v: float) -> float:
    """Return the part of the horizontal movement covered at swing phase v, 0..1, between phases `go` and `arrive`."""
    return smooth((v - go) / (arrive - go))


@kernel
def point(shape: SwingShape, p0: Array, p1: Array, top: float, go: float, arrive: float, v: float) -> Array:
    """Return the foot centre at swing phase v, (3,) m, map.

    Args:
        shape: phases of the swing.
        p0: foot centre at lift-off, (3,) m.
        p1: foot centre at landing, (3,) m.
        top: height of the level part, m.
        go: phase in which the sideways movement begins.
        arrive: phase in which it ends.
        v: phase, 0 to 1; above 1 the foot goes on down.
    """
    s = progress(go, arrive, v)
    out = np.empty(3)
    out[0] = p0[0] + s * (p1[0] - p0[0])
    out[1] = p0[1] + s * (p1[1] - p0[1])
    out[2] = height(shape, p0[2], top, p1[2], v)
    return out


@kernel
def clears(
    shape: SwingShape, z0: float, z1: float, top: float, go: float, arrive: float, ground: Array, margin: float
) -> bool:
    """Return True if the path of the foot centre stays above the ground below it.

    Args:
        shape: phases of the swing.
        z0: height of the foot centre at lift-off, m.
        z1: height at landing, m.
        top: height of the level part, m.
        go: phase in which the sideways movement begins.
        arrive: phase in which it ends.
        ground: lowest admissible foot-centre heights at equal steps of the path, first at lift-off, (k,) m, NaN =
            unknown.
        margin: wanted clearance away from the two ends, m; it grows from 0 over the first and last eighth.
    """
    n = ground.size
    for k in range(101):
        v = k / 100.0
        s = progress(go, arrive, v)
        at = s * (n - 1)
        i = min(int(at), n - 2)
        low = max(ground[i], ground[i + 1]) if at > i else ground[i]
        if math.isnan(low):
            continue
        ease = min(1.0, 8.0 * min(s, 1.0 - s))
        if ease > 0.0 and height(shape, z0, top, z1, v) < low + margin * ease - 1e-12:
            return False
    return True


def swept_ground(centres: HeightMap, p0: Array, p1: Array, halfwidth: float) -> Array:
    """Return the lowest admissible foot-centre heights along the path from p0 to p1, (13,) m, map, NaN where unknown.

    Args:
        centres: map of foot centres (ground dilated by the foot sphere).
        p0: lift-off, (3,) m, map.
        p1: landing, (3,) m, map.
        halfwidth: half the width of the swept corridor, m.
    """
    out = np.empty(SAMPLES)
    _swept(centres.z, centres.cell, centres.origin[0], centres.origin[1], p0, p1, halfwidth, out)
    return out


@kernel
def _swept(
    z: NDArray[np.float32], cell: float, x0: float, y0: float, p0: Array, p1: Array, halfwidth: float, out: Array
) -> None:
    """Write the highest cell, m, per section of the path from p0 to p1 into `out` (13,), NaN where all are unknown.

    A cell counts one cell's width around its centre, so no height slips by. z (ny, nx) m: heights of foot centres,
    cells of edge `cell` m, the first one's centre at x0, y0 m; p0, p1 (3,) m, map; `halfwidth` of the path, m.
    """
    ny, nx = z.shape
    out[:] = -math.inf
    dx, dy = p1[0] - p0[0], p1[1] - p0[1]
    length = math.hypot(dx, dy)
    ux, uy = (dx / length, dy / length) if length > 1e-9 else (1.0, 0.0)
    wide = halfwidth + cell
    row0 = max(0, math.floor((min(p0[1], p1[1]) - wide - y0) / cell))
    row1 = min(ny - 1, math.ceil((max(p0[1], p1[1]) + wide - y0) / cell))
    col0 = max(0, math.floor((min(p0[0], p1[0]) - wide - x0) / cell))
    col1 = min(nx - 1, math.ceil((max(p0[0], p1[0]) + wide - x0) / cell))
    pieces = out.size
    for row in range(row0, row1 + 1):
        ry = y0 + row * cell - p0[1]
        for col in range(col0, col1 + 1):
            high = z[row, col]
            if math.isnan(high):
                continue
            rx = x0 + col * cell - p0[0]
            along = rx * ux + ry * uy
            if abs(ux * ry - uy * rx) >= wide or along <= -wide or along >= length + wide:
                continue
            if length > 1e-9:
                first = math.floor((along - cell) / length * pieces)
                last = math.floor((along + cell) / length * pieces)
            else:
                first, last = 0, pieces - 1
            for k in range(min(pieces - 1, max(0, first)), max(0, min(pieces - 1, last)) + 1):
                out[k] = max(out[k], high)
    for k in range(pieces):
        if out[k] == -math.inf:
            out[k] = math.nan


def top_of(p0: Array, p1: Array, ground: Array, clearance: float) -> float:
    """Return the height of a swing's level part, m, map: `clearance`, m, above both ends and the highest ground below.

    p0, p1: foot centres at lift-off and landing, (3,) m; ground: heights of the foot centre along the path, (k,) m.
    """
    high = float(np.nanmax(ground)) if not np.isnan(ground).all() else -math.inf
    return max(float(p0[2]), float(p1[2]), high) + clearance


def window(shape: SwingShape, p0: Array, p1: Array, top: float, ground: Array, margin: float) -> tuple[float, float]:
    """Return phases (go, arrive) of the sideways movement: the gentlest that clears the ground, else the last tried.

    Args:
        shape: phases of the swing.
        p0: foot centre at lift-off, (3,) m.
        p1: foot centre at landing, (3,) m.
        top: height of the level part, m.
        ground: lowest admissible heights of the foot centre at equal steps of the path, (k,) m, NaN = unknown.
        margin: clearance over them, m.
    """
    for go, arrive in WINDOWS:
        if clears(shape, p0[2], p1[2], top, go, arrive, ground, margin):
            return go, arrive
    return WINDOWS[-1]


class SwingPaths(NamedTuple):
    """Swing paths of the L feet in a step: which swing, from where to where, top height and phases; frame map."""

    shape: SwingShape
    swinging: NDArray[np.bool_]  # (L,)
    feet_from: Array  # (L, 3) m, foot centres at lift-off
    feet_to: Array  # (L, 3) m, foot centres at landing
    top: Array  # (L,) m, height of the level part
    go: Array  # (L,) phase in which the sideways movement begins
    arrive: Array  # (L,) phase in which it ends


@kernel
def targets(
    paths: SwingPaths, landed: NDArray[np.bool_], v: float, present: Array, reach: float, support: Array, rate: float
) -> tuple[Array, Array]:
    """Return foot centres of all legs in this tick, (L, 3) m, map, and the share of each in the load, 0..1, (L,).

    Args:
        paths: paths of all feet in the step.
        landed: feet on the ground, (L,).
        v: swing phase.
        present: foot centres of the last tick, (L, 3) m.
        reach: largest movement per axis of a standing or landed foot towards its foothold in this tick, m.
        support: shares of the last tick, (L,).
        rate: growth of a share in this tick; that of a foot in the air shrinks by it.
    """
    shape, swinging, feet_from, feet_to, top, go, arrive = paths
    out, share = np.empty_like(feet_from), np.empty_like(support)
    for i in range(feet_from.shape[0]):
        share[i] = min(1.0, max(0.0, support[i] + (rate if landed[i] else -rate)))
        if swinging[i] and not landed[i]:
            there = point(shape, feet_from[i], feet_to[i], top[i], go[i], arrive[i], v)
            for k in range(3):
                out[i, k] = there[k]
            continue
        for k in range(3):
            step = feet_to[i, k] - present[i, k]
            out[i, k] = present[i, k] + min(reach, max(-reach, step))
    return out, share
