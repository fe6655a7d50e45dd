"""Rows at stamps between those that were stored."""

import numpy as np

from surefoot.services.estimator.paper.history import ROWS, History


def test_interpolates_and_clamps():
    history = History(2)
    for k in range(3 * ROWS):
        history.put(10 * k, np.array([k, -k], dtype=float))
    newest, oldest = 3 * ROWS - 1, 2 * ROWS
    assert len(history) == ROWS
    np.testing.assert_allclose(history.at(10 * newest - 7), [newest - 0.7, 0.7 - newest])
    np.testing.assert_allclose(history.at(10 * newest + 50), [newest, -newest])
    np.testing.assert_allclose(history.at(0), [oldest, -oldest])
    history.clear()
    assert len(history) == 0


def test_a_young_history_knows_little():
    history = History(1)
    history.put(100, np.array([5.0]))
    np.testing.assert_allclose([history.at(0), history.at(1000)], 5.0)
