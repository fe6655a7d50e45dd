"""Where the robot is put: at the start of a run parallel to the plane or level on a height field, just above it."""

# mujoco has no type stubs for its compiled modules:
# pyright: reportAttributeAccessIssue=false
import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.rotations import multiply, quat_from_rpy
from surefoot.services.simulator.ground.terrain import Terrain
from surefoot.services.simulator.physics.addresses import Addresses
from surefoot.services.simulator.physics.disturb import WorldError
from surefoot.services.simulator.physics.joints import place_joints

GRID = 0.03  # m, walls are thicker
TOUCH = 0.01  # m, may reach into a wall: then the robot leans on it
STANCE_GAP = 0.001  # m, the lowest foot starts this high above the ground


def place(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    address: Addresses,
    spheres: NDArray[np.int64],
    terrain: Terrain,
    pose: tuple[float, float, float],
    stance: NDArray[np.float64],
) -> None:
    """Set the positions of trunk and joints.

    Args:
        model: the compiled world.
        data: its state, changed here.
        address: where the robot is in it.
        spheres: geoms of the feet.
        terrain: the ground.
        pose: x, y in m and yaw in rad of the trunk.
        stance: joint angles, (nj,), rad.

    Raises:
        WorldError: a foot would stand beside the map, or the robot in or behind a wall.
    """
    data.qpos[:3] = (pose[0], pose[1], 0.0)
    data.qpos[3:7] = multiply(terrain.quat_wxyz, quat_from_rpy(0.0, 0.0, pose[2]))
    place_joints(data.qpos, address, stance)
    mujoco.mj_kinematics(model, data)
    centre, radius = data.geom_xpos[spheres], model.geom_size[spheres, 0]
    ground = terrain.map.height(centre[:, 0], centre[:, 1])
    if not np.isfinite(ground).all():
        raise WorldError("pose", f"a foot would stand beside the map at {pose!r}")
    if not terrain.on_floor(footprint(model, data, address, spheres, pose[2])).all():
        raise WorldError("pose", f"the robot would stand in or behind a wall at {pose!r}")
    gap = (centre[:, 2] - ground) * terrain.normal[2] - radius
    data.qpos[2] = (STANCE_GAP - float(gap.min())) / terrain.normal[2]


def footprint(
    model: mujoco.MjModel, data: mujoco.MjData, address: Addresses, spheres: NDArray[np.int64], yaw: float
) -> NDArray[np.float64]:
    """Return points (n, 2) m on the floor, `GRID` apart, of the rectangle along the heading that feet and trunk fill.

    Args:
        model: the compiled world.
        data: its state, with the kinematics that belong to it.
        address: where the robot is in it.
        spheres: geoms of the feet.
        yaw: heading of the robot, rad.
    """
    geoms = np.concatenate((spheres, address.belly_geoms))
    c, s = math.cos(yaw), math.sin(yaw)
    x, y, radius = data.geom_xpos[geoms, 0], data.geom_xpos[geoms, 1], model.geom_size[geoms, 0]
    sides: list[NDArray[np.float64]] = []
    for way in (c * x + s * y, c * y - s * x):
        low, high = float((way - radius).min()) + TOUCH, float((way + radius).max()) - TOUCH
        count = math.ceil((high - low) / GRID)
        sides.append(low + (high - low) / count * np.arange(count + 1, dtype=np.float64))
    along, across = (side.ravel() for side in np.meshgrid(*sides))
    return np.column_stack((c * along - s * across, s * along + c * across))
