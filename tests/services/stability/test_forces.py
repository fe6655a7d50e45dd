"""Forces from torques, CoM from forces."""

import numpy as np
import pytest

from services.stability.directions import equally_spaced
from services.stability.forces import com_from_forces, forces_from_torques
from services.stability.region import region
from surefoot.kinematics import foot_jacobians, gravity_torques
from surefoot.robot import load_robot
from tests.services.stability.sets import feasible_sets

RAGNO = load_robot("ragno")
UP = np.array([0.0, 0.0, 9.81])


def eye(n: int, variance: float = 1.0) -> np.ndarray:
    return np.tile(variance * np.eye(3), (n, 1, 1))


def test_forces_of_an_optimum_give_its_com() -> None:
    """4.7: "the resulting position of the CM of the robot was exactly the same" as the SOCP's."""
    for contacts in feasible_sets(30, 10):
        support = region(contacts, equally_spaced(16)).support
        for k in range(16):
            found = com_from_forces(contacts.position, 21.1 * support.force[k], eye(len(contacts)))
            assert found is not None
            np.testing.assert_allclose(found.com, support.point[k], atol=1e-8)
            assert found.weight == pytest.approx(21.1, abs=1e-6)
            assert found.misfit < 1e-12


def test_a_common_gain_error_cancels_where_31_does_not() -> None:
    contacts = feasible_sets(31, 1)[0]
    support = region(contacts, equally_spaced(16)).support
    for gain in (0.7, 1.3):
        found = com_from_forces(contacts.position, gain * support.force[0], eye(len(contacts)))
        assert found is not None
        np.testing.assert_allclose(found.com, support.point[0], atol=1e-8)
        moment = np.cross(contacts.position, gain * support.force[0]).sum(axis=0)
        by_31 = np.array([-moment[1], moment[0]])
        np.testing.assert_allclose(by_31, gain * support.point[0], atol=1e-8)


def test_covariance_against_random_draws() -> None:
    rng = np.random.default_rng(0)
    contacts = feasible_sets(32, 1)[0]
    n = len(contacts)
    force = 20.0 * region(contacts, equally_spaced(16)).support.force[3]
    root = rng.normal(size=(n, 3, 3)) * 0.2
    covariance = root @ root.transpose(0, 2, 1)
    drawn = []
    for _ in range(4000):
        noisy = force + np.einsum("iab,ib->ia", root, rng.normal(size=(n, 3)))
        found = com_from_forces(contacts.position, noisy, covariance)
        assert found is not None
        drawn.append((*found.com, found.misfit))
    exact = com_from_forces(contacts.position, force, covariance)
    assert exact is not None
    sample = np.cov(np.array(drawn)[:, :2].T)
    np.testing.assert_allclose(sample, exact.covariance, atol=0.06 * np.trace(exact.covariance))
    assert np.mean(np.array(drawn)[:, 2]) == pytest.approx(3.0, abs=0.2)  # chi-square with 3 degrees of freedom


def test_torques_back_to_forces_with_the_weight_of_the_legs() -> None:
    rng = np.random.default_rng(1)
    q = RAGNO.neutral + 0.1 * rng.normal(size=18)
    force = rng.normal(size=(6, 3)) + [0.0, 0.0, 3.5] * np.ones((6, 1))
    jacobian, torque = foot_jacobians(RAGNO.model, q), gravity_torques(RAGNO.model, q, UP)
    for i, leg in enumerate(RAGNO.legs):
        torque[list(leg.joints)] -= jacobian[i].T @ force[i]
    found = forces_from_torques(RAGNO, q, torque, UP, 1e-4)
    assert found.observed.all()
    np.testing.assert_allclose(found.force, force, atol=1e-12)
    inverse = np.linalg.inv(jacobian[2].T)
    np.testing.assert_allclose(found.covariance[2], 1e-4 * inverse @ inverse.T, rtol=1e-9)


def test_leg_weight_is_a_fifth_of_the_load() -> None:
    """A neutral middle leg reads 2.79 N instead of 3.52 N when its own weight is left out (design note 2.7)."""
    torque = gravity_torques(RAGNO.model, RAGNO.neutral, UP)
    jacobian = foot_jacobians(RAGNO.model, RAGNO.neutral)
    load = np.array([0.0, 0.0, RAGNO.mass * 9.81 / 6.0])
    for i, leg in enumerate(RAGNO.legs):
        torque[list(leg.joints)] -= jacobian[i].T @ load
    found = forces_from_torques(RAGNO, RAGNO.neutral, torque, UP, 1e-4)
    np.testing.assert_allclose(found.force, np.tile(load, (6, 1)), atol=1e-12)
    bare = -np.linalg.solve(jacobian[1].T, torque[list(RAGNO.legs[1].joints)])
    assert bare[2] / load[2] - 1.0 == pytest.approx(-0.208, abs=0.01)


def test_a_straight_leg_is_not_observed() -> None:
    q = RAGNO.neutral.copy()
    q[list(RAGNO.legs[3].joints)] = [0.0, 0.3, 0.0]
    found = forces_from_torques(RAGNO, q, np.zeros(18), UP, 1e-4)
    assert not found.observed[3]
    assert found.observed.sum() == 5


def test_feet_that_carry_nothing() -> None:
    assert com_from_forces(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3, 3))) is None
    assert com_from_forces(np.zeros((3, 3)), np.zeros((3, 3)), eye(3)) is None
    assert com_from_forces(np.eye(3), np.tile([0.0, 0.0, -1.0], (3, 1)), eye(3)) is None


def test_one_foot() -> None:
    found = com_from_forces(np.array([[1.0, 2.0, 3.0]]), np.array([[0.1, 0.2, 5.0]]), eye(1))
    assert found is not None
    np.testing.assert_allclose(found.com, [1.0, 2.0], atol=1e-12)
