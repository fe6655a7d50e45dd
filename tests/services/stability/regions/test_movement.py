"""The planned-movement check."""

import numpy as np
import pytest

from surefoot.services.stability.programs.contacts import contact_set
from surefoot.services.stability.regions.movement import check
from surefoot.services.stability.regions.region import region
from tests.services.stability.sets import SQUARE, UP

SQUARE_REGION = region(contact_set(SQUARE, [UP] * 4, 0.5))
ORIGIN, STILL = np.zeros(2), np.zeros(3)


def test_numbers_of_a_square() -> None:
    found = check(SQUARE_REGION, np.array([0.02, 0.0]), np.array([0.05, 0.0, 0.3]), np.array([-0.01, 0.0, 9.0]))
    np.testing.assert_allclose(found.com_after, [0.06, 0.0], atol=1e-12)
    assert found.margin_now.value == pytest.approx(0.08)
    assert found.margin.value == pytest.approx(0.04)
    assert found.extent is not None
    assert found.gsm is not None
    assert found.extent.value == pytest.approx(0.08)
    assert found.gsm.value == pytest.approx(0.04)
    assert found.stable


def test_a_norm_would_hide_the_fall() -> None:
    """(28) as printed gives +2 cm here; the CoM ends 2 cm outside."""
    found = check(SQUARE_REGION, ORIGIN, np.array([0.12, 0.0, 0.0]), STILL)
    assert found.gsm is not None
    assert found.gsm.value == pytest.approx(-0.02)
    assert found.margin.value == pytest.approx(-0.02)
    assert not found.stable


def test_a_ray_that_enters_ahead_is_not_stable() -> None:
    found = check(SQUARE_REGION, np.array([-0.3, 0.0]), np.array([0.1, 0.0, 0.0]), STILL)
    assert found.gsm is not None
    assert found.gsm.value == pytest.approx(0.3)
    assert found.margin.value == pytest.approx(-0.1)
    assert not found.stable


def test_without_horizontal_movement_there_is_no_gsm() -> None:
    found = check(SQUARE_REGION, ORIGIN, np.array([0.0, 0.0, 0.05]), STILL)
    assert found.gsm is None
    assert found.extent is None
    assert found.margin.value == pytest.approx(0.1)
    assert found.stable


@pytest.mark.parametrize("n", [0, 1, 2])
def test_few_contacts_are_never_stable(n: int) -> None:
    found = check(region(contact_set(SQUARE[:n], [UP] * n, 0.5)), ORIGIN, np.array([0.1, 0.0, 0.0]), STILL)
    assert not found.stable
    assert (found.margin.value is None) == (n == 0)
