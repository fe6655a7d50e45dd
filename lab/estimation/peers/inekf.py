"""Contact-aided right-invariant extended Kalman filter, after Hartley et al., IJRR 2020 (arXiv 1904.09251): a referee.

State: R = rot_world_from_imu, v, p, contact points d_1..d_N (world axes), gyro and accelerometer bias. The error is
X_hat X^-1 = exp(xi), xi = (phi, v, p, d_1..d_N), errors of the biases are b_hat - b:

    phi' = -R e_g,  v' = [g] phi - [v] R e_g - R e_a,  p' = xi_v - [p] R e_g,  d' = -[d] R e_g       (A of section 5)
    z = R y + p - d = xi_p - xi_d + R n          (y = the point in IMU axes by forward kinematics)

A point that touches down is set to p + R y with the covariance of p (augmentation); one that lifts is dropped.
Nothing is gated; noise is constant. For the laboratory: it multiplies by BLAS and does not run in a tick.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.constants import GRAVITY
from surefoot.kernels.jit import kernel

from ..log import Log, segments

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]

FREE = 1e4  # m^2, of a point that does not touch: it takes no part


@dataclass(frozen=True)
class InekfNoise:
    """Standard deviations; of the IMU per sample of 10 ms."""

    sigma_w: float = 0.0054  # rad/s
    sigma_q: float = 0.035  # m/s^2
    sigma_c: float = 0.001  # m/sqrt(s), walk of a contact point
    sigma_p: float = 0.0008  # m, of a point by forward kinematics
    walk_g: float = 2e-4  # rad/s/sqrt(s), of the gyro bias
    walk_a: float = 1e-3  # m/s^2/sqrt(s), of the accelerometer bias
    bias_g: float = 0.002  # rad/s, of the gyro bias after a standstill; without one 0.02
    bias_a: float = 0.05  # m/s^2
    points: bool = False  # all points of a sole, else the foot centre

    def vector(self) -> Array:
        """The numbers in the order of the kernel."""
        return np.array([self.sigma_w, self.sigma_q, self.sigma_c, self.sigma_p, self.walk_g, self.walk_a])


@kernel
def _skew(x: Array) -> Array:
    return np.array([[0.0, -x[2], x[1]], [x[2], 0.0, -x[0]], [-x[1], x[0], 0.0]])


@kernel
def exp3(x: Array) -> tuple[Array, Array]:
    """Exp(x) and its left Jacobian, (3, 3) each."""
    s = _skew(x)
    ss = s @ s
    t2 = x[0] * x[0] + x[1] * x[1] + x[2] * x[2]
    if t2 < 1e-12:
        return np.eye(3) + s + 0.5 * ss, np.eye(3) + 0.5 * s + ss / 6.0
    t = np.sqrt(t2)
    a, b, c = np.sin(t) / t, (1.0 - np.cos(t)) / t2, (t - np.sin(t)) / (t2 * t)
    return np.eye(3) + a * s + b * ss, np.eye(3) + b * s + c * ss


@kernel
def run(
    d: Array, row: Ints, feet: Ints, last: Flags, w: Array, q: Array, seen: Array, touch: Flags, begin: int,
    rot: Array, bias: Array, p0: Array, noise: Array, gravity: float,
) -> tuple[Array, Array, Array, Array, Array]:  # fmt: skip
    """Walk along a log.

    Args:
        d: and `row`, `feet`, `last`: segments of the log.
        w: gyro, (n, 3) rad/s.
        q: accelerometer, (n, 3) m/s^2.
        seen: contact points in IMU axes, (m, N, 3) m.
        touch: which of them touch, (m, N).
        begin: first segment to run; the robot stands until then.
        rot: rot_world_from_imu at the beginning, (3, 3).
        bias: of gyro and accelerometer, (6,).
        p0: variances of phi, v, p and the biases, (15,).
        noise: see `InekfNoise`.
        gravity: m/s^2.

    Returns:
        v (n, 3) m/s IMU axes, g (n, 3), P of (g, v) (n, 6, 6), p (n, 3) m world, rot (n, 3, 3).
    """
    n, points = w.shape[0], seen.shape[1]
    size = 15 + 3 * points
    bg, ba = 9 + 3 * points, 12 + 3 * points
    out_v, out_g, out_p = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 6, 6))
    out_x, out_r = np.zeros((n, 3)), np.zeros((n, 3, 3))
    g = np.array([0.0, 0.0, -gravity])
    v, x, at = np.zeros(3), np.zeros(3), np.zeros((points, 3))
    b_g, b_a = bias[:3].copy(), bias[3:].copy()
    cov = np.zeros((size, size))
    for i in range(9):
        cov[i, i] = p0[i]
    for i in range(6):
        cov[bg + i, bg + i] = p0[9 + i]
    for i in range(3 * points):
        cov[9 + i, 9 + i] = FREE
    active = np.zeros(points, dtype=np.bool_)
    gx = _skew(g)
    for s in range(d.size):
        k, dt = row[s], d[s]
        if s >= begin:
            # prediction: the mean rates of the row hold over the segment
            wk, qk = w[k] - b_g, q[k] - b_a
            a = np.zeros((size, size))
            a[3:6, 0:3] = gx
            for i in range(3):
                a[6 + i, 3 + i] = 1.0
                for j in range(3):
                    a[i, bg + j] = -rot[i, j]
                    a[3 + i, ba + j] = -rot[i, j]
            a[3:6, bg : bg + 3] = -(_skew(v) @ rot)
            a[6:9, bg : bg + 3] = -(_skew(x) @ rot)
            for f in range(points):
                if active[f]:
                    a[9 + 3 * f : 12 + 3 * f, bg : bg + 3] = -(_skew(at[f]) @ rot)
            a *= dt
            phi = np.eye(size) + a + 0.5 * (a @ a)
            # noise of gyro and accelerometer enters where the biases do: per sample of 10 ms
            per_g, per_a = noise[0] ** 2 * 0.01 / dt, noise[1] ** 2 * 0.01 / dt
            gain = a[:, bg : bg + 6].copy()
            for i in range(size):
                for j in range(6):
                    gain[i, j] *= np.sqrt(per_g if j < 3 else per_a)
            cov = phi @ cov @ phi.T + gain @ gain.T
            for f in range(points):
                for i in range(3):
                    if active[f]:
                        cov[9 + 3 * f + i, 9 + 3 * f + i] += noise[2] ** 2 * dt
            for i in range(3):
                cov[bg + i, bg + i] += noise[4] ** 2 * dt
                cov[ba + i, ba + i] += noise[5] ** 2 * dt
            turn, _ = exp3(wk * dt)
            half, _ = exp3(wk * (0.5 * dt))
            acc = rot @ half @ qk + g
            x = x + v * dt + 0.5 * acc * dt * dt
            v = v + acc * dt
            rot = rot @ turn
        j = feet[s]
        if j >= 0 and s >= begin:
            old = 0
            for f in range(points):
                good = touch[j, f] and np.isfinite(seen[j, f]).all()
                if active[f] and not good:
                    active[f] = False
                    cov[9 + 3 * f : 12 + 3 * f, :] = 0.0
                    cov[:, 9 + 3 * f : 12 + 3 * f] = 0.0
                    for i in range(3):
                        cov[9 + 3 * f + i, 9 + 3 * f + i] = FREE
                old += 1 if active[f] else 0
            if old > 0:
                h, z = np.zeros((3 * old, size)), np.zeros(3 * old)
                r = 0
                for f in range(points):
                    if active[f]:
                        z[3 * r : 3 * r + 3] = rot @ seen[j, f] + x - at[f]
                        for i in range(3):
                            h[3 * r + i, 6 + i] = -1.0
                            h[3 * r + i, 9 + 3 * f + i] = 1.0
                        r += 1
                ph = cov @ h.T
                inn = h @ ph
                for i in range(3 * old):
                    inn[i, i] += noise[3] ** 2
                gain_k = np.linalg.solve(inn, ph.T).T
                delta = gain_k @ z
                rest = np.eye(size) - gain_k @ h
                cov = rest @ cov @ rest.T + noise[3] ** 2 * (gain_k @ gain_k.T)
                cov = 0.5 * (cov + cov.T)
                turn, left = exp3(delta[:3].copy())
                rot = turn @ rot
                v = turn @ v + left @ delta[3:6]
                x = turn @ x + left @ delta[6:9]
                for f in range(points):
                    if active[f]:
                        at[f] = turn @ at[f] + left @ delta[9 + 3 * f : 12 + 3 * f]
                b_g = b_g + delta[bg : bg + 3]
                b_a = b_a + delta[ba : ba + 3]
            for f in range(points):
                if not active[f] and touch[j, f] and np.isfinite(seen[j, f]).all():
                    active[f] = True
                    at[f] = x + rot @ seen[j, f]
                    lo = 9 + 3 * f
                    cov[lo : lo + 3, :] = cov[6:9, :]
                    cov[:, lo : lo + 3] = cov[:, 6:9]
                    cov[lo : lo + 3, lo : lo + 3] = cov[6:9, 6:9]
                    for i in range(3):
                        cov[lo + i, lo + i] += noise[3] ** 2
        if last[s]:
            out_v[k] = rot.T @ v
            out_g[k] = -(rot.T @ g)
            out_x[k], out_r[k] = x, rot
            m = np.zeros((6, size))
            m[0:3, 0:3] = -(rot.T @ gx)
            for i in range(3):
                for jj in range(3):
                    m[3 + i, 3 + jj] = rot[jj, i]
            out_p[k] = m @ cov @ m.T
    return out_v, out_g, out_p, out_x, out_r


def upright(q: Array) -> Array:
    """A rotation (3, 3) world from IMU that turns the specific force q (3,) up."""
    z = q / np.linalg.norm(q)
    helper = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = helper - z * (helper @ z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.asarray(np.cross(z, x), dtype=np.float64), z])


def at_rest(log: Log) -> tuple[Array | None, Array, int]:
    """Mean gyro (3,) rad/s and specific force (3,) m/s^2 of the standstill, and the row after it.

    Without a standstill of ten rows the gyro is None, the force that of the first row.
    """
    first, end = log.rest
    if end - first < 10:
        return None, log.q[0], 0
    return log.w[first:end].mean(axis=0), log.q[first:end].mean(axis=0), end


def inekf(log: Log, noise: InekfNoise) -> tuple[Array, Array, Array, Array, Array]:
    """Run over a log; see `run` for what is returned."""
    cut = segments(log)
    seen, touch = log.point_views(noise.points)
    bias, sd_g = np.zeros(6), 0.02
    w, q, begin = at_rest(log)
    if w is not None:
        bias[:3], sd_g = w, noise.bias_g
    tilt = max(noise.bias_a / GRAVITY, 0.005)
    p0 = np.repeat([tilt**2, 0.01**2, 1e-8, sd_g**2, noise.bias_a**2], 3)
    p0[2] = 1e-8  # heading is by definition
    return run(
        *cut, log.w, log.q, seen, touch, int(np.searchsorted(cut.row, begin)), upright(q), bias, p0, noise.vector(),
        float(GRAVITY),
    )  # fmt: skip
