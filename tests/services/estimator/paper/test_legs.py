"""Velocities from two samples of the feet."""

import numpy as np
import pytest

from surefoot.geometry.rotations import matrix_from_rotvec
from surefoot.papers.wawrzynski import chain
from surefoot.papers.wawrzynski.synthetic import bioloid_chains
from surefoot.services.estimator.feet.mount import FootSample
from surefoot.services.estimator.paper import legs

UP = np.array([0.0, 0.0, 1.0])


def pair(p_0, p_1, rot_0, rot_1, d):
    """Two samples of feet that stand, `d` s apart."""
    stand = np.ones(len(p_0), dtype=bool)
    return FootSample(0, p_0, rot_0, stand), FootSample(round(1e9 * d), p_1, rot_1, stand)


def velocities(p_0, p_1, rot_0, rot_1, used, w, up, radius, d):
    return legs.foot_velocities(*pair(p_0, p_1, rot_0, rot_1, d), used, w, up, radius)


def fit(p_0, p_1, used, d):
    rot = np.tile(np.eye(3), (len(p_0), 1, 1))
    return legs.rigid_fit(*pair(p_0, p_1, rot, rot, d), used)


def moving_body(rng, points, d, v, w):
    """Fixed points seen by a body that moves with a constant twist (v, w) in its own axes: samples at 0 and d."""
    rot = matrix_from_rotvec(w * d)  # rot_0_from_1
    shift = v * d
    return points, (points - shift) @ rot


def test_finite_differences_tend_to_the_recursion():
    leg, rng = bioloid_chains()[1], np.random.default_rng(0)
    for _ in range(10):
        theta, rate, w, d = rng.uniform(-0.8, 0.8, 6), rng.normal(size=6), rng.normal(size=3), 1e-4
        poses = [
            chain.foot_pose(chain.descend(leg, theta + s * d / 2 * rate, rate, w)) for s in (-1.0, 1.0)
        ]  # symmetric about theta
        (p_0, r_0), (p_1, r_1) = poses
        used = np.ones(1, dtype=bool)
        v_kg, v_k = velocities(p_0[None], p_1[None], r_0[None], r_1[None], used, w, UP, np.zeros(1), d)
        state = chain.descend(leg, theta, rate, w)
        np.testing.assert_allclose(v_kg[0], chain.velocity_kinematics_gyro(state, np.zeros(3)), atol=1e-7)
        np.testing.assert_allclose(v_k[0], chain.velocity_kinematics(state), atol=1e-3)  # first order: rot_1 for mid


def test_fixed_points_give_the_twist():
    rng, d = np.random.default_rng(1), 0.01
    points, v, w = rng.normal(size=(6, 3)) * 0.1 - 0.1 * UP, np.array([0.1, -0.05, 0.02]), np.array([0.2, -0.3, 0.1])
    p_0, p_1 = moving_body(rng, points, d, v, w)
    rot, used = np.tile(np.eye(3), (6, 1, 1)), np.ones(6, dtype=bool)
    v_kg, _ = velocities(p_0, p_1, rot, rot, used, w, UP, np.zeros(6), d)
    np.testing.assert_allclose(v_kg, np.tile(v, (6, 1)), atol=5e-4)
    fit_v, fit_w, ok = fit(p_0, p_1, used, d)
    assert ok
    np.testing.assert_allclose(fit_v, v, atol=5e-4)
    np.testing.assert_allclose(fit_w, w, atol=1e-3)


def test_rigid_fit_needs_three_feet_off_one_line():
    line = np.array([[0.1, 0.0, -0.1], [0.0, 0.0, -0.1], [-0.1, 0.0, -0.1]])
    assert not fit(line, line, np.ones(3, dtype=bool), 0.033)[2]
    spread = line + np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0], [0.0, 0.1, 0.0]])
    assert fit(spread, spread, np.ones(3, dtype=bool), 0.033)[2]
    assert not fit(spread, spread, np.array([True, True, False]), 0.033)[2]


def test_a_rolling_foot_carries_its_centre_along():
    """A ball of radius r under a leg that pivots by w_y: its centre moves r w_y forward, and the body with it."""
    r, w_y, d, hip = 0.008, 0.5, 0.01, np.array([0.0, 0.0, 0.1])
    p_0 = -hip[None].copy()
    turn = matrix_from_rotvec(np.array([0.0, w_y * d, 0.0]))
    p_1 = (turn @ -hip)[None]  # the leg turns in the body, the body does not
    used, w = np.ones(1, dtype=bool), np.zeros(3)
    fixed, _ = velocities(p_0, p_1, np.eye(3)[None], turn[None], used, w, UP, np.zeros(1), d)
    rolled, _ = velocities(p_0, p_1, np.eye(3)[None], turn[None], used, w, UP, np.full(1, r), d)
    np.testing.assert_allclose(fixed[0, 0], 0.1 * w_y, rtol=1e-3)
    np.testing.assert_allclose(rolled[0, 0], (0.1 + r) * w_y, rtol=1e-3)


def test_one_sliding_foot_of_three_is_left_out():
    v = np.array([[0.1, 0.0, 0.0], [0.105, 0.002, 0.0], [0.4, 0.0, 0.0], [9.0, 9.0, 9.0]])
    used = np.array([True, True, True, False])
    mean, slipping, n = legs.combine(v, used, 0.06)
    np.testing.assert_allclose(mean, [0.1025, 0.001, 0.0], atol=1e-12)
    assert (slipping.tolist(), n) == ([False, False, True, False], 2)


def test_two_feet_are_averaged_and_none_gives_none():
    v = np.array([[0.1, 0.0, 0.0], [0.4, 0.0, 0.0]])
    mean, slipping, n = legs.combine(v, np.ones(2, dtype=bool), 0.06)
    assert mean[0] == pytest.approx(0.25)
    assert (n, slipping.any()) == (2, False)
    assert legs.combine(v, np.zeros(2, dtype=bool), 0.06)[2] == 0


def test_no_two_feet_agree():
    v = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [-1.0, 0.5, 0.0]])
    mean, slipping, n = legs.combine(v, np.ones(3, dtype=bool), 0.01)
    assert n == 0
    assert slipping.all()
    assert np.isfinite(mean).all()
