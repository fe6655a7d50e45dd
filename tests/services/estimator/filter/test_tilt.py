"""Tilts of robots that were knocked over, which only a rest shows."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from surefoot.geometry.constants import GRAVITY
from surefoot.services.estimator.stream import BEST
from tests.services.estimator.test_stream import TICK, make, walk


def lie_down(angle, lost=60):
    """Return the estimates, each with its pose, of a robot that lies still with its feet in the air.

    It stood for a second, and then turned by an angle (a vector, rad) while its gyro was at the end of its range for so
    many ticks.
    """
    estimator, random, feet = make(names=(BEST,)), np.random.default_rng(0), walk().feet[0]
    up, found = np.array([0.0, 0.0, GRAVITY]), []
    turned = Rotation.from_rotvec(angle).inv().apply(up)
    for k in range(400):
        q = (up if k < 100 else turned) + 0.02 * random.standard_normal(3)
        w = 0.002 * random.standard_normal(3)
        if 100 <= k < 100 + lost:
            w = np.full(3, 1e3)
        estimator.imu((k + 1) * TICK, w, q)
        if k % 3 == 0:
            estimator.feet((k + 1) * TICK, feet.position, feet.rot, np.full(2, float(k < 100)))
        if k > 103 + lost:  # the first sample after the gap is refused: its stamp could be wrong
            found.append((estimator.estimate(), estimator.pose()))
    return found


def tilt_of(estimate):
    return math.acos(math.cos(estimate.roll) * math.cos(estimate.pitch))


@pytest.mark.parametrize("degrees", [10.0, 45.0, 90.0, 135.0, 180.0])
@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.6, -0.8, 0.0)])
def test_a_rest_shows_how_a_robot_lies_that_was_knocked_over_unseen(axis, degrees):
    found = lie_down(math.radians(degrees) * np.array(axis))
    (first, _), (last, pose) = found[0], found[-1]
    assert tilt_of(first) < math.radians(3.0)
    assert tilt_of(last) == pytest.approx(math.radians(degrees), abs=math.radians(1.0))
    assert last.initialised
    assert np.linalg.norm(last.velocity) < 0.1
    sd = math.sqrt(pose.covariance[5, 5])
    assert sd < 0.1 if degrees < 40.0 else sd > 0.9 or degrees < 60.0  # it has fallen: its heading may be any
    assert np.isfinite(pose.covariance).all()
    wrong = [e.filter_ok for e, _ in found if abs(tilt_of(e) - math.radians(degrees)) > math.radians(5.0)]
    assert sum(wrong) <= 50  # ticks: half a second


def test_a_tilt_by_less_than_the_bias_may_be_is_left_alone():
    """3 deg: 0.5 m/s^2, three standard deviations of the bias."""
    found = lie_down(np.radians([3.0, 0.0, 0.0]))
    assert all(e.initialised for e, _ in found)
    assert math.sqrt(found[-1][1].covariance[5, 5]) < 0.1
