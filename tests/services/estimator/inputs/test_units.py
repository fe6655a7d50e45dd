"""Sensors in another unit, or mounted the wrong way round, are refused with the factor."""

import numpy as np
import pytest

from surefoot.geometry.constants import GRAVITY
from tests.services.estimator.test_stream import TICK, finite, make, run, walk


@pytest.mark.parametrize(
    ("which", "factor", "word"),
    [("acc", 1.0 / 9.81, "in g"), ("acc", -1.0, "other sign"), ("gyro", 180.0 / np.pi, "0.0174533")],
)
def test_a_sensor_in_another_unit_is_refused_with_the_factor(which, factor, word):
    def change(k, stamp, w, q, due):
        return (stamp, w, factor * q, due) if which == "acc" else (stamp, factor * w, q, due)

    estimator = make()
    estimates = list(run(walk(), estimator, change))
    assert estimator.check.counts["imu_unit"] > 100
    assert {"acc": "accelerometer", "gyro": "gyro"}[which] in estimator.check.unit
    assert word in estimates[-1].reasons[0] or word in estimates[-1].reasons[1]
    assert not estimates[-1].inputs_ok
    assert all(finite(e) for e in estimates)
    assert np.linalg.norm([e.velocity for e in estimates], axis=1).max() < 2.0


def test_a_robot_that_falls_over_is_no_reason_to_refuse_its_gyro():
    """It turns by a right angle on the edges of its feet: contacts hold, and no joint moves."""
    estimator, up, feet = make(), np.array([0.0, 0.0, GRAVITY]), walk().feet[0]
    for k in range(300):
        turn = np.array([0.0, 2.0 if 150 <= k < 230 else 0.0, 0.0])
        up = up - 0.01 * np.cross(turn, up)
        estimator.imu((k + 1) * TICK, turn + 1e-4 * np.sin(k), up + 1e-3 * np.sin(k + np.arange(3.0)))
        if k % 3 == 0:
            estimator.feet((k + 1) * TICK, feet.position + 1e-4 * np.sin(k), feet.rot, np.ones(2))
    assert estimator.check.unit == ""


@pytest.mark.parametrize("degrees", [0.0, 80.0, 100.0, 110.0, 180.0])
def test_the_sign_of_the_accelerometer_is_known_by_feet_that_are_above(degrees):
    """A robot on its side, whose feet still show contact, has a right accelerometer; on its head it seems wrong."""
    estimator, feet, random = make(), walk().feet[0], np.random.default_rng(1)
    lean = np.radians(degrees)
    up = GRAVITY * np.array([np.sin(lean), 0.0, np.cos(lean)])
    for k in range(400):
        estimator.imu((k + 1) * TICK, 1e-3 * random.standard_normal(3), up + 0.01 * random.standard_normal(3))
        if k % 3 == 0:
            estimator.feet((k + 1) * TICK, feet.position, feet.rot, np.ones(2))
    assert ("other sign" in estimator.check.unit) == (degrees == 180.0)
