"""Samples of the feet that the filter leaves out: repeated errors, and feet that never fit."""

import numpy as np
import pytest

from surefoot.geometry.constants import GRAVITY
from surefoot.lab.estimation.planted import frozen
from surefoot.services.estimator.feet.mount import bare_mount
from surefoot.services.estimator.params import EstimatorParams
from surefoot.services.estimator.stream import BEST, Estimator
from tests.services.estimator.test_order import fed, stirred
from tests.services.estimator.test_stream import TICK, make, run, walk


def test_samples_of_the_feet_that_repeat_the_errors_of_the_last_are_left_out():
    """Between the samples of the feet others, 1 cm wrong: the estimate is that of the slow feet."""
    log, slow, fast = walk(seed=3), make(names=(BEST,)), make(names=(BEST,))

    def wrong(k, stamp, w, q, due):
        more = [s._replace(stamp_ns=s.stamp_ns + 8_000_000, position=s.position + 0.01) for s in due]
        return stamp, w, q, [*due, *more] if k > 250 else due

    for one, other in zip(run(log, slow), run(log, fast, wrong), strict=True):
        np.testing.assert_allclose(one.velocity_imu, other.velocity_imu, atol=1e-4)


def test_a_switch_that_hangs_while_its_foot_swings_is_named():
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
    flagged = [k for k, e in enumerate(found) if any(r.startswith("switch of foot 3 ") for r in e.reasons)]
    assert 200 < flagged[0] < 300
    assert not found[flagged[0]].sensors_ok
    assert np.abs([e.velocity for e in found[200:]]).max() < 0.02


STILL_LEG = "left out: foot 1, whose encoders stand still"


@pytest.mark.parametrize("seed", range(3))
def test_a_leg_whose_encoders_stand_still_is_named_within_half_a_second_on_the_ground(seed):
    log = frozen(walk(seed=seed), 5.0, [1])
    found = list(run(log, make(names=(BEST,))))
    stands = np.interp(log.stamp_ns, log.foot_ns, log.contact[:, 1]) >= 0.5
    since = np.cumsum((log.seconds > 5.0) & stands) * 1e-9 * TICK
    named = [any(r.startswith(STILL_LEG) for r in e.reasons) for e in found]
    first = named.index(True)
    assert log.seconds[first] > 5.0
    assert since[first] < 0.5
    assert not found[first].sensors_ok
    assert all(named[first:][:100])


def test_a_standing_robot_that_lifts_one_leg_has_no_encoder_that_stands_still():
    """Three legs repeat one sample to the bit for 8 s, and the gyro has an offset that no rest has shown yet."""
    estimator = Estimator(bare_mount(4), EstimatorParams(), names=(BEST,))
    feet = np.array([[0.2, 0.1, -0.3], [0.2, -0.1, -0.3], [-0.2, 0.1, -0.3], [-0.2, -0.1, -0.3]])
    rng = np.random.default_rng(6)
    for k in range(1, 1000):
        gyro = 0.05 + 0.005 * rng.normal(size=3)
        estimator.imu(k * TICK, gyro, [0.0, 0.0, GRAVITY] + 0.03 * rng.normal(size=3))
        if k % 4 == 0:
            seen = feet.copy()
            seen[3, 2] += abs(0.05 * np.sin(0.1 * (k - 200))) if k > 200 else 0.0
            estimator.feet(k * TICK, seen, np.tile(np.eye(3), (4, 1, 1)), [True, True, True, k <= 200])
        assert not any(r.startswith("left out") for r in estimator.estimate().reasons)


def test_encoders_that_are_held_for_some_samples_do_not_stand_still():
    """Every sample of the feet comes four times, with stamps of its own."""
    log, estimator = walk(seed=1), make(names=(BEST,))

    def held(k, stamp, w, q, due):
        return stamp, w, q, [s._replace(stamp_ns=s.stamp_ns + i * 2_000_000) for s in due for i in range(4)]

    assert all(e.sensors_ok for e in run(log, estimator, held))


def test_a_leg_that_stands_still_leaves_the_order_of_arrival_without_effect():
    log = frozen(walk(), 5.0, [1])
    ordered = sorted([(False, i) for i in range(len(log.stamp_ns))] + [(True, i) for i in range(len(log.feet))],
                     key=lambda a: log.feet[a[1]].stamp_ns if a[0] else int(log.stamp_ns[a[1]]))  # fmt: skip
    one, _ = fed(log, ordered, make(names=(BEST,)))
    other, _ = fed(log, stirred(log, 0), make(names=(BEST,)))
    np.testing.assert_array_equal(one.velocity, other.velocity)
