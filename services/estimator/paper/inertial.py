"""Inertial part of Wawrzynski et al.: integration (1)-(4) and the linear model (24)-(26) of its error.

State: g (3,) = specific force at rest, m/s^2, points UP, and v (3,) = velocity of the IMU, m/s, both in the immobile
frame that is parallel to the IMU at the moment. Inputs: w (3,) rad/s, q (3,) m/s^2 from the IMU, d = time step in s.
"""

import math

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.linear_kernels import congruence, times_transposed
from surefoot.kernels.jit import kernel

SMALL_ANGLE_SQUARED = 1e-16  # rad^2; below it the series is exact to machine precision


@kernel
def rotate_by(b: Array, x: Array) -> Array:
    """Return f(b, x) = exp([b]) x, (3,): x (3,), any unit, turned about the vector b (3,) by |b| rad (Rodrigues)."""
    angle_sq = b[0] * b[0] + b[1] * b[1] + b[2] * b[2]
    if angle_sq > SMALL_ANGLE_SQUARED:
        angle = math.sqrt(angle_sq)
        s, c = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle_sq
    else:
        s, c = 1.0, 0.5
    y0 = b[1] * x[2] - b[2] * x[1]
    y1 = b[2] * x[0] - b[0] * x[2]
    y2 = b[0] * x[1] - b[1] * x[0]
    out = np.empty(3)
    out[0] = x[0] + s * y0 + c * (b[1] * y2 - b[2] * y1)
    out[1] = x[1] + s * y1 + c * (b[2] * y0 - b[0] * y2)
    out[2] = x[2] + s * y2 + c * (b[0] * y1 - b[1] * y0)
    return out


@kernel
def propagate(g: Array, v: Array, w: Array, q: Array, d: float) -> tuple[Array, Array]:
    """Integrate g and v over a step of d s: half a turn of g, a turn and a push of v, half a turn of g.

    Equations (2)-(4), also (28)-(30), of Wawrzynski et al. All in IMU axes.

    Args:
        g: specific force at rest, points up, (3,) m/s^2.
        v: velocity of the IMU, (3,) m/s.
        w: gyro, (3,) rad/s.
        q: accelerometer, (3,) m/s^2.
        d: length of the step, s.

    Returns:
        g (3,) m/s^2, v (3,) m/s after the step.
    """
    half, whole = np.empty(3), np.empty(3)
    for i in range(3):
        half[i], whole[i] = -0.5 * d * w[i], -d * w[i]
    g_mid, v_next = rotate_by(half, g), rotate_by(whole, v)
    for i in range(3):
        v_next[i] += (q[i] - g_mid[i]) * d
    return rotate_by(half, g_mid), v_next


@kernel
def turn_jacobian(x: Array) -> Array:
    """Return J(x) = df(b, x)/db at b = 0, which is -[x], (3, 3), of the turn f(b, x) = exp([b]) x; x (3,), any unit.

    (26) of Wawrzynski et al. with the corrected sign (printed: +[x]). C enters P only as C C^T, where the sign cancels.
    """
    j = np.zeros((3, 3))
    j[0, 1], j[0, 2] = x[2], -x[1]
    j[1, 0], j[1, 2] = -x[2], x[0]
    j[2, 0], j[2, 1] = x[1], -x[0]
    return j


@kernel
def transition(w: Array, d: float, exact: bool) -> Array:
    """Return the transition matrix F of (g, v) over a step of d s, (6, 6), with gyro w (3,) rad/s.

    g is the specific force at rest, m/s^2, v the velocity of the IMU, m/s, both in IMU axes. F is (24) of Wawrzynski et
    al., [I 0; -d I I], or with the rotation that it drops (`exact`): [E 0; -d E_h E], E = exp(-[w] d), E_h = exp(-[w] d
    / 2), [w] the matrix of the cross product.
    """
    f = np.zeros((6, 6))
    axis, by_half, by_whole = np.zeros(3), np.empty(3), np.empty(3)
    for i in range(3):
        by_half[i], by_whole[i] = -0.5 * d * w[i], -d * w[i]
    for i in range(3):
        for k in range(3):
            axis[k] = 1.0 if k == i else 0.0
        turned, half = axis, axis
        if exact:
            turned, half = rotate_by(by_whole, axis), rotate_by(by_half, axis)
        for k in range(3):
            f[k, i] = f[3 + k, 3 + i] = turned[k]
            f[3 + k, i] = -d * half[k]
    return f


@kernel
def input_noise(g: Array, v: Array, d: float, sigma_w: float, sigma_q: float) -> Array:
    """Return C, (6, 6): effect on (g, v), m/s^2 and m/s, of unit noise of gyro and accelerometer in a step of d s.

    C = sigma_w d [J(g); J(v) - J(g) d / 2] for the gyro and -sigma_q d I on v for the accelerometer, (25) of Wawrzynski
    et al., with J(x) = -[x], [x] the matrix of the cross product. All in IMU axes.

    Args:
        g: specific force at rest before the step, (3,) m/s^2.
        v: velocity of the IMU before the step, (3,) m/s.
        d: length of the step, s.
        sigma_w: standard deviation of a gyro sample, rad/s.
        sigma_q: standard deviation of an accelerometer sample, m/s^2.
    """
    c = np.zeros((6, 6))
    jg, jv = turn_jacobian(g), turn_jacobian(v)
    for i in range(3):
        for k in range(3):
            c[i, k] = jg[i, k] * d * sigma_w
            c[3 + i, k] = jv[i, k] * d * sigma_w - 0.5 * jg[i, k] * d * d * sigma_w
        c[3 + i, 3 + i] = -d * sigma_q
    return c


@kernel
def process_noise(g: Array, v: Array, d: float, sigma_w: float, sigma_q: float) -> Array:
    """Return the noise Q = C C^T of (g, v), (6, 6), over a step of d s, C the effect of gyro and accelerometer noise.

    Args:
        g: specific force at rest before the step, IMU axes, (3,) m/s^2.
        v: velocity of the IMU before the step, IMU axes, (3,) m/s.
        d: length of the step, s.
        sigma_w: standard deviation of a gyro sample, rad/s.
        sigma_q: standard deviation of an accelerometer sample, m/s^2.
    """
    c = input_noise(g, v, d, sigma_w, sigma_q)
    return times_transposed(c, c)


@kernel
def _covariance(p: Array, g: Array, v: Array, w: Array, d: float, noise: Array, exact: bool) -> Array:
    """Return the covariance (6, 6) of (g, v) after a step: F P F^T + C C^T, (31) of Wawrzynski et al.

    Args:
        p: covariance P before the step, (6, 6), m/s^2 and m/s squared.
        g: specific force at rest, IMU axes, (3,) m/s^2.
        v: velocity of the IMU, IMU axes, (3,) m/s.
        w: gyro, (3,) rad/s.
        d: length of the step, s.
        noise: standard deviations of a gyro and an accelerometer sample, (2,) rad/s and m/s^2.
        exact: True: exact transition F; False: first order, as by Wawrzynski et al.
    """
    f = transition(w, d, exact)
    out, more = congruence(f, p), process_noise(g, v, d, noise[0], noise[1])
    for i in range(6):
        for k in range(6):
            out[i, k] += more[i, k]
    return out


@kernel
def predict(
    x: Array, p: Array, w: Array, q: Array, d: float, noise: Array, exact: bool, symmetric: bool
) -> tuple[Array, Array]:
    """Return state x = (g, v) (6,) and covariance P (6, 6) after an inertial sample: P = F P F^T + C C^T.

    Equations (28)-(31) of Wawrzynski et al., F the transition of (g, v) and C the effect of the sensors' noise on it.

    Args:
        x: state before it, (6,); g m/s^2, v m/s, IMU axes.
        p: covariance P of the state, (6, 6).
        w: gyro, IMU axes, (3,) rad/s.
        q: accelerometer, IMU axes, (3,) m/s^2.
        d: length of the step, s.
        noise: standard deviations of a gyro and an accelerometer sample, (2,) rad/s and m/s^2.
        exact: True: exact transition; False: first order, as by Wawrzynski et al.
        symmetric: True: P is made symmetric at once; False: that is left to the correction.
    """
    g, v = x[:3], x[3:]
    p_next = _covariance(p, g, v, w, d, noise, exact)
    g_next, v_next = propagate(g, v, w, q, d)
    x_next = np.empty(6)
    for i in range(3):
        x_next[i], x_next[3 + i] = g_next[i], v_next[i]
    if symmetric:
        for i in range(6):
            for k in range(i):
                p_next[i, k] = p_next[k, i] = 0.5 * (p_next[i, k] + p_next[k, i])
    return x_next, p_next


def widened(p: Array, sd_g: float, sd_v: float) -> Array:
    """Return the covariance p (6, 6) of (g, v) with standard deviations sd_g, m/s^2, and sd_v, m/s, added."""
    return p + np.diag([sd_g**2] * 3 + [sd_v**2] * 3)


def without_velocity(p: Array, sd: float) -> Array:
    """Return the covariance p (6, 6) of (g, v) with v independent of g and of variance sd^2, sd in m/s."""
    out = np.zeros((6, 6))
    out[:3, :3] = p[:3, :3]
    out[3:, 3:] = np.eye(3) * sd**2
    return out
