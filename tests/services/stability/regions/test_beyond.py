"""Equilibrium forces, what-if, robust margins and gradients."""

import math

import numpy as np
import pytest

from surefoot.arrays import Array
from surefoot.services.stability.programs.contacts import ContactSet, contact_set, equally_spaced
from surefoot.services.stability.regions.equilibrium import _least_balance, equilibrium, least_forces, least_friction
from surefoot.services.stability.regions.margin import margin
from surefoot.services.stability.regions.region import region
from surefoot.services.stability.regions.robust import Uncertainty, gradient, robust_margin, shrunk
from tests.services.stability.certificate import balance, force_violation
from tests.services.stability.oracles import share_excess
from tests.services.stability.sets import SQUARE, UP, feasible_sets, tilted

CENTRE = np.zeros(2)
SQUARE_SET = contact_set(SQUARE, [UP] * 4, 0.5)


def test_held_exactly_inside_the_region() -> None:
    rng = np.random.default_rng(0)
    seen = set()
    for contacts in feasible_sets(40, 15):
        found = region(contacts)
        for _ in range(4):
            c = contacts.position[:, :2].mean(axis=0) + rng.uniform(-0.2, 0.2, 2)
            got, distance = equilibrium(contacts, c), margin(found, c).value
            assert distance is not None
            assert got.held == (distance > 0.0)
            seen.add(got.held)
            if got.force is not None:
                assert force_violation(contacts, got.force) <= 1e-9
                assert balance(contacts, got.force, c) < 1e-8
            else:
                assert got.twist is not None
                v, spin = got.twist[:3], got.twist[3:]
                u = v + np.cross(spin, contacts.position)
                along = np.einsum("ij,ij->i", contacts.normal, u)
                across = np.linalg.norm(u - along[:, None] * contacts.normal, axis=1)
                size = np.abs(u).max()
                assert np.all(along >= contacts.mu * across - 1e-7 * size)
                assert (v + np.cross(spin, [*c, 0.0]))[2] < 0.0
    assert seen == {True, False}


def test_nothing_holds_nothing() -> None:
    got = equilibrium(contact_set([], [], []), CENTRE)
    assert not got.held
    assert least_friction(contact_set([], [], []), CENTRE) is None
    assert least_forces(contact_set([], [], []), CENTRE) is None


def test_least_forces_on_a_square() -> None:
    force = least_forces(SQUARE_SET, CENTRE)
    assert force is not None
    np.testing.assert_allclose(force, np.tile([0.0, 0.0, 0.25], (4, 1)), atol=1e-6)


def test_least_forces_are_the_smallest() -> None:
    for contacts in feasible_sets(41, 6):
        c = contacts.position[:, :2].mean(axis=0)
        some, least = equilibrium(contacts, c).force, least_forces(contacts, c)
        if some is None:
            assert least is None
            continue
        assert least is not None
        assert balance(contacts, least, c) < 1e-6
        assert force_violation(contacts, least) < 1e-6
        assert np.sum(least**2) <= np.sum(some**2) + 1e-6


def test_least_forces_are_those_of_the_pseudoinverse_where_these_lie_in_the_cones() -> None:
    """Also for contacts on a line, far from the origin, without friction, of any size: A+ b of the balance A f = b."""
    rng, held = np.random.default_rng(5), 0
    for trial in range(300):
        n, size = int(rng.integers(1, 9)), 10.0 ** int(rng.integers(-2, 2))
        points = rng.normal(size=(n, 3)) * [1.0, 1.0, 0.0 if trial % 3 == 0 else 0.3]
        if trial % 4 == 0:
            points = points[:1] + np.outer(rng.normal(size=n), [1.0, 0.5, 0.0])
        place = rng.dirichlet(np.ones(n)) @ points
        mu = 0.0 if trial % 5 == 0 else 0.7
        rows = np.vstack([np.hstack([np.eye(3)] * n), np.hstack([_arm_of(point - place) for point in points])])
        least = (np.linalg.pinv(rows, rcond=1e-10) @ [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]).reshape(n, 3)
        inside = np.hypot(least[:, 0], least[:, 1]) <= mu * least[:, 2] + (1e-12 if mu == 0.0 else -1e-9)
        if bool((least[:, 2] > 1e-9).all() and inside.all()):
            got = least_forces(contact_set(size * points, [[0.0, 0.0, 1.0]] * n, mu), size * place[:2])
            assert got is not None
            np.testing.assert_allclose(got, least, atol=1e-11)
            held += 1
    assert held > 60


@pytest.mark.parametrize("spread", [0.1, 1e-3, 1e-4, 1e-6])
def test_least_forces_balance_however_close_together_the_contacts_are(spread: float) -> None:
    """Contacts 1.4 m beside the CoM, which press and pull: the moment is a difference of large ones."""
    rng, found = np.random.default_rng(7), 0
    for _ in range(60):
        points = spread * rng.uniform(-1.0, 1.0, (int(rng.integers(3, 7)), 3)) + [1.0, 1.0, 0.0]
        arm = points / np.abs(points).max()
        force = _least_balance(arm)
        if force is not None:
            found += 1
            moment = np.array([math.fsum(part) for part in np.cross(arm, force).T])
            assert np.abs(moment).max() < 2e-12
            assert abs(math.fsum(force[:, 2]) - 1.0) < 2e-12
    assert found > 0 or spread < 1e-3


def _arm_of(r: Array) -> Array:
    """Return the matrix (3, 3) of r x: its product with a force is the force's moment."""
    return np.array([[0.0, -r[2], r[1]], [r[2], 0.0, -r[0]], [-r[1], r[0], 0.0]])


@pytest.mark.parametrize("slope", [0.0, 10.0, 20.0])
def test_least_friction_on_a_slope_is_its_steepness(slope: float) -> None:
    xy = np.array(SQUARE)[:, :2]
    feet = np.column_stack((xy, np.tan(np.radians(slope)) * xy[:, 0]))
    got = least_friction(contact_set(feet, [tilted(slope)] * 4, 0.5), CENTRE)
    assert got is not None
    assert got.share == pytest.approx(np.tan(np.radians(slope)) / 0.5, abs=1e-8)


def test_least_friction_is_needed_and_enough() -> None:
    """The forces hold with that share of friction; with 1e-7 less, clarabel proves that none do, with more some do."""
    rng, checked = np.random.default_rng(45), 0
    for contacts in feasible_sets(45, 12):
        corners = region(contacts).inner
        if len(corners) < 3:
            continue
        com = rng.dirichlet(np.ones(len(corners))) @ corners
        got = least_friction(contacts, com)
        assert got is not None
        assert balance(contacts, got.force, com) < 1e-8
        normal = np.einsum("ij,ij->i", contacts.normal, got.force)
        tangential = np.linalg.norm(got.force - normal[:, None] * contacts.normal, axis=1)
        loaded = normal > 0.0
        assert np.all(tangential[~loaded] < 1e-9)
        used = float(np.max(tangential[loaded] / (contacts.mu * normal)[loaded]))
        assert used == pytest.approx(got.share, abs=1e-7)
        if got.share > 1e-7:
            assert share_excess(contacts, com, got.share - 1e-7) > 0.0
            checked += 1
        assert share_excess(contacts, com, got.share + 1e-7) < 0.0
    assert checked >= 8


def test_least_friction_of_some_contacts_without_and_some_with_any() -> None:
    """Ice carries no tangential force, unlimited friction counts as none used."""
    slope = [tilted(15.0)] * 4
    feet = np.array(SQUARE) + np.outer(np.tan(np.radians(15.0)) * np.array(SQUARE)[:, 0], UP)
    icy = least_friction(contact_set(feet, slope, [0.0, 0.8, 0.8, 0.8]), CENTRE)
    assert icy is not None
    along = icy.force[0] - (icy.force[0] @ slope[0]) * np.array(slope[0])
    assert np.abs(along).max() < 1e-9
    even = least_friction(contact_set(feet, slope, 0.8), CENTRE)
    assert even is not None
    assert icy.share > even.share
    anchored = least_friction(contact_set(feet, slope, [np.inf, np.inf, 0.8, 0.8]), CENTRE)
    assert anchored is not None
    assert anchored.share < 1e-8


def test_least_friction_between_walls_squeezes_within_reason() -> None:
    """Two facing walls: half the weight on each, |f_t| = share mu f_n, and no more than 100 weights of load."""
    walls = contact_set([[0.1, 0, 0], [-0.1, 0, 0]], [[-1, 0, 0], [1, 0, 0]], 0.5)
    got = least_friction(walls, CENTRE)
    assert got is not None
    assert got.share == pytest.approx(1.0 / (0.5 * 100.0), rel=1e-6)
    assert force_violation(walls, got.force) < 0.0


def finite_difference(contacts: ContactSet, a: np.ndarray, i: int, axis: int | None, step: float = 1e-5) -> float:
    values = []
    for sign in (1.0, -1.0):
        position, mu = contacts.position.copy(), contacts.mu.copy()
        if axis is None:
            mu[i] += sign * step
        else:
            position[i, axis] += sign * step
        values.append(region(ContactSet(position, contacts.normal, mu), a[None]).support.value[0])
    return float((values[0] - values[1]) / (2.0 * step))


def test_gradients_against_finite_differences() -> None:
    checked = 0
    for contacts in feasible_sets(43, 6, (4, 7)):
        a = equally_spaced(16)[5]
        support = region(contacts, a[None]).support
        if len(contacts) < 4 or support.status[0] != "ok":
            continue
        by_mu, by_position = gradient(contacts, support.twist[0], support.force[0], support.direction[0])
        for i in range(len(contacts)):
            left = [finite_difference(contacts, a, i, None, s) for s in (1e-5, 2e-5)]
            if abs(left[0] - left[1]) > 1e-4:  # at a kink
                continue
            assert by_mu[i] == pytest.approx(left[0], abs=2e-4)
            for axis in range(3):
                assert by_position[i, axis] == pytest.approx(finite_difference(contacts, a, i, axis), abs=2e-4)
            checked += 1
    assert checked > 10


def test_robust_margin_of_a_square() -> None:
    sure = Uncertainty(np.zeros((2, 2)), np.zeros((4, 3, 3)))
    assert robust_margin(SQUARE_SET, CENTRE, sure) == pytest.approx(0.1, abs=1e-9)
    shaky = Uncertainty(np.diag([1e-4, 0.0]), np.zeros((4, 3, 3)), kappa=2.0)
    assert robust_margin(SQUARE_SET, CENTRE, shaky) == pytest.approx(0.08, abs=1e-6)
    feet = np.zeros((4, 3, 3))
    feet[:, 0, 0] = 1e-4  # along x: the feet of the edge share the load, the edge moves with them
    less = robust_margin(SQUARE_SET, CENTRE, Uncertainty(np.zeros((2, 2)), feet, kappa=2.0))
    assert less is not None
    assert 0.08 - 1e-6 <= less < 0.1


def test_caution_never_adds_margin() -> None:
    for contacts in feasible_sets(44, 4):
        n, c = len(contacts), contacts.position[:, :2].mean(axis=0)
        plain = margin(region(contacts), c).value
        doubts = Uncertainty(1e-5 * np.eye(2), np.tile(1e-6 * np.eye(3), (n, 1, 1)), friction=0.05, normal=0.03)
        careful = robust_margin(contacts, c, doubts)
        assert plain is not None
        assert careful is None or careful < plain


def test_robust_margin_leaves_out_no_direction() -> None:
    """Independent of where the search begins: never above the value in any of 720 directions.

    The same uncertainty in all directions moves every edge inwards alike: margin less kappa sd, by any edge.
    """
    rng = np.random.default_rng(46)
    for k, contacts in enumerate(feasible_sets(46, 8, (3, 7))):
        if k % 2:
            flat = contacts.position * [1.0, 1.0, 0.0]
            contacts = contact_set(flat, [UP] * len(contacts), 0.6)
        found = region(contacts)
        if found.status != "ok":
            continue
        com = found.inner.mean(axis=0) + rng.uniform(-0.03, 0.03, 2)
        plain, none = margin(found, com).value, np.zeros((len(contacts), 3, 3))
        assert plain is not None
        alike = robust_margin(contacts, com, Uncertainty(1e-4 * np.eye(2), none))
        assert alike == pytest.approx(plain - 0.03, abs=1e-5)
        feet = np.tile(1e-4 * np.eye(3), (len(contacts), 1, 1))
        support = region(contacts, equally_spaced(720)).support
        rows = zip(support.twist, support.force, support.direction, strict=True)
        slopes = [gradient(contacts, *row)[1] for row in rows]
        loss = [3.0 * 0.01 * float(np.linalg.norm(slope)) for slope in slopes]
        each = support.value - support.direction @ com - np.array(loss)
        got = robust_margin(contacts, com, Uncertainty(np.zeros((2, 2)), feet))
        assert got is not None
        assert got <= each.min() + 1e-6


def test_shrunk_friction() -> None:
    got = shrunk(contact_set(SQUARE, [UP] * 4, [0.5, 1.0, np.inf, 0.01]), 0.1, np.radians(10.0)).mu
    expected = [
        np.tan(np.arctan(0.4) - np.radians(10)),
        np.tan(np.arctan(0.9) - np.radians(10)),
        np.tan(np.radians(80)),
        0.0,
    ]
    np.testing.assert_allclose(got, expected, atol=1e-12)
