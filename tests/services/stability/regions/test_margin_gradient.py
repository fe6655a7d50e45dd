"""Gradient of the signed margin, against differences."""

import numpy as np
import pytest

from surefoot.services.stability.programs.contacts import ContactSet, contact_set
from surefoot.services.stability.regions.margin import margin
from surefoot.services.stability.regions.region import region
from surefoot.services.stability.regions.robust import MarginSlope, margin_gradient
from tests.services.stability.sets import SQUARE, UP, feasible_sets, tilted

STEP = 2e-6


def slope_of(contacts: ContactSet, com: np.ndarray) -> MarginSlope | None:
    found = region(contacts)
    return margin_gradient(found, com, margin(found, com))


def value(contacts: ContactSet, com: np.ndarray) -> float:
    found = margin(region(contacts), com).value
    assert found is not None
    return found


def moved(contacts: ContactSet, i: int, by: np.ndarray, mu: float = 0.0) -> ContactSet:
    position, friction = contacts.position.copy(), contacts.mu.copy()
    position[i] += by
    friction[i] += mu
    return ContactSet(position, contacts.normal, friction)


def test_com_feet_and_friction_on_uneven_ground() -> None:
    checked = 0
    for contacts in feasible_sets(60, 12):
        com = contacts.position[:, :2].mean(axis=0) + np.array([0.01, -0.02])
        found, here = slope_of(contacts, com), value(contacts, com)
        assert found is not None
        for d in range(2):
            by = STEP * np.eye(2)[d]
            slope = (value(contacts, com + by) - value(contacts, com - by)) / (2.0 * STEP)
            assert found.com[d] == pytest.approx(slope, abs=5e-3)
        for i in range(len(contacts)):
            sides = []
            for axis in np.vstack((np.eye(3), np.zeros(3))):
                mu = STEP if not axis.any() else 0.0
                up, down = (value(moved(contacts, i, s * STEP * axis, s * mu), com) for s in (1.0, -1.0))
                one, other = (up - here) / STEP, (here - down) / STEP
                sides.append(0.5 * (one + other) if abs(one - other) < 1e-2 else np.nan)
            mine = np.append(found.position[i], found.mu[i])
            smooth = np.isfinite(sides)
            checked += int(smooth.sum())
            np.testing.assert_allclose(mine[smooth], np.array(sides)[smooth], atol=2e-2)
    assert checked > 100


def test_feet_count_by_their_lever_on_a_straight_edge() -> None:
    contacts = contact_set(SQUARE, [UP] * 4, 0.5)
    com = np.array([0.08, 0.05])  # nearest to the edge x = 0.1, a quarter of the way from its upper foot
    found = slope_of(contacts, com)
    assert found is not None
    assert value(contacts, com) == pytest.approx(0.02)
    np.testing.assert_allclose(found.com, [-1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(found.position[:, 0], [0.75, 0.0, 0.0, 0.25], atol=1e-4)
    np.testing.assert_allclose(found.mu, 0.0, atol=1e-6)


def test_outside_the_gradient_points_back() -> None:
    contacts = contact_set(SQUARE, [UP] * 4, 0.5)
    com = np.array([0.13, 0.14])
    found = slope_of(contacts, com)
    assert found is not None
    assert value(contacts, com) == pytest.approx(-0.05)
    np.testing.assert_allclose(found.com, [-0.6, -0.8], atol=1e-9)
    np.testing.assert_allclose(found.position[0, :2], [0.6, 0.8], atol=1e-3)


def test_nothing_to_derive() -> None:
    assert slope_of(contact_set(SQUARE, [tilted(45.0)] * 4, 0.5), np.zeros(2)) is None
    assert slope_of(contact_set(SQUARE[:2], [UP] * 2, 0.5), np.zeros(2)) is None
