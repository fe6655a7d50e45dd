"""Gravity that is not vertical."""

import numpy as np
import pytest

from surefoot.geometry.polygon import area
from surefoot.services.stability.programs.contacts import ContactSet, StabilityError, contact_set
from surefoot.services.stability.regions.equilibrium import equilibrium
from surefoot.services.stability.regions.margin import margin
from surefoot.services.stability.regions.model import Region
from surefoot.services.stability.regions.modes import Refinement, Tilted, in_common, lean, regions_in
from surefoot.services.stability.regions.region import region
from tests.services.stability.sets import feasible_sets

SQUARE = np.array([[0.1, 0.1, 0.0], [-0.1, 0.1, 0.0], [-0.1, -0.1, 0.0], [0.1, -0.1, 0.0]])
UP = [[0.0, 0.0, 1.0]] * 4
STILL = np.zeros(3)
WEIGHT = np.array([0.0, 0.0, 9.81])
"""-g; with an acceleration a of the CoM -g_eff = WEIGHT + a."""


def common(mode: Tilted, contacts: ContactSet) -> Region:
    return in_common(regions_in(mode, contacts, Refinement()))


def test_an_acceleration_shifts_the_square_by_its_share_of_the_height() -> None:
    """c must lie over the square along g_eff: the shift is h a/g towards the acceleration."""
    contacts, acceleration = contact_set(SQUARE, UP, 0.8), np.array([2.0, 0.0, 0.0])
    leaning = lean(contacts, WEIGHT + acceleration)
    found = region(leaning.contacts)
    for height in (0.0, 0.3):
        corners = leaning.at_height(found.inner, height)
        shift = height * 2.0 / 9.81
        assert corners[:, 0].max() == pytest.approx(0.1 + shift, abs=1e-9)
        assert corners[:, 0].min() == pytest.approx(-0.1 + shift, abs=1e-9)
        assert corners[:, 1].max() == pytest.approx(0.1, abs=1e-9)
    assert leaning.strength == pytest.approx(np.hypot(9.81, 2.0))


def test_more_acceleration_than_friction_is_infeasible() -> None:
    contacts = contact_set(SQUARE, UP, 0.2)
    assert region(lean(contacts, WEIGHT + np.array([1.9, 0.0, 0.0])).contacts).status == "ok"
    assert region(lean(contacts, WEIGHT + np.array([2.0, 0.0, 0.0])).contacts).status == "infeasible"


def test_points_of_the_leaning_region_are_held_by_forces() -> None:
    """Inside and outside of the region at a height, against the balance of forces with the acceleration."""
    rng = np.random.default_rng(0)
    for contacts in feasible_sets(40, 6):
        leaning = lean(contacts, WEIGHT + rng.uniform(-0.3, 0.3, 3))
        found = region(leaning.contacts)
        if found.status != "ok":
            continue
        for _ in range(5):
            com = np.append(rng.uniform(-0.3, 0.3, 2), rng.uniform(0.1, 0.3))
            inside = margin(found, leaning.seen(com)).value
            assert inside is not None
            if abs(inside) > 1e-5:
                assert equilibrium(leaning.contacts, leaning.seen(com)).held == (inside > 0.0)


def test_upright_gravity_changes_nothing() -> None:
    contacts = feasible_sets(41, 1)[0]
    leaning = lean(contacts, np.array([0.0, 0.0, 9.81]))
    np.testing.assert_allclose(leaning.rot, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(leaning.contacts.position, contacts.position, atol=1e-15)


def test_tilt_robust_region_lies_in_each_and_shrinks() -> None:
    contacts = contact_set(SQUARE, UP, 0.8)
    sizes = [area(common(Tilted(angle, STILL, 0.2), contacts).inner) for angle in (0.0, 0.05, 0.1)]
    assert sizes[0] == pytest.approx(0.04, rel=1e-9)
    assert sizes[0] > sizes[1] > sizes[2]
    reach = 0.1 - 0.2 * np.tan(0.1)
    polygon = common(Tilted(0.1, STILL, 0.2), contacts).inner
    assert np.abs(polygon).max() == pytest.approx(reach, abs=1e-9)
    assert len(common(Tilted(0.1, STILL, 0.2), contact_set(SQUARE, UP, 0.05)).inner) == 0


@pytest.mark.parametrize(
    ("feet", "height", "status"),
    [
        (SQUARE[:1], 0.0, "point"),
        (SQUARE[:1], 0.1, "infeasible"),
        (SQUARE[:2], 0.0, "segment"),
        (SQUARE[:2], 0.1, "infeasible"),
        (SQUARE, 0.1, "ok"),
        ((), 0.0, "infeasible"),
    ],
)
def test_what_all_gravities_have_in_common(feet: tuple, height: float, status: str) -> None:
    """One foot or two hold a CoM at their own height whatever way gravity leans, above it each way another one."""
    found = common(Tilted(0.05, STILL, height), contact_set(feet, UP[: len(feet)], 0.5))
    assert found.status == status
    if status in ("point", "segment"):
        np.testing.assert_allclose(np.sort(found.inner, axis=0), np.sort(np.array(feet)[:, :2], axis=0), atol=1e-7)


WALLS = [[0.2, 0.0, 0.0], [-0.2, 0.0, 0.0]]
STEP = [[0.2, 0.0, 0.1], [-0.2, 0.0, -0.1]]
FACING = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]


@pytest.mark.parametrize(
    ("feet", "normals", "height", "status"),
    [
        (WALLS, FACING, 0.0, "unbounded"),  # the line through both, whatever way gravity leans
        (WALLS, FACING, 0.1, "infeasible"),  # each way another line
        (STEP, FACING, 0.0, "point"),  # lines that cross where the line of the contacts has this height
        ([*WALLS, [0.0, 0.2, 0.0]], [*FACING, UP[0]], 0.1, "unbounded"),  # half-planes
    ],
)
def test_what_regions_without_bounds_have_in_common(feet: list, normals: list, height: float, status: str) -> None:
    contacts = contact_set(feet, normals, 0.9)
    assert all(each.status == "unbounded" for each in regions_in(Tilted(0.05, STILL, height), contacts, Refinement()))
    found = common(Tilted(0.05, STILL, height), contacts)
    assert found.status == status
    assert len(found.inner) == (status == "point")
    if status == "point":
        np.testing.assert_allclose(found.inner, [[0.0, 0.0]], atol=1e-6)


@pytest.mark.parametrize("up", [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (np.nan, 0.0, 1.0)])
def test_directions_that_are_none(up: tuple[float, float, float]) -> None:
    with pytest.raises(StabilityError):
        lean(contact_set(SQUARE, UP, 0.5), np.array(up))
