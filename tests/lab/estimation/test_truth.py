"""Velocity of captured positions, against scipy's filter of the same kind."""

import numpy as np
import pytest
from scipy.signal import savgol_filter

from surefoot.lab.estimation.truth import slopes


@pytest.mark.parametrize(("rows", "window"), [(5, 5), (31, 31), (40, 7), (500, 31)])
def test_slopes_are_those_of_scipy(rows, window):
    values = np.cumsum(np.random.default_rng(rows).normal(size=(rows, 3)), axis=0)
    expected = savgol_filter(values, window, 3, deriv=1, delta=0.01, axis=0)
    np.testing.assert_allclose(slopes(values, window, 0.01), expected, atol=1e-9)


def test_a_cubic_is_met_exactly():
    t = np.arange(20) * 0.1
    found = slopes(np.stack([t**3 - t, 2.0 * t**2], axis=1), 9, 0.1)
    np.testing.assert_allclose(found, np.stack([3.0 * t**2 - 1.0, 4.0 * t], axis=1), atol=1e-9)
