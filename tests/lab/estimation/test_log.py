"""Order of arrival, cuts of time, contact points."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.lab.estimation.log import segments
from tests.lab.estimation.walks import clean, noisy


def test_feet_arrive_after_the_first_inertial_row_at_or_after_their_stamp():
    log = clean()
    n, order = len(log.stamp_ns), log.arrival()
    np.testing.assert_array_equal(np.sort(order), np.arange(n + len(log.foot_ns)))
    newest = -1
    for at in order:
        if at < n:
            newest = log.stamp_ns[at]
        else:
            assert newest - 10_000_000 < log.foot_ns[at - n] <= newest


def test_segments_add_up_and_hold_the_row_that_covers_them():
    log = clean()
    cut = segments(log)
    ends = log.stamp_ns[0] + np.cumsum(cut.d)[0:] * 1e9 - cut.d[0] * 1e9
    assert ends[-1] == pytest.approx(log.stamp_ns[-1])
    assert cut.last.sum() == len(log.stamp_ns)
    assert (log.stamp_ns[cut.row] >= ends - 1).all()
    assert (np.diff(cut.row) <= 1).all()
    inside = (log.foot_ns > log.stamp_ns[0]) & (log.foot_ns <= log.stamp_ns[-1])
    np.testing.assert_array_equal(cut.feet[cut.feet >= 0], np.flatnonzero(inside))
    np.testing.assert_allclose(ends[cut.feet >= 0], log.foot_ns[inside])


def test_points_of_a_sole_move_with_the_foot():
    log = noisy()
    one, _ = log.point_views(False)
    several, touch = log.point_views(True)
    assert one.shape[1] == 2
    assert several.shape[1] == touch.shape[1] == 8
    apart = np.linalg.norm(several[:, :4] - one[:, :1], axis=2)
    np.testing.assert_allclose(apart, np.linalg.norm(log.points[0], axis=1)[None] * np.ones((len(apart), 1)))


def test_a_log_without_truth_says_so():
    with pytest.raises(ValueError, match="no truth"):
        _ = replace(clean(), truth=None).v
