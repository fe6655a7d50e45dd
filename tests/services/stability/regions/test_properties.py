"""Properties of every contact set, whatever the numbers."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from surefoot.services.stability.programs.contacts import ContactSet, equally_spaced
from surefoot.services.stability.regions.region import region
from tests.services.stability.sets import random_set

SIXTEEN = equally_spaced(16)
seeds = st.integers(0, 10_000)
FEW = settings(max_examples=25)


def a_set(seed: int) -> ContactSet:
    rng = np.random.default_rng(seed)
    return random_set(rng, int(rng.integers(3, 9)), 30.0, (0.3, 0.9))


def values(contacts: ContactSet) -> np.ndarray:
    """h of sixteen directions, NaN where there is none."""
    return region(contacts, SIXTEEN).support.value


@FEW
@given(seeds, st.tuples(*[st.floats(-5, 5)] * 3))
def test_translation_moves_the_region_and_height_does_not_matter(seed: int, by: tuple[float, float, float]) -> None:
    s = a_set(seed)
    moved = ContactSet(s.position + np.array(by), s.normal, s.mu)
    np.testing.assert_allclose(values(moved), values(s) + SIXTEEN @ np.array(by)[:2], atol=1e-8)


@FEW
@given(seeds, st.integers(1, 15))
def test_yaw_turns_the_region(seed: int, eighths: int) -> None:
    s = a_set(seed)
    c, t = SIXTEEN[eighths]
    turn = np.array([[c, -t, 0.0], [t, c, 0.0], [0.0, 0.0, 1.0]])
    turned = ContactSet(np.ascontiguousarray(s.position @ turn.T), np.ascontiguousarray(s.normal @ turn.T), s.mu)
    np.testing.assert_allclose(values(turned), np.roll(values(s), eighths), atol=2e-8)


@FEW
@given(seeds)
def test_mirror(seed: int) -> None:
    s, flip = a_set(seed), np.array([1.0, -1.0, 1.0])
    mirrored = ContactSet(s.position * flip, s.normal * flip, s.mu)
    np.testing.assert_allclose(values(mirrored), np.roll(values(s)[::-1], 1), atol=2e-8)


@FEW
@given(seeds, st.floats(1e-3, 1e3))
def test_scale(seed: int, by: float) -> None:
    s = a_set(seed)
    np.testing.assert_allclose(values(ContactSet(s.position * by, s.normal, s.mu)), values(s) * by, atol=1e-8 * by)


@FEW
@given(seeds, st.randoms(use_true_random=False))
def test_order_of_the_contacts_does_not_matter(seed: int, random) -> None:  # type: ignore[no-untyped-def]
    s = a_set(seed)
    order = list(range(len(s)))
    random.shuffle(order)
    np.testing.assert_allclose(
        values(ContactSet(s.position[order], s.normal[order], s.mu[order])), values(s), atol=1e-8
    )


@FEW
@given(seeds, st.floats(0.0, 0.5))
def test_more_friction_never_shrinks_the_region(seed: int, more: float) -> None:
    s = a_set(seed)
    low, high = values(s), values(ContactSet(s.position, s.normal, s.mu + more))
    there = ~np.isnan(low)
    assert not np.isnan(high[there]).any()
    assert np.all(high[there] >= low[there] - 1e-8)


@FEW
@given(seeds)
def test_one_more_contact_never_shrinks_the_region(seed: int) -> None:
    s = a_set(seed)
    less = values(s.without(seed % len(s)))
    there = ~np.isnan(less)
    assert np.all(values(s)[there] >= less[there] - 1e-8)


@FEW
@given(seeds)
def test_a_contact_twice_is_a_contact_once(seed: int) -> None:
    s = a_set(seed)
    twice = ContactSet(*(np.concatenate((x, x[:1])) for x in (s.position, s.normal, s.mu)))
    np.testing.assert_allclose(values(twice), values(s), atol=1e-8)


@FEW
@given(seeds)
def test_opposite_directions_enclose_something(seed: int) -> None:
    h = values(a_set(seed))
    assert np.all(np.isnan(h) | (h + np.roll(h, 8) >= -1e-8))
