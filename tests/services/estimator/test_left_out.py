"""Samples of the feet that the filter leaves out: repeated errors, and feet that never fit."""

import numpy as np

from surefoot.geometry.constants import GRAVITY
from surefoot.services.estimator.feet.mount import bare_mount
from surefoot.services.estimator.params import EstimatorParams
from surefoot.services.estimator.stream import BEST, Estimator
from tests.services.estimator.test_stream import TICK, make, run, walk


def test_samples_of_the_feet_that_repeat_the_errors_of_the_last_are_left_out():
    """Between the samples of the feet others, 1 cm wrong: the estimate is that of the slow feet."""
    log, slow, fast = walk(seed=3), make(names=(BEST,)), make(names=(BEST,))

    def wrong(k, stamp, w, q, due):
        more = [s._replace(stamp_ns=s.stamp_ns + 8_000_000, position=s.position + 0.01) for s in due]
        return stamp, w, q, [*due, *more] if k > 250 else due

    for one, other in zip(run(log, slow), run(log, fast, wrong), strict=True):
        np.testing.assert_allclose(one.velocity_imu, other.velocity_imu, atol=1e-4)


def test_a_foot_that_never_fits_is_left_out_and_named():
    """Three feet stand; the switch of the fourth hangs while its leg swings by 5 cm, up and down."""
    estimator = Estimator(bare_mount(4), EstimatorParams(), names=(BEST,))
    feet = np.array([[0.2, 0.1, -0.3], [0.2, -0.1, -0.3], [-0.2, 0.1, -0.3], [-0.2, -0.1, -0.3]])
    found, rng = [], np.random.default_rng(6)
    for k in range(1, 500):
        estimator.imu(k * TICK, 0.005 * rng.normal(size=3), [0.0, 0.0, GRAVITY] + 0.03 * rng.normal(size=3))
        if k % 4 == 0:
            seen = feet.copy()
            seen[3, 2] += 0.05 * np.sin(0.1 * (k - 200)) if k > 200 else 0.0
            estimator.feet(k * TICK, seen, np.tile(np.eye(3), (4, 1, 1)), np.ones(4, dtype=bool))
        found.append(estimator.estimate())
    assert all(e.sensors_ok for e in found[100:200])
    flagged = [k for k, e in enumerate(found) if any(r.startswith("left out: foot 3,") for r in e.reasons)]
    assert 200 < flagged[0] < 300
    assert not found[flagged[0]].sensors_ok
    assert np.abs([e.velocity for e in found[200:]]).max() < 0.02
