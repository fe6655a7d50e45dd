"""Forces from torques, CoM from forces."""

import numpy as np
import pytest

from surefoot.robot.kinematics import foot_jacobians, foot_positions, forward, gravity_torques
from surefoot.robot.reader import load_robot
from surefoot.services.stability.programs.contacts import equally_spaced
from surefoot.services.stability.regions.region import region
from surefoot.services.stability.sensing.forces import (
    FootForces,
    com_from_forces,
    forces_from_torques,
    fuse_normal,
    gain_from_weight,
)
from surefoot.services.stability.sensing.posture import contact_jacobians
from tests.services.stability.sets import feasible_sets

RAGNO = load_robot("ragno")
UP = np.array([0.0, 0.0, 9.81])
RADIUS = np.array([leg.foot.radius for leg in RAGNO.legs])
ALL = np.ones(6, dtype=bool)


def standing(force: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Joint torques with which the feet press with `force` (6, 3) on the ground, N."""
    jacobian, torque = contact_jacobians(RAGNO.model, q, UP / 9.81, RADIUS), gravity_torques(RAGNO.model, q, UP)
    for i, leg in enumerate(RAGNO.legs):
        torque[list(leg.joints)] -= jacobian[i].T @ force[i]
    return torque


def held(q: np.ndarray, com: np.ndarray) -> np.ndarray:
    """Forces of least squares with which six feet hold the weight at a CoM (2,), with some tension between them."""
    feet = foot_positions(RAGNO.model, q) - RADIUS[:, None] * [0.0, 0.0, 1.0]
    balance = np.hstack([np.vstack((np.eye(3), np.cross(p, np.eye(3)).T)) for p in feet])
    weight = RAGNO.mass * 9.81
    wanted = np.array([0.0, 0.0, weight, weight * com[1], -weight * com[0], 0.0])
    force = np.linalg.lstsq(balance, wanted, rcond=None)[0]
    null = np.linalg.svd(balance)[2][6:]
    return (force + 0.8 * null.T @ np.random.default_rng(5).normal(size=12)).reshape(6, 3)


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
    jacobian, torque = contact_jacobians(RAGNO.model, q, UP / 9.81, RADIUS), gravity_torques(RAGNO.model, q, UP)
    for i, leg in enumerate(RAGNO.legs):
        torque[list(leg.joints)] -= jacobian[i].T @ force[i]
    found = forces_from_torques(RAGNO, q, torque, UP, 1e-4)
    assert found.observed.all()
    np.testing.assert_allclose(found.force, force, atol=1e-12)
    inverse = np.linalg.inv(jacobian[2].T)
    np.testing.assert_allclose(found.covariance[2], 1e-4 * inverse @ inverse.T, rtol=1e-9)


def test_leg_weight_is_a_fifth_of_the_load() -> None:
    """A neutral middle leg reads 2.79 N instead of 3.52 N when its own weight is left out."""
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


def test_jacobian_of_the_contact_point_against_differences() -> None:
    q = RAGNO.neutral + 0.1 * np.random.default_rng(3).normal(size=18)
    rot0 = forward(RAGNO.model, q)[0]
    points = [rot0[k].T @ (-RADIUS[i] * UP / 9.81) for i, k in enumerate(RAGNO.model.foot_link)]  # fixed to the foot

    def touched(angles: np.ndarray) -> np.ndarray:
        rot, feet = forward(RAGNO.model, angles)[0], foot_positions(RAGNO.model, angles)
        return np.array([feet[i] + rot[k] @ points[i] for i, k in enumerate(RAGNO.model.foot_link)])

    jacobian = contact_jacobians(RAGNO.model, q, UP / 9.81, RADIUS)
    for i, leg in enumerate(RAGNO.legs):
        for c, j in enumerate(leg.joints):
            step = np.zeros(18)
            step[j] = 1e-6
            slope = (touched(q + step)[i] - touched(q - step)[i]) / 2e-6
            np.testing.assert_allclose(jacobian[i, :, c], slope, atol=1e-8)


@pytest.mark.parametrize("gain", [0.7, 1.0, 1.3])
def test_com_is_free_of_the_gain_of_the_torques(gain: float) -> None:
    """Known weight, unknown gain: CoM to 1e-9 m where the stated torques alone miss by millimetres."""
    q = RAGNO.neutral + 0.1 * np.random.default_rng(4).normal(size=18)
    com = np.array([0.02, -0.015])
    told = standing(held(q, com), q) / gain
    found = gain_from_weight(RAGNO, q, told, UP, ALL)
    assert found == pytest.approx(gain, abs=1e-9)
    feet = foot_positions(RAGNO.model, q) - RADIUS[:, None] * [0.0, 0.0, 1.0]
    errors = []
    for factor in (1.0, found):
        forces = forces_from_torques(RAGNO, q, factor * told, UP, 1e-4)
        seen = com_from_forces(feet, forces.force, forces.covariance)
        assert seen is not None
        errors.append(np.linalg.norm(seen.com - com))
    assert errors[1] < 1e-9
    assert gain == 1.0 or errors[0] > 1e-3


def test_gain_needs_load_and_observed_legs() -> None:
    assert gain_from_weight(RAGNO, RAGNO.neutral, np.zeros(18), UP, ALL) is None
    assert gain_from_weight(RAGNO, RAGNO.neutral, np.ones(18), UP, ~ALL) is None
    q = RAGNO.neutral.copy()
    q[list(RAGNO.legs[3].joints)] = [0.0, 0.3, 0.0]
    assert gain_from_weight(RAGNO, q, np.ones(18), UP, ALL) is None


def test_fusion_is_the_weighted_mean_along_the_normal() -> None:
    normal = np.tile([0.0, 0.0, 1.0], (2, 1))
    force, covariance = np.array([[1.0, 2.0, 4.0], [0.0, 0.0, 0.0]]), np.tile(np.diag([1.0, 1.0, 3.0]), (2, 1, 1))
    given = FootForces(force, covariance, np.array([True, False]))
    found = fuse_normal(given, normal, np.array([5.0, 6.0]), np.array([1.0, 0.25]))
    np.testing.assert_allclose(found.force[0], [1.0, 2.0, (4.0 / 3.0 + 5.0) / (1.0 / 3.0 + 1.0)])
    np.testing.assert_allclose(np.diag(found.covariance[0]), [1.0, 1.0, 0.75])
    np.testing.assert_allclose(found.force[1], [0.0, 0.0, 6.0], atol=1e-12)  # torques show nothing: the sensor alone
    assert found.observed.all()
    assert found.covariance[1, 0, 0] > 1.0
    silent = fuse_normal(given, normal, np.array([np.nan, np.nan]), np.ones(2))
    np.testing.assert_array_equal(silent.force, force)
    np.testing.assert_array_equal(silent.observed, given.observed)


def test_fusion_is_never_less_certain() -> None:
    rng = np.random.default_rng(6)
    for _ in range(20):
        root = rng.normal(size=(1, 3, 3))
        normal = rng.normal(size=(1, 3))
        normal /= np.linalg.norm(normal)
        given = FootForces(rng.normal(size=(1, 3)), root @ root.transpose(0, 2, 1), np.array([True]))
        found = fuse_normal(given, normal, rng.normal(size=1), rng.uniform(0.01, 1.0, 1))
        assert np.linalg.eigvalsh(given.covariance[0] - found.covariance[0]).min() > -1e-9
        assert np.linalg.eigvalsh(found.covariance[0]).min() > -1e-9


def test_a_tilted_frame_is_allowed_for() -> None:
    """Forces seen in a frame that is 2 degrees off: with the tilt's uncertainty the CoM over the feet stays."""
    contacts = feasible_sets(33, 1)[0]
    flat = contacts.position * [1.0, 1.0, 0.0]
    support = region(contacts, equally_spaced(16)).support
    lean = np.radians(2.0)
    rot = np.array([[np.cos(lean), 0.0, np.sin(lean)], [0.0, 1.0, 0.0], [-np.sin(lean), 0.0, np.cos(lean)]])
    root = 0.1 * np.random.default_rng(9).normal(size=(len(contacts), 3, 3))
    covariance = root @ root.transpose(0, 2, 1)
    force = 20.0 * np.abs(support.force[0]) * [0.0, 0.0, 1.0]
    exact = com_from_forces(flat, force, covariance)
    errors = []
    for tilt_sd in (0.0, lean):
        seen = com_from_forces(flat, force @ rot.T, covariance, tilt_sd=tilt_sd)
        assert exact is not None
        assert seen is not None
        errors.append(np.linalg.norm(seen.com - exact.com))
    assert errors[1] < 0.6 * errors[0]
