"""Where a run begins: the robot parallel to the plane, or level on a height field, just above the ground."""

# mujoco has no type stubs for its compiled modules:
# pyright: reportAttributeAccessIssue=false
import mujoco
import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.rotations import multiply, quat_from_rpy
from surefoot.services.simulator.ground.terrain import Terrain
from surefoot.services.simulator.physics.addresses import Addresses
from surefoot.services.simulator.physics.disturb import WorldError
from surefoot.services.simulator.physics.joints import place_joints

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
        WorldError: a foot would stand beside the map.
    """
    data.qpos[:3] = (pose[0], pose[1], 0.0)
    data.qpos[3:7] = multiply(terrain.quat_wxyz, quat_from_rpy(0.0, 0.0, pose[2]))
    place_joints(data.qpos, address, stance)
    mujoco.mj_kinematics(model, data)
    centre, radius = data.geom_xpos[spheres], model.geom_size[spheres, 0]
    ground = terrain.map.height(centre[:, 0], centre[:, 1])
    if not np.isfinite(ground).all():
        raise WorldError("pose", f"a foot would stand beside the map at {pose!r}")
    gap = (centre[:, 2] - ground) * terrain.normal[2] - radius
    data.qpos[2] = (STANCE_GAP - float(gap.min())) / terrain.normal[2]
