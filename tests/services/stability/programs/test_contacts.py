"""Refusals at the border, by code and field."""

import numpy as np
import pytest

from surefoot.services.stability.programs.contacts import StabilityError, contact_set, equally_spaced, unit
from tests.services.stability.sets import UP


@pytest.mark.parametrize(
    ("position", "normal", "mu", "code", "field"),
    [
        ([[0, 0, 0]] * 65, [UP] * 65, 0.5, "too_many", "contacts"),
        ([[0, 0, 0], [np.nan, 0, 0]], [UP] * 2, 0.5, "not_finite", "contacts.1.position"),
        ([[0, 0, 0], [0, np.inf, 0]], [UP] * 2, 0.5, "not_finite", "contacts.1.position"),
        ([[0, 0, 0]], [[0, 0, 0]], 0.5, "zero_normal", "contacts.0.normal"),
        ([[0, 0, 0]], [[0, 0, np.nan]], 0.5, "not_finite", "contacts.0.normal"),
        ([[0, 0, 0]], [UP], -0.1, "negative_mu", "contacts.0.mu"),
        ([[0, 0, 0]], [UP], np.nan, "negative_mu", "contacts.0.mu"),
        ([[0, 0, 1e7]], [UP], 0.5, "too_large", "contacts.0.position"),
        ([[0, 0, 0]], [UP, UP], 0.5, "shape", "contacts"),
        ([[0, 0, 0]] * 2, [UP] * 2, [0.5, 1e10], "too_large", "contacts.1.mu"),
    ],
)
def test_refused(position: list, normal: list, mu: float, code: str, field: str) -> None:
    with pytest.raises(StabilityError) as refused:
        contact_set(position, normal, mu)
    assert (refused.value.code, refused.value.field) == (code, field)


def test_normals_of_any_length() -> None:
    found = contact_set([[0, 0, 0]] * 3, [[0, 0, 1e-200], [0, 0, 1e200], [0, 3, 4]], np.inf)
    np.testing.assert_allclose(found.normal, [UP, UP, [0.0, 0.6, 0.8]], atol=1e-15)


@pytest.mark.parametrize("count", [1, 3, 8, 16, 37, 720])
def test_equally_spaced_directions_are_exact_and_symmetric(count: int) -> None:
    a = equally_spaced(count)
    angle = 2.0 * np.pi * np.arange(count) / count
    np.testing.assert_allclose(a, np.column_stack((np.cos(angle), np.sin(angle))), atol=1e-14)
    if count % 2 == 0:
        np.testing.assert_array_equal(a[: count // 2], -a[count // 2 :])
    if count % 4 == 0:
        np.testing.assert_array_equal(a[count // 4], [0.0, 1.0])


def test_directions_are_normalised_or_refused() -> None:
    np.testing.assert_allclose(unit([[3e-200, 4e-200], [1e300, 0.0]]), [[0.6, 0.8], [1.0, 0.0]], atol=1e-12)
    for bad, code in (([0.0, 0.0], "zero_direction"), ([np.nan, 1.0], "not_finite")):
        with pytest.raises(StabilityError) as refused:
            unit([[1.0, 0.0], bad])
        assert (refused.value.code, refused.value.field) == (code, "directions.1")


def test_arrays_of_any_layout_become_the_one_the_kernels_know() -> None:
    """Another layout, or one that may not be written to, would make the kernels compile anew, in a query."""
    rows = np.array([[0.1, 0.2, 0.3, 0.0, 0.0, 2.0, 0.5]])
    rows.flags.writeable = False
    columns = np.asfortranarray(np.tile(rows, (3, 1)))
    for table in (rows, columns):
        found = contact_set(table[:, :3], table[:, 3:6], table[:, 6])
        for array in (found.position, found.normal, found.mu):
            assert array.flags.c_contiguous
            assert array.flags.writeable
        np.testing.assert_allclose(found.normal[0], UP, atol=1e-15)
