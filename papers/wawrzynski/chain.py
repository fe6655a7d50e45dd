"""Velocity of the IMU from one leg, equations (5)-(14) of Wawrzynski et al. as they stand, signs corrected.

A leg is a serial chain from the foot (frame 1) to the link that carries the IMU (frame n + 1, origin at the IMU).
Joint i turns about z of frame i by theta_i; x_i = R_i x_{i+1}, R_i = Rz(theta_i) A_i, and A_i l_i is the constant
displacement of frame i + 1 seen in frame i before the turn.
These are exact derivatives: they need joint RATES. The service computes them from finite differences (`legs`).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.kernels.jit import kernel
from surefoot.robot.description import Robot


class Chain(NamedTuple):
    """Serial chain of a leg from foot to IMU, as arrays for kernels: rotations, displacements (m), joints, signs."""

    rot: Array  # (n, 3, 3) A_i, constant rotation of frame i + 1 in frame i at theta_i = 0
    shift: Array  # (n, 3) A_i l_i, origin of frame i + 1 in frame i at theta_i = 0, m
    imu_axes: Array  # (3, 3) W_{n+1}: columns = IMU axes in the last link
    joints: NDArray[np.int64]  # (n,) index of joint i in the robot's joint order
    sign: float  # theta_i = sign * joint angle


class ChainState(NamedTuple):
    """Position, velocity and axes of the IMU in the frame of a standing foot, from the joints between them."""

    p_1: Array  # (3,) IMU in the foot frame, m
    v_1: Array  # (3,) velocity of the IMU in the foot frame by kinematics only, m/s
    w_1: Array  # (3,) angular velocity of the foot in its own axes, rad/s
    imu_axes: Array  # (3, 3) W_1: columns = IMU axes in the foot frame


def chain_from_dh(a: Array, alpha: Array, d: Array, offset: Array, imu_position: Array, imu_axes: Array) -> Chain:
    """Return the chain of standard Denavit-Hartenberg rows, foot to pelvis: R_i = Rz(theta) Rx(alpha).

    l_i = (a, d sin alpha, d cos alpha), undefined in Wawrzynski et al.; l_n holds the IMU's mounting as well.

    Args:
        a: link lengths, (n,) m.
        alpha: link twists, (n,) rad.
        d: link offsets, (n,) m.
        offset: constant part of theta, (n,) rad.
        imu_position: IMU in the last link's D-H frame, (3,) m.
        imu_axes: columns = IMU axes in the last link, (3, 3).
    """
    n = a.size
    rot, shift = np.empty((n, 3, 3)), np.empty((n, 3))
    for i in range(n):
        ca, sa = math.cos(alpha[i]), math.sin(alpha[i])
        twist = np.array([[1.0, 0.0, 0.0], [0.0, ca, -sa], [0.0, sa, ca]])
        along = np.array([a[i], d[i] * sa, d[i] * ca])
        if i == n - 1:
            along = along + imu_position
        zero = np.array(
            [
                [math.cos(offset[i]), -math.sin(offset[i]), 0.0],
                [math.sin(offset[i]), math.cos(offset[i]), 0.0],
                [0.0, 0.0, 1.0],
            ]
        )
        rot[i], shift[i] = zero @ twist, zero @ twist @ along
    return Chain(rot, shift, np.ascontiguousarray(imu_axes), np.arange(n), 1.0)


def chain_from_robot(robot: Robot, leg: int) -> Chain:
    """Return the chain of one leg of a robot; frame 1 has its origin at the foot centre, z along the first axis.

    Seen from the foot a joint turns in the opposite sense, hence theta = -(joint angle).
    """
    model = robot.model
    links = list(_links_to_trunk(model.parent, int(model.foot_link[leg])))  # foot link first
    moving = [link for link in links if model.joint[link] >= 0]
    align = {link: _rot_with_z(model.axis[link]) for link in moving}  # rot_link_from_frame, frame z = axis
    imu_rot = matrix_from_quat(robot.imu.quat_wxyz)  # rot_base_from_imu
    n = len(moving)
    rot, shift = np.empty((n, 3, 3)), np.empty((n, 3))
    for i, link in enumerate(moving):
        last = i == n - 1
        above, at = np.eye(3), np.zeros(3)  # pose of `link` (angle 0) in the next moving link or in the trunk
        node = link
        while node >= 0 and (node == link or model.joint[node] < 0) and model.parent[node] >= 0:
            at = model.origin_pos[node] + model.origin_rot[node] @ at
            above = model.origin_rot[node] @ above
            node = int(model.parent[node])
        target = np.eye(3) if last else align[moving[i + 1]]
        origin = robot.imu.position if last else np.zeros(3)
        rot[i] = align[link].T @ above.T @ target
        shift[i] = align[link].T @ above.T @ (origin - at)
    # the fixed link of the foot: frame 1 keeps the axis of the first joint, its origin moves to the foot centre
    foot = _foot_in_link(model, int(model.foot_link[leg]), moving[0], model.foot_point[leg])
    joints = np.array([model.joint[link] for link in moving])
    chain = Chain(rot, shift, imu_rot, joints, -1.0)
    return _with_foot(chain, align[moving[0]].T @ foot)


def _links_to_trunk(parent: NDArray[np.int64], link: int) -> list[int]:
    out: list[int] = []
    while parent[link] >= 0:
        out.append(link)
        link = int(parent[link])
    return out


def _foot_in_link(model, link: int, target: int, point: Array) -> Array:
    while link != target:
        point = model.origin_pos[link] + model.origin_rot[link] @ point
        link = int(model.parent[link])
    return point


def _with_foot(chain: Chain, foot: Array) -> Chain:
    """Return the chain with a leading frame at the foot point (3,) m: a joint that never turns (index -1)."""
    n = chain.joints.size
    rot = np.concatenate([np.eye(3)[None], chain.rot])
    shift = np.concatenate([-foot[None], chain.shift])
    joints = np.concatenate([np.array([-1], dtype=np.int64), chain.joints.astype(np.int64)])
    return Chain(np.ascontiguousarray(rot), np.ascontiguousarray(shift.reshape(n + 1, 3)), chain.imu_axes, joints, -1.0)


def _rot_with_z(axis: Array) -> Array:
    """Return a rotation (3, 3) whose third column is `axis` (3,)."""
    helper = np.array([1.0, 0.0, 0.0]) if abs(axis[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = helper - axis * (helper @ axis)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])


def chain_angles(chain: Chain, q: Array) -> Array:
    """Return theta (n,) from the robot's joint angles (or rates) q (nj,); a joint index of -1 gives 0."""
    padded = np.append(q, 0.0)
    return chain.sign * padded[chain.joints]


@kernel
def _turn(theta: float) -> Array:
    c, s = math.cos(theta), math.sin(theta)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@kernel
def descend(chain: Chain, theta: Array, theta_rate: Array, w: Array) -> ChainState:
    """Run the recursion (5)-(9), (11), (12) of Wawrzynski et al. from the IMU down to the foot.

    (7) p_i = R_i (l_i + p_{i+1});  (8) v_i = R_i v_{i+1} + theta'_i z x p_i  (printed p_i x z theta': wrong sign);
    (9) W_i = R_i W_{i+1};  (12) w_i = R_i w_{i+1} - theta'_i z  (printed with the IMU's z axis: the joint's is meant).

    Args:
        theta: joint angles, (n,) rad.
        theta_rate: joint rates, (n,) rad/s.
        w: angular velocity of the IMU in IMU axes, (3,) rad/s.
    """
    p, v = np.zeros(3), np.zeros(3)  # (5), (6)
    axes = chain.imu_axes.copy()
    omega = axes @ w  # (11)
    for i in range(theta.size - 1, -1, -1):
        turn = _turn(theta[i])
        rot = turn @ chain.rot[i]
        p = turn @ chain.shift[i] + rot @ p
        v = rot @ v
        v[0] -= theta_rate[i] * p[1]
        v[1] += theta_rate[i] * p[0]
        axes = rot @ axes
        omega = rot @ omega
        omega[2] -= theta_rate[i]
    return ChainState(p, v, omega, axes)


@kernel
def velocity_kinematics(state: ChainState) -> Array:
    """Return v^K = W_1^T v_1, (10) of Wawrzynski et al., (3,) m/s, IMU axes: IMU velocity if the foot is fixed."""
    return state.imu_axes.T @ state.v_1


@kernel
def velocity_kinematics_gyro(state: ChainState, pivot: Array) -> Array:
    """Return v^KG = W_1^T (v_1 + w_1 x (p_1 - c_1)), (13), (14) of Wawrzynski et al., (3,) m/s in IMU axes.

    Args:
        state: result of `descend`.
        pivot: c_1, the point of the foot that does not move, foot frame, (3,) m; 0, the ankle, in Wawrzynski et al.
    """
    x, y, z = state.p_1[0] - pivot[0], state.p_1[1] - pivot[1], state.p_1[2] - pivot[2]
    w = state.w_1
    v = state.v_1.copy()
    v[0] += w[1] * z - w[2] * y
    v[1] += w[2] * x - w[0] * z
    v[2] += w[0] * y - w[1] * x
    return state.imu_axes.T @ v


@kernel
def foot_pose(state: ChainState) -> tuple[Array, Array]:
    """Return the foot in IMU axes: position (3,) = -W_1^T p_1 m and rot_imu_from_foot (3, 3) = W_1^T."""
    rot = np.ascontiguousarray(state.imu_axes.T)
    return -rot @ state.p_1, rot
