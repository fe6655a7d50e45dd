"""The walker in the simulated world, with the real estimator; short walks, more in benchmarks/foothold_walks.py."""

import numpy as np
import pytest

from surefoot.lab.footholds.rules import model_rule
from surefoot.lab.footholds.walks import JoinedWalk, Setting, walk
from surefoot.services.footholds.models.score import HandScore
from surefoot.services.footholds.select import SelectParams
from surefoot.services.walker.interface import MotionCommand

CHOSEN = model_rule(HandScore(), SelectParams())
RULES = {"ragno": CHOSEN, "lupo": None}
"""Rule of the footholds by robot; None = nominal ones, as the foothold service knows no roll-pitch-pitch legs."""
WAYS = {"ragno": 0.15, "lupo": 0.3}
"""Way of a short walk by robot, m."""
MOST_SLIDING_MM = {"ragno": 0.5, "lupo": 1.5}
"""Largest mean of the sliding of a stance, mm: a foot of Lupo bears five times the load."""


@pytest.mark.parametrize("robot", RULES)
def test_walks_on_flat_ground_by_the_estimate_alone_without_sliding(robot):
    result = walk(1, Setting(terrain="flat", distance=WAYS[robot], robot=robot), RULES[robot])
    assert result.reached
    assert result.x == pytest.approx(WAYS[robot], abs=0.015)
    assert result.sliding_mm < MOST_SLIDING_MM[robot]
    assert result.tilt_deg < 3.0
    assert result.unreachable == 0


def test_walks_over_the_first_hills_of_the_demo():
    result = walk(2, Setting(distance=0.3), CHOSEN)
    assert result.reached
    assert result.odometry_mm < 20.0


def test_crawls_over_rough_ground_with_a_margin_in_every_step():
    setting = Setting("rough", 0.4, 0.04, robot="lupo")
    result = walk(2, setting)
    assert result.reached
    assert result.odometry_mm < 20.0
    assert result.margin_mm > 20.0
    assert result.tilt_deg < 5.0


@pytest.mark.parametrize("robot", RULES)
def test_turns_on_the_spot(robot):
    setting = Setting("flat", robot=robot, command=MotionCommand("turn", angle=0.4))
    turned = JoinedWalk(3, setting, RULES[robot]).run()
    result, quat = turned.verdict(), turned.world.truth().quat_wxyz
    assert not result.fallen
    assert 2.0 * np.arctan2(quat[3], quat[0]) == pytest.approx(0.4, abs=0.03)
    assert np.hypot(result.x, result.y) < 0.02
