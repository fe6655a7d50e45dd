"""Rest, and what is learned from it."""

import numpy as np
import pytest

from surefoot.services.estimator.paper.standstill import GyroBias, Standstill, gravity_at_rest, plane_normal
from surefoot.services.estimator.params import EstimatorParams

GRAVITY = np.array([0.0, 0.0, 9.81])


def feed(standstill, rng, n, w=0.0, noise=1.0):
    out = []
    for _ in range(n):
        gyro = np.array([w, 0.0, 0.0]) + noise * 0.0054 * rng.normal(size=3)
        out.append(standstill.on_imu(gyro, GRAVITY + noise * 0.035 * rng.normal(size=3)))
    return out


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.fixture
def standstill():
    return Standstill(50, 0.0135, 0.0875, 0.0013)


def test_rest_is_seen_after_fifty_samples(standstill, rng):
    assert feed(standstill, rng, 60).index(True) == 49


def test_shaking_is_no_rest(standstill, rng):
    assert not any(feed(standstill, rng, 200, noise=6.0))


def test_a_gap_starts_the_count_anew(standstill, rng):
    feed(standstill, rng, 60)
    standstill.break_off()
    assert feed(standstill, rng, 60).index(True) == 49


def test_moving_feet_are_no_rest(standstill, rng):
    feet = np.zeros((6, 3))
    standstill.on_feet(feet)
    for k in range(40):
        standstill.on_feet(feet + 0.001 * k)
        feed(standstill, rng, 3)
        assert not standstill.standing
    assert feed(standstill, rng, 60)[-1]


def test_a_dead_encoder_does_not_hide_rest(standstill, rng):
    feet = np.zeros((6, 3))
    feet[2] = np.nan
    standstill.on_feet(feet)
    standstill.on_feet(feet)
    assert feed(standstill, rng, 60)[-1]


def test_only_rest_with_rest_around_it_is_settled(standstill, rng):
    for k in range(1, 160):
        feed(standstill, rng, 1)
        assert (standstill.settled is not None) == (k >= 100)
    feed(standstill, rng, 1, noise=60.0)
    assert standstill.settled is None


def test_bias_is_the_mean_of_all_samples_at_rest():
    rng, bias = np.random.default_rng(1), GyroBias(0.0054, 1e-4)
    true = np.array([0.05, -0.02, 0.01])
    samples = true + 0.0054 * rng.normal(size=(1000, 3))
    bias.start(samples[:50].mean(axis=0), 50)
    for k in range(50, 1000):
        bias.refine(true, samples[k], 50)
    assert bias.samples == 1000
    np.testing.assert_allclose(bias.value, samples.mean(axis=0), atol=1e-12)
    assert np.abs(bias.value - true).max() < 4 * 0.0054 / np.sqrt(1000)


def test_a_slow_turn_is_not_taken_for_the_bias():
    bias = GyroBias(0.0054, 1e-4)
    bias.start(np.zeros(3), 50)
    bias.refine(np.array([0.0, 0.006, 0.0]), np.full(3, 0.006), 50)
    assert bias.samples == 50
    assert not bias.value.any()
    bias.refine(np.full(3, 0.002), np.full(3, 0.0051), 50)
    assert bias.samples == 51
    np.testing.assert_allclose(bias.value, 1e-4)


def test_a_bias_that_was_learned_in_a_slow_turn_is_replaced_by_a_long_rest():
    rng, bias = np.random.default_rng(2), GyroBias(0.0054, 1e-4)
    true, turning = np.array([0.05, -0.02, 0.01]), np.array([0.05, -0.01, 0.01])
    bias.start(turning, 50)
    samples = true + 0.0054 * rng.normal(size=(600, 3))
    for k in range(50, 240):
        bias.refine(samples[k - 50 : k].mean(axis=0), samples[k], 50)
    assert bias.value[1] == turning[1]  # not before two seconds
    bias.interrupt()
    for k in range(50, 600):
        bias.refine(samples[k - 50 : k].mean(axis=0), samples[k], 50)
        assert bool(bias.value[1] == turning[1]) is (k < 249)
    assert np.abs(bias.value - true).max() < 4 * 0.0054 / np.sqrt(300)


def test_gravity_is_the_accelerometer_unless_the_ground_is_known():
    mean, up = np.array([0.2, 0.0, 9.81]), np.array([0.0, 0.0, 1.0])
    level = EstimatorParams(start_slope_sd=0.0)
    np.testing.assert_allclose(gravity_at_rest(mean, up, EstimatorParams())[0], mean, atol=1e-12)
    np.testing.assert_allclose(gravity_at_rest(mean, None, level)[0], mean, atol=1e-12)
    np.testing.assert_allclose(gravity_at_rest(mean, up, level)[0], GRAVITY, atol=1e-12)
    even = EstimatorParams(start_slope_sd=0.157 / 9.81, acc_bias_sd=0.157)
    g, hidden = gravity_at_rest(mean, up, even)
    np.testing.assert_allclose(g, 0.5 * (mean + GRAVITY), atol=1e-12)
    assert hidden == pytest.approx(0.157**2 / 2.0)


def test_a_slope_that_the_accelerometer_feels_is_believed():
    slope = np.array([np.sin(0.2), 0.0, np.cos(0.2)])
    g, hidden = gravity_at_rest(9.81 * slope, np.array([0.0, 0.0, 1.0]), EstimatorParams(start_slope_sd=0.003))
    np.testing.assert_allclose(g, 9.81 * slope, atol=1e-12)
    assert hidden == pytest.approx(0.157**2)


def test_plane_of_the_feet():
    feet = np.array([[0.1, 0.1, -0.1], [0.1, -0.1, -0.1], [-0.1, 0.1, -0.08], [-0.1, -0.1, -0.08]])
    used = np.ones(4, dtype=bool)
    expected = np.array([0.1, 0.0, 1.0]) / np.hypot(0.1, 1.0)
    np.testing.assert_allclose(plane_normal(feet, used, GRAVITY), expected, atol=1e-12)
    assert plane_normal(feet, np.array([True, True, False, False]), GRAVITY) is None
    assert plane_normal(np.outer([1.0, 2.0, 3.0], [0.1, 0.0, 0.0]), np.ones(3, dtype=bool), GRAVITY) is None
