"""Statistics: intervals hold the true value as often as they state, and pairing narrows them."""

import math

import numpy as np
import pytest

from surefoot.lab import statistics as s


def test_an_interval_of_a_mean_holds_it_in_95_percent() -> None:
    rng = np.random.default_rng(0)
    drawn = [s.interval(rng.normal(3.0, 2.0, 8)) for _ in range(1000)]
    assert 0.93 < np.mean([low <= 3.0 <= high for low, high in drawn]) < 0.97


def test_one_value_has_no_spread() -> None:
    assert math.isnan(s.half_width([1.0]))
    assert math.isnan(s.deviation([1.0]))
    assert s.middle_and_ends([3.0, 1.0, 2.0], 1, " s") == "median 2.0 s (1.0 to 3.0)"


@pytest.mark.parametrize(("k", "n"), [(0, 10), (10, 10), (95, 100)])
def test_a_rate_lies_within_its_interval(k: int, n: int) -> None:
    low, high = s.wilson(k, n)
    assert -1e-12 <= low <= k / n <= high <= 1.0 + 1e-12
    assert s.success_bound(k, n) <= k / n


def test_equal_measurements_do_not_differ() -> None:
    values = np.array([1.0, 2.0, 4.0])
    assert s.paired(values, values) == (0.0, 0.0, 0.0, 1.0, 1.0)


def test_pairs_tell_apart_what_groups_do_not() -> None:
    rng = np.random.default_rng(1)
    base = rng.uniform(10.0, 100.0, 20)
    found = s.paired(base + rng.normal(1.0, 0.2, 20), base)
    assert found.low < 1.0 < found.high
    assert found.p_paired < 1e-6 < 0.5 < found.p_welch
    assert s.p_of_mean(rng.normal(0.0, 1.0, 20)) > 0.01


def test_ratios_narrow_with_pairing() -> None:
    rng = np.random.default_rng(1)
    b = rng.uniform(0.5, 3.0, 20)
    exact = s.ratio(0.5 * b, b)
    assert exact.value == pytest.approx(0.5)
    assert exact.high - exact.low < 1e-9  # every pair has the same ratio, however much the seeds differ
    a = b * rng.uniform(0.2, 0.8, 20)
    one = s.ratio(a, b, np.random.default_rng(0))
    assert one.low < one.value < one.high < 0.8
    whole = s.mean_ratio([(a, b), (0.5 * b, b)])
    assert whole.value == pytest.approx(0.5 * (one.value + 0.5))
    assert whole.high - whole.low < one.high - one.low


def test_resampled_groups() -> None:
    rng = np.random.default_rng(2)
    walks = [rng.normal(k % 3, 1.0, 10) for k in range(12)]
    found = s.resampled(walks, lambda chosen: float(np.mean(np.concatenate(chosen))), 200)
    assert found.low < found.value < found.high
    assert s.resampled_mean(np.concatenate(walks)).value == pytest.approx(found.value)


def test_a_band_of_a_consistent_filter_holds_its_mean() -> None:
    low, high = s.chi_band(50)
    assert (round(low, 2), round(high, 2)) == (2.36, 3.72)


def test_a_region_holds_95_percent_of_the_errors_of_a_consistent_estimate() -> None:
    squares = (np.random.default_rng(2).standard_normal((200_000, 3)) ** 2).sum(axis=1)
    assert 0.9485 < np.mean(squares < s.REGION_95) < 0.9515
