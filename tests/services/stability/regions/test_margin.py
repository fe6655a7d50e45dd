"""Signed margins and extents."""

import math

import numpy as np
import pytest

from surefoot.services.stability.programs.contacts import ContactSet, contact_set, equally_spaced
from surefoot.services.stability.regions import margin as margins
from surefoot.services.stability.regions.margin import extent, margin
from surefoot.services.stability.regions.region import region
from tests.services.stability.sets import SQUARE, UP, feasible_sets

EAST, WEST = (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)
X, Y = np.array([1.0, 0.0]), np.array([0.0, 1.0])


def around(direction: np.ndarray, width: float, count: int = 65) -> np.ndarray:
    """Directions within `width` rad of one."""
    angle = math.atan2(direction[1], direction[0]) + np.linspace(-width, width, count)
    return np.column_stack((np.cos(angle), np.sin(angle)))


def test_margin_is_the_smallest_distance_over_all_directions() -> None:
    rng = np.random.default_rng(1)
    signs = set()
    for contacts in feasible_sets(20, 12):
        found, everywhere = region(contacts, tolerance=1e-2), region(contacts, equally_spaced(720)).support
        for _ in range(4):
            c = np.array([1.0, 2.0]) + rng.uniform(-0.25, 0.25, 2)
            got = margin(found, c)
            assert got.value is not None
            distance = everywhere.value - everywhere.direction @ c
            assert got.value <= distance.min() + 1e-8
            near = region(contacts, around(everywhere.direction[distance.argmin()], 0.01)).support
            assert got.value == pytest.approx((near.value - near.direction @ c).min(), abs=5e-5)
            assert got.direction is not None  # the value is reached, so it is not too low either
            there = region(contacts, got.direction[None]).support.value[0] - got.direction @ c
            assert got.value == pytest.approx(there, abs=1e-8)
            signs.add(got.value > 0.0)
    assert signs == {True, False}


def test_margin_does_not_depend_on_how_fine_the_region_is() -> None:
    for contacts in feasible_sets(21, 6):
        c = contacts.position[:, :2].mean(axis=0) + np.array([0.05, -0.03])
        coarse, fine = margin(region(contacts, tolerance=0.1), c), margin(region(contacts, tolerance=1e-5), c)
        assert coarse.value == pytest.approx(fine.value, abs=1e-8)


@pytest.mark.parametrize(
    ("c", "expected"),
    [((0.0, 0.0), 0.1), ((0.07, 0.0), 0.03), ((0.1, 0.0), 0.0), ((0.2, 0.0), -0.1), ((0.4, 0.5), -0.5)],
)
def test_margin_of_a_square(c: tuple[float, float], expected: float) -> None:
    for lift in (0.0, 1e-7):  # exact hull, and the solver
        feet = np.array(SQUARE)
        feet[0, 2] = lift
        found = region(contact_set(feet, [UP] * 4, 0.5))
        assert found.exact == (lift == 0.0)
        assert margin(found, np.array(c)).value == pytest.approx(expected, abs=1e-6)


def test_margin_without_inside() -> None:
    point, segment = (
        region(contact_set([[1, 2, 0]], [UP], 0.5)),
        region(contact_set([[0, 0, 0], [1, 0, 0]], [UP] * 2, 1)),
    )
    assert margin(point, np.array([1.0, 2.0])).value == pytest.approx(0.0, abs=1e-12)
    assert margin(point, np.array([4.0, 6.0])).value == pytest.approx(-5.0)
    assert margin(segment, np.array([0.5, 0.0])).value == pytest.approx(0.0, abs=1e-8)
    assert margin(segment, np.array([0.5, 0.2])).value == pytest.approx(-0.2)


def test_no_margin_where_there_is_no_edge() -> None:
    assert margin(region(contact_set([], [], [])), X).value is None
    everywhere = [[-1, -1, 0], [-1, 1, 0], [1, -1, 0], [1, 1, 0]]
    assert margin(region(contact_set(everywhere, [EAST, EAST, WEST, WEST], 0.5)), X).value is None
    line = region(contact_set([[-1, 0, 0], [1, 0, 0]], [EAST, WEST], 0.5))
    assert margin(line, X).value == 0.0
    assert margin(line, np.array([3.0, 0.2])).value == pytest.approx(-0.2, abs=1e-8)


def test_extent_is_the_crossing_of_the_ray_not_the_support_point() -> None:
    rng = np.random.default_rng(2)
    directions = equally_spaced(720)
    for contacts in feasible_sets(22, 10):
        found, everywhere = region(contacts), region(contacts, directions).support
        start = contacts.position[:, :2].mean(axis=0)
        a = directions[int(rng.integers(720))]
        got = extent(found, start, a)
        assert got.status == "ok"
        assert got.value is not None
        cos = directions @ a
        ahead = cos > 1e-3  # min over d with d'a > 0 of (h(d) - d'c) / d'a
        bound = ((everywhere.value - directions @ start)[ahead] / cos[ahead]).min()
        assert got.value <= bound + 1e-8
        assert got.value == pytest.approx(bound, abs=2e-3)
        at_edge = margin(found, start + got.value * a)
        assert at_edge.value == pytest.approx(0.0, abs=1e-8)


def test_extent_of_a_square() -> None:
    for lift in (0.0, 1e-7):
        feet = np.array(SQUARE)
        feet[0, 2] = lift
        found = region(contact_set(feet, [UP] * 4, 0.5))
        assert extent(found, np.zeros(2), X).value == pytest.approx(0.1, abs=1e-6)
        assert extent(found, np.array([0.3, 0.05]), X).value == pytest.approx(-0.2, abs=1e-6)
        assert extent(found, np.array([-0.3, 0.05]), X).value == pytest.approx(0.4, abs=1e-6)
        missed = extent(found, np.array([0.0, 0.3]), X)
        assert (missed.value, missed.status) == (None, "missed")


def test_extent_of_a_segment_and_of_nothing() -> None:
    segment = region(contact_set([[0, 0, 0], [1, 0, 0]], [UP] * 2, 0.5))
    assert extent(segment, np.array([0.25, 0.0]), X).value == pytest.approx(0.75, abs=1e-8)
    assert extent(segment, np.array([0.25, -0.5]), Y).value == pytest.approx(0.5, abs=1e-8)
    assert extent(segment, np.array([2.0, -0.5]), Y).status == "missed"
    assert extent(region(contact_set([], [], [])), X, X).status == "infeasible"


def test_extent_between_walls() -> None:
    walls = region(contact_set([[-1, 0, 0], [1, 0, 0.1], [0, -1, 0]], [EAST, WEST, UP], 0.5))
    assert walls.status == "unbounded"
    assert extent(walls, np.zeros(2), X).status == "unbounded"
    pair = region(contact_set([[-1, 0, 0], [1, 0, 0]], [EAST, WEST], 0.5))
    assert extent(pair, np.array([0.3, -0.2]), Y).value == pytest.approx(0.2, abs=1e-7)


def test_extent_with_free_forces() -> None:
    """Two holds on one wall, unlimited friction: the CoM may go anywhere along the wall, nowhere across it."""
    holds = region(contact_set([[0, 0, 0], [0, 1, 0]], [EAST] * 2, math.inf))
    assert extent(holds, np.zeros(2), Y).status == "unbounded"
    assert extent(holds, np.array([-0.2, 0.3]), X).value == pytest.approx(0.2, abs=1e-8)


def wall_sets(count: int) -> list[ContactSet]:
    """Contacts on two facing walls and on the floor, seeded, whose regions have no bound somewhere."""
    rng, found = np.random.default_rng(59), list[ContactSet]()
    while len(found) < count:
        k = int(rng.integers(2, 6))
        side = rng.choice([-1.0, 1.0], k)
        place = np.column_stack((0.3 * side, rng.uniform(-0.4, 0.4, (k, 2))))
        normal = np.column_stack((-side, rng.normal(0.0, 0.3, (k, 2))))
        floor = rng.random(k) < 0.3
        place[floor, 2], normal[floor] = 0.0, UP
        contacts = contact_set(place, normal, rng.uniform(0.1, 0.8, k))
        if region(contacts).status == "unbounded":
            found.append(contacts)
    return found


def test_margin_to_the_edge_of_a_region_without_bounds_needs_few_programs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rays in 720 directions end at the margin or beyond it, and one of them no farther than it by its angle."""
    solved, solve = list[int](), margins.solve_one
    monkeypatch.setattr(margins, "solve_one", lambda *given: solved.append(1) or solve(*given))
    rng, insides, endless = np.random.default_rng(3), 0, 0
    for contacts in wall_sets(40):
        found, c = region(contacts), rng.uniform(-0.4, 0.4, 2)
        solved.clear()
        value = margin(found, c).value
        assert len(solved) <= (margins.RAYS + 1 if value is None else 60)
        if value is not None and value <= 0.0:
            continue
        reaches = [extent(found, c, ray).value for ray in equally_spaced(720 if value else 90)]
        nearest = min(math.inf if reach is None else reach for reach in reaches)
        endless += value is None
        if value is None:
            assert math.isinf(nearest)
        else:
            insides += 1
            assert nearest * math.cos(math.pi / 720) - 1e-8 <= value <= nearest + 1e-8
    assert insides >= 5
    assert endless >= 5
