"""The walker in the simulated world, with the real estimator; short walks, more in benchmarks/foothold_walks.py."""

import numpy as np
import pytest

from surefoot.lab.footholds.rules import model_rule
from surefoot.lab.footholds.walks import JoinedWalk, Setting, walk
from surefoot.services.footholds.models.score import HandScore
from surefoot.services.footholds.select import SelectParams
from surefoot.services.walker.interface import MotionCommand

CHOSEN = model_rule(HandScore(), SelectParams())


def test_walks_on_flat_ground_by_the_estimate_alone_without_sliding():
    result = walk(1, Setting(terrain="flat", distance=0.15), CHOSEN)
    assert result.reached
    assert result.x == pytest.approx(0.15, abs=0.015)
    assert result.sliding_mm < 0.5
    assert result.tilt_deg < 3.0
    assert result.unreachable == 0


def test_walks_over_the_first_hills_of_the_demo():
    result = walk(2, Setting(distance=0.4), CHOSEN)
    assert result.reached
    assert result.odometry_mm < 20.0


def test_turns_on_the_spot():
    turned = JoinedWalk(3, Setting(terrain="flat", command=MotionCommand("turn", angle=0.4)), CHOSEN).run()
    result, quat = turned.verdict(), turned.world.truth().quat_wxyz
    assert not result.fallen
    assert 2.0 * np.arctan2(quat[3], quat[0]) == pytest.approx(0.4, abs=0.03)
    assert np.hypot(result.x, result.y) < 0.02
