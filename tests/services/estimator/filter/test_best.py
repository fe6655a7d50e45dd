"""The kernels of `best` against equations written down a second time: finite differences, NumPy, closed forms."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_normal

from surefoot.services.estimator.feet.contact import SeenPoints, points_of, sole_feet
from surefoot.services.estimator.feet.mount import FootMount
from surefoot.services.estimator.filter.advance import stand_on_level
from surefoot.services.estimator.filter.layout import E, M, P, X
from surefoot.services.estimator.filter.noise import FIXED, BestNoise
from surefoot.services.estimator.filter.point import lift, observe, put_down, retract
from surefoot.services.estimator.filter.rest import learn_gyro_bias
from surefoot.services.estimator.filter.setting import best_limits, best_noise
from surefoot.services.estimator.filter.state import Felt, fit_in, forget_velocity, new_state, predict, rotation
from surefoot.services.estimator.filter.update import follow, take_points
from surefoot.services.estimator.params import EstimatorParams, StartPose
from surefoot.services.estimator.stream import Estimator
from tests.services.estimator.mounts import OPEN, balls, mounted

FEET = 2
STANDING = np.array([[0.0, 0.1, -0.3], [0.0, -0.1, -0.3]])
BOX = FootMount(None, np.eye(3), np.zeros(3), np.zeros(FEET))
NOISE = best_noise(EstimatorParams())
CALM = Felt(0.0, 0.0, 0.0)
SILENT = ("gyro", "acc", "gyro_bias", "acc_bias", "gyro_jerk", "turn_jerk", "stay", "turn_bias", "twist")
QUIET = BestNoise(**(NOISE._asdict() | dict.fromkeys(SILENT, 0.0)))
G = np.array([0.0, 0.0, 9.81])


def random_state(seed=0):
    rng, state = np.random.default_rng(seed), new_state(FEET)
    state.x[:9] = Rotation.from_rotvec(rng.normal(size=3)).as_matrix().ravel()
    state.x[X.vel :] = rng.normal(size=12 + 3 * FEET)
    state.x[X.gyro_bias : X.pos] *= 0.05
    root = rng.normal(size=state.cov.shape) * 0.01
    state.cov[...] = root @ root.T
    state.points[:, P.down] = 1.0
    return state, rng


def copied(state):
    """A state with the same values."""
    other = new_state(FEET)
    fit_in(state, other)
    return other


def sure(points, variance=1e-6):
    """A state of so many points with one variance of all errors."""
    state = new_state(points)
    state.cov[...] = variance * np.eye(len(state.cov))
    return state


def rest(state):
    """Three inertial samples at rest, 11 ms apart."""
    for _ in range(3):
        predict(state, np.zeros(3), G, 0.011, NOISE, CALM)


def disturbed(state, xi):
    """The state whose error is xi: the filter's is `state`, so the truth is `state` less xi."""
    other = copied(state)
    retract(other, xi)
    return other


def error(found, true):
    """Error of `found` against `true`, by its definition."""
    turn = Rotation.from_matrix(rotation(found.x) @ rotation(true.x).T)
    xi = np.zeros(len(found.cov))
    xi[:3] = turn.as_rotvec()
    rot = turn.as_matrix()
    xi[E.vel : E.vel + 3] = found.x[X.vel : X.vel + 3] - rot @ true.x[X.vel : X.vel + 3]
    xi[E.gyro_bias : E.pos + 3] = found.x[X.gyro_bias : X.pos + 3] - true.x[X.gyro_bias : X.pos + 3]
    for k in range(FEET):
        at = slice(X.points + 3 * k, X.points + 3 * k + 3)
        xi[E.points + 3 * k : E.points + 3 * k + 3] = found.x[at] - rot @ true.x[at]
    return xi


def test_retract_takes_the_error_out():
    state, rng = random_state()
    xi = 1e-4 * rng.normal(size=len(state.cov))
    np.testing.assert_allclose(error(state, disturbed(state, xi)), xi, rtol=1e-3, atol=1e-7)


def test_prediction_follows_its_equations():
    state, rng = random_state(1)
    x, w, q, d = state.x.copy(), rng.normal(size=3), G + rng.normal(size=3), 0.01
    rot = x[:9].reshape(3, 3)
    predict(state, w, q, d, NOISE, CALM)
    turn = (w - x[X.gyro_bias : X.gyro_bias + 3]) * d
    np.testing.assert_allclose(rotation(state.x), rot @ Rotation.from_rotvec(turn).as_matrix(), atol=1e-14)
    middle = rot @ Rotation.from_rotvec(0.5 * turn).as_matrix()
    v = x[X.vel : X.vel + 3] + d * (middle @ (q - x[X.acc_bias : X.acc_bias + 3]) - G)
    np.testing.assert_allclose(state.x[X.vel : X.vel + 3], v, atol=1e-13)
    moved = 0.5 * d * (v + x[X.vel : X.vel + 3])
    np.testing.assert_allclose(state.x[X.pos : X.pos + 3], x[X.pos : X.pos + 3] + moved, atol=1e-14)
    for k in range(FEET):
        at = slice(X.points + 3 * k, X.points + 3 * k + 3)
        np.testing.assert_allclose(state.x[at], x[at] - moved, atol=1e-14)


@pytest.mark.parametrize("seed", range(3))
def test_covariance_is_carried_by_the_jacobian_of_the_prediction(seed):
    """F by finite differences of the error itself; the filter's is exact to second order in the step."""
    state, rng = random_state(seed)
    w, q, d, h = rng.normal(size=3), G + rng.normal(size=3), 0.0005, 1e-5
    n = len(state.cov)
    jacobian = np.empty((n, n))
    after = copied(state)
    predict(after, w, q, d, QUIET, CALM)
    for i in range(n):
        column = []
        for sign in (1.0, -1.0):
            true = disturbed(state, sign * h * np.eye(n)[i])
            predict(true, w, q, d, QUIET, CALM)
            column.append(error(after, true))
        jacobian[:, i] = (column[0] - column[1]) / (2.0 * h)
    np.testing.assert_allclose(after.cov, jacobian @ state.cov @ jacobian.T, atol=1e-8)


def test_inertial_noise_enters_as_a_bias_does():
    """White noise of variance s^2 per sample adds d^2 s^2 B B^T with the Jacobian B of the bias, of opposite sign."""
    state, rng = random_state(2)
    state.cov[...] = 0.0
    w, q, d, h = rng.normal(size=3), G + rng.normal(size=3), 0.0005, 1e-5
    noise = QUIET._replace(gyro=0.3, acc=0.7)
    after = copied(state)
    predict(after, w, q, d, noise, CALM)
    expected = np.zeros_like(state.cov)
    for axis in range(3):
        for gyro, scale in ((True, 0.3), (False, 0.7)):
            true = copied(state)
            step = h * np.eye(3)[axis]
            predict(true, w - step * gyro, q - step * (not gyro), d, QUIET, CALM)
            column = error(after, true) / h * scale / math.sqrt(d)
            expected += np.outer(column, column)
    np.testing.assert_allclose(after.cov, expected, rtol=0.02, atol=1e-4 * abs(expected).max())


def test_a_point_that_stays_is_a_kalman_update():
    state, rng = random_state(3)
    before = copied(state)
    seen = rotation(state.x).T @ (state.x[X.points : X.points + 3] + 1e-3 * rng.normal(size=3))
    misfit, likely = observe(state, 0, seen, 1.0, 0.033, NOISE, False)
    h = np.zeros((3, len(state.cov)))
    h[:, E.points : E.points + 3] = -np.eye(3)
    z = rotation(before.x) @ seen - before.x[X.points : X.points + 3]
    s = h @ before.cov @ h.T + NOISE.point**2 * np.eye(3)
    gain = before.cov @ h.T @ np.linalg.inv(s)
    slide = (NOISE.slide * 0.033) ** 2 * np.diag([1.0, 1.0, FIXED.vertical_slide])
    assert misfit == pytest.approx(z @ np.linalg.solve(s + slide, z))
    assert likely == pytest.approx(multivariate_normal.logpdf(z, cov=s) + 1.5 * math.log(2.0 * math.pi))
    np.testing.assert_allclose(state.cov, before.cov - gain @ h @ before.cov, atol=1e-12)
    expected = disturbed(before, gain @ z)
    np.testing.assert_allclose(state.x, expected.x, atol=1e-12)


def test_the_mixture_of_both_hypotheses_by_its_definition():
    state, rng = random_state(4)
    state.cov[...] *= 1e-3
    before, dt = copied(state), 0.033
    seen = rotation(state.x).T @ (state.x[X.points : X.points + 3] + 1e-3 * rng.normal(size=3))
    observe(state, 0, seen, 0.9, dt, NOISE, True)
    h = np.zeros((3, len(state.cov)))
    h[:, E.points : E.points + 3] = -np.eye(3)
    z = rotation(before.x) @ seen - before.x[X.points : X.points + 3]
    moved = np.diag((NOISE.slide * dt) ** 2 * np.array([1.0, 1.0, 0.25]))
    likelihood, means, covariances = [], [], []
    for q in (np.zeros((3, 3)), moved):
        cov = before.cov + h.T @ q @ h
        s = h @ cov @ h.T + NOISE.point**2 * np.eye(3)
        gain = cov @ h.T @ np.linalg.inv(s)
        likelihood.append(math.exp(-0.5 * z @ np.linalg.solve(s, z)) / math.sqrt(np.linalg.det(s)))
        means.append(gain @ z)
        covariances.append(cov - gain @ h @ cov)
    prior = 1.0 - 0.9 * (1.0 - NOISE.begin_slide)
    weight = prior * likelihood[1] / (prior * likelihood[1] + (1.0 - prior) * likelihood[0])
    assert 0.01 < weight < 0.99
    assert state.points[0, P.slide] == pytest.approx(weight, rel=1e-6)
    mean = (1.0 - weight) * means[0] + weight * means[1]
    apart = means[0] - means[1]
    cov = (1.0 - weight) * covariances[0] + weight * covariances[1] + weight * (1.0 - weight) * np.outer(apart, apart)
    np.testing.assert_allclose(state.cov, cov, atol=1e-14)
    np.testing.assert_allclose(state.x, disturbed(before, mean).x, atol=1e-12)


def test_a_point_that_comes_down_is_known_by_the_kinematics_alone():
    state, _ = random_state(5)
    put_down(state, 1, np.array([0.1, -0.2, -0.3]), NOISE)
    np.testing.assert_allclose(state.x[X.points + 3 : X.points + 6], rotation(state.x) @ [0.1, -0.2, -0.3])
    at = slice(E.points + 3, E.points + 6)
    np.testing.assert_allclose(state.cov[at, at], NOISE.point**2 * np.eye(3))
    assert not state.cov[at, : E.points].any()
    lift(state, 1)
    assert state.points[1, P.down] == 0.0


def test_a_robot_at_rest_shows_the_gyro_bias():
    state, _ = random_state(6)
    limits = best_limits(EstimatorParams(), StartPose(), True)
    state.cov[E.gyro_bias : E.gyro_bias + 3] = state.cov[:, E.gyro_bias : E.gyro_bias + 3] = 0.0
    for i in range(3):
        state.cov[E.gyro_bias + i, E.gyro_bias + i] = 0.05**2
    bias = np.array([0.03, -0.02, 0.01])
    for _ in range(3000):
        learn_gyro_bias(state, bias, 1, NOISE, limits)
    np.testing.assert_allclose(state.x[X.gyro_bias : X.gyro_bias + 3], bias, atol=1e-4)
    assert np.linalg.eigvalsh(state.cov).min() > -1e-12


def test_rest_shows_the_bias_about_the_vertical_best():
    """Servos settle under the weight, which tilts the robot and does not turn it."""
    state, _ = random_state(11)
    limits = best_limits(EstimatorParams(), StartPose(), True)
    state.cov[...] = 0.05**2 * np.eye(len(state.cov))
    for _ in range(300):
        learn_gyro_bias(state, np.zeros(3), 1, NOISE, limits)
    at, rot = slice(E.gyro_bias, E.gyro_bias + 3), rotation(state.x)
    creep = np.array([limits.creep, limits.creep, limits.turn_creep])
    sample = NOISE.sample_gyro**2 + limits.samples * creep**2
    expected = rot.T @ np.diag(1.0 / (1.0 / 0.05**2 + 300 / sample)) @ rot
    np.testing.assert_allclose(state.cov[at, at], expected, rtol=1e-2, atol=1e-9)


def test_a_sample_of_the_first_rest_is_taken_once():
    """The gyro reads more in the first half of the first rest than in the second, and its mean afterwards."""
    params = EstimatorParams()
    estimator = Estimator(BOX, params, names=("best",))
    found = []
    for k in range(3 * params.standstill_samples):
        early, late = k < params.standstill_samples // 2, k >= params.standstill_samples
        w = np.array([0.0, 0.0, 0.02 if late else (0.024 if early else 0.016)])
        estimator.imu((k + 1) * params.imu_period_ns, w, G)
        if k % 3 == 0:
            estimator.feet((k + 1) * params.imu_period_ns, STANDING, np.stack([np.eye(3)] * FEET), np.ones(FEET))
        if k >= params.standstill_samples:
            found.append(estimator.best.gyro_bias[2])
    np.testing.assert_allclose(found, 0.02, atol=2e-5)


def test_what_waits_when_a_rest_ends_is_learned_from_but_for_its_last_fifth():
    """A gyro that reads more in the last half second of a rest, and wildly once the robot moves."""
    params = EstimatorParams()
    window, estimator, found = params.standstill_samples, Estimator(BOX, EstimatorParams(), names=("best",)), []
    for k in range(3 * window + 2):
        waits, moves = k >= 2 * window + 1, k >= 3 * window
        spoilt = k >= 3 * window - window // 5 and not moves
        w = np.array([0.0, 0.0, 1.0 if moves else 0.0 if spoilt else 0.024 if waits else 0.02])
        estimator.imu((k + 1) * params.imu_period_ns, w, G)
        if k % 3 == 0:
            estimator.feet((k + 1) * params.imu_period_ns, STANDING, np.stack([np.eye(3)] * FEET), np.ones(FEET))
        found.append(float(estimator.best.gyro_bias[2]))
    assert estimator.best.settled
    assert found[3 * window - window // 5 - 1] == pytest.approx(0.02, abs=1e-4)
    share = (found[3 * window] - 0.02) / 0.004  # of so many samples that were learned from
    assert 0.6 * 40 / 140 < share < 1.0


def test_misfits_of_all_points_make_the_velocity_unknown_and_not_the_feet():
    """Nothing starves: if every foot contradicts the inertial unit for long, the feet are right."""
    places = sole_feet(np.array([[0.0, 0.0, 1.0]]), 0.1)
    one = sure(3, 1e-8)
    one.x[X.vel] = 1.0
    position, rot = np.array([[0.0, 0.0, -0.3]]), np.eye(3)[None]
    limits = np.ones(3)
    for _ in range(10):
        y, turn = points_of(places.foot, places.place, position, rot)
        take_points(one, SeenPoints(y, turn, limits, OPEN[:1]), mounted(places), NOISE, True, 0, 1.0)
        rest(one)
    assert abs(one.x[X.vel]) < 0.02
    forget_velocity(one, 1.0)
    assert one.cov[E.vel, E.vel] == 1.0


def test_the_excess_follows_errors_that_repeat_and_not_noise():
    """An accelerometer that errs for long raises it; noise of the encoders does not."""
    found = {}
    for name, push, sigma in (("inertial", 3.0, 2e-4), ("encoders", 0.0, 1.5e-3)):
        rng = np.random.default_rng(8)
        places = sole_feet(np.array([[0.0, 0.0, 1.0]]), 0.1)
        state = sure(3)
        for k in range(300):
            y, turn = points_of(places.foot, places.place, np.array([[0.0, 0.0, -0.3]]), np.eye(3)[None])
            y += sigma * rng.normal(size=y.shape)
            take_points(state, SeenPoints(y, turn, np.ones(3), OPEN[:1]), mounted(places), NOISE, True, 0, 1.0)
            q = G + np.array([push * math.sin(0.3 * k), 0.0, 0.0])
            for _ in range(3):
                predict(state, np.zeros(3), q, 0.011, NOISE, CALM)
        found[name] = state.memory[M.excess]
    assert found["inertial"] > 3.0
    assert found["encoders"] < 1.2


def test_corrections_of_the_position_that_go_on_are_velocity():
    """A filter that is 20 mm/s too slow: the feet move its position on by 0.66 mm every 33 ms."""
    state, _ = random_state(10)
    state.cov[...] = 1e-8 * np.eye(len(state.cov))
    step, missed = 0.033, np.array([0.016, -0.012, 0.0])
    for _ in range(3000):
        before = state.x[X.pos : X.pos + 3].copy()
        state.x[X.pos : X.pos + 3] += step * missed
        follow(state, before, NOISE)
        rot, still = rotation(state.x), state.x[X.gyro_bias : X.gyro_bias + 3].copy()
        predict(state, still, rot.T @ G + state.x[X.acc_bias : X.acc_bias + 3], step, NOISE, CALM)
    np.testing.assert_allclose(rot @ state.memory[M.lag : M.lag + 3], missed, rtol=0.01, atol=1e-5)
    before = state.x[X.pos : X.pos + 3] - 1.0  # a mishap
    follow(state, before, NOISE)
    assert np.abs(rot @ state.memory[M.lag : M.lag + 3] - missed).max() < 5.0 * NOISE.point / NOISE.lag_s
    forget_velocity(state, 1.0)
    assert not state.memory[M.lag : M.lag + 3].any()


def test_level_ground_is_a_kalman_update_of_the_height_of_each_point():
    state, _ = random_state(9)
    state.cov[...] *= 1e-2
    before = copied(state)
    state.points[1, P.down] = before.points[1, P.down] = 0.0
    ground = float(before.x[X.pos + 2] + before.x[X.points + 2]) - 0.03
    stand_on_level(state, ground, np.array([0.01, 0.0]), 0.01)
    h, n = np.empty(len(before.cov)), len(before.cov)
    for i in range(n):  # by finite differences of the height of a disturbed state
        true = disturbed(before, 1e-6 * np.eye(n)[i])
        h[i] = (before.x[X.pos + 2] + before.x[X.points + 2] - true.x[X.pos + 2] - true.x[X.points + 2]) / 1e-6
    s = h @ before.cov @ h + 0.01**2
    gain = before.cov @ h / s
    np.testing.assert_allclose(state.cov, before.cov - np.outer(gain, h @ before.cov), atol=1e-9)
    np.testing.assert_allclose(state.x, disturbed(before, gain * 0.02).x, atol=1e-8)


def test_one_wrong_sample_where_a_foot_comes_down_is_no_wrong_velocity():
    """Of two samples that contradict each other either may be wrong: the foot is put down again, nothing else."""
    one = sure(1)
    true, off = np.array([[0.0, 0.0, -0.3]]), np.array([[0.02, 0.0, -0.3]])
    for y in (off, true, true, true):
        take_points(one, SeenPoints(y, np.eye(3)[None], np.ones(1), OPEN[:1]), balls(1), NOISE, True, 0, 1.0)
        rest(one)
    assert np.linalg.norm(one.x[X.vel : X.vel + 3]) < 1e-3
    assert one.cov[E.vel, E.vel] < 1e-3
    np.testing.assert_allclose(one.x[X.points : X.points + 3], true[0], atol=1e-3)


def test_a_foot_that_lifts_leaves_no_lost_velocity_behind():
    """The last sample of which a point fitted counts, even if that foot is in the air now."""
    one = sure(2)
    feet, off = STANDING.copy(), STANDING + np.array([[0.0, 0.0, 0.0], [0.02, 0.0, 0.0]])
    both, second = np.ones(2), np.array([0.0, 1.0])
    samples = [(feet, both), (feet, both), (off, both), (off, both), (off, second), (off, second)]
    for y, contact in samples:
        take_points(one, SeenPoints(y, np.tile(np.eye(3), (2, 1, 1)), contact, OPEN), balls(2), NOISE, True, 0, 1.0)
        rest(one)
    assert one.cov[E.vel, E.vel] < 1e-3
    assert one.x[X.points + 3] == pytest.approx(0.02, abs=2e-3)
