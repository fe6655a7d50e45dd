"""Depth images of ground that is known in closed form, and odometry with planted errors."""

import math
from dataclasses import dataclass

import numpy as np

from surefoot.geometry.rotations import matrix_from_rpy, quat_from_matrix
from surefoot.services.mapper.mapper import DepthView, MapPose

WIDTH, HEIGHT, FOCAL = 40, 30, 24.0
PLACE = np.array([0.1, 0.0, 0.25])
CAMERA_AXES = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
LOOK = matrix_from_rpy(0.0, math.radians(50.0), 0.0) @ CAMERA_AXES
TICK_NS = 10_000_000


@dataclass(frozen=True)
class Slope:
    """The plane z = at + along x + across y."""

    at: float = 0.0
    along: float = 0.0
    across: float = 0.0

    def far(self, p, d):
        """Ways along rays d (n, 3) from p until they meet the ground."""
        return (self.at + self.along * p[0] + self.across * p[1] - p[2]) / (
            d[:, 2] - self.along * d[:, 0] - self.across * d[:, 1]
        )

    def height(self, x, y):
        return self.at + self.along * x + self.across * y


@dataclass(frozen=True)
class Stair:
    """Level ground with a step up at x = edge."""

    edge: float
    rise: float

    def far(self, p, d):
        low, high, face = -p[2] / d[:, 2], (self.rise - p[2]) / d[:, 2], (self.edge - p[0]) / d[:, 0]
        on_high = p[0] + high * d[:, 0] >= self.edge
        z = p[2] + face * d[:, 2]
        on_face = (face > 0) & (z >= 0) & (z <= self.rise)
        return np.where(on_high, high, np.where(on_face, face, low))

    def height(self, x, y):
        return np.where(x >= self.edge, self.rise, 0.0) + 0.0 * y


def pose(x=0.0, z=0.1, tick=0, variance=(0.0,) * 6, y=0.0):
    return MapPose(tick * TICK_NS, np.array([x, y, z]), np.eye(3), np.diag(variance).astype(float))


def picture(ground, x=0.0, z=0.1, tick=0, sigma=0.0, rng=None, drop=0.0):
    """The image that a level robot at (x, 0, z) m takes of the ground."""
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH].reshape(2, -1) + 0.5
    rays = np.stack(((u - WIDTH / 2) / FOCAL, (v - HEIGHT / 2) / FOCAL, np.ones_like(u)), 1)
    depths = ground.far(np.array([x, 0.0, z]) + PLACE, rays @ LOOK.T)
    depths = np.where((depths > 0) & (depths < 2.0), depths, np.nan)
    if rng is not None:
        depths = depths + sigma * rng.standard_normal(depths.shape)
        depths[rng.random(depths.shape) < drop] = np.nan
    return DepthView(
        tick * TICK_NS, depths.reshape(HEIGHT, WIDTH), FOCAL, (WIDTH / 2, HEIGHT / 2), sigma, 0.0, "base_link", PLACE,
        quat_from_matrix(LOOK),
    )  # fmt: skip


def centres(mapper):
    """x and y of the cells, m."""
    n = mapper.layers.height.shape[0]
    steps = mapper.grid.cell * np.arange(n)
    return np.meshgrid(mapper.origin[0] + steps, mapper.origin[1] + steps)
