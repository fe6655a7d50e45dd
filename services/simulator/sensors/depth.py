"""Depth camera on the trunk: one ray a pixel to the ground, with the errors of stereo depth.

The depth z along the optical axis is measured with the standard deviation sigma + sigma_square z^2, in steps; pixels
that show the robot itself or nothing within reach, or drop out by chance, have none.
"""

# mujoco has no type stubs for its compiled modules:
# pyright: reportAttributeAccessIssue=false
import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.geometry.linear import product
from surefoot.geometry.rotations import matrix_from_rpy
from surefoot.robot.profiles import DepthCameraFile, read_profile
from surefoot.schemas.topics import HW_DEPTH, TICK_NS

from ..ground.grid import random_stream
from .landmarks import CAMERA_AXES
from .rate import period_ms

TERRAIN = 0  # group of the ground's geoms


@dataclass(frozen=True, eq=False)
class DepthCamera:
    """Numbers of a depth camera's file, SI, and the direction of every pixel as a ray (row by row from the top)."""

    file: DepthCameraFile
    focal: float  # px
    look: Array  # (3, 3) rot_base_from_camera
    rays: Array  # (n, 3) unit vectors, base_link, row by row from the top
    ahead: Array  # (n,) part of each along the optical axis


def read_depth_camera(name: str) -> DepthCamera:
    """Return the depth camera of `robots/depth_cameras/<name>.toml`.

    Raises:
        RobotError: unknown name, or a number is out of range; `field` names it.
    """
    file, _ = read_profile(DepthCameraFile, name, "depth_camera")
    focal = 0.5 * file.width_px / math.tan(0.5 * math.radians(file.field_deg))
    look = product(matrix_from_rpy(0.0, math.radians(file.pitch_deg), 0.0), CAMERA_AXES)
    v, u = np.mgrid[0 : file.height_px, 0 : file.width_px].reshape(2, -1) + 0.5
    rays = np.stack((u - 0.5 * file.width_px, v - 0.5 * file.height_px, np.full(u.shape, focal)), axis=1)
    rays /= np.sqrt((rays * rays).sum(axis=1))[:, None]
    return DepthCamera(file, focal, look, product(rays, look.T), rays[:, 2].copy())


class DepthFrame(NamedTuple):
    """Image of a depth camera: its sequence number and the depth of each pixel."""

    seq: int
    depths: NDArray[np.float32]
    """Depth of each pixel along the optical axis, (height, width) m; NaN = no depth measured."""


class DepthSensor:
    """Sensor model of a depth camera, with the random stream of one run.

    Args:
        camera: numbers and rays of the camera.
        seed: seed of the run.
    """

    def __init__(self, camera: DepthCamera, seed: int) -> None:
        self.camera = camera
        self.rng = random_stream(seed, "depth")
        self._every = period_ms(camera.file.period_ms, HW_DEPTH) * 1_000_000 // TICK_NS

    def take(self, ticks: int, model: Any, data: Any, trunk: int) -> DepthFrame | None:
        """Return the image of the state at the end of a tick; None = none is due.

        Args:
            ticks: control ticks since the run began.
            model: MuJoCo model of the world.
            data: state of MuJoCo's physics.
            trunk: id of the body of base_link.
        """
        if ticks % self._every:
            return None
        c, f = self.camera, self.camera.file
        n, base = len(c.rays), data.xmat[trunk].reshape(3, 3)
        place = data.xpos[trunk] + product(base, np.array(f.position))
        along, reach = product(c.rays, base.T).reshape(-1), f.longest / float(c.ahead.min())
        geom, far = np.full(n, -1, dtype=np.int32), np.empty(n)
        mujoco.mj_multiRay(model, data, place, along, None, 1, -1, geom, far, None, n, reach)
        normal, chance = self.rng.standard_normal(n), self.rng.random(n)
        z = far * c.ahead
        seen = (geom >= 0) & (chance >= f.dropout) & (z >= f.shortest) & (z <= f.longest)
        seen &= model.geom_group[np.maximum(geom, 0)] == TERRAIN
        z = f.resolution * np.rint((z + (f.sigma + f.sigma_square * z * z) * normal) / f.resolution)
        depths = np.where(seen, z, np.nan).astype(np.float32)
        return DepthFrame(ticks // self._every, depths.reshape(f.height_px, f.width_px))
