"""Positions and rotations of the feet seen from the IMU, by joint angles; feet with unknown angles are left out."""

import math
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array, Flags, Ints
from surefoot.geometry.linear_kernels import times, times_vector
from surefoot.geometry.rotations import matrix_from_quat, rotvec_from_matrix
from surefoot.kernels.jit import kernel
from surefoot.robot.description import KinematicModel, Robot
from surefoot.robot.kinematics import forward


class FootSample(NamedTuple):
    """All L feet at one time, seen from the IMU.

    position: foot centres, IMU axes, (L, 3) m; rot: rot_imu_from_foot, (L, 3, 3); contact: True = the foot touches the
    ground, (L,).
    """

    stamp_ns: int
    position: Array  # (L, 3) m
    rot: Array  # (L, 3, 3) rot_imu_from_foot
    contact: Flags  # (L,)


class FootMount(NamedTuple):
    """Parts of a robot description that locate the L feet from the IMU.

    model: joints and links, None if feet come as positions; rot_imu_from_base: (3, 3); imu_position: IMU in base_link,
    (3,) m; radius: of a round foot, (L,) m, 0 = a sole.
    """

    model: KinematicModel | None  # None: feet come as positions, there are no joints
    rot_imu_from_base: Array  # (3, 3)
    imu_position: Array  # (3,) in base_link, m
    radius: Array  # (L,) m, radius of a round foot; 0 = a sole


def foot_mount(robot: Robot) -> FootMount:
    """Return the mounting of the IMU and the shape of the feet of a robot; a foot of several spheres is a sole."""
    rot = np.ascontiguousarray(matrix_from_quat(robot.imu.quat_wxyz).T)
    radius = np.array([leg.foot.radius if len(leg.foot.points) == 1 else 0.0 for leg in robot.legs])
    return FootMount(robot.model, rot, np.ascontiguousarray(robot.imu.position, dtype=np.float64), radius)


def bare_mount(feet: int) -> FootMount:
    """Return a mount for logs of the positions of `feet` feet: the IMU in base_link, feet that do not roll."""
    return FootMount(None, np.eye(3), np.zeros(3), np.zeros(feet))


def feet_in_imu(mount: FootMount, q: Array) -> tuple[Array, Array]:
    """Return foot centres (L, 3) m from the IMU, IMU axes, and rot_imu_from_foot (L, 3, 3), by the joint angles.

    Args:
        mount: kinematic model, and mounting of the IMU in base_link.
        q: joint angles, (nj,) rad.
    """
    assert mount.model is not None, "a bare mount has no joints"
    return _feet_in_imu(mount.model, mount.rot_imu_from_base, mount.imu_position, q)


@kernel
def _feet_in_imu(model: KinematicModel, rot_imu_from_base: Array, imu_position: Array, q: Array) -> tuple[Array, Array]:
    """Return foot centres (L, 3) m from the IMU, IMU axes, and rot_imu_from_foot (L, 3, 3), by the joint angles.

    Args:
        model: kinematic model of the robot.
        rot_imu_from_base: mounting of the IMU, (3, 3).
        imu_position: place of the IMU in base_link, (3,) m.
        q: joint angles, (nj,) rad.
    """
    rot_base, pos_base = forward(model, q)
    feet = model.foot_link.size
    position, rot = np.empty((feet, 3)), np.empty((feet, 3, 3))
    point = np.empty(3)
    for f in range(feet):
        link = model.foot_link[f]
        for i in range(3):
            point[i] = pos_base[link, i] - imu_position[i]
            for k in range(3):
                point[i] += rot_base[link, i, k] * model.foot_point[f, k]
        position[f], rot[f] = times_vector(rot_imu_from_base, point), times(rot_imu_from_base, rot_base[link])
    return position, rot


@kernel
def known_feet(position: Array, rot: Array, switches: Array) -> tuple[Array, Array, Array, Ints, bool]:
    """Return the feet; those that are not finite (a dead encoder) are lifted off the ground.

    Args:
        position: foot centres from the IMU, IMU axes, (L, 3) m.
        rot: rot_imu_from_foot, (L, 3, 3).
        switches: probability of contact at each switch, (L, S), NaN = unknown.

    Returns:
        Positions (L, 3) m and rotations (L, 3, 3), zeros and unit matrices for unknown feet; probability of contact of
        each foot (L,), 0 for those, NaN = unknown; the switches that are closed, or unknown, (L,), bit s for switch s;
        True if a foot may stand.
    """
    position, rot, stands = position.copy(), rot.copy(), False
    contact, closed = np.full(switches.shape[0], np.nan), np.zeros(switches.shape[0], dtype=np.int64)
    for f in range(contact.size):
        for s in range(switches.shape[1]):
            if not contact[f] >= switches[f, s]:
                contact[f] = switches[f, s] if not math.isnan(switches[f, s]) else contact[f]
            if not switches[f, s] < 0.5:
                closed[f] |= 1 << s
        finite = True
        for i in range(3):
            finite = finite and math.isfinite(position[f, i])
            for k in range(3):
                finite = finite and math.isfinite(rot[f, i, k])
        if not finite:
            contact[f] = 0.0
            for i in range(3):
                position[f, i] = 0.0
                for k in range(3):
                    rot[f, i, k] = 1.0 if i == k else 0.0
        stands = stands or not contact[f] < 0.5
    return position, rot, contact, closed, stands


@kernel
def foot_turn(rot_0: Array, rot_1: Array) -> Array:
    """Return the turn of a foot between two samples, (3,) rad, in the axes of a frame A: log(rot_1 rot_0^T).

    Args:
        rot_0: rot_A_from_foot at the earlier sample, (3, 3); A is odom or the IMU.
        rot_1: rot_A_from_foot at the later sample, (3, 3).
    """
    relative = np.empty((3, 3))
    for i in range(3):
        for k in range(3):
            relative[i, k] = rot_1[i, 0] * rot_0[k, 0] + rot_1[i, 1] * rot_0[k, 1] + rot_1[i, 2] * rot_0[k, 2]
    return rotvec_from_matrix(relative)
