"""Terrain map of the walker: noise filtered, small holes filled, dilated by the foot sphere."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.geometry.heightmap import HeightMap
from surefoot.kernels.jit import kernel

Heights = NDArray[np.float32]

FILL_ROUNDS = 6  # cells by which known ground grows into unknown ground
NORMAL_REACH = 0.020  # m, ground about a foot whose slope counts: eight cells wide, enough for 3 mm of noise
NORMAL_SCALE = 0.002  # m, a cell that lies much further off the plane belongs to another face: noise after the filter
NORMAL_ROUNDS = 4


class Rectangle(NamedTuple):
    """Rectangle on the floor: centre, heading and half edge lengths, frame map."""

    x: float  # m, of its middle
    y: float  # m
    yaw: float  # rad
    half_x: float  # m, half its length along its own x
    half_y: float  # m


@kernel
def box_max(z: Heights, cell: float, x0: float, y0: float, under: Rectangle) -> float:
    """Return the height of the highest cell with its centre in a rectangle, m; NaN if it holds no known cell.

    Args:
        z: heights, (ny, nx) m, map, NaN = unknown; rows along y, columns along x.
        cell: edge of a cell, m.
        x0: x of the centre of cell [0, 0], m, map.
        y0: y of the centre of cell [0, 0], m.
        under: the rectangle.
    """
    ny, nx = z.shape
    x, y, yaw, half_x, half_y = under
    best = -math.inf
    c, s = math.cos(yaw), math.sin(yaw)
    reach = math.hypot(half_x, half_y)
    row0, row1 = max(0, math.floor((y - reach - y0) / cell)), min(ny - 1, math.ceil((y + reach - y0) / cell))
    col0, col1 = max(0, math.floor((x - reach - x0) / cell)), min(nx - 1, math.ceil((x + reach - x0) / cell))
    for row in range(row0, row1 + 1):
        dy = y0 + row * cell - y
        for col in range(col0, col1 + 1):
            dx = x0 + col * cell - x
            if abs(c * dx + s * dy) <= half_x and abs(-s * dx + c * dy) <= half_y and z[row, col] > best:
                best = z[row, col]
    return best if best > -math.inf else math.nan


@kernel
def face_normal(z: Heights, cell: float, x0: float, y0: float, x: float, y: float, bottom: float) -> Array:
    """Return the unit normal of the face a foot stands on, map, (3,): plane through the cells near its lowest point.

    Robust least squares, weights 1 / (1 + (e / scale)^2) with e first the height over `bottom`, then the distance from
    the plane of the round before: a foot beside or upon a step sees the level ground it stands on, not the mean of both
    levels. Vertical where fewer than three cells, or cells on one line, are known.

    Args:
        z: heights, (ny, nx) m, NaN = unknown; rows along y, columns along x.
        cell: edge of a cell, m.
        x0: x of the centre of cell [0, 0], m, map.
        y0: y of the centre of cell [0, 0], m.
        x: x of the lowest point of the foot, m, map.
        y: y of the lowest point, m.
        bottom: height of the lowest point, m.
    """
    ny, nx = z.shape
    row0, row1 = (
        max(0, math.ceil((y - NORMAL_REACH - y0) / cell)),
        min(ny - 1, math.floor((y + NORMAL_REACH - y0) / cell)),
    )
    col0, col1 = (
        max(0, math.ceil((x - NORMAL_REACH - x0) / cell)),
        min(nx - 1, math.floor((x + NORMAL_REACH - x0) / cell)),
    )
    h, gx, gy, scale = bottom, 0.0, 0.0, 2.0 * NORMAL_SCALE
    for _ in range(NORMAL_ROUNDS):
        w, wx, wy, wz, wxx, wxy, wyy, wxz, wyz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for row in range(row0, row1 + 1):
            dy = y0 + row * cell - y
            for col in range(col0, col1 + 1):
                dx, height = x0 + col * cell - x, z[row, col]
                if math.isnan(height) or dx * dx + dy * dy > NORMAL_REACH * NORMAL_REACH:
                    continue
                off = (height - h - gx * dx - gy * dy) / scale
                k = 1.0 / (1.0 + off * off)
                w, wx, wy, wz = w + k, wx + k * dx, wy + k * dy, wz + k * height
                wxx, wxy, wyy = wxx + k * dx * dx, wxy + k * dx * dy, wyy + k * dy * dy
                wxz, wyz = wxz + k * dx * height, wyz + k * dy * height
        if w <= 0.0:
            break
        mx, my, mz = wx / w, wy / w, wz / w
        xx, xy, yy = wxx / w - mx * mx, wxy / w - mx * my, wyy / w - my * my
        det = xx * yy - xy * xy
        if det < 1e-3 * cell**4:
            break
        xz, yz = wxz / w - mx * mz, wyz / w - my * mz
        gx, gy = (yy * xz - xy * yz) / det, (xx * yz - xy * xz) / det
        h, scale = mz - gx * mx - gy * my, NORMAL_SCALE
    size = math.sqrt(gx * gx + gy * gy + 1.0)
    return np.array([-gx / size, -gy / size, 1.0 / size])


@dataclass(frozen=True, eq=False)
class Ground:
    """Height layers of the terrain for the walker: filtered ground and foot centres; built once per map version."""

    surface: HeightMap
    """Filtered heights of the ground, m, map frame."""
    centres: HeightMap
    """Heights of the foot centre where the foot sphere rests on the ground, m, map frame."""
    version: int

    @classmethod
    def build(cls, heights: HeightMap, foot_radius: float, smooth: bool = True) -> "Ground":
        """Return the layers of a map: 3 x 3 median (edges stay), holes filled, dilated by the foot sphere.

        `foot_radius`: of that sphere, m; `smooth` False: no median on known ground.
        """
        surface = heights.smoothed(1) if smooth else heights
        for _ in range(FILL_ROUNDS):
            unknown = np.isnan(surface.z)
            if not unknown.any():
                break
            surface = surface.with_z(np.where(unknown, surface.smoothed(1).z, surface.z))
        return cls(surface=surface, centres=surface.dilated(foot_radius), version=heights.version)

    def centre_height(self, x: float, y: float) -> float:
        """Return the height of a foot centre that stands at (x, y) m, frame map, m; NaN where unknown."""
        return self.centres.height_at(x, y)

    def normal(self, x: float, y: float, bottom: float) -> Array:
        """Return the unit normal of the ground (3,) under a foot whose lowest point is (x, y, bottom) m, frame map."""
        s = self.surface
        return face_normal(s.z, s.cell, s.origin[0], s.origin[1], x, y, bottom)

    def highest_under(self, under: Rectangle) -> float:
        """Return the highest ground under a rectangle, m; NaN where all is unknown."""
        s = self.surface
        return box_max(s.z, s.cell, s.origin[0], s.origin[1], under)
