"""Samples in the order of their stamps."""

import numpy as np

from surefoot.services.estimator.filter.samples import CAPACITY, after, insert_imu, new_samples


def store(stamps):
    """Insert samples in this order; return them, their number, and True for each that was inserted."""
    samples, count, taken = new_samples(1, 1), 0, []
    for s in stamps:
        end = insert_imu(samples, count, int(s), np.full(3, float(s)), np.full(3, -float(s)))
        count = count if end < 0 else end
        taken.append(end >= 0)
    return samples, count, taken


def test_samples_are_in_order_whatever_comes_first():
    samples, count, taken = store([*np.random.default_rng(0).permutation(200), 7])
    assert taken == [True] * 200 + [False]
    assert count == 200
    assert samples.imu_stamps[:200].tolist() == list(range(200))
    np.testing.assert_array_equal(samples.imu[:200, 0], np.arange(200.0))
    np.testing.assert_array_equal(samples.imu[:200, 5], -np.arange(200.0))
    assert after(samples.imu_stamps[:200], 99) == 100


def test_a_full_store_keeps_the_newest():
    samples, count, taken = store([*range(3 * CAPACITY), 3 * CAPACITY - 5])
    assert all(taken[:-1])
    assert not taken[-1]
    assert count >= CAPACITY // 2
    assert samples.imu_stamps[:count].tolist() == list(range(3 * CAPACITY - count, 3 * CAPACITY))
