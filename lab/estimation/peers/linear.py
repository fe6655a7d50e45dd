"""Linear filter of position, velocity and feet with attitude from outside, as in MIT's Cheetah-Software: a referee.

Attitude by a complementary filter (Mahony et al. 2008) over gyro and accelerometer, gyro bias by the rest at the
beginning. State p, v, d_1..d_L (world axes); a = R q - g is an input. At each foot sample, per foot in contact:

    p - d = -R y          (y = the foot in IMU axes)
    v = -R (w x y + y')   (y' by differences: logs have no joint rates)
    d_z = height at touch-down

A foot in the air gets 100 times the noise, as there.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.constants import GRAVITY
from surefoot.kernels.jit import kernel

from ..log import Log, segments
from .inekf import at_rest, exp3, upright

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]

SUSPECT = 100.0  # factor on the noise of a foot in the air


@dataclass(frozen=True)
class LinearNoise:
    """Standard deviations and gains."""

    sigma_a: float = 0.5  # m/s^2 per sample of 10 ms; most of it is the tilt's error
    sigma_c: float = 0.005  # m/sqrt(s), walk of a foot
    sigma_p: float = 0.001  # m, foot against trunk
    sigma_v: float = 0.05  # m/s, velocity by a leg
    sigma_z: float = 0.01  # m, height of a standing foot
    kp: float = 0.1  # 1/s, attitude

    def vector(self) -> Array:
        """The numbers in the order of the kernel."""
        return np.array([self.sigma_a, self.sigma_c, self.sigma_p, self.sigma_v, self.sigma_z, self.kp])


@kernel
def run(
    d: Array, row: Ints, feet: Ints, last: Flags, w: Array, q: Array, seen: Array, stamps: Array, touch: Flags,
    begin: int, rot: Array, bias: Array, noise: Array, gravity: float,
) -> tuple[Array, Array, Array, Array, Array]:  # fmt: skip
    """Walk along a log; arguments as in `inekf.run`, `stamps` of the foot samples in s, `bias` of the gyro.

    Returns:
        v (n, 3) m/s IMU axes, g (n, 3), P of (g, v) (n, 6, 6) as if the attitude were exact, p (n, 3), rot (n, 3, 3).
    """
    n, points = w.shape[0], seen.shape[1]
    size = 6 + 3 * points
    out_v, out_g, out_p = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 6, 6))
    out_x, out_r = np.zeros((n, 3)), np.zeros((n, 3, 3))
    up = np.array([0.0, 0.0, 1.0])
    x, cov, ground = np.zeros(size), np.eye(size) * 1e-4, np.zeros(points)
    for f in range(points):
        for i in range(3):
            cov[6 + 3 * f + i, 6 + 3 * f + i] = 1.0
    mean_w, since, before = np.zeros(3), 0.0, -1
    began = False
    for s in range(d.size):
        k, dt = row[s], d[s]
        j = feet[s]
        if s >= begin:
            acc = np.ascontiguousarray(rot.T) @ up
            lean = np.cross(q[k] / np.linalg.norm(q[k]), acc)
            rate = w[k] - bias + noise[5] * lean
            turn, _ = exp3(rate * dt)
            half, _ = exp3(rate * (0.5 * dt))
            push = rot @ half @ q[k] - gravity * up
            rot = rot @ turn
            for i in range(3):
                x[i] += x[3 + i] * dt + 0.5 * push[i] * dt * dt
                x[3 + i] += push[i] * dt
            step = np.eye(size)
            for i in range(3):
                step[i, 3 + i] = dt
            cov = step @ cov @ step.T
            for i in range(3):
                cov[3 + i, 3 + i] += noise[0] ** 2 * 0.01 * dt
                cov[i, i] += noise[0] ** 2 * 0.01 * dt**3 / 3.0
            mean_w += (w[k] - bias) * dt
            since += dt
        if j >= 0 and s >= begin:
            for f in range(points):
                down = touch[j, f] and np.isfinite(seen[j, f]).all()
                was = before >= 0 and touch[before, f]
                q_f = noise[1] ** 2 * since * (1.0 if down else SUSPECT**2)
                for i in range(3):
                    cov[6 + 3 * f + i, 6 + 3 * f + i] += q_f
                if not np.isfinite(seen[j, f]).all():
                    continue
                y = rot @ seen[j, f]
                if (down and not was) or not began:
                    for i in range(3):
                        x[6 + 3 * f + i] = x[i] + y[i]
                    ground[f] = x[6 + 3 * f + 2]
                    lo = 6 + 3 * f
                    cov[lo : lo + 3, :] = cov[0:3, :]
                    cov[:, lo : lo + 3] = cov[:, 0:3]
                    cov[lo : lo + 3, lo : lo + 3] = cov[0:3, 0:3]
                    for i in range(3):
                        cov[lo + i, lo + i] += noise[2] ** 2
                trust = 1.0 if down else SUSPECT
                for i in range(3):
                    h = np.zeros(size)
                    h[i], h[6 + 3 * f + i] = 1.0, -1.0
                    x, cov = _take(x, cov, h, -y[i], (noise[2] * trust) ** 2)
                if down and was and since > 0.0:
                    mean = mean_w / since
                    mid = 0.5 * (seen[j, f] + seen[before, f])
                    speed = -((seen[j, f] - seen[before, f]) / (stamps[j] - stamps[before]) + np.cross(mean, mid))
                    speed = rot @ speed
                    for i in range(3):
                        h = np.zeros(size)
                        h[3 + i] = 1.0
                        x, cov = _take(x, cov, h, speed[i], noise[3] ** 2)
                if down:
                    h = np.zeros(size)
                    h[6 + 3 * f + 2] = 1.0
                    x, cov = _take(x, cov, h, ground[f], noise[4] ** 2)
            began, before, since = True, j, 0.0
            mean_w[:] = 0.0
        if last[s]:
            back = np.ascontiguousarray(rot.T)
            out_v[k] = back @ x[3:6]
            out_g[k] = gravity * (back @ up)
            out_x[k], out_r[k] = x[:3], rot
            out_p[k, 3:, 3:] = back @ np.ascontiguousarray(cov[3:6, 3:6]) @ rot
            for i in range(3):
                out_p[k, i, i] = 1e-2
    return out_v, out_g, out_p, out_x, out_r


@kernel
def _take(x: Array, cov: Array, h: Array, y: float, variance: float) -> tuple[Array, Array]:
    """Correct by one number y = h x + noise."""
    ph = cov @ h
    s = h @ ph + variance
    x_next = x + ph * ((y - h @ x) / s)
    out = cov.copy()
    for i in range(x.size):
        for k in range(x.size):
            out[i, k] -= ph[i] * ph[k] / s
    return x_next, out


def linear(log: Log, noise: LinearNoise) -> tuple[Array, Array, Array, Array, Array]:
    """Run over a log; see `run` for what is returned."""
    cut = segments(log)
    bias, q, begin = at_rest(log)
    seen, touch = np.ascontiguousarray(log.foot_position), np.ascontiguousarray(log.contact)
    return run(
        *cut, log.w, log.q, seen, 1e-9 * (log.foot_ns - log.stamp_ns[0]), touch,
        int(np.searchsorted(cut.row, begin)), upright(q), np.zeros(3) if bias is None else bias,
        noise.vector(), float(GRAVITY),
    )  # fmt: skip
