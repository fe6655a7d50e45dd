"""The filter of the pose beside filterpy's, its consistency on data of its own model, and its edges."""

import math

import numpy as np
import pytest
from filterpy.kalman import JulierSigmaPoints, UnscentedKalmanFilter
from scipy.stats import chi2

from surefoot.services.navigator.belief.ukf import (
    LandmarkSighting,
    entropy,
    innovation,
    predict,
    update,
    work_space,
    wrap,
)

NOISE = np.array([0.02**2, 0.01**2, math.radians(5.0) ** 2, math.radians(0.5) ** 2])
SR, SB = 0.06, math.radians(4.0)
NO_GAIN = np.zeros((2, 0))


def carry(mean, cov, forward, turn, walked, noise=NOISE):
    predict(mean, cov, forward, 0.0, turn, walked, noise, work_space(mean.size))


def gains(n, rng):
    return rng.normal(size=(2, n - 4)) * 0.2 if n > 4 else NO_GAIN


class Referee:
    """filterpy with the same model, the noise added by hand, points drawn anew before every step."""

    def __init__(self, mean, cov):
        n = mean.size
        self.points = JulierSigmaPoints(n, kappa=0.0)
        self.f = UnscentedKalmanFilter(
            n, 2, 1.0, hx=self._see, fx=self._move, points=self.points, z_mean_fn=self._mean, residual_z=self._less
        )
        self.f.x, self.f.P, self.f.Q = mean.copy(), cov.copy(), np.zeros((n, n))

    def _move(self, x, dt):
        out = x.copy()
        change = self.turn + (x[3] * self.walked if x.size > 3 else 0.0)
        middle = x[2] + change / 2
        out[0] += self.forward * math.cos(middle)
        out[1] += self.forward * math.sin(middle)
        out[2] += change
        return out

    def _see(self, x):
        lx, ly = self.landmark
        seen = np.array([math.hypot(lx - x[0], ly - x[1]), math.atan2(ly - x[1], lx - x[0]) - x[2]])
        return seen + self.gain @ x[4:] if x.size > 4 else seen

    def _mean(self, z, weights):
        first = z[0, 1]
        return np.array([weights @ z[:, 0], first + weights @ wrap_all(z[:, 1] - first)])

    def _less(self, a, b):
        return np.array([a[0] - b[0], wrap(a[1] - b[1])])

    def predict(self, forward, turn, walked):
        self.forward, self.turn, self.walked = forward, turn, walked
        middle = self.f.x[2] + (turn + (self.f.x[3] * walked if self.f.x.size > 3 else 0.0)) / 2
        self.f.predict()
        rot = np.array([[math.cos(middle), -math.sin(middle)], [math.sin(middle), math.cos(middle)]])
        self.f.P[:2, :2] += rot @ np.diag(NOISE[:2]) @ rot.T
        self.f.P[2, 2] += NOISE[2]
        if self.f.x.size > 3:
            self.f.P[3, 3] += NOISE[3]
        self.f.x[2] = wrap(self.f.x[2])

    def update(self, landmark, seen, gain):
        self.landmark, self.gain = landmark, gain
        self.f.sigmas_f = self.points.sigma_points(self.f.x, self.f.P)
        self.f.update(np.array(seen), R=np.diag([SR**2, SB**2]))
        self.f.x[2] = wrap(self.f.x[2])


def wrap_all(angles):
    return np.array([wrap(a) for a in angles])


def start(n):
    cov = np.diag([0.05**2, 0.05**2, math.radians(5.0) ** 2, 0.7**2] + [0.05**2] * 4)[:n, :n].copy()
    return np.zeros(n), cov


def truth_of(mean, cov, rng):
    return mean + np.linalg.cholesky(cov) @ rng.normal(size=mean.size)


def move(truth, forward, turn, walked, rng):
    """Move the truth by the model; its noise is along and across the true heading half-way."""
    change = turn + (truth[3] * walked if truth.size > 3 else 0.0)
    middle = truth[2] + change / 2
    along, across = forward + 0.02 * rng.normal(), 0.01 * rng.normal()
    truth[0] += along * math.cos(middle) - across * math.sin(middle)
    truth[1] += along * math.sin(middle) + across * math.cos(middle)
    truth[2] += change + math.sqrt(NOISE[2]) * rng.normal()
    if truth.size > 3:
        truth[3] += math.sqrt(NOISE[3]) * rng.normal()


def sight(truth, gain, rng):
    """Return the sighting of a landmark ahead of the truth."""
    r, a = rng.uniform(0.3, 1.0), truth[2] + rng.uniform(-0.6, 0.6)
    landmark = truth[0] + r * math.cos(a), truth[1] + r * math.sin(a)
    common = gain @ truth[4:] if truth.size > 4 else np.zeros(2)
    seen_r, seen_b = r + common[0] + SR * rng.normal(), wrap(a - truth[2] + common[1] + SB * rng.normal())
    return LandmarkSighting(*landmark, seen_r, seen_b, SR**2, SB**2)


MOTIONS = ((0.1, 0.0, 0.1), (0.0, 0.4, 0.0), (0.0, -0.4, 0.0), (0.1, 0.4, 0.1), (0.1, -0.2, 0.1), (0.0, 0.0, 0.0))


@pytest.mark.parametrize("n", [3, 4, 6])
def test_equals_filterpy_over_long_runs(n):
    rng = np.random.default_rng(n)
    mean, cov = start(n)
    truth, gain, worst = truth_of(mean, cov, rng), gains(n, rng), 0.0
    referee = Referee(mean, cov)
    for _ in range(500):
        motion = MOTIONS[rng.integers(len(MOTIONS))]
        move(truth, *motion, rng)
        carry(mean, cov, *motion)
        referee.predict(*motion)
        for _ in range(rng.integers(0, 4)):
            seen = sight(truth, gain, rng)
            before = mean.copy(), cov.copy()
            v0, v1, s00, s01, s11 = innovation(mean, cov, seen, gain, work_space(n))
            assert np.array_equal(before[0], mean)
            assert np.array_equal(before[1], cov)
            nis = update(mean, cov, seen, gain, work_space(n))
            referee.update(seen[:2], seen[2:4], gain)
            assert np.allclose([v0, v1], referee.f.y, atol=1e-9)
            assert np.allclose([[s00, s01], [s01, s11]], referee.f.S, atol=1e-9)
            assert nis == pytest.approx(referee.f.y @ np.linalg.solve(referee.f.S, referee.f.y), abs=1e-9)
        off = mean - referee.f.x
        off[2] = wrap(off[2])
        worst = max(worst, np.abs(off).max(), np.abs(cov - referee.f.P).max())
    assert worst < 1e-9


@pytest.mark.parametrize("n", [3, 4, 6])
def test_errors_and_innovations_are_as_large_as_claimed(n):
    """NEES after each run and NIS of each sight lie in their 95 % bands (Bonferroni: 4 bands are tested, so 99 %)."""
    rng, runs = np.random.default_rng(10 + n), 400
    nees, nis, sights = 0.0, 0.0, 0
    for _ in range(runs):
        mean, cov = start(n)
        if n > 3:
            cov[3, 3] = 0.2**2
        truth, gain = truth_of(mean, cov, rng), gains(n, rng)
        for _ in range(12):
            motion = MOTIONS[rng.integers(len(MOTIONS))]
            move(truth, *motion, rng)
            carry(mean, cov, *motion)
            for _ in range(3):
                seen = sight(truth, gain, rng)
                nis += update(mean, cov, seen, gain, work_space(n))
                sights += 1
        error = truth - mean
        error[2] = wrap(error[2])
        nees += error @ np.linalg.solve(cov, error)
    low, high = chi2.ppf([0.005, 0.995], n * runs) / runs
    assert low < nees / runs < high
    low, high = chi2.ppf([0.005, 0.995], 2 * sights) / sights
    assert low < nis / sights < high


def test_prediction_commutes_with_moving_the_map():
    rng = np.random.default_rng(5)
    mean, cov = start(4)
    cov += 0.01 * np.outer(a := rng.normal(size=4), a)
    angle, shift = 1.1, np.array([2.0, -3.0])
    rot = np.eye(4)
    rot[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]

    def moved(m, p):
        return rot @ m + [*shift, angle, 0.0], rot @ p @ rot.T

    m1, p1 = mean.copy(), cov.copy()
    carry(m1, p1, 0.1, 0.3, 0.1)
    m2, p2 = moved(mean, cov)
    carry(m2, p2, 0.1, 0.3, 0.1)
    want_m, want_p = moved(m1, p1)
    off = m2 - want_m
    off[2] = wrap(off[2])
    # Sigma points along the axes are not turned with the map, so the two differ by terms of fourth order
    assert np.abs(off).max() < 1e-3
    assert np.abs(p2 - want_p).max() < 1e-4


def test_without_uncertainty_the_mean_moves_on_the_arc():
    mean, cov, noise = np.array([1.0, 2.0, 0.5, 0.3]), np.zeros((4, 4)), np.zeros(4)
    carry(mean, cov, 0.1, 0.2, 0.1, noise)
    half = 0.5 + (0.2 + 0.03) / 2
    assert mean == pytest.approx([1 + 0.1 * math.cos(half), 2 + 0.1 * math.sin(half), 0.73, 0.3], abs=1e-12)
    assert not cov.any()


def test_sideways_is_forward_turned_by_a_right_angle():
    a, cov_a = start(4)
    b, cov_b = start(4)
    predict(a, cov_a, 0.0, 0.1, 0.0, 0.0, np.zeros(4), work_space(4))
    b[2] = math.pi / 2
    predict(b, cov_b, 0.1, 0.0, 0.0, 0.0, np.zeros(4), work_space(4))
    assert a[:2] == pytest.approx(b[:2], abs=1e-12)
    assert cov_a == pytest.approx(cov_b, abs=1e-12)


def test_heading_is_wrapped_and_an_innovation_across_pi_is_small():
    mean, cov = start(4)
    mean[2] = math.pi - 0.01
    carry(mean, cov, 0.0, 0.1, 0.0)
    assert mean[2] == pytest.approx(-math.pi + 0.09, abs=1e-9)
    behind = LandmarkSighting(mean[0] - 1.0, mean[1], 1.0, wrap(math.pi - mean[2] + 0.01), SR**2, SB**2)
    v = innovation(mean, cov, behind, NO_GAIN, work_space(4))
    assert abs(v[1]) < 0.05


def test_covariance_stays_symmetric_and_positive():
    rng = np.random.default_rng(3)
    mean, cov = start(6)
    gain, work, truth = gains(6, rng), work_space(6), np.zeros(6)
    for _ in range(2000):
        predict(mean, cov, *(m := MOTIONS[rng.integers(6)])[:1], 0.0, *m[1:], NOISE, work)
        move(truth, *m, rng)
        seen = sight(truth, gain, rng)
        update(mean, cov, seen._replace(var_range=1e-6, var_bearing=1e-6), gain, work)
        assert np.array_equal(cov, cov.T)
        assert np.linalg.eigvalsh(cov).min() > 0


def test_entropy_is_that_of_the_pose_in_metres_and_radians():
    rng = np.random.default_rng(4)
    a = rng.normal(size=(4, 4))
    cov = a @ a.T
    want = 0.5 * math.log((2 * math.pi * math.e) ** 3 * np.linalg.det(cov[:3, :3]))
    assert entropy(cov) == pytest.approx(want, abs=1e-9)
    assert entropy(np.zeros((3, 3))) == -math.inf


@pytest.mark.parametrize("angle", [-math.pi, 0.3, 3.0, 10.0, -25.0])
def test_wrap(angle):
    assert -math.pi <= wrap(angle) < math.pi
    assert math.cos(wrap(angle) - angle) == pytest.approx(1.0, abs=1e-12)
