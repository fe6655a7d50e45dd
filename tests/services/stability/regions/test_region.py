"""Regions: statuses with proof, special sets, polygons."""

import math

import numpy as np
import pytest

from surefoot.geometry.polygon import area, hull, signed_distance
from surefoot.services.stability.programs.contacts import ContactSet, contact_set, equally_spaced
from surefoot.services.stability.regions.model import Region
from surefoot.services.stability.regions.region import region
from tests.services.stability.certificate import balance, force_violation, twist_violation
from tests.services.stability.oracles import share_excess
from tests.services.stability.sets import SQUARE, UP, feasible_sets, random_set, tilted

SIXTEEN = equally_spaced(16)
EAST, WEST, NORTH = (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
FREE = math.inf

SETS: dict[str, tuple[list, list, object, str, list | None]] = {
    "nothing": ([], [], [], "infeasible", None),
    "one": ([[0.1, 0.2, 0.3]], [UP], 0.5, "point", [[0.1, 0.2]]),
    "one, vertical on the rim of the cone": ([[0.1, 0.2, 0.3]], [tilted(45.0)], 1.0, "point", [[0.1, 0.2]]),
    "one, too steep": ([[0.1, 0.2, 0.3]], [tilted(46.0)], 1.0, "infeasible", None),
    "one wall": ([[0.1, 0.2, 0.3]], [EAST], 5.0, "infeasible", None),
    "one wall, unlimited friction": ([[0.1, 0.2, 0.3]], [EAST], FREE, "point", [[0.1, 0.2]]),
    "one ceiling": ([[0.1, 0.2, 0.3]], [(0, 0, -1)], 0.5, "infeasible", None),
    "one ceiling, unlimited friction": ([[0.1, 0.2, 0.3]], [(0.1, 0, -1)], FREE, "infeasible", None),
    "one slippery slope": ([[0.1, 0.2, 0.3]], [tilted(1.0)], 0.0, "infeasible", None),
    "two": ([[0.1, 0.2, 0.3], [0.3, 0.2, 0.1]], [UP] * 2, 0.5, "segment", [[0.1, 0.2], [0.3, 0.2]]),
    "two on one spot": ([[0.1, 0.2, 0.3]] * 2, [UP] * 2, 0.5, "point", [[0.1, 0.2]]),
    "wedge on one spot": ([[0.1, 0.2, 0.3]] * 2, [tilted(60.0), tilted(60.0, 180.0)], 0.1, "point", [[0.1, 0.2]]),
    "spot too steep": ([[0.1, 0.2, 0.3]] * 2, [tilted(60.0), tilted(60.0, 20.0)], 0.1, "infeasible", None),
    "slippery groove": ([[0.1, 0.2, 0], [0.3, 0.2, 0]], [tilted(-45), tilted(45)], 0.0, "point", [[0.2, 0.2]]),
    "three on a line": ([[0, 0, 0], [0.1, 0.1, 0], [0.3, 0.3, 0]], [UP] * 3, 0.5, "segment", [[0, 0], [0.3, 0.3]]),
    "three on one spot": ([[0.1, 0.2, 0.3]] * 3, [UP] * 3, 0.5, "point", [[0.1, 0.2]]),
    "square": (list(SQUARE), [UP] * 4, 0.5, "ok", [p[:2] for p in SQUARE]),
    "square with duplicates": ([*SQUARE, *SQUARE], [UP] * 8, 0.5, "ok", [p[:2] for p in SQUARE]),
    "slippery square": (list(SQUARE), [UP] * 4, 0.0, "ok", [p[:2] for p in SQUARE]),
    "square, unlimited friction": (list(SQUARE), [UP] * 4, FREE, "ok", [p[:2] for p in SQUARE]),
    "steep plane": ([[0, 0, 0], [1, 0, 1], [0, 1, 0]], [tilted(45.0)] * 3, 0.99, "infeasible", None),
    "facing walls": ([[-0.5, 0, 0], [0.5, 0, 0.1]], [EAST, WEST], 0.5, "unbounded", None),
    "facing walls, opposite": ([[-0.5, 0, 0], [0.5, 0, 0]], [EAST, WEST], 0.5, "unbounded", None),
    "facing walls, slippery": ([[-0.5, 0, 0], [0.5, 0, 0]], [EAST, WEST], 0.0, "infeasible", None),
    "three walls": ([[-1, 0, 0], [1, 0.3, 0], [0, -1, 0]], [EAST, WEST, NORTH], 0.6, "unbounded", None),
    "floor and ceiling": ([*SQUARE, (0, 0, 1)], [UP] * 4 + [(0, 0, -1)], 0.5, "unbounded", None),
    "uneven, unlimited": ([[0, 0, 0], [1, 0, 0], [0, 1, 0.2], [1, 1, 0.5]], [UP] * 4, FREE, "unbounded", None),
    "a wall, unlimited": ([[0, 0, 0], [0, 1, 0]], [EAST] * 2, FREE, "unbounded", None),
}


def make(name: str) -> tuple[ContactSet, str, list | None]:
    position, normal, mu, status, polygon = SETS[name]
    return contact_set(position, normal, mu), status, polygon


def verify(found: Region) -> None:
    """Every claim of a region, checked by the proofs that come with it."""
    contacts, support = found.contacts, found.support
    if found.status == "infeasible":
        assert found.sinking is not None
        assert found.sinking[2] == pytest.approx(-1.0)
        size = np.abs(found.sinking).max()
        assert twist_violation(contacts, found.sinking, np.zeros(2)) < 1e-8 * size
    if found.status == "unbounded":
        assert "unbounded" in support.status
    for k, status in enumerate(support.status):
        a = support.direction[k]
        if status == "ok":
            size = max(1.0, np.abs(support.force[k]).max())  # squeezing forces may be many times the weight
            assert twist_violation(contacts, support.twist[k], a) < 2e-9 * size
            assert force_violation(contacts, support.force[k]) < 2e-9 * size
            assert balance(contacts, support.force[k], support.point[k]) < 1e-8 * size
            assert abs(support.gap[k]) < 5e-9 * size
        if status == "unbounded":
            moment = np.cross(contacts.position, support.force[k]).sum(axis=0)
            com = np.array([-moment[1], moment[0]])  # shift of the CoM per unit of these forces
            size = np.abs(support.force[k]).max()
            assert force_violation(contacts, support.force[k]) < 1e-8 * size
            assert balance(contacts, support.force[k], com, weight=0.0) < 1e-7 * size
            assert a @ com > 0.1


@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("given", [None, SIXTEEN], ids=["adaptive", "sixteen"])
def test_named_sets(name: str, given: np.ndarray | None) -> None:
    contacts, status, polygon = make(name)
    found = region(contacts, given)
    assert found.status == status
    verify(found)
    if polygon is not None:
        expected = hull(np.array(polygon, dtype=float))
        got = hull(found.inner)
        assert len(got) == len(expected)
        np.testing.assert_allclose(got[np.lexsort(got.T)], expected[np.lexsort(expected.T)], atol=1e-8)


def test_one_status_for_all_directions_of_a_hopeless_set() -> None:
    """Facing walls could shift the CoM without end, but nothing here carries the weight."""
    walls = contact_set([[-0.5, 0, 0], [0.5, 0, 0], [0, 0, 1]], [EAST, WEST, (0, 0, -1)], [0.0, 0.0, 0.0])
    found = region(walls, SIXTEEN)
    assert found.status == "infeasible"
    assert set(found.support.status) == {"infeasible"}
    verify(found)


def test_random_sets_keep_their_promises() -> None:
    rng = np.random.default_rng(8)
    seen: dict[str, int] = {}
    for _ in range(150):
        contacts = random_set(rng, int(rng.integers(1, 13)), 85.0, (0.0, 1.5), 0.2)
        found = region(contacts, SIXTEEN)
        seen[found.status] = seen.get(found.status, 0) + 1
        verify(found)
    assert set(seen) == {"ok", "infeasible", "unbounded", "segment", "point"}


def test_friction_of_some_contacts_only() -> None:
    rng = np.random.default_rng(9)
    for _ in range(60):
        base = random_set(rng, int(rng.integers(2, 8)), 60.0, (0.2, 1.0))
        mu = np.where(rng.random(len(base)) < 0.4, rng.choice([0.0, np.inf], len(base)), base.mu)
        found = region(ContactSet(base.position, base.normal, mu), SIXTEEN)
        verify(found)


def test_unlimited_friction_is_the_limit_of_large_friction() -> None:
    position = np.array([[0.1, 0.1, 0.0], [-0.1, 0.1, 0.03], [-0.1, -0.1, 0.0], [0.1, -0.1, 0.01]])
    normal = np.array([tilted(10.0), UP, tilted(20.0, 90.0), UP])
    mu = np.array([math.inf, 0.5, 0.4, 0.3])
    limit = region(contact_set(position, normal, mu), SIXTEEN)
    assert limit.status == "ok"
    values = [region(contact_set(position, normal, np.where(mu > 1, m, mu)), SIXTEEN).support.value for m in (1e2, 1e3)]
    assert np.all(values[0] <= values[1] + 1e-8)
    assert np.all(values[1] <= limit.support.value + 1e-8)
    np.testing.assert_allclose(values[1], limit.support.value, atol=1e-3)


@pytest.mark.parametrize("slope", [0.0, 5.0, 20.0, 26.0])
def test_coplanar_contacts_give_exactly_the_hull(slope: float) -> None:
    """The solver, too, agrees with the short cut, which a lifted contact switches off."""
    rng = np.random.default_rng(int(slope))
    xy = rng.uniform(-0.2, 0.2, (6, 2))
    z = np.tan(np.radians(slope)) * xy[:, 0]
    contacts = contact_set(np.column_stack((xy, z)), [tilted(slope)] * 6, 0.5)
    found = region(contacts)
    assert found.status == "ok"
    assert found.exact
    np.testing.assert_array_equal(found.inner, hull(xy))
    verify(found)
    bent = contact_set(np.column_stack((xy, z + np.array([0, 0, 0, 0, 0, 1e-9]))), contacts.normal, 0.5)
    solved = region(bent, tolerance=1e-6)
    assert not solved.exact
    assert area(solved.inner) == pytest.approx(area(found.inner), rel=1e-6)


def test_slope_beyond_friction_is_infeasible() -> None:
    found = region(contact_set(SQUARE, [tilted(30.0)] * 4, 0.57))
    assert found.status == "infeasible"
    verify(found)


def test_opposing_slopes_reach_beyond_the_hull() -> None:
    """Feet that push against each other at different heights carry the CoM outside their hull."""
    feet = [[-0.1, 0.0, 0.0], [0.1, 0.1, 0.1], [0.1, -0.1, 0.1]]
    valley = contact_set(feet, [tilted(-40.0), tilted(40.0), tilted(40.0)], 0.8)
    found = region(valley, tolerance=1e-5)
    assert area(found.inner) > area(hull(np.array(feet)[:, :2].copy())) + 1e-3
    verify(found)


def test_adaptive_polygons_enclose_the_region_within_tolerance() -> None:
    fine = equally_spaced(720)
    for contacts in feasible_sets(10, 8):
        found = region(contacts, tolerance=1e-4, limit=400)
        assert 0.0 <= found.gap <= 1e-4
        truth = region(contacts, fine)
        for point in truth.support.point:
            assert signed_distance(found.outer, *point) > -1e-8
            assert signed_distance(found.inner, *point) > -1e-4 - 1e-8
        for point in found.inner:
            assert np.all(fine @ point <= truth.support.value + 1e-8)


def test_sixteen_adaptive_directions_lose_half_a_percent_of_the_area_at_most() -> None:
    worst_adaptive, worst_fixed = 0.0, 0.0
    for contacts in feasible_sets(11, 40):
        exact = area(region(contacts, tolerance=1e-5, limit=720).inner)
        adaptive = region(contacts, tolerance=1e-9, limit=16)
        assert adaptive.calls <= 16
        worst_adaptive = max(worst_adaptive, 1.0 - area(adaptive.inner) / exact)
        worst_fixed = max(worst_fixed, 1.0 - area(region(contacts, SIXTEEN).inner) / exact)
    assert worst_adaptive <= 0.005
    assert worst_fixed > worst_adaptive


@pytest.mark.parametrize(("seed", "contacts"), [(90, 3), (91, 4), (154, 7)])
def test_points_beyond_the_chords_belong_to_the_region(seed: int, contacts: int) -> None:
    """Strongly curved: the support points alone leave out more than 0.5 %; what lies between them is held by forces."""
    stance = random_set(np.random.default_rng(seed), contacts)
    few, many = region(stance, tolerance=1e-9, limit=16), region(stance, tolerance=1e-5, limit=720)
    whole = area(many.inner)
    assert area(hull(few.support.point.copy())) < 0.995 * whole
    assert 0.997 * whole < area(few.inner) <= whole + 1e-6
    assert few.gap == pytest.approx(max(-signed_distance(few.inner, x, y) for x, y in few.outer))
    own = {tuple(p) for p in few.support.point.tolist()}
    between = [p for p in few.inner.tolist() if tuple(p) not in own]
    assert len(between) > 10
    for x, y in between:
        assert share_excess(stance, np.array([x, y]), 1.0) <= 1e-9
        assert signed_distance(many.outer, x, y) > -1e-9


def test_given_directions_come_back_in_order() -> None:
    contacts = feasible_sets(12, 1)[0]
    given = SIXTEEN[[5, 0, 11]]
    found = region(contacts, given)
    np.testing.assert_allclose(found.support.direction, given, atol=1e-12)
    np.testing.assert_allclose(found.support.value, region(contacts, SIXTEEN).support.value[[5, 0, 11]], atol=1e-8)
    both = region(contacts, given, adaptive=True)
    assert len(both.support.direction) > 8
    angle = np.arctan2(both.support.direction[:, 1], both.support.direction[:, 0]) % (2 * np.pi)
    assert np.all(np.diff(angle) >= 0.0)


def test_sixty_four_contacts() -> None:
    found = region(random_set(np.random.default_rng(13), 64), SIXTEEN)
    assert found.status == "ok"
    verify(found)


def test_every_number_of_contacts_from_none_to_sixty_four() -> None:
    """Any normal (walls, ceilings), no, some and unlimited friction, doubled contacts: every verdict is proved."""
    rng, seen = np.random.default_rng(14), set[str]()
    for n in range(65):
        position, normal = rng.uniform(-0.2, 0.2, (n, 3)), rng.normal(size=(n, 3))
        if n % 3:
            normal[:, 2] = np.abs(normal[:, 2]) + 0.5
        mu = rng.choice([0.0, 0.3, 0.9, np.inf], n, p=[0.1, 0.4, 0.4, 0.1])
        if n > 1:
            position[-1] = position[0]
        found = region(contact_set(position, normal, mu), SIXTEEN)
        seen.add(found.status)
        verify(found)
    assert seen >= {"ok", "infeasible", "unbounded"}
