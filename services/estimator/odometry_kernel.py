"""Kernel of the odometry filter: base_link and its feet in `odom`, tilt given.

State x (5 + 3 L,): position p of base_link (3), yaw, gyro bias about the vertical, foot centres c_f (3 each).
A stance foot is where it was: p + Rz(yaw) s_f - c_f = 0, s_f = the foot seen in heading axes (levelled base_link).
Encoder readings are never differentiated: an anchored foot does not let their noise add up within a stance.
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.linear_kernels import inverse3, times
from surefoot.kernels.jit import kernel
from surefoot.services.estimator.feet import median, order

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

P, YAW, BIAS, FEET = slice(0, 3), 3, 4, 5  # parts of the state
FREE = 1.0  # m^2, variance of a foot in the air

# indices of the noise vector
SIGMA_P, SIGMA_C, SIGMA_W, SIGMA_B, SIGMA_V, GATE, REANCHOR = 0, 1, 2, 3, 4, 5, 6


@kernel
def predict(
    x: Array, cov: Array, d: float, turn: float, moved: Array, roll: Array, stance: Flags, noise: Array
) -> None:
    """Carry x and its covariance over d s, in place.

    p += Rz(yaw) moved; yaw += turn - bias d; c_f += Rz(yaw) roll_f for stance feet.

    Args:
        x: state, (n,).
        cov: covariance, (n, n).
        d: time step, s.
        turn: heading change by the gyro, rad.
        moved: travel of base_link in heading axes by the velocity estimate, (3,) m.
        roll: travel of the foot centres by rolling, heading axes, (L, 3) m.
        stance: feet on the ground all the time, (L,).
        noise: SIGMA_P foot by kinematics, m; SIGMA_C foot walk, m/sqrt(s); SIGMA_W heading, rad/sqrt(s); SIGMA_B bias,
            rad/s/sqrt(s); SIGMA_V velocity, m/s; GATE, REANCHOR, chi^2.
    """
    n = x.size
    mid = x[YAW] + 0.5 * (turn - x[BIAS] * d)
    c, s = math.cos(mid), math.sin(mid)
    dx, dy = c * moved[0] - s * moved[1], s * moved[0] + c * moved[1]
    x[0] += dx
    x[1] += dy
    x[2] += moved[2]
    x[YAW] += turn - x[BIAS] * d
    for j in range(n):  # F cov: rows of p, then of yaw
        cov[0, j] -= dy * cov[YAW, j]
        cov[1, j] += dx * cov[YAW, j]
        cov[YAW, j] -= d * cov[BIAS, j]
    for j in range(n):  # (F cov) F^T
        cov[j, 0] -= dy * cov[j, YAW]
        cov[j, 1] += dx * cov[j, YAW]
        cov[j, YAW] -= d * cov[j, BIAS]
    for i in range(3):
        cov[i, i] += (noise[SIGMA_V] * d) ** 2
    cov[YAW, YAW] += noise[SIGMA_W] ** 2 * d
    cov[BIAS, BIAS] += noise[SIGMA_B] ** 2 * d
    for f in range(stance.size):
        at = FEET + 3 * f
        if stance[f]:
            x[at] += c * roll[f, 0] - s * roll[f, 1]
            x[at + 1] += s * roll[f, 0] + c * roll[f, 1]
            x[at + 2] += roll[f, 2]
            for i in range(3):
                cov[at + i, at + i] += noise[SIGMA_C] ** 2 * d


@kernel
def lift(cov: Array, foot: int) -> None:
    """Forget a foot that left the ground, in place."""
    at = FEET + 3 * foot
    for i in range(at, at + 3):
        for j in range(cov.shape[0]):
            cov[i, j] = 0.0
            cov[j, i] = 0.0
        cov[i, i] = FREE


@kernel
def anchor(x: Array, cov: Array, foot: int, seen: Array, noise: Array) -> None:
    """A foot came down: c = p + Rz(yaw) seen, with the covariance that follows from p and yaw, in place."""
    n, at = x.size, FEET + 3 * foot
    lift(cov, foot)
    c, s = math.cos(x[YAW]), math.sin(x[YAW])
    rx, ry = c * seen[0] - s * seen[1], s * seen[0] + c * seen[1]
    x[at], x[at + 1], x[at + 2] = x[0] + rx, x[1] + ry, x[2] + seen[2]
    by_yaw = np.array([-ry, rx, 0.0])
    for i in range(3):
        for j in range(n):
            if j < at or j >= at + 3:
                cov[at + i, j] = cov[i, j] + by_yaw[i] * cov[YAW, j]
    for i in range(3):
        for k in range(3):
            cov[at + i, at + k] = cov[at + i, k] + by_yaw[k] * cov[at + i, YAW]
        cov[at + i, at + i] += noise[SIGMA_P] ** 2
    for i in range(3):
        for j in range(n):
            cov[j, at + i] = cov[at + i, j]


@kernel
def observe(x: Array, cov: Array, foot: int, seen: Array, noise: Array) -> float:
    """Correct with a stance foot, in place.

    An innovation beyond the gate widens the FOOT (it slid), far beyond it anchors the foot anew.

    Returns:
        Normalised innovation squared, 3 degrees of freedom.
    """
    n, at = x.size, FEET + 3 * foot
    c, s = math.cos(x[YAW]), math.sin(x[YAW])
    rx, ry = c * seen[0] - s * seen[1], s * seen[0] + c * seen[1]
    by_yaw = np.array([-ry, rx, 0.0])
    r = np.array([x[at] - x[0] - rx, x[at + 1] - x[1] - ry, x[at + 2] - x[2] - seen[2]])
    ph = np.empty((n, 3))  # cov H^T, H = [I, by_yaw, 0, -I at the foot]
    for j in range(n):
        for i in range(3):
            ph[j, i] = cov[j, i] + by_yaw[i] * cov[j, YAW] - cov[j, at + i]
    inn = np.empty((3, 3))
    for i in range(3):
        for k in range(3):
            inn[i, k] = ph[i, k] + by_yaw[i] * ph[YAW, k] - ph[at + i, k]
        inn[i, i] += noise[SIGMA_P] ** 2
    inv = inverse3(inn)[0]
    nis = 0.0
    for i in range(3):
        for k in range(3):
            nis += r[i] * inv[i, k] * r[k]
    if nis > noise[REANCHOR]:
        anchor(x, cov, foot, seen, noise)
        return nis
    if nis > noise[GATE]:
        wider = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
        for i in range(3):
            cov[at + i, at + i] += wider
            ph[at + i, i] -= wider
            inn[i, i] += wider
        inv = inverse3(inn)[0]
    gain = times(ph, inv)
    for j in range(n):
        for i in range(3):
            x[j] += gain[j, i] * r[i]
    for j in range(n):
        for k in range(j + 1):
            cov[j, k] -= gain[j, 0] * ph[k, 0] + gain[j, 1] * ph[k, 1] + gain[j, 2] * ph[k, 2]
            cov[k, j] = cov[j, k]
    return nis


@kernel
def agreement(x: Array, seen: Array, used: Flags) -> NDArray[np.int64]:
    """Used feet, (k,), those first that agree best with the median of all about where base_link is.

    The predicted position is loose, so the foot that is taken first decides: it must not be the one that slides.
    """
    n = 0
    for f in range(used.size):
        n += 1 if used[f] else 0
    feet, gap, apart = np.empty(n, dtype=np.int64), np.empty((3, n)), np.zeros(n)
    c, s = math.cos(x[YAW]), math.sin(x[YAW])
    i = 0
    for f in range(used.size):
        if used[f]:
            at = FEET + 3 * f
            feet[i] = f
            gap[0, i] = x[at] - c * seen[f, 0] + s * seen[f, 1]
            gap[1, i] = x[at + 1] - s * seen[f, 0] - c * seen[f, 1]
            gap[2, i] = x[at + 2] - seen[f, 2]
            i += 1
    for k in range(3):
        middle = median(gap[k]) if n > 0 else 0.0
        for i in range(n):
            apart[i] += (gap[k, i] - middle) ** 2
    best, ranked = order(apart), np.empty(n, dtype=np.int64)
    for i in range(n):
        ranked[i] = feet[best[i]]
    return ranked


@kernel
def step(
    x: Array,
    cov: Array,
    d: float,
    turn: float,
    moved: Array,
    roll: Array,
    seen: Array,
    was: Flags,
    now: Flags,
    noise: Array,
) -> Array:
    """One kinematic sample, in place: predict, correct with the feet that stayed down, anchor those that came down.

    Args:
        x: state, (n,).
        cov: covariance, (n, n).
        d: time since the last sample, s.
        turn: heading change by the gyro since then, rad.
        moved: travel by the velocity estimate, heading axes, (3,) m.
        roll: rolling of the foot centres, heading axes, (L, 3) m.
        seen: feet in heading axes, (L, 3) m.
        was: feet anchored at the last sample, (L,).
        now: feet in contact now, (L,).
        noise: see `predict`.

    Returns:
        Normalised innovation squared by foot, (L,), 0 for feet not used.
    """
    nis, stayed = np.zeros(now.size), np.empty(now.size, dtype=np.bool_)
    for f in range(now.size):
        stayed[f] = was[f] and now[f]
    predict(x, cov, d, turn, moved, roll, stayed, noise)
    for f in range(now.size):
        if was[f] and not now[f]:
            lift(cov, f)
    for f in agreement(x, seen, stayed):
        nis[f] = observe(x, cov, f, seen[f], noise)
    for f in range(now.size):
        if now[f] and not was[f]:
            anchor(x, cov, f, seen[f], noise)
    return nis


@kernel
def level(rot_base_from_imu: Array, g: Array) -> Array:
    """rot_heading_from_base (3, 3) = Ry(pitch) Rx(roll) from g (3,), specific force at rest in IMU axes."""
    up = np.zeros(3)
    for i in range(3):
        for k in range(3):
            up[i] += rot_base_from_imu[i, k] * g[k]
    roll, pitch = math.atan2(up[1], up[2]), math.atan2(-up[0], math.hypot(up[1], up[2]))
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    return np.array([[cp, sp * sr, sp * cr], [0.0, cr, -sr], [-sp, cp * sr, cp * cr]])


@kernel
def heading_rate(rot_heading_from_base: Array, w_base: Array) -> float:
    """Rate of yaw, rad/s: (w_y sin roll + w_z cos roll)/cos pitch."""
    m = rot_heading_from_base
    return (w_base[1] * -m[1, 2] + w_base[2] * m[1, 1]) / max(m[0, 0], 0.1)


@kernel
def turned(row: Array, w: Array, w_true: Array, g: Array, d: float, rot_base_from_imu: Array) -> Array:
    """Integrals of the gyro after d s more: row (7,) = angle by the gyro (3), heading, g (3).

    Args:
        row: before.
        w: gyro as integrated in the row, (3,) rad/s.
        w_true: gyro less the bias the heading is to be free of, (3,) rad/s.
        g: specific force at rest now, (3,) IMU axes.
        d: s.
        rot_base_from_imu: (3, 3).
    """
    out, w_base = np.empty(7), np.zeros(3)
    for i in range(3):
        out[i] = row[i] + w[i] * d
        out[4 + i] = g[i]
        for k in range(3):
            w_base[i] += rot_base_from_imu[i, k] * w_true[k]
    out[3] = row[3] + heading_rate(level(rot_base_from_imu, g), w_base) * d
    return out


@kernel
def heading_view(rot_heading_from_base: Array, rot_base_from_imu: Array, imu_position: Array, feet: Array) -> Array:
    """Feet (L, 3) in heading axes from base_link, from feet (L, 3) in IMU axes from the IMU."""
    seen, base = np.zeros(feet.shape), np.empty(3)
    for f in range(feet.shape[0]):
        for i in range(3):
            base[i] = imu_position[i]
            for k in range(3):
                base[i] += rot_base_from_imu[i, k] * feet[f, k]
        for i in range(3):
            for k in range(3):
                seen[f, i] += rot_heading_from_base[i, k] * base[k]
    return seen


@kernel
def heading_roll(rot_heading_from_imu: Array, turn_imu: Array, radius: Array) -> Array:
    """Travel of the centres of rolling feet, heading axes, (L, 3) m: turn x (radius * up).

    Args:
        rot_heading_from_imu: (3, 3).
        turn_imu: rotation of each foot over the ground, IMU axes, (L, 3) rad.
        radius: (L,) m.
    """
    roll, turn = np.zeros(turn_imu.shape), np.empty(2)
    for f in range(radius.size):
        for i in range(2):
            turn[i] = 0.0
            for k in range(3):
                turn[i] += rot_heading_from_imu[i, k] * turn_imu[f, k]
        roll[f, 0], roll[f, 1] = turn[1] * radius[f], -turn[0] * radius[f]
    return roll
