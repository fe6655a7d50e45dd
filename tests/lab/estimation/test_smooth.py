"""Logs run backward, and estimates smoothed over the whole log."""

import math
from dataclasses import replace

import numpy as np
import pytest

from surefoot.errors import SurefootError
from surefoot.lab.estimation.reverse import begins, follows, reversed_log
from surefoot.lab.estimation.scores import score
from surefoot.lab.estimation.smooth import fused, mirrored, smooth
from surefoot.lab.estimation.track import track
from tests.lab.estimation.walks import clean, noisy
from tests.surefoot.expect import expect_error

COLUMNS = ("stamp_ns", "w", "q", "foot_ns", "foot_position", "foot_rot", "contact", "touch", "joints")


@pytest.mark.parametrize("lost", [slice(0, 0), slice(400, 409)], ids=["whole", "gap"])
def test_twice_reversed_is_the_log(lost):
    log = noisy()
    log = log.with_imu(np.delete(np.arange(len(log.stamp_ns)), lost))
    back = reversed_log(reversed_log(log))
    for name in COLUMNS:
        a, b = getattr(log, name), getattr(back, name)
        assert (a is None) == (b is None)
        if a is not None:
            np.testing.assert_array_equal(a, b)


def test_backward_rows_are_means_over_the_same_intervals():
    log = noisy().with_imu(np.delete(np.arange(2000), slice(400, 409)))
    other = reversed_log(log)
    total = int(other.stamp_ns[-1] + begins(log)[0])
    np.testing.assert_array_equal(total - other.stamp_ns[::-1], begins(log))
    np.testing.assert_array_equal(total - begins(other)[::-1], log.stamp_ns)
    assert not follows(log)[399]  # what is after the gap is not the future of the row before it
    assert follows(log)[:399].all()
    assert (other.foot_ns > other.stamp_ns[0]).any()


def test_a_foot_sample_at_a_row_counts_in_one_direction_only():
    log = noisy()
    log = replace(log, foot_ns=log.stamp_ns[np.searchsorted(log.stamp_ns, log.foot_ns).clip(max=1999)])
    other = reversed_log(log)
    assert not np.isin(other.foot_ns, other.stamp_ns).any()


def test_an_exact_walk_backward_is_the_reversed_truth():
    log = clean()
    back = mirrored(track("best", reversed_log(log), joint=True, start_slope_sd=math.inf), follows(log))
    rows = slice(20, len(log.stamp_ns) - 150)  # it starts in motion, at the end of the log
    assert back.flags["initialised"][rows].all()
    assert np.abs(back.v - log.v)[rows].max() < 5e-3
    assert np.sqrt(np.mean(np.sum((back.v - log.v)[rows] ** 2, axis=1))) < 1.5e-3
    turned = np.unwrap(np.arctan2(log.rot[:, 1, 0], log.rot[:, 0, 0]))
    np.testing.assert_allclose(back.yaw[rows] - back.yaw[20], turned[rows] - turned[20], atol=5e-3)
    np.testing.assert_allclose(np.linalg.norm(back.g[rows], axis=1), 9.81, atol=1e-6)


@pytest.mark.parametrize("kind", ["twist", "slip"])
@pytest.mark.parametrize("seed", range(3))
def test_smoothed_is_better_than_forward_and_knows_how_good_it_is(kind, seed):
    log = noisy(kind, seed)
    ahead, found = score(log, track("best", log)), score(log, smooth("best", log))
    assert found.rmse < 0.85 * ahead.rmse
    assert found.smooth < 0.9 * ahead.smooth
    assert found.rpe_1s < 1.05 * ahead.rpe_1s
    assert found.ate < 1.1 * ahead.ate
    assert 0.4 < found.nees / 3.0 < 2.0
    assert found.integral < 1e-4  # the velocity is the derivative of the path


def test_rows_before_the_start_have_an_estimate():
    log = noisy("slip", 1)
    log = log.with_imu(np.arange(700, 2000))
    log = log.with_feet(log.foot_ns > log.stamp_ns[0])
    ahead, found = track("best", log), smooth("best", log)
    first = int(np.argmax(ahead.flags["initialised"]))
    assert first > 20
    assert found.flags["initialised"][:first].all()
    assert np.sqrt(np.mean(np.sum((found.v - log.v)[:first] ** 2, axis=1))) < 0.01
    assert (np.linalg.eigvalsh(found.p) > 0.0).all()


def test_a_pass_that_is_not_ok_weighs_nothing():
    log = noisy()
    ahead, back = track("best", log, joint=True), track("best", reversed_log(log), joint=True)
    back = mirrored(back, follows(log))

    bad = replace(back, v=back.v + 1.0, flags={**back.flags, "filter_ok": np.zeros(len(log.stamp_ns), dtype=bool)})
    rows = ahead.flags["initialised"]
    np.testing.assert_allclose(fused(log, ahead, bad).p[rows], ahead.p[rows], atol=1e-15)
    assert np.abs(fused(log, ahead, bad).v - ahead.v)[rows].max() < 0.02  # only so that the path is its integral


def test_covariance_grows_where_the_passes_disagree():
    log = noisy()
    ahead = track("best", log, joint=True)
    back = mirrored(track("best", reversed_log(log), joint=True), follows(log))

    off = replace(back, v=back.v + np.where(np.arange(2000) > 1000, 0.05, 0.0)[:, None])
    good, bad = (np.trace(fused(log, ahead, one).p[:, 3:, 3:], axis1=1, axis2=2) for one in (back, off))
    assert (bad[1200:1800] > 10.0 * good[1200:1800]).all()
    np.testing.assert_allclose(bad[200:800], good[200:800])


def test_what_cannot_be_smoothed_is_refused():
    with expect_error(SurefootError, "invalid", text="goes with the estimator best"):
        smooth("inekf", noisy())
    log = noisy()
    stamp = log.stamp_ns.copy()
    stamp[500:] -= 1_000_000_000
    with expect_error(SurefootError, "invalid", text="backwards"):
        smooth("best", replace(log, stamp_ns=stamp))
