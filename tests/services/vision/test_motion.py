"""Motion since an image, by odometry that may correct its past."""

import math

import numpy as np
import pytest

from surefoot.robot.reader import load_robot
from surefoot.schemas.state import Odometry
from surefoot.schemas.topics import TICK_NS
from surefoot.services.vision.motion import MotionHistory, since


def history(correction: float) -> MotionHistory:
    """Return 20 ticks of a walk along x, at 10 mm a tick, whose heading is corrected after half of them."""
    motion = MotionHistory(load_robot("nao"))
    for tick in range(20):
        turn, variance = (correction, 1e-4) if tick > 10 and correction else (0.0, 1e-2)
        x, y = 0.01 * tick * math.cos(turn), 0.01 * tick * math.sin(turn)
        message = Odometry(
            position=(x, y, 0.3), quat_wxyz=(math.cos(0.5 * turn), 0, 0, math.sin(0.5 * turn)), yaw=turn,
            velocity=(0, 0, 0), covariance=np.diag([1e-4, 1e-4, 1e-6, variance]).ravel().tolist(), initialised=True,
        )  # fmt: skip
        motion.moved(message.stamped(tick * TICK_NS, tick, 1, tick, "estimator"))
    return motion


@pytest.mark.parametrize("correction", [0.4, -1.0])
def test_places_seen_before_a_correction_stay_where_they_are_beside_the_robot(correction: float) -> None:
    places = np.array([[0.5, 0.0], [0.7, 0.2]])
    moments = [history(turn)._moments for turn in (0.0, correction)]
    plain, corrected = (since(places, kept[0], kept[-1]) for kept in moments)
    assert plain == pytest.approx(places - (0.19, 0.0), abs=1e-9)
    assert corrected == pytest.approx(places - (0.18, 0.0), abs=1e-9)  # less the step in which it was corrected
