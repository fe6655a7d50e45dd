"""Placing of the robot just above its ground at the start of a run, and displacements of it during the run."""

# mujoco has no type stubs for its compiled modules:
# pyright: reportAttributeAccessIssue=false
import math
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.rotations import multiply, quat_from_rpy

from ..ground.terrain import Terrain
from .addresses import Addresses
from .disturb import WorldError
from .joints import place_joints

GRID = 0.03  # m, walls are thicker
TOUCH = 0.01  # m, may reach into a wall: then the robot leans on it
EVEN = 0.002  # m, the ground under the feet may differ so much where a standing robot is put
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
    """Set the positions of trunk and joints of a robot that stands on its ground, 1 mm above it.

    Args:
        model: the compiled world.
        data: state of MuJoCo's physics, changed here.
        address: indices of the robot in it.
        spheres: geoms of the feet, (P,).
        terrain: the ground.
        pose: x, y in m and yaw in rad of the trunk, frame map.
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
    """Return points (n, 2) m, 3 cm apart, of the rectangle on the floor along the heading that feet and trunk fill.

    Args:
        model: the compiled world.
        data: its state, with the kinematics that belong to it.
        address: indices of the robot in it.
        spheres: geoms of the feet, (P,).
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


class Displacement(NamedTuple):
    """Rigid motion of the robot over the floor, of points p (3,) m: p' = Rz(turn) (p - centre) + centre + move."""

    centre: NDArray[np.float64]
    """Point about which the robot turns, the origin of base_link before the motion: x, y, (2,) m, map axes."""
    move: NDArray[np.float64]
    """Translation of the robot, (3,) m, map axes."""
    turn: float
    """Rotation of the robot about the vertical, rad, left positive."""

    def of(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the places (n, 3) m to which the motion takes points (n, 3) m."""
        c, s = math.cos(self.turn), math.sin(self.turn)
        x, y = points[:, 0] - self.centre[0], points[:, 1] - self.centre[1]
        out = points + self.move
        out[:, 0] = self.centre[0] + self.move[0] + c * x - s * y
        out[:, 1] = self.centre[1] + self.move[1] + s * x + c * y
        return out

    def turned(self, vector: NDArray[np.float64]) -> None:
        """Turn `vector`, in map axes, (3,), any unit, by the turn of the motion about the vertical, in place."""
        c, s = math.cos(self.turn), math.sin(self.turn)
        vector[:2] = c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]


def displacement(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    address: Addresses,
    spheres: NDArray[np.int64],
    terrain: Terrain,
    forward: float,
    left: float,
    turn: float,
) -> Displacement:
    """Return the motion that takes the robot to a place beside its present one, after a check; nothing is changed.

    Args:
        model: the compiled world.
        data: state of MuJoCo's physics at the end of a tick.
        address: indices of the robot in it.
        spheres: geoms of the feet, (P,).
        terrain: the ground.
        forward: way along the heading, m.
        left: way across it, m.
        turn: change of heading, rad, left positive.

    Raises:
        WorldError: the place is in or behind a wall, off the ground, or the ground under the feet is another there.
    """
    base = data.xmat[address.trunk].reshape(3, 3)
    yaw = math.atan2(base[1, 0], base[0, 0])
    c, s = math.cos(yaw), math.sin(yaw)
    way = Displacement(
        data.qpos[:2].copy(), np.array([c * forward - s * left, s * forward + c * left, 0.0]), float(turn)
    )
    there = f"{forward:g} m ahead, {left:g} m to the left, turned by {turn:g} rad"
    old = data.geom_xpos[spheres]
    before, after = (terrain.map.height(feet[:, 0], feet[:, 1]) for feet in (old, way.of(old)))
    if not np.isfinite(after).all():
        raise WorldError("forward", f"a foot would stand beside the map: {there}")
    ground = footprint(model, data, address, spheres, yaw)
    if not terrain.on_floor(way.of(np.column_stack((ground, np.zeros(len(ground)))))[:, :2]).all():
        raise WorldError("forward", f"the robot would stand in or behind a wall: {there}")
    rise = after - before
    if float(np.ptp(rise)) > EVEN:
        raise WorldError("forward", f"the ground is {1e3 * float(np.ptp(rise)):.0f} mm less even: {there}")
    way.move[2] = float(np.mean(rise))
    return way


def displace(data: mujoco.MjData, way: Displacement) -> None:
    """Move the robot by a displacement with its posture, speeds and loads, so that it continues to stand or walk."""
    data.qpos[:3] = way.of(data.qpos[None, :3])[0]
    data.qpos[3:7] = multiply(quat_from_rpy(0.0, 0.0, way.turn), data.qpos[3:7].copy())
    for vector in (data.qvel[:3], data.qacc_warmstart[:3]):  # rates of the free joint are in its own axes
        way.turned(vector)
