"""Feet seen from the IMU, and the velocity of the IMU from two successive samples of them.

p_f, rot_f = position and orientation of the foot in IMU axes. With D the time between the samples, w the MEAN gyro over
it and p the mean of both positions, a foot that does not slide gives (identity proved in the tests against `chain`)

    v^KG = -(p_1 - p_0)/D - w x p                        (5)-(14), robust to a twisting foot
    v^K  = rot_1 (r_1 - r_0)/D,   r = -rot^T p           (5)-(10), right only if the foot keeps its orientation

A round foot rolls: its centre moves by w_foot x (radius * up), which `v^KG` takes into account (note 2.3, (13) `best`).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.rotations import matrix_from_quat, rotvec_from_matrix
from surefoot.kernels.jit import kernel
from surefoot.robot.description import KinematicModel, Robot
from surefoot.robot.kinematics import forward

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

MIN_SPREAD = 1e-4  # m^2; three feet closer to one line than 1 cm cannot tell a rotation


class FootSample(NamedTuple):
    """All feet at one time, IMU axes."""

    stamp_ns: int
    position: Array  # (L, 3) m
    rot: Array  # (L, 3, 3) rot_imu_from_foot
    contact: Flags  # (L,)


class FootMount(NamedTuple):
    """What of a robot description is needed to see the feet from the IMU."""

    model: KinematicModel | None  # None: feet come as positions, there are no joints
    rot_imu_from_base: Array  # (3, 3)
    imu_position: Array  # (3,) in base_link, m
    radius: Array  # (L,) m, radius of a round foot; 0 = a sole


def foot_mount(robot: Robot) -> FootMount:
    """Mounting of the IMU and shape of the feet; a foot of several spheres is a sole."""
    rot = np.ascontiguousarray(matrix_from_quat(robot.imu.quat_wxyz).T)
    radius = np.array([leg.foot.radius if len(leg.foot.points) == 1 else 0.0 for leg in robot.legs])
    return FootMount(robot.model, rot, np.ascontiguousarray(robot.imu.position, dtype=np.float64), radius)


def bare_mount(feet: int) -> FootMount:
    """IMU in base_link, feet that do not roll: for logs of foot positions."""
    return FootMount(None, np.eye(3), np.zeros(3), np.zeros(feet))


def feet_in_imu(mount: FootMount, q: Array) -> tuple[Array, Array]:
    """Foot centres (L, 3) and rot_imu_from_foot (L, 3, 3) from joint angles q (nj,)."""
    assert mount.model is not None, "a bare mount has no joints"
    return _feet_in_imu(mount.model, mount.rot_imu_from_base, mount.imu_position, q)


@kernel
def _feet_in_imu(model: KinematicModel, rot_imu_from_base: Array, imu_position: Array, q: Array) -> tuple[Array, Array]:
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
        for i in range(3):
            position[f, i] = 0.0
            for k in range(3):
                position[f, i] += rot_imu_from_base[i, k] * point[k]
                rot[f, i, k] = 0.0
                for m in range(3):
                    rot[f, i, k] += rot_imu_from_base[i, m] * rot_base[link, m, k]
    return position, rot


@kernel
def known_feet(position: Array, rot: Array, switches: Array) -> tuple[Array, Array, Array, Ints, bool]:
    """Feet with those that are not finite (a dead encoder) lifted off the ground.

    Args:
        position: (L, 3) m, IMU axes.
        rot: rot_imu_from_foot, (L, 3, 3).
        switches: probability of contact at each switch, (L, S), NaN = unknown.

    Returns:
        Positions and rotations with zeros and unit matrices for unknown feet; probability of contact of each foot (L,),
        0 for those, NaN = unknown; the switches that are closed (L,), bit s for switch s; and whether a foot may stand.
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
def cross(a: Array, b: Array) -> Array:
    """a x b, (3,)."""
    out = np.empty(3)
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
    return out


@kernel
def foot_turn(rot_0: Array, rot_1: Array) -> Array:
    """Rotation vector of the foot against the IMU between two samples, IMU axes, (3,) rad: log(rot_1 rot_0^T)."""
    relative = np.empty((3, 3))
    for i in range(3):
        for k in range(3):
            relative[i, k] = rot_1[i, 0] * rot_0[k, 0] + rot_1[i, 1] * rot_0[k, 1] + rot_1[i, 2] * rot_0[k, 2]
    return rotvec_from_matrix(relative)


@kernel
def foot_velocities(
    p_0: Array, p_1: Array, rot_0: Array, rot_1: Array, used: Flags, w: Array, up: Array, radius: Array, d: float
) -> tuple[Array, Array]:
    """Velocity of the IMU by each foot.

    Args:
        p_0: foot positions at the earlier sample, (L, 3) m, IMU axes.
        p_1: at the later one.
        rot_0: rot_imu_from_foot at the earlier sample, (L, 3, 3).
        rot_1: at the later one.
        used: feet to compute, (L,); the others give 0.
        w: mean gyro between the samples, (3,) rad/s.
        up: upward unit vector, IMU axes, (3,).
        radius: radius of round feet, (L,) m.
        d: time between the samples, s.

    Returns:
        v^KG (L, 3) and v^K (L, 3), m/s, IMU axes.
    """
    feet = p_0.shape[0]
    v_kg, v_k = np.zeros((feet, 3)), np.zeros((feet, 3))
    arm, moved = np.empty(3), np.empty(3)
    for f in range(feet):
        if not used[f]:
            continue
        for i in range(3):
            arm[i] = 0.5 * (p_0[f, i] + p_1[f, i])
        sweep = cross(w, arm)
        for i in range(3):
            v_kg[f, i] = -(p_1[f, i] - p_0[f, i]) / d - sweep[i]
        if radius[f] > 0.0:
            turn = foot_turn(rot_0[f], rot_1[f])
            for i in range(3):
                turn[i] = w[i] + turn[i] / d
                arm[i] = radius[f] * up[i]
            rolled = cross(turn, arm)
            for i in range(3):
                v_kg[f, i] += rolled[i]
        for i in range(3):
            moved[i] = 0.0
            for k in range(3):
                moved[i] += rot_0[f, k, i] * p_0[f, k] - rot_1[f, k, i] * p_1[f, k]
        for i in range(3):
            for k in range(3):
                v_k[f, i] += rot_1[f, i, k] * moved[k] / d
    return v_kg, v_k


@kernel
def rigid_fit(p_0: Array, p_1: Array, used: Flags, d: float) -> tuple[Array, Array, bool]:
    """Twist of the IMU from three or more point feet, no gyro: min sum |v + w x p_f + (p_1 - p_0)/d|^2.

    The kinematics-only estimate of a robot whose feet are points: (10) needs the orientation of a foot, which a point
    does not have; three points that stay put have one.

    Returns:
        v (3,) m/s, w (3,) rad/s, IMU axes, and whether three feet off one line were there.
    """
    feet = p_0.shape[0]
    n = 0
    centre, mean = np.zeros(3), np.zeros(3)
    for f in range(feet):
        if used[f]:
            n += 1
            for i in range(3):
                centre[i] += 0.5 * (p_0[f, i] + p_1[f, i])
                mean[i] -= (p_1[f, i] - p_0[f, i]) / d
    if n < 3:
        return np.zeros(3), np.zeros(3), False
    for i in range(3):
        centre[i] /= n
        mean[i] /= n
    a, b, arm, rate = np.zeros((3, 3)), np.zeros(3), np.empty(3), np.empty(3)
    for f in range(feet):
        if used[f]:
            for i in range(3):
                arm[i] = 0.5 * (p_0[f, i] + p_1[f, i]) - centre[i]
                rate[i] = -(p_1[f, i] - p_0[f, i]) / d - mean[i]
            moment = cross(arm, rate)
            for i in range(3):
                b[i] += moment[i]
            square = arm[0] * arm[0] + arm[1] * arm[1] + arm[2] * arm[2]
            for i in range(3):
                a[i, i] += square
                for k in range(3):
                    a[i, k] -= arm[i] * arm[k]
    w, ok = _solve_3(a, b)
    if not ok:
        return np.zeros(3), np.zeros(3), False
    swept = cross(w, centre)
    for i in range(3):
        mean[i] -= swept[i]
    return mean, w, True


@kernel
def leg_velocity(
    p_0: Array,
    p_1: Array,
    rot_0: Array,
    rot_1: Array,
    used: Flags,
    w: Array,
    up: Array,
    radius: Array,
    d: float,
    gate: float,
    v_now: Array,
) -> tuple[Array, int, Array, int, Flags]:
    """One velocity of the IMU from the feet of two samples; see `foot_velocities`, `combine`, `rigid_fit`.

    Args:
        p_0: and the following as in `foot_velocities`.
        gate: as in `combine`.
        v_now: velocity by the filter, (3,) m/s: it casts doubt on one or two feet that cannot be compared.

    Returns:
        v^KG (3,), feet in it, v^K (3,), feet in it, slipping or doubtful feet (L,).
    """
    v_kg, v_k = foot_velocities(p_0, p_1, rot_0, rot_1, used, w, up, radius, d)
    mean_kg, slipping, feet_kg = combine(v_kg, used, gate)
    trusted, feet_k = np.empty(used.size, dtype=np.bool_), 0
    for f in range(used.size):
        trusted[f] = used[f] and not slipping[f]
        feet_k += 1 if trusted[f] else 0
    mean_k, _, fits = rigid_fit(p_0, p_1, trusted, d)
    if not fits:
        mean_k, _, feet_k = combine(v_k, trusted, np.inf)
    if 0 < feet_kg < 3:
        for f in range(used.size):
            off = 0.0
            for i in range(3):
                off += (v_kg[f, i] - v_now[i]) ** 2
            slipping[f] = used[f] and off > gate * gate
    return mean_kg, feet_kg, mean_k, feet_k, slipping


@kernel
def _solve_3(a: Array, b: Array) -> tuple[Array, bool]:
    """Solve the symmetric 3 x 3 system by cofactors; false if it is near singular."""
    c = np.empty((3, 3))
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for k in range(3):
            k1, k2 = (k + 1) % 3, (k + 2) % 3
            c[i, k] = a[i1, k1] * a[i2, k2] - a[i1, k2] * a[i2, k1]
    det = a[0, 0] * c[0, 0] + a[0, 1] * c[0, 1] + a[0, 2] * c[0, 2]
    if det < MIN_SPREAD**3:
        return np.zeros(3), False
    x = np.zeros(3)
    for i in range(3):
        for k in range(3):
            x[i] += c[k, i] * b[k] / det
    return x, True


@kernel
def order(values: Array) -> NDArray[np.int64]:
    """Indices (n,) that sort a handful of numbers (n,), equal ones in their order, NaN last."""
    ranked = np.empty(values.size, dtype=np.int64)
    for i in range(values.size):
        k = i
        while k > 0 and (values[i] < values[ranked[k - 1]] or math.isnan(values[ranked[k - 1]])):
            ranked[k] = ranked[k - 1]
            k -= 1
        ranked[k] = i
    return ranked


@kernel
def median(values: Array) -> float:
    """Median of a handful of numbers, (n,), n > 0."""
    ranked = order(values)
    return float(0.5 * (values[ranked[(values.size - 1) // 2]] + values[ranked[values.size // 2]]))


@kernel
def combine(v: Array, used: Flags, gate: float) -> tuple[Array, Flags, int]:
    """One velocity from several feet, and which of them slip.

    Median per axis, then the mean of the feet within `gate` of it: with three feet or more one sliding foot is left
    out, and the mean of the rest has the least encoder noise. Two feet cannot say who slides: their mean.

    Args:
        v: velocity by each foot, (L, 3) m/s.
        used: feet to take, (L,).
        gate: largest distance from the median, m/s.

    Returns:
        velocity (3,), slipping (L,), number of feet in the mean (0: none, velocity 0).
    """
    feet = v.shape[0]
    slipping = np.zeros(feet, dtype=np.bool_)
    n = 0
    for f in range(feet):
        n += 1 if used[f] else 0
    out = np.zeros(3)
    if n == 0:
        return out, slipping, 0
    middle = np.empty(3)
    values = np.empty(n)
    for i in range(3):
        k = 0
        for f in range(feet):
            if used[f]:
                values[k] = v[f, i]
                k += 1
        middle[i] = median(values)
    kept = 0
    for f in range(feet):
        if not used[f]:
            continue
        x, y, z = v[f, 0] - middle[0], v[f, 1] - middle[1], v[f, 2] - middle[2]
        if n > 2 and x * x + y * y + z * z > gate * gate:
            slipping[f] = True
            continue
        kept += 1
        for i in range(3):
            out[i] += v[f, i]
    if kept == 0:  # no two feet agree: the median is all there is
        return middle, slipping, 0
    for i in range(3):
        out[i] /= kept
    return out, slipping, kept
