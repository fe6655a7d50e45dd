"""Equations (1)-(4) and (24)-(26)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from surefoot.geometry.constants import GRAVITY
from surefoot.services.estimator.paper import inertial

vectors = st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(np.array)


@given(vectors, vectors)
def test_rotate_by_is_the_matrix_exponential(b, x):
    np.testing.assert_allclose(inertial.rotate_by(b, x), expm(np.cross(np.eye(3), b)) @ x, atol=1e-12)


@given(vectors)
def test_a_rotation_keeps_lengths(b):
    x = np.array([1.0, -2.0, 0.5])
    assert np.linalg.norm(inertial.rotate_by(b, x)) == pytest.approx(np.linalg.norm(x), abs=1e-12)


def test_tiny_rotations_are_exact():
    b, x = np.array([1e-9, -2e-9, 3e-9]), np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(inertial.rotate_by(b, x) - x, np.cross(b, x), atol=1e-15)


@given(vectors)
def test_turn_jacobian_is_the_derivative_at_zero(x):
    h = 1e-6
    numeric = np.stack(
        [(inertial.rotate_by(h * e, x) - inertial.rotate_by(-h * e, x)) / (2 * h) for e in np.eye(3)], axis=1
    )
    np.testing.assert_allclose(inertial.turn_jacobian(x), numeric, atol=1e-8)
    np.testing.assert_allclose(inertial.turn_jacobian(x), np.cross(np.eye(3), -x), atol=1e-15)


def test_the_printed_sign_of_26_does_not_change_p():
    g, v, d, sigma = np.array([0.3, -0.2, 9.7]), np.array([0.1, 0.2, -0.05]), 0.01, (0.0054, 0.035)
    c = inertial.input_noise(g, v, d, *sigma)
    printed = c.copy()
    printed[:, :3] *= -1.0  # +[x] instead of -[x] in both rows
    np.testing.assert_allclose(printed @ printed.T, c @ c.T, atol=1e-18)
    np.testing.assert_allclose(inertial.process_noise(g, v, d, *sigma), c @ c.T, atol=1e-18)


def test_at_rest_nothing_changes():
    g = np.array([0.0, 0.0, GRAVITY])
    g_next, v_next = inertial.propagate(g, np.zeros(3), np.zeros(3), g, 0.01)
    np.testing.assert_allclose(g_next, g, atol=1e-12)
    np.testing.assert_allclose(v_next, np.zeros(3), atol=1e-12)


def test_a_constant_turn_and_push_is_integrated():
    """v' = q - g - w x v, g' = -w x g, against a fine Runge-Kutta solution."""
    w, q = np.array([0.3, -0.5, 0.8]), np.array([0.4, 0.2, 9.9])
    state = np.array([0.5, 0.1, 9.78, 0.02, -0.03, 0.01])

    def rate(x):
        return np.concatenate([-np.cross(w, x[:3]), q - x[:3] - np.cross(w, x[3:])])

    g, v, d, fine = state[:3].copy(), state[3:].copy(), 0.01, 10
    for _ in range(100):
        g, v = inertial.propagate(g, v, w, q, d)
        for _ in range(fine):
            h = d / fine
            k1 = rate(state)
            k2 = rate(state + h / 2 * k1)
            k3 = rate(state + h / 2 * k2)
            k4 = rate(state + h * k3)
            state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    np.testing.assert_allclose(g, state[:3], atol=1e-9)
    np.testing.assert_allclose(v, state[3:], atol=3e-2)  # first order in d, as the paper has it


def test_exact_transition_is_the_derivative_of_the_step():
    g, v, w, q, d = np.array([0.5, 0.1, 9.7]), np.array([0.1, 0.2, 0.3]), np.array([1.0, -2.0, 0.5]), np.zeros(3), 0.01
    h = 1e-6
    numeric = np.empty((6, 6))
    for k in range(6):
        e = np.zeros(6)
        e[k] = h
        up = np.concatenate(inertial.propagate(g + e[:3], v + e[3:], w, q, d))
        down = np.concatenate(inertial.propagate(g - e[:3], v - e[3:], w, q, d))
        numeric[:, k] = (up - down) / (2 * h)
    np.testing.assert_allclose(inertial.transition(w, d, True), numeric, atol=1e-8)
    paper = np.block([[np.eye(3), np.zeros((3, 3))], [-d * np.eye(3), np.eye(3)]])
    np.testing.assert_allclose(inertial.transition(w, d, False), paper, atol=1e-15)


def test_covariance_stays_symmetric_and_grows():
    p, noise = np.eye(6) * 1e-4, np.array([0.0054, 0.035])
    x, w = np.array([0.0, 0.0, 9.81, 0.0, 0.0, 0.0]), np.array([0.2, 0.1, -0.3])
    for _ in range(1000):
        _, p = inertial.predict(x, p, w, x[:3], 0.01, noise, False, True)
    np.testing.assert_allclose(p, p.T, rtol=1e-9, atol=1e-15)
    assert np.linalg.eigvalsh(p).min() > 0.0
    assert p[3, 3] > 1e-4
