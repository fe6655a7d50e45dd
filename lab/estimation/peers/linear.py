"""Linear filter of position, velocity and feet with attitude from outside, as in MIT's Cheetah-Software: a referee.

A referee is an estimator of others, with which ours is compared. Attitude by a complementary filter (Mahony et al.
2008) over gyro and accelerometer, gyro bias by the rest at the beginning. State p position, v velocity, d_1..d_L feet
(world axes); a = R q - g is an input, R the rotation from IMU to world, q the specific force, g gravity. At each foot
sample, per foot in contact, w the rate of turn:

    p - d = -R y          (y = the foot in IMU axes)
    v = -R (w x y + y')   (y' by differences: logs have no joint rates)
    d_z = height at touch-down

A foot in the air gets 100 times the standard deviations of a standing one.
"""

from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY
from surefoot.kernels.jit import kernel

from ..log import Log, Segments, segments
from .inekf import PeerStart, PeerTrack, Readings, at_rest, exp3, new_track, readings, upright

SUSPECT = 100.0
"""Factor on the standard deviations of random walk and measured position of a foot in the air; 1 for one in contact."""


class LinearNoise(NamedTuple):
    """Standard deviations and gains of the linear Kalman filter of position, velocity and feet."""

    sigma_a: float = 0.5  # m/s^2 per sample of 10 ms; most of it is the tilt's error
    sigma_c: float = 0.005  # m/sqrt(s), walk of a foot
    sigma_p: float = 0.001  # m, foot against trunk
    sigma_v: float = 0.05  # m/s, velocity by a leg
    sigma_z: float = 0.01  # m, height of a standing foot
    kp: float = 0.1  # 1/s, attitude


class LinearState(NamedTuple):
    """State of the linear Kalman filter with L feet, changed in place."""

    x: Array  # (6 + 3 L,) position m, velocity m/s, feet m, world axes
    cov: Array  # (6 + 3 L, 6 + 3 L)
    rot: Array  # (3, 3) rot_world_from_imu
    ground: Array  # (L,) m, height of each foot at touch-down
    turned: Array  # (4,) rad and s, turn by the gyro since the last sample of the feet, and the time since


def _new_state(feet: int, start: PeerStart) -> LinearState:
    size = 6 + 3 * feet
    cov = np.diag(np.concatenate([np.full(6, 1e-4), np.ones(3 * feet)]))
    return LinearState(np.zeros(size), cov, start.rot.copy(), np.zeros(feet), np.zeros(4))


@kernel
def _predict(s: LinearState, w: Array, q: Array, dt: float, noise: LinearNoise) -> None:
    """Carry attitude and state over `dt` s, in place.

    `w`: rate of turn, (3,) rad/s, bias removed; `q`: specific force, (3,) m/s^2; both in IMU axes.
    """
    up = np.array([0.0, 0.0, 1.0])
    lean = np.cross(q / np.linalg.norm(q), np.ascontiguousarray(s.rot.T) @ up)
    rate = w + noise.kp * lean
    turn, _ = exp3(rate * dt)
    half, _ = exp3(rate * (0.5 * dt))
    push = s.rot @ half @ q - GRAVITY * up
    s.rot[:] = s.rot @ turn
    step = np.eye(s.x.size)
    for i in range(3):
        s.x[i] += s.x[3 + i] * dt + 0.5 * push[i] * dt * dt
        s.x[3 + i] += push[i] * dt
        step[i, 3 + i] = dt
    s.cov[:] = step @ s.cov @ step.T
    for i in range(3):
        s.cov[3 + i, 3 + i] += noise.sigma_a**2 * 0.01 * dt
        s.cov[i, i] += noise.sigma_a**2 * 0.01 * dt**3 / 3.0
    s.turned[:3] += w * dt
    s.turned[3] += dt


@kernel
def _take_foot(s: LinearState, f: int, log: Readings, j: int, before: int, noise: LinearNoise) -> None:
    """Correct the state with foot f of foot sample j, in place; `before`: index of the sample before, -1 = none."""
    seen, since = log.seen[j, f], s.turned[3]
    down = log.touch[j, f] and np.isfinite(seen).all()
    was = before >= 0 and log.touch[before, f]
    lo = 6 + 3 * f
    for i in range(3):
        s.cov[lo + i, lo + i] += noise.sigma_c**2 * since * (1.0 if down else SUSPECT**2)
    if not np.isfinite(seen).all():
        return
    y = s.rot @ seen
    if (down and not was) or before < 0:
        for i in range(3):
            s.x[lo + i] = s.x[i] + y[i]
        s.ground[f] = s.x[lo + 2]
        s.cov[lo : lo + 3, :] = s.cov[0:3, :]
        s.cov[:, lo : lo + 3] = s.cov[:, 0:3]
        s.cov[lo : lo + 3, lo : lo + 3] = s.cov[0:3, 0:3]
        for i in range(3):
            s.cov[lo + i, lo + i] += noise.sigma_p**2
    trust = 1.0 if down else SUSPECT
    for i in range(3):
        h = np.zeros(s.x.size)
        h[i], h[lo + i] = 1.0, -1.0
        _take(s, h, -y[i], (noise.sigma_p * trust) ** 2)
    if down and was and since > 0.0:
        last = log.seen[before, f]
        mean, mid = s.turned[:3] / since, 0.5 * (seen + last)
        speed = s.rot @ -((seen - last) / (log.seconds[j] - log.seconds[before]) + np.cross(mean, mid))
        for i in range(3):
            h = np.zeros(s.x.size)
            h[3 + i] = 1.0
            _take(s, h, speed[i], noise.sigma_v**2)
    if down:
        h = np.zeros(s.x.size)
        h[lo + 2] = 1.0
        _take(s, h, s.ground[f], noise.sigma_z**2)


@kernel
def _take(s: LinearState, h: Array, y: float, variance: float) -> None:
    """Correct the state x (n,) by one number y = h x + noise, in place; h (n,), `variance` of the noise."""
    ph = s.cov @ h
    inn = h @ ph + variance
    s.x[:] = s.x + ph * ((y - h @ s.x) / inn)
    for i in range(s.x.size):
        for k in range(s.x.size):
            s.cov[i, k] -= ph[i] * ph[k] / inn


@kernel
def run(
    cut: Segments, log: Readings, start: PeerStart, state: LinearState, noise: LinearNoise, track: PeerTrack
) -> None:
    """Run the linear filter along a log, and write its estimates to a track, in place.

    The covariance of the track is that of an exact attitude.

    Args:
        cut: time of the log, cut at every inertial row and foot sample.
        log: samples of the log.
        start: its first segment and gyro bias are read.
        state: state at that segment, changed in place.
        noise: standard deviations and gains.
        track: rows to write, in place.
    """
    up, before = np.array([0.0, 0.0, 1.0]), -1
    for s in range(cut.d.size):
        k, j = cut.row[s], cut.feet[s]
        if s >= start.segment:
            _predict(state, log.w[k] - start.bias, log.q[k], cut.d[s], noise)
            if j >= 0:
                for f in range(log.touch.shape[1]):
                    _take_foot(state, f, log, j, before, noise)
                before = j
                state.turned[:] = 0.0
        if cut.last[s]:
            back = np.ascontiguousarray(state.rot.T)
            track.v[k] = back @ state.x[3:6]
            track.g[k] = GRAVITY * (back @ up)
            track.x[k], track.rot[k] = state.x[:3], state.rot
            track.p[k, 3:, 3:] = back @ np.ascontiguousarray(state.cov[3:6, 3:6]) @ state.rot
            for i in range(3):
                track.p[k, i, i] = 1e-2


def linear(log: Log, noise: LinearNoise) -> PeerTrack:
    """Return the track of the linear filter over a log."""
    cut, out = segments(log), new_track(len(log.stamp_ns))
    bias, q, begin = at_rest(log)
    bias = np.zeros(3) if bias is None else bias
    start = PeerStart(int(np.searchsorted(cut.row, begin)), upright(q), bias, np.zeros(15))
    state = _new_state(log.feet_count, start)
    run(cut, readings(log, False), start, state, LinearNoise(*map(float, noise)), out)
    return out
