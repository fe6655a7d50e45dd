"""Dead reckoning over feet that stay where they are."""

import math

import numpy as np
import pytest

from surefoot.geometry.rotations import matrix_from_rpy
from surefoot.services.estimator import odometry_kernel as k
from surefoot.services.estimator.feet import FootSample
from surefoot.services.estimator.odometry import OdometryFilter, OdometryParams

G = np.array([0.0, 0.0, 9.81])
PERIOD = 33_000_000
HOME = np.array([[0.1, 0.12, -0.1], [0.0, 0.14, -0.1], [-0.1, 0.12, -0.1]])
HOME = np.concatenate([HOME, HOME * [1.0, -1.0, 1.0]])
TRIPODS = (np.array([1, 0, 1, 0, 1, 0], dtype=bool), np.array([0, 1, 0, 1, 0, 1], dtype=bool))


def tripod(step):
    """The tripods swing in turn, all feet stand in the first third of a step."""
    return TRIPODS[(step // 15) % 2] | (step % 15 < 5)


def make(params=None, bias_sd=1e-3, pose_sd=1e-3):
    odometry = OdometryFilter(6, np.eye(3), np.zeros(3), np.zeros(6), params or OdometryParams())
    odometry.start(np.array([0.0, 0.0, 0.1]), 0.0, bias_sd, np.full(4, pose_sd))
    return odometry


class Walk:
    """A hexapod on a curve: feet in the world, alternating tripods, exact kinematics plus noise."""

    def __init__(self, speed=0.05, rate=0.05, noise=0.0, gyro_error=0.0, seed=0):
        self.speed, self.rate, self.noise, self.gyro_error = speed, rate, noise, gyro_error
        self.rng = np.random.default_rng(seed)
        self.position, self.yaw, self.psi = np.array([0.0, 0.0, 0.1]), 0.0, 0.0
        self.feet = self.position + HOME
        self.stamp, self.steps = 0, 0

    @property
    def rot(self):
        return matrix_from_rpy(0.0, 0.0, self.yaw)

    def go(self, odometry, n, down=tripod, slide=None):
        for step in range(self.steps, self.steps + n):
            d = 1e-9 * PERIOD
            self.yaw += self.rate * d
            self.psi += (self.rate + self.gyro_error) * d
            self.position = self.position + self.rot @ [self.speed * d, 0.0, 0.0]
            stand = down(step)
            self.feet[~stand] = self.position + (HOME @ self.rot.T)[~stand]
            if slide is not None:
                self.feet += slide
            seen = (self.feet - self.position) @ self.rot + self.noise * self.rng.normal(size=(6, 3))
            self.stamp += PERIOD
            sample = FootSample(self.stamp, seen, np.tile(np.eye(3), (6, 1, 1)), stand.copy())
            w = np.array([0.0, 0.0, self.rate + self.gyro_error])
            odometry.on_feet(sample, self.psi, G, w, np.array([self.speed, 0.0, 0.0]))
        self.steps += n

    def error(self, odometry):
        return odometry.x[k.P] - self.position, odometry.x[k.YAW] - self.yaw


def test_exact_feet_give_an_exact_way():
    odometry, walk = make(), Walk()
    walk.go(odometry, 900)
    error, yaw = walk.error(odometry)
    assert np.linalg.norm(walk.position[:2]) > 0.5
    assert np.abs(error).max() < 2e-3  # the first sample is half a step late
    assert abs(yaw) < 5e-3


def test_three_feet_find_the_gyro_bias():
    odometry, walk = make(bias_sd=0.01), Walk(noise=3e-4, gyro_error=0.01)
    walk.go(odometry, 900)
    assert odometry.x[k.BIAS] == pytest.approx(0.01, abs=2e-3)
    assert abs(walk.error(odometry)[1]) < 0.03  # the gyro alone: 0.3 rad


def test_errors_fit_the_covariance():
    squares = []
    for seed in range(40):
        only_feet = OdometryParams(sigma_p=5e-4, sigma_c=1e-6, sigma_turn=1e-6, sigma_bias=0.0, gate=100.0)
        odometry, walk = make(only_feet, 1e-6, 1e-5), Walk(0.0, 0.0, noise=5e-4, seed=seed)
        walk.go(odometry, 1, lambda _: np.ones(6, dtype=bool))
        walk.speed, walk.rate = 0.05, 0.05
        walk.go(odometry, 300)
        error, yaw = walk.error(odometry)
        e = np.append(error, yaw)
        squares.append(e @ np.linalg.solve(odometry.cov[:4, :4], e))
    assert 2.5 < np.mean(squares) < 5.5  # 4 degrees of freedom


def test_covariance_grows_with_the_way_and_stays_positive():
    odometry, walk, sizes = make(), Walk(noise=4e-4), []
    for _ in range(10):
        walk.go(odometry, 60)
        sizes.append(np.sqrt(np.diag(odometry.cov)[:4]))
        np.testing.assert_allclose(odometry.cov, odometry.cov.T, rtol=1e-9, atol=1e-15)
        assert np.linalg.eigvalsh(odometry.cov).min() > 0.0
    assert (np.diff(sizes, axis=0) > 0.0).all()


def test_one_sliding_foot_is_seen_and_hardly_moves_the_body():
    def all_down(_):
        return np.ones(6, dtype=bool)

    slide = np.zeros((6, 3))
    slide[2] = [0.004, 0.0, 0.0]  # 12 cm/s
    odometry, walk = make(), Walk(speed=0.0, rate=0.0, noise=2e-4)
    walk.go(odometry, 30, all_down)
    assert not odometry.slipping.any()
    walk.go(odometry, 10, all_down, slide)
    assert odometry.slipping.tolist() == [False, False, True, False, False, False]
    assert np.abs(walk.error(odometry)[0]).max() < 2e-3


def test_no_feet_at_all_is_dead_reckoning_by_the_velocity():
    odometry, walk = make(), Walk(rate=0.0)
    walk.go(odometry, 30)
    before = odometry.cov[0, 0]
    walk.go(odometry, 150, lambda _: np.zeros(6, dtype=bool))
    error, _ = walk.error(odometry)
    assert np.abs(error).max() < 2e-3
    assert odometry.cov[0, 0] > 10 * before


def numeric(function, x, n, h=1e-6):
    return np.stack([(function(x + h * e) - function(x - h * e)) / (2 * h) for e in np.eye(n)], axis=1)


def test_predict_and_anchor_follow_their_jacobians():
    rng = np.random.default_rng(2)
    n, noise = k.FEET + 6, np.zeros(7)
    x = rng.normal(size=n)
    a = rng.normal(size=(n, n)) * 0.1
    cov, moved, turn, d = a @ a.T + np.eye(n), np.array([0.02, 0.01, 0.005]), 0.1, 0.033
    roll, stance = rng.normal(size=(2, 3)) * 1e-3, np.zeros(2, dtype=bool)

    def predicted(x0):
        x1, c1 = x0.copy(), cov.copy()
        k.predict(x1, c1, d, turn, moved, roll, stance, noise)
        return x1

    x1, c1 = x.copy(), cov.copy()
    k.predict(x1, c1, d, turn, moved, roll, stance, noise)
    f = numeric(predicted, x, n)
    np.testing.assert_allclose(c1, f @ cov @ f.T, atol=2e-3)  # bias to position is second order in d and left out
    seen = np.array([0.1, 0.2, -0.1])

    def anchored(x0):
        x2, c2 = x0.copy(), cov.copy()
        k.anchor(x2, c2, 1, seen, noise)
        return x2

    x2, c2 = x.copy(), cov.copy()
    k.anchor(x2, c2, 1, seen, noise)
    f = numeric(anchored, x, n)
    np.testing.assert_allclose(c2, f @ cov @ f.T, atol=1e-8)


def test_observe_is_the_kalman_update_of_its_equation():
    rng = np.random.default_rng(4)
    n, noise = k.FEET + 6, np.array([0.01, 0.0, 0.0, 0.0, 0.0, 1e9, 1e9])
    x = rng.normal(size=n) * 0.1
    a = rng.normal(size=(n, n)) * 0.01
    cov, seen = a @ a.T + 1e-4 * np.eye(n), np.array([0.1, 0.2, -0.1])

    def gap(x0):
        c, s = math.cos(x0[k.YAW]), math.sin(x0[k.YAW])
        rot = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return x0[:3] + rot @ seen - x0[k.FEET : k.FEET + 3]

    h = numeric(gap, x, n)
    inn = h @ cov @ h.T + 1e-4 * np.eye(3)
    gain = cov @ h.T @ np.linalg.inv(inn)
    x1, c1 = x.copy(), cov.copy()
    nis = k.observe(x1, c1, 0, seen, noise)
    np.testing.assert_allclose(x1, x - gain @ gap(x), atol=1e-8)
    np.testing.assert_allclose(c1, (np.eye(n) - gain @ h) @ cov, atol=1e-8)
    assert nis == pytest.approx(gap(x) @ np.linalg.solve(inn, gap(x)))


def test_level_and_heading_rate():
    rng = np.random.default_rng(0)
    for roll, pitch in rng.uniform(-0.6, 0.6, size=(10, 2)):
        rot = matrix_from_rpy(roll, pitch, 0.0)
        np.testing.assert_allclose(k.level(np.eye(3), rot.T @ G), rot, atol=1e-12)
        h, yaw_rate = 1e-6, 0.7
        later = matrix_from_rpy(roll + 0.2 * h, pitch - 0.4 * h, yaw_rate * h)
        spin = rot.T @ (later - rot) / h
        w = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
        assert k.heading_rate(rot, w) == pytest.approx(yaw_rate, abs=1e-5)


def test_a_constant_tilt_error_bends_the_way():
    odometry, walk = make(), Walk(rate=0.0)
    walk.go(odometry, 300)
    plain, bent = (odometry.pose(0.0, walk.psi, G, np.zeros(3), v).covariance for v in (0.0, 0.01**2))
    way = np.linalg.norm(odometry.x[k.P] - [0.0, 0.0, 0.1])
    assert np.sqrt(bent[2, 2] - plain[2, 2]) == pytest.approx(0.01 * way, rel=1e-3)


def test_pose_is_carried_on_between_the_feet():
    odometry, walk = make(), Walk(rate=0.0)
    walk.go(odometry, 60)
    at, later = (odometry.pose(s, walk.psi, G, np.array([0.05, 0.0, 0.0])) for s in (0.0, 0.02))
    np.testing.assert_allclose(later.position - at.position, [0.001, 0.0, 0.0], atol=1e-4)
    assert np.linalg.norm(later.quat_wxyz) == pytest.approx(1.0)
