"""The filter of equations (15)-(37) beside filterpy's, which predicts with matrices of its own."""

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter
from scipy.linalg import expm

from surefoot.services.estimator.paper.ekf import PaperEkf
from surefoot.services.estimator.params import EstimatorParams


def cross(v):
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


class Referee(ExtendedKalmanFilter):
    """Equations (24)-(31) in matrices: exponentials by scipy, F and C written out; corrections are filterpy's."""

    def __init__(self, params, g, p):
        super().__init__(dim_x=6, dim_z=3)
        self.params, self.x, self.P = params, np.concatenate([g, np.zeros(3)]), p.copy()

    def predict(self, w, q, d):
        g, v, one = self.x[:3], self.x[3:], np.eye(3)
        turn, half = expm(-cross(w) * d), expm(-cross(w) * d / 2)
        e, e_half = (turn, half) if self.params.exact_transition else (one, one)
        f = np.block([[e, np.zeros((3, 3))], [-d * e_half, e]])
        c = np.block(
            [
                [-cross(g) * d * self.params.sigma_w, np.zeros((3, 3))],
                [(-cross(v) * d + cross(g) * d * d / 2) * self.params.sigma_w, -d * one * self.params.sigma_q],
            ]
        )
        self.x = np.concatenate([turn @ g, turn @ v + (q - half @ g) * d])
        self.P = f @ self.P @ f.T + c @ c.T

    def correct(self, v, sigma):
        h = np.hstack([np.zeros((3, 3)), np.eye(3)])
        self.update(v, lambda x: h, lambda x: x[3:], R=np.eye(3) * sigma**2)


def inputs(n, seed):
    rng = np.random.default_rng(seed)
    t = np.arange(n)[:, None] * 0.01
    w = 0.3 * np.sin(t * [5.0, 7.0, 3.0]) + 0.0054 * rng.normal(size=(n, 3))
    q = [0.0, 0.0, 9.81] + 0.5 * np.cos(t * [4.0, 6.0, 9.0]) + 0.035 * rng.normal(size=(n, 3))
    has = np.arange(n) % 3 == 2
    measured = 0.1 * np.sin(t * [2.0, 3.0, 5.0]) + 0.03 * rng.normal(size=(n, 3))
    return w, q, has, measured


@pytest.mark.parametrize("exact", [False, True])
def test_equals_filterpy(exact):
    n, params = 2_000, EstimatorParams(exact_transition=exact)
    w, q, has, measured = inputs(n, 0)
    g0, p0 = np.array([0.1, -0.2, 9.8]), np.eye(6) * 1e-3
    ekf, referee = PaperEkf(params), Referee(params, g0, p0)
    ekf.reset(g0, p0)
    for k in range(n):
        ekf.predict(w[k], q[k], 0.01)
        referee.predict(w[k], q[k], 0.01)
        if has[k]:
            ekf.correct_with(measured[k], params.sigma_v)
            referee.correct(measured[k], params.sigma_v)
            assert ekf.nis == pytest.approx(float(referee.y @ referee.SI @ referee.y), rel=1e-6, abs=1e-9)
        np.testing.assert_allclose(np.concatenate([ekf.g, ekf.v]), referee.x, atol=1e-9)
        np.testing.assert_allclose(ekf.p, referee.P, atol=1e-9)


def test_covariance_stays_symmetric_positive():
    ekf = PaperEkf(EstimatorParams())
    ekf.reset(np.array([0.0, 0.0, 9.81]), np.eye(6) * 1e-4)
    w, q, has, measured = inputs(2000, 1)
    for k in range(2000):
        ekf.predict(w[k], q[k], 0.01)
        if has[k]:
            ekf.correct_with(measured[k], 0.015)
            np.testing.assert_allclose(ekf.p, ekf.p.T, rtol=1e-9, atol=1e-15)
        assert np.linalg.eigvalsh(ekf.p).min() > 0.0
    assert ekf.nis is not None
    assert ekf.nis > 0.0


def test_a_correction_is_equations_32_to_37():
    params, p, v = EstimatorParams(), np.diag([1.0, 2.0, 3.0, 0.1, 0.2, 0.3]), np.array([0.1, -0.2, 0.3])
    p[0, 3] = p[3, 0] = 0.05
    ekf = PaperEkf(params)
    ekf.reset(np.array([0.0, 0.0, 9.81]), p)
    ekf.correct_with(v, 0.1)
    h = np.hstack([np.zeros((3, 3)), np.eye(3)])
    gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + 0.01 * np.eye(3))
    expected = [0.0, 0.0, 9.81, 0.0, 0.0, 0.0] + gain @ v
    np.testing.assert_allclose(np.concatenate([ekf.g, ekf.v]), expected, atol=1e-12)
    np.testing.assert_allclose(ekf.p, (np.eye(6) - gain @ h) @ p, atol=1e-12)


def test_missing_samples_widen_the_covariance():
    ekf = PaperEkf(EstimatorParams())
    ekf.reset(np.array([0.0, 0.0, 9.81]), np.eye(6))
    ekf.widen(2.0, 3.0)
    np.testing.assert_allclose(np.diag(ekf.p), [5.0] * 3 + [10.0] * 3)


def test_forgetting_the_velocity_keeps_gravity():
    ekf = PaperEkf(EstimatorParams())
    ekf.reset(np.array([0.0, 0.0, 9.81]), np.eye(6) + 0.1)
    ekf.forget_velocity(2.0)
    np.testing.assert_array_equal(ekf.p[3:, 3:], 4.0 * np.eye(3))
    assert not ekf.p[:3, 3:].any()
    np.testing.assert_array_equal(ekf.p[:3, :3], np.eye(3) + 0.1)
