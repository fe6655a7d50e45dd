"""The report of `best` against finite differences of the state."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from surefoot.services.estimator.feet.contact import BestGeometry, point_feet
from surefoot.services.estimator.filter.layout import E, M, X
from surefoot.services.estimator.filter.noise import FIXED
from surefoot.services.estimator.filter.point import retract
from surefoot.services.estimator.filter.pose import grow_pose
from surefoot.services.estimator.filter.setting import best_noise
from surefoot.services.estimator.filter.state import new_state, rotation
from surefoot.services.estimator.filter.summary import R, joint_covariance, summary
from surefoot.services.estimator.params import EstimatorParams

GYRO = np.array([0.1, -0.2, 0.3])


def random_state(seed):
    rng, state = np.random.default_rng(seed), new_state(2)
    state.x[:9] = Rotation.from_rotvec(rng.normal(size=3)).as_matrix().ravel()
    state.x[X.vel :] = rng.normal(size=12 + 6) * 0.3
    root = rng.normal(size=state.cov.shape) * 0.01
    state.cov[...] = root @ root.T
    base = np.ascontiguousarray(Rotation.from_rotvec(rng.normal(size=3)).as_matrix())
    return state, BestGeometry(*point_feet(np.zeros(2)), base, rng.normal(size=3) * 0.2)


def vectors_less(state, geometry, xi):
    """Vectors of the report of a state whose error xi has been taken out."""
    other = new_state(2)
    other.x[...] = state.x
    retract(other, xi)
    return summary(other, geometry, GYRO, 2)[0]


def errors_by(state, geometry, rows):
    """Derivative of rows of the report by the error of the state."""
    n, step = state.cov.shape[0], 1e-6
    columns = []
    for j in range(n):
        a, b = (vectors_less(state, geometry, sign * step * np.eye(n)[j]) for sign in (-1.0, 1.0))
        columns.append(((a - b) / (2.0 * step))[rows].ravel())
    return np.array(columns).T


@pytest.mark.parametrize("seed", range(3))
def test_covariance_of_gravity_and_velocity_is_that_of_the_error(seed):
    state, geometry = random_state(seed)
    by = errors_by(state, geometry, [R.g, R.v])
    _, _, covariance, _ = summary(state, geometry, GYRO, 2)
    up = rotation(state.x)[2]
    covariance[:3, :3] -= FIXED.length_sd**2 * np.outer(up, up)  # the length of g, which the state takes as known
    np.testing.assert_allclose(covariance, by @ state.cov @ by.T, atol=1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_joint_covariance_has_the_biases(seed):
    state, geometry = random_state(seed)
    by = errors_by(state, geometry, [R.g, R.v, R.gyro_bias, R.acc_bias])
    found = joint_covariance(rotation(state.x), state.cov)
    up = rotation(state.x)[2]
    found[:3, :3] -= FIXED.length_sd**2 * np.outer(up, up)
    np.testing.assert_allclose(found, by @ state.cov @ by.T, atol=1e-8)
    assert E.acc_bias + 3 == 12


@pytest.mark.parametrize("seed", range(3))
def test_covariance_of_the_pose_is_that_of_base_link(seed):
    state, geometry = random_state(seed)
    place = errors_by(state, geometry, [R.position])
    turn = np.zeros((3, len(state.cov)))
    turn[:, E.rot : E.rot + 3] = np.eye(3)
    by = np.vstack([place, turn])
    _, _, _, pose = summary(state, geometry, GYRO, 2)
    np.testing.assert_allclose(pose, by @ state.cov @ by.T, atol=1e-8)


def test_what_the_noises_leave_out_grows_with_time_and_way():
    state, noise = new_state(1), best_noise(EstimatorParams())
    state.cov[...] = 0.0
    geometry = BestGeometry(*point_feet(np.zeros(1)), np.eye(3), np.zeros(3))
    state.x[X.vel] = 0.5
    grow_pose(state, 1.0, noise)
    assert not summary(state, geometry, GYRO, 1)[3].any()  # a sensor as good as stated
    state.memory[M.excess] = 3.0
    for _ in range(4000):
        grow_pose(state, 0.01, noise)
    pose = summary(state, geometry, GYRO, 1)[3]
    turned, way = 8.0 * noise.gyro**2, 0.5  # (f^2 - 1) gyro^2, m/s
    assert pose[5, 5] == pytest.approx(40.0 * turned)
    assert pose[0, 0] == pytest.approx(40.0 * 8.0 * FIXED.pose_walk**2)
    assert pose[1, 1] == pytest.approx(pose[0, 0] + turned * way**2 * 40.0**3 / 3.0, rel=1e-2)
    assert pose[1, 5] == pytest.approx(turned * way * 40.0**2 / 2.0, rel=1e-2)
    assert (np.linalg.eigvalsh(pose[np.ix_((0, 1, 5), (0, 1, 5))]) > 0.0).all()
