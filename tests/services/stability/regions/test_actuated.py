"""Regions under torque limits."""

import numpy as np
import pytest

from surefoot.geometry.polygon import area, hull
from surefoot.robot.kinematics import foot_jacobians, foot_positions, gravity_torques
from surefoot.robot.reader import load_robot
from surefoot.services.stability.programs.contacts import ContactSet, StabilityError, contact_set, equally_spaced
from surefoot.services.stability.regions.actuated import ServoLegs, actuated_region
from surefoot.services.stability.regions.region import region
from surefoot.services.stability.sensing.posture import contact_jacobians
from tests.services.stability.oracles import pyramid_support

RAGNO = load_robot("ragno")
UP = np.array([0.0, 0.0, 1.0])
RADIUS = np.array([leg.foot.radius for leg in RAGNO.legs])
SIXTEEN = equally_spaced(16)


def stance(chosen: list[int], limit: float, mu: float = 0.6, own: bool = True) -> tuple[ContactSet, ServoLegs]:
    """Ragno in its neutral stance on the chosen feet."""
    feet = foot_positions(RAGNO.model, RAGNO.neutral)[chosen] - [0.0, 0.0, 0.008]
    index = RAGNO.model.leg_joints[chosen]
    weight = gravity_torques(RAGNO.model, RAGNO.neutral, 9.81 * UP)[index]
    jacobian = contact_jacobians(RAGNO.model, RAGNO.neutral, UP, RADIUS)[chosen]
    legs = ServoLegs(jacobian, weight if own else 0.0 * weight, np.full(weight.shape, limit), RAGNO.mass * 9.81)
    return contact_set(feet, [UP] * len(chosen), mu), legs


ALL, TRIPOD = [0, 1, 2, 3, 4, 5], [0, 2, 4]


def test_generous_limits_change_nothing() -> None:
    for chosen in (ALL, TRIPOD):
        contacts, legs = stance(chosen, 1e3)
        found, free = actuated_region(contacts, legs, SIXTEEN), region(contacts, SIXTEEN)
        np.testing.assert_allclose(found.support.value, free.support.value, atol=1e-7)
        assert found.status == "ok"


@pytest.mark.parametrize(("chosen", "limit"), [(ALL, 0.9), (ALL, 0.5), (TRIPOD, 0.9), (TRIPOD, 0.6)])
def test_between_two_linear_programs(chosen: list[int], limit: float) -> None:
    contacts, legs = stance(chosen, limit)
    found = actuated_region(contacts, legs, SIXTEEN[::4])
    for a, value in zip(SIXTEEN[::4], found.support.value, strict=True):
        low, high = (pyramid_support(contacts, a, 64, outside, legs) for outside in (False, True))
        assert low - 1e-7 <= value <= high + 1e-7
        assert high - low < 2e-3
    free = region(contacts, SIXTEEN).inner
    assert area(actuated_region(contacts, legs).inner) < 0.97 * area(free)  # the limits bind


@pytest.mark.parametrize(
    ("chosen", "limit", "share"),
    [(ALL, 1.2, 0.969), (ALL, 0.9, 0.904), (ALL, 0.7, 0.844), (ALL, 0.5, 0.770), (ALL, 0.45, 0.714),
     (TRIPOD, 1.2, 0.957), (TRIPOD, 0.9, 0.805), (TRIPOD, 0.7, 0.643), (TRIPOD, 0.6, 0.544), (TRIPOD, 0.5, 0.421)],
)  # fmt: skip
def test_area_over_hull_of_the_design_note(chosen: list[int], limit: float, share: float) -> None:
    """Case 5 of a first study: flat, mu 0.6, no leg weight, 16 directions, Jacobians of the foot centres."""
    contacts, legs = stance(chosen, limit, own=False)
    legs = ServoLegs(foot_jacobians(RAGNO.model, RAGNO.neutral)[chosen], legs.own, legs.limit, legs.weight)
    whole = area(hull(np.ascontiguousarray(contacts.position[:, :2])))
    assert area(actuated_region(contacts, legs).inner) / whole == pytest.approx(share, abs=2.5e-3)


def test_monotone_in_the_limit_and_inside_the_cones() -> None:
    last = -np.inf * np.ones(16)
    for limit in (0.5, 0.7, 0.9, 1.5):
        contacts, legs = stance(TRIPOD, limit)
        found = actuated_region(contacts, legs, SIXTEEN)
        assert (found.support.value >= last - 1e-7).all()
        assert np.abs(found.support.torque).max() <= limit + 1e-6
        np.testing.assert_allclose(found.support.force.sum(axis=1), np.tile(UP, (16, 1)), atol=1e-7)
        slip = np.hypot(found.support.force[..., 0], found.support.force[..., 1]) - 0.6 * found.support.force[..., 2]
        assert slip.max() < 1e-6
        last = found.support.value


def test_points_are_held_by_their_forces() -> None:
    contacts, legs = stance(ALL, 0.7)
    found = actuated_region(contacts, legs, SIXTEEN)
    for k in range(16):
        moment = np.cross(contacts.position, found.support.force[k]).sum(axis=0)
        np.testing.assert_allclose([-moment[1], moment[0]], found.support.point[k], atol=1e-7)
        assert SIXTEEN[k] @ found.support.point[k] == pytest.approx(found.support.value[k], abs=1e-7)


def test_unlimited_friction_is_what_more_and_more_comes_to() -> None:
    """Also on walls, which carry a foot without its pressing: no friction, however large, does that."""
    contacts, legs = stance(TRIPOD, 0.9)
    for normals in ([UP] * 3, [[1.0, 0.0, 0.0]] * 3):
        found = actuated_region(contact_set(contacts.position, normals, np.inf), legs, SIXTEEN)
        assert found.status == "ok"
        assert np.abs(found.support.torque).max() <= 0.9 + 1e-6
        np.testing.assert_allclose(found.support.force.sum(axis=1), np.tile(UP, (16, 1)), atol=1e-7)
        assert np.einsum("kid,id->ki", found.support.force, normals).min() > -1e-7
    most, steep = (actuated_region(contact_set(contacts.position, [UP] * 3, mu), legs, SIXTEEN) for mu in (np.inf, 1e3))
    assert np.all(steep.support.value <= most.support.value + 1e-7)
    np.testing.assert_allclose(most.support.value, steep.support.value, atol=2e-4)
    walls = contact_set(contacts.position, [[1.0, 0.0, 0.0]] * 3, 1e3)
    assert actuated_region(walls, legs, SIXTEEN).status == "infeasible"


def test_servos_too_weak_to_stand() -> None:
    contacts, legs = stance(TRIPOD, 0.05)
    found = actuated_region(contacts, legs)
    assert found.status == "infeasible"
    assert len(found.inner) == 0


def test_sizes_must_agree() -> None:
    contacts, _ = stance(ALL, 1.0)
    _, legs = stance(TRIPOD, 1.0)
    with pytest.raises(StabilityError):
        actuated_region(contacts, legs)
    nobody = ServoLegs(np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros((0, 3)), 1.0)
    assert actuated_region(contact_set(np.zeros((0, 3)), np.zeros((0, 3)), 0.5), nobody).status == "infeasible"
