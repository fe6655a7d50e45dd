"""Rotations as pure functions on float64 arrays, usable inside numba kernels.

Quaternions are `quat_wxyz` (scalar first, as in MuJoCo), unit length. `rot_a_from_b` maps vectors from frame b to a.
Frames: x forward, y left, z up; gravity is -z of the world, `g_up` is the upward unit vector (specific force at rest).
"""

import math

import numpy as np

from surefoot.arrays import Array
from surefoot.kernels.jit import kernel

SMALL_ANGLE = 1e-8  # rad; below it series are exact to machine precision


@kernel
def multiply(qa: Array, qb: Array) -> Array:
    """Return the Hamilton product qa * qb of quaternions w, x, y, z, (4,): first rotate by qb, then by qa."""
    q = np.empty(4)
    q[0] = qa[0] * qb[0] - qa[1] * qb[1] - qa[2] * qb[2] - qa[3] * qb[3]
    q[1] = qa[0] * qb[1] + qa[1] * qb[0] + qa[2] * qb[3] - qa[3] * qb[2]
    q[2] = qa[0] * qb[2] - qa[1] * qb[3] + qa[2] * qb[0] + qa[3] * qb[1]
    q[3] = qa[0] * qb[3] + qa[1] * qb[2] - qa[2] * qb[1] + qa[3] * qb[0]
    return q


@kernel
def normalized(q: Array) -> Array:
    """Return a quaternion q = w, x, y, z, (4,), scaled to length 1, with its sign chosen so that w >= 0."""
    n = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    if q[0] < 0.0:
        n = -n
    return q / n


@kernel
def matrix_from_quat(q: Array) -> Array:
    """Return the rotation matrix (3, 3) of a unit quaternion q = w, x, y, z, (4,)."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    m = np.empty((3, 3))
    m[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    m[0, 1] = 2.0 * (x * y - w * z)
    m[0, 2] = 2.0 * (x * z + w * y)
    m[1, 0] = 2.0 * (x * y + w * z)
    m[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    m[1, 2] = 2.0 * (y * z - w * x)
    m[2, 0] = 2.0 * (x * z - w * y)
    m[2, 1] = 2.0 * (y * z + w * x)
    m[2, 2] = 1.0 - 2.0 * (x * x + y * y)
    return m


@kernel
def quat_from_matrix(m: Array) -> Array:
    """Return the unit quaternion w, x, y, z, (4,), w >= 0, of a rotation matrix m (3, 3), exact at any angle."""
    q = np.empty(4)
    t = m[0, 0] + m[1, 1] + m[2, 2]
    if t > m[0, 0] and t > m[1, 1] and t > m[2, 2]:
        q[0] = 1.0 + t
        q[1] = m[2, 1] - m[1, 2]
        q[2] = m[0, 2] - m[2, 0]
        q[3] = m[1, 0] - m[0, 1]
    elif m[0, 0] >= m[1, 1] and m[0, 0] >= m[2, 2]:
        q[0] = m[2, 1] - m[1, 2]
        q[1] = 1.0 + 2.0 * m[0, 0] - t
        q[2] = m[0, 1] + m[1, 0]
        q[3] = m[0, 2] + m[2, 0]
    elif m[1, 1] >= m[2, 2]:
        q[0] = m[0, 2] - m[2, 0]
        q[1] = m[0, 1] + m[1, 0]
        q[2] = 1.0 + 2.0 * m[1, 1] - t
        q[3] = m[1, 2] + m[2, 1]
    else:
        q[0] = m[1, 0] - m[0, 1]
        q[1] = m[0, 2] + m[2, 0]
        q[2] = m[1, 2] + m[2, 1]
        q[3] = 1.0 + 2.0 * m[2, 2] - t
    return normalized(q)


@kernel
def quat_from_rotvec(v: Array) -> Array:
    """Return the unit quaternion w, x, y, z, (4,), of a rotation by |v| rad about v (3,): the exponential map."""
    angle = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    half = 0.5 * angle
    k = math.sin(half) / angle if angle > SMALL_ANGLE else 0.5
    return np.array([math.cos(half), k * v[0], k * v[1], k * v[2]])


@kernel
def rotvec_from_quat(q: Array) -> Array:
    """Return the rotation vector, (3,) rad, at most pi long, of a unit quaternion q = w, x, y, z, (4,) (logarithm)."""
    sign = -1.0 if q[0] < 0.0 else 1.0
    n = math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    k = 2.0 * sign
    if n > SMALL_ANGLE:
        k *= math.atan2(n, sign * q[0]) / n
    return np.array([k * q[1], k * q[2], k * q[3]])


@kernel
def matrix_from_rotvec(v: Array) -> Array:
    """Return the matrix (3, 3) of a rotation about v (3,) by |v| rad: the exponential map."""
    return matrix_from_quat(quat_from_rotvec(v))


@kernel
def rotvec_from_matrix(m: Array) -> Array:
    """Return the rotation vector (axis times angle), (3,) rad, of a rotation matrix m (3, 3): the logarithm."""
    return rotvec_from_quat(quat_from_matrix(m))


@kernel
def matrix_from_axis_angle(axis: Array, angle: float) -> Array:
    """Return the matrix (3, 3) of a rotation by `angle` rad about a unit axis (3,)."""
    m = np.empty((3, 3))
    axis_angle_into(m, axis, angle)
    return m


@kernel
def axis_angle_into(out: Array, axis: Array, angle: float) -> None:
    """Write the matrix of a rotation by `angle` rad about a unit axis (3,) into `out` (3, 3)."""
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
    k = 1.0 - c
    out[0, 0] = c + k * x * x
    out[0, 1] = k * x * y - s * z
    out[0, 2] = k * x * z + s * y
    out[1, 0] = k * x * y + s * z
    out[1, 1] = c + k * y * y
    out[1, 2] = k * y * z - s * x
    out[2, 0] = k * x * z - s * y
    out[2, 1] = k * y * z + s * x
    out[2, 2] = c + k * z * z


@kernel
def quat_from_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """Return the quaternion w, x, y, z, (4,), of Rz(yaw) Ry(pitch) Rx(roll), world from base, angles in rad."""
    cr, sr = math.cos(0.5 * roll), math.sin(0.5 * roll)
    cp, sp = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    cy, sy = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    q = np.empty(4)
    q[0] = cr * cp * cy + sr * sp * sy
    q[1] = sr * cp * cy - cr * sp * sy
    q[2] = cr * sp * cy + sr * cp * sy
    q[3] = cr * cp * sy - sr * sp * cy
    return q


@kernel
def matrix_from_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """Return the matrix (3, 3) of Rz(yaw) Ry(pitch) Rx(roll), world from base, angles in rad."""
    return matrix_from_quat(quat_from_rpy(roll, pitch, yaw))


@kernel
def rpy_from_matrix(rot_world_from_base: Array) -> Array:
    """Return roll, pitch, yaw in rad, (3,), of rot_world_from_base (3, 3); at |pitch| = 90 deg roll is set to 0."""
    m = rot_world_from_base
    flat = math.hypot(m[0, 0], m[1, 0])
    pitch = math.atan2(-m[2, 0], flat)
    if flat > SMALL_ANGLE:
        return np.array([math.atan2(m[2, 1], m[2, 2]), pitch, math.atan2(m[1, 0], m[0, 0])])
    return np.array([0.0, pitch, math.atan2(-m[0, 1], m[1, 1])])


@kernel
def wrap_angle(angle: float) -> float:
    """Return the angle in (-pi, pi], rad, that differs from `angle`, rad, by full turns."""
    return -((-angle + math.pi) % (2.0 * math.pi) - math.pi)
