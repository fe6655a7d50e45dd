"""Indices of the robot's parts in MuJoCo's arrays."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Ints


@dataclass(frozen=True, eq=False)
class Addresses:
    """Indices of the robot's bodies, joints, motors, geoms and sensors in MjModel and MjData, in the robot's order."""

    trunk: int  # body id of base_link
    bodies: Ints  # (nl,) body id per link
    joint_qpos: Ints  # (nj,)
    joint_dof: Ints  # (nj,)
    actuators: Ints  # (nj,)
    joint_qpos_slice: slice | Ints  # the same as a slice where the joints follow each other in order
    joint_dof_slice: slice | Ints
    coupled: Ints  # (c,) joints whose motor also turns another axis
    coupled_qpos: Ints  # (c,) position of the other axis
    coupled_dof: Ints  # (c,)
    backlash_qpos: Ints  # (nj,) play behind each joint, -1 = none; empty when no servo has any
    foot_bodies: Ints  # (L,)
    foot_geoms: Ints  # (L, k), -1 pads
    foot_of_geom: Ints  # (ngeom,) foot index, -1 = no foot
    belly_geoms: Ints  # (b,)
    terrain_geoms: Ints  # (t,)
    is_terrain: NDArray[np.bool_]  # (ngeom,)
    is_belly: NDArray[np.bool_]  # (ngeom,) trunk spheres, and leg segments if they collide
    imu_site: int
