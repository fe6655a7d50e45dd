"""The localiser follows odometry that corrects its past."""

import math

import numpy as np
import pytest

from surefoot.schemas.state import Odometry
from surefoot.schemas.topics import TICK_NS
from surefoot.services.navigator.belief.relocalise import between
from surefoot.services.navigator.config import NavigatorConfig
from surefoot.services.navigator.localiser import Localiser
from surefoot.services.navigator.policy.params import load


def odometry(tick: int, x: float, y: float, yaw: float, variance: float) -> Odometry:
    """Return the odometry of a tick, with a variance of its heading."""
    covariance = np.diag([1e-4, 1e-4, 1e-6, variance]).ravel().tolist()
    return Odometry(
        position=(x, y, 0.3), quat_wxyz=(1, 0, 0, 0), yaw=yaw, velocity=(0, 0, 0), covariance=covariance,
        initialised=True,
    ).stamped(tick * TICK_NS, tick, 1, tick, "estimator")  # fmt: skip


def walked(correction: float) -> Localiser:
    """Return a localiser after 1 m straight on, a rest in which the heading is corrected, and 0.5 m more."""
    localiser = Localiser(NavigatorConfig(robot="nao", control="odometry"), load("nao"))
    c, s = math.cos(correction), math.sin(correction)
    for tick in range(200):
        x, y, yaw, variance = 0.01 * min(tick, 100), 0.0, 0.0, 1e-3 * (1 + tick)
        if tick > 110:  # the whole way is turned about its begin
            x, y, yaw, variance = c * x - s * y, s * x + c * y, correction, 1e-4 * (1 + tick)
        if tick > 150:
            x, y = x + 0.01 * c * (tick - 150), y + 0.01 * s * (tick - 150)
        localiser.odometry(odometry(tick, x, y, yaw, variance), 0.01 * tick)
    return localiser


@pytest.mark.parametrize("correction", [0.3, -0.2, math.pi])
def test_a_correction_of_the_past_moves_the_odometry_and_not_the_robot(correction: float) -> None:
    plain, corrected = walked(0.0), walked(correction)
    assert plain.tracker.pose == pytest.approx((1.4, 0.0, 0.0), abs=0.1)
    assert corrected.tracker.pose == pytest.approx(plain.tracker.pose, abs=1e-9)
    assert corrected.odom is not None
    assert corrected.map_from_odom == pytest.approx(between(corrected.tracker.pose, corrected.odom))
    assert math.hypot(*corrected.map_from_odom[:2]) < 0.1 + 1e-6 + abs(math.sin(correction))


def test_a_turn_whose_variance_does_not_fall_is_a_motion() -> None:
    localiser = Localiser(NavigatorConfig(robot="nao", control="odometry"), load("nao"))
    for tick in range(100):
        localiser.odometry(odometry(tick, 0.0, 0.0, 0.01 * tick, 1e-3), 0.01 * tick)
    assert localiser.tracker.pose[2] == pytest.approx(0.9, abs=0.1)
