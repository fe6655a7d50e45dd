"""Many sets at once: the same verdicts and margins as one by one, on any number of threads."""

import numpy as np
import pytest

from surefoot.services.stability.programs.contacts import ContactSet, StabilityError, contact_set
from surefoot.services.stability.regions.many import STATUSES, PackedSets, batch, pack, what_if
from surefoot.services.stability.regions.margin import margin
from surefoot.services.stability.regions.region import region
from tests.services.stability.sets import SQUARE, UP, feasible_sets, random_set, tilted

SQUARE_SET = contact_set(SQUARE, [UP] * 4, 0.5)


def laid_out(sets: list[ContactSet], com: np.ndarray) -> PackedSets:
    whole = ContactSet(*(np.concatenate([getattr(s, f) for s in sets]) for f in ("position", "normal", "mu")))
    return pack(whole.position, whole.normal, whole.mu, [len(s) for s in sets], com)


def any_set(rng: np.random.Generator) -> ContactSet:
    """Mild or steep, a line, a spot, doubled, on one plane; with friction, without, or with unlimited friction."""
    kind, n = int(rng.integers(9)), int(rng.integers(1, 9))
    s = random_set(rng, n, 85.0 if kind == 0 else 30.0, (0.0, 1.5) if kind < 2 else (0.3, 0.9))
    position, normal, mu = s.position.copy(), s.normal.copy(), s.mu.copy()
    if kind == 2:
        position = position[0] + np.outer(rng.uniform(-0.2, 0.2, n), rng.normal(size=3))
    elif kind == 3:
        position[:] = position[0]
    elif kind == 4:
        position[-1], normal[-1] = position[0], normal[0]
    elif kind == 5:
        position[:, 2], normal[:] = 0.1, UP
    elif kind == 6:
        mu[rng.random(n) < 0.5] = np.inf
    elif kind == 7:
        mu[rng.random(n) < 0.5] = 0.0
    return ContactSet(position, normal, mu)


def test_statuses_and_margins_equal_single_questions() -> None:
    rng = np.random.default_rng(70)
    sets = [any_set(rng) for _ in range(400)]
    sets.append(contact_set([], [], []))
    walls = contact_set([[-0.5, 0, 0], [0.5, 0, 0.1]], [[1, 0, 0], [-1, 0, 0]], 0.5)
    sets += [walls, contact_set([*SQUARE, (0, 0, 1)], [UP] * 4 + [(0, 0, -1)], 0.5)]
    com = np.array([1.0, 2.0]) + rng.uniform(-0.25, 0.25, (len(sets), 2))
    found = batch(laid_out(sets, com))
    for k, s in enumerate(sets):
        alone = region(s)
        assert STATUSES[found.status[k]] == alone.status, k
        value = margin(alone, com[k]).value
        np.testing.assert_allclose(found.margin[k], np.nan if value is None else value, atol=2e-8)
        assert found.stable[k] == (alone.status == "ok" and value is not None and value >= 0.0)
    assert set(found.status) == set(range(len(STATUSES)))


def test_threads_change_nothing_not_even_the_last_bit() -> None:
    rng = np.random.default_rng(71)
    sets = [any_set(rng) for _ in range(300)]
    com = np.array([1.0, 2.0]) + rng.uniform(-0.2, 0.2, (300, 2))
    together = laid_out(sets, com)
    alone = batch(together, threads=1)
    for threads in (2, 3):
        shared = batch(together, threads=threads)
        np.testing.assert_array_equal(shared.status, alone.status)
        assert shared.margin.tobytes() == alone.margin.tobytes()
    again = [batch(laid_out([s], com[k : k + 1])) for k, s in enumerate(sets[:50])]  # nor does the company
    assert np.concatenate([g.margin for g in again]).tobytes() == alone.margin[:50].tobytes()


def test_lifting_a_leg() -> None:
    com = np.array([0.02, 0.05])
    found = what_if(SQUARE_SET, com)
    assert found.stable.tolist() == [True, False, False, True, True]
    diagonal = np.array([-0.07, -0.03, 0.07, 0.03]) / np.sqrt(2.0)
    np.testing.assert_allclose(found.margin, [0.05, *diagonal], atol=1e-12)


def test_lifts_and_candidates_equal_single_questions() -> None:
    for contacts in feasible_sets(42, 6, (3, 7)):
        candidates = feasible_sets(43, 1, (2, 3))[0]
        com = contacts.position[:, :2].mean(axis=0)
        n, found = len(contacts), what_if(contacts, com, candidates)
        sets = [contacts, *(contacts.without(i) for i in range(n))]
        for j in range(len(candidates)):
            pairs = ((getattr(contacts, f), getattr(candidates, f)) for f in ("position", "normal", "mu"))
            sets.append(ContactSet(*(np.concatenate((a, b[j : j + 1])) for a, b in pairs)))
        assert len(found.margin) == len(sets)
        for k, s in enumerate(sets):
            alone = region(s)
            value = margin(alone, com).value
            assert STATUSES[found.status[k]] == alone.status
            np.testing.assert_allclose(found.margin[k], np.nan if value is None else value, atol=1e-8)


def test_nothing_to_lift() -> None:
    assert what_if(contact_set([], [], []), np.zeros(2)).status.tolist() == [STATUSES.index("infeasible")]
    one = what_if(contact_set([[0, 0, 0]], [tilted(10.0)], 0.5), np.array([0.3, 0.4]))
    assert [STATUSES[s] for s in one.status] == ["point", "infeasible"]
    assert one.margin[0] == pytest.approx(-0.5)


@pytest.mark.parametrize(
    ("position", "normal", "mu", "counts", "com", "code", "field"),
    [
        ([[0, 0, 0]] * 3, [UP] * 3, 0.5, [1, 1], [[0, 0]] * 2, "shape", "counts"),
        ([[0, 0, 0]] * 2, [UP] * 2, 0.5, [1, 1], [[0, 0]], "shape", "counts"),
        ([[0, 0, 0]] * 2, [UP] * 2, 0.5, [3, -1], [[0, 0]] * 2, "shape", "counts"),
        ([[0, 0, 0]] * 66, [UP] * 66, 0.5, [1, 65], [[0, 0]] * 2, "too_many", "sets.1.contacts"),
        ([[0, 0, 0]] * 2, [UP] * 2, 0.5, [1, 1], [[0, 0], [0, np.nan]], "not_finite", "sets.1.com"),
        ([[0, 0, 0]] * 3, [UP, UP, [0, 0, 0]], 0.5, [1, 2], [[0, 0]] * 2, "zero_normal", "sets.1.contacts.1.normal"),
        ([[0, 0, 0]] * 3, [UP] * 3, [1, np.nan, 1], [0, 2, 1], [[0, 0]] * 3, "negative_mu", "sets.1.contacts.1.mu"),
    ],
)
def test_refused(position: list, normal: list, mu: object, counts: list, com: list, code: str, field: str) -> None:
    with pytest.raises(StabilityError) as refused:
        pack(position, normal, mu, counts, com)  # type: ignore[arg-type]
    assert (refused.value.code, refused.value.field) == (code, field)
