"""Sets that tempt a solver into a wrong answer: needles, spots, walls without a limit of friction, wild friction.

Every verdict is held against proofs checked here, and against what other functions return for the same set.
"""

import math

import numpy as np
import pytest

from surefoot.geometry.polygon import gap, hull
from surefoot.services.stability.programs import reference
from surefoot.services.stability.programs.contacts import (
    MAX_MU,
    ContactSet,
    StabilityError,
    contact_set,
    equally_spaced,
)
from surefoot.services.stability.programs.interior import FAILED
from surefoot.services.stability.programs.outline import corner_normals, edge_normals
from surefoot.services.stability.programs.reduced import reduce
from surefoot.services.stability.programs.reference import Reference, ReferenceAnswer
from surefoot.services.stability.regions.careful import Oracle
from surefoot.services.stability.regions.equilibrium import equilibrium, least_forces
from surefoot.services.stability.regions.many import STATUSES, assess
from surefoot.services.stability.regions.margin import margin
from surefoot.services.stability.regions.region import region
from tests.services.stability.certificate import balance, force_violation
from tests.services.stability.sets import SQUARE, UP, tilted

SIXTEEN = equally_spaced(16)


def normals(rng: np.random.Generator, n: int, steepest_deg: float) -> np.ndarray:
    s, h = np.radians(rng.uniform(0.0, steepest_deg, n)), rng.uniform(0.0, 2.0 * np.pi, n)
    return np.column_stack((np.sin(s) * np.cos(h), np.sin(s) * np.sin(h), np.cos(s)))


def drawn(rng: np.random.Generator) -> ContactSet:
    """1 to 12 contacts: scattered, doubled, nearly on a line, at a spot; walls; no, some or unlimited friction."""
    n = int(rng.integers(1, 13))
    p, kind, far = rng.uniform(-0.2, 0.2, (n, 3)), rng.integers(5), 10.0 ** rng.uniform(-1.0, 3.0)
    if kind == 1:
        p[n // 2 :] = p[: n - n // 2]
    if kind in (2, 3):
        p = p[0] + np.outer(rng.uniform(-1.0, 1.0, n), 0.2 * rng.normal(size=3))
    if kind == 3:
        p = p + rng.normal(size=p.shape) * 10.0 ** -rng.uniform(3.0, 12.0)
    if kind == 4:
        p[:] = p[0]
    mu = (rng.uniform(0.1, 1.5, n), np.zeros(n), np.full(n, math.inf), rng.choice([0.0, 0.5, math.inf], n))
    return contact_set(
        p + far * rng.normal(size=3), normals(rng, n, rng.choice([30.0, 120.0])), mu[int(rng.integers(4))]
    )


def support_value(contacts: ContactSet, direction: np.ndarray) -> float:
    """Return h(a), m, of one unit direction (2,), solved alone."""
    oracle = Oracle(contacts, *reduce(contacts))
    return float(oracle.support(oracle.fan(direction[None], 1), np.zeros(1, dtype=np.int64)).value[0])


def check_forces(contacts: ContactSet, force: np.ndarray, com: np.ndarray) -> None:
    size, centre = max(1.0, np.abs(force).max()), contacts.position.mean(axis=0)
    near = ContactSet(contacts.position - centre, contacts.normal, contacts.mu)
    assert force_violation(near, force) <= 1e-7 * size
    assert balance(near, force, com - centre[:2]) <= 1e-7 * size


def check_fall(contacts: ContactSet, twist: np.ndarray, com: np.ndarray) -> None:
    """The proof that nothing holds: no contact resists this twist, and it lowers the CoM."""
    centre = contacts.position.mean(axis=0)
    v, spin = twist[:3] + np.cross(twist[3:], centre), twist[3:]
    u = v + np.cross(spin, contacts.position - centre)
    along = np.einsum("ij,ij->i", contacts.normal, u)
    across = np.linalg.norm(u - along[:, None] * contacts.normal, axis=1)
    finite = np.isfinite(contacts.mu)
    mu = np.where(finite, contacts.mu, 0.0)
    size = max(np.abs(v).max(), np.abs(spin).max())
    assert np.all(np.where(finite, mu * across - along, np.maximum(across, -along)) <= 1e-7 * size * np.hypot(1.0, mu))
    assert v[2] + np.cross(spin, [*(com - centre[:2]), 0.0])[2] < 0.0


@pytest.mark.parametrize("seed", range(4))
def test_equilibrium_proves_what_it_says(seed: int) -> None:
    """Held: forces in the cones that balance. Not held: a twist no contact resists. Both as the region has it."""
    rng, seen = np.random.default_rng([70, seed]), set[tuple[str, bool]]()
    for _ in range(60):
        contacts = drawn(rng)
        found = region(contacts)
        for _ in range(2):
            com = contacts.position[:, :2].mean(axis=0) + rng.uniform(-0.15, 0.15, 2)
            got = equilibrium(contacts, com)
            if got.held:
                assert got.force is not None
                assert found.status != "infeasible"
                check_forces(contacts, got.force, com)
            else:
                assert got.twist is not None
                check_fall(contacts, got.twist, com)
            seen.add((found.status, got.held))
            away = margin(found, com).value
            if away is not None and abs(away) > 1e-6:
                assert got.held == (away > 0.0)
    assert {("ok", True), ("ok", False), ("infeasible", False), ("unbounded", True), ("unbounded", False)} <= seen


@pytest.mark.parametrize("normal", [UP, (1.0, 0.0, 0.0), tilted(60.0)])
def test_one_contact_that_cannot_slip_holds_what_hangs_on_it(normal: tuple[float, float, float]) -> None:
    """A wall, too: its forces need no pressure. The region is the contact's own point, and there it is held."""
    contacts = contact_set([[0.3, -0.2, 0.5]], [normal], math.inf)
    place = np.array([0.3, -0.2])
    assert region(contacts).status == "point"
    for force in (equilibrium(contacts, place).force, least_forces(contacts, place)):
        assert force is not None
        np.testing.assert_allclose(force, [[0.0, 0.0, 1.0]], atol=1e-7)
    beside = equilibrium(contacts, place + 0.01)
    assert beside.twist is not None
    check_fall(contacts, beside.twist, place + 0.01)


def test_contacts_a_rounding_error_apart_are_one() -> None:
    """Far from the origin the same point differs in its last digits; their distances are no lever."""
    rng = np.random.default_rng(71)
    for n in range(2, 9):
        for mu in (0.0, 0.7, math.inf):
            p = np.tile([1000.1, -400.7, 3.3], (n, 1)) + rng.uniform(-1e-12, 1e-12, (n, 3))
            contacts = contact_set(p, normals(rng, n, 80.0), mu)
            found = region(contacts, SIXTEEN)
            held = equilibrium(contacts, p[0, :2])
            assert found.status == ("point" if held.held else "infeasible")
            if found.sinking is not None:
                assert np.abs(found.sinking[:3]).max() < 1e6
            com = p[0, :2] + 0.01
            got = assess(contacts, np.arange(n), np.array([0, n]), com[None])
            assert STATUSES[got.status[0]] == found.status


def test_the_gap_of_a_needle_is_true() -> None:
    """Three to six contacts almost on a line on steep ground: the region is far wider than their hull."""
    rng, checked = np.random.default_rng(72), 0
    while checked < 25:
        n = int(rng.integers(3, 7))
        line = np.outer(rng.uniform(-1.0, 1.0, n), [0.25, 0.1, 0.0])
        p = line + rng.normal(size=(n, 3)) * 10.0 ** -rng.uniform(4.0, 9.0)
        contacts = contact_set(p, normals(rng, n, 60.0), rng.uniform(0.3, 0.8, n))
        found = region(contacts, tolerance=1e-4)
        if found.status != "ok" or found.exact:
            continue
        checked += 1
        assert found.gap <= 1e-4
        assert gap(found.inner, found.outer) <= found.gap + 1e-9
        for a in SIXTEEN:
            value = support_value(contacts, a)
            assert float((found.inner @ a).max()) - 1e-8 <= value <= float((found.outer @ a).max()) + 1e-8


@pytest.mark.parametrize("apex", [1e-3, 1e-5, 1e-8])
def test_directions_to_begin_with_are_never_half_a_turn_apart(apex: float) -> None:
    needle = np.array([[-0.2, 0.0, 0.0], [0.2, 0.0, 0.0], [0.05, apex, 0.0]])
    for found in (edge_normals(hull(needle[:, :2].copy())), corner_normals(hull(needle[:, :2].copy()))):
        angle = np.sort(np.arctan2(found[:, 1], found[:, 0]))
        widest = np.diff(np.append(angle, angle[0] + 2.0 * np.pi)).max()
        assert widest < np.pi - 5e-4


def test_a_margin_the_kernel_gives_up_on_is_found_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """The kernel that stops early leaves a margin too large; clarabel goes on, and reports it if it cannot either."""
    rng = np.random.default_rng(73)
    contacts = contact_set(rng.uniform(-0.2, 0.2, (6, 3)), normals(rng, 6, 25.0), 0.6)
    found = region(contacts, SIXTEEN)
    com = contacts.position[:, :2].mean(axis=0)
    exact = margin(found, com).value
    assert exact is not None
    explore = reference.explore
    monkeypatch.setattr(reference, "explore", lambda *given: explore(*given[:5], given[2], 8))  # no room for more
    assert margin(found, com).value == pytest.approx(exact, abs=1e-8)
    failed = ReferenceAnswer(FAILED, math.nan, np.empty(4), np.empty((6, 3)), math.inf)
    monkeypatch.setattr(Reference, "solve", lambda *given: failed)
    with pytest.raises(StabilityError) as refused:
        margin(found, com)
    assert refused.value.code == "no_convergence"


def test_the_middle_of_a_circle_has_a_margin() -> None:
    """Two feet of one vertical: all directions are equally near, and none is the nearest."""
    contacts = contact_set([[0.0, 0.0, 0.1], [0.0, 0.0, -0.1]], [UP] * 2, [1.4, 0.4])
    found = region(contacts)
    radius = support_value(contacts, SIXTEEN[0])
    assert found.status == "ok"
    assert margin(found, np.zeros(2)).value == pytest.approx(radius, abs=1e-8)
    got = assess(contacts, np.arange(2), np.array([0, 2]), np.zeros((1, 2)))
    assert got.margin[0] == pytest.approx(radius, abs=1e-8)


def test_friction_that_only_looks_limited_is_refused() -> None:
    """Above 1e4 answers would lose the digits they promise; null states what is meant."""
    contact_set(SQUARE, [UP] * 4, MAX_MU)
    with pytest.raises(StabilityError) as refused:
        contact_set(SQUARE, [UP] * 4, [0.5, 0.5, 1e5, 0.5])
    assert (refused.value.code, refused.value.field) == ("too_large", "contacts.2.mu")
    assert "null" in refused.value.message
