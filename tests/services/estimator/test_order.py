"""The order of arrival does not matter to `best`."""

import numpy as np
import pytest

from tests.services.estimator.test_stream import BEST, TICK, make, rms, run, walk


def stirred(log, seed, lag=8):
    """Arrivals of all samples, each up to `lag` rows late: (is a foot sample, index)."""
    n = len(log.stamp_ns)
    due = np.concatenate([np.arange(n), np.searchsorted(log.stamp_ns, log.foot_ns) + 0.5])
    late = due + np.random.default_rng(seed).uniform(0.0, lag, len(due))
    return [(bool(i >= n), int(i - n if i >= n else i)) for i in np.argsort(late)]


def fed(log, arrivals, estimator):
    for number, (foot, i) in enumerate(arrivals):
        if foot:
            estimator.feet(*log.feet[i])
        else:
            estimator.imu(int(log.stamp_ns[i]), log.w[i], log.q[i])
        if number % 5 == 0:
            estimator.estimate()
    return estimator.estimate(), estimator.pose()


@pytest.mark.parametrize("seed", range(3))
def test_the_order_of_arrival_does_not_change_one_bit(seed):
    log = walk()
    n = len(log.stamp_ns)
    ordered = sorted([(False, i) for i in range(n)] + [(True, i) for i in range(len(log.feet))],
                     key=lambda a: log.feet[a[1]].stamp_ns if a[0] else int(log.stamp_ns[a[1]]))  # fmt: skip
    one, other = make(names=(BEST,)), make(names=(BEST,))
    e, pose = fed(log, ordered, one)
    f, place = fed(log, stirred(log, seed), other)
    assert other.check.refused == 0
    for a, b in ((e.velocity, f.velocity), (e.covariance, f.covariance), (pose.position, place.position)):
        np.testing.assert_array_equal(a, b)


def test_the_legs_do_not_need_aligned_stamps():
    log = walk()
    shifted = log.with_feet(log.foot_ns % TICK != 0)
    assert rms(shifted, list(run(shifted, make()))) < 0.01
