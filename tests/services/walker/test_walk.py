"""The walker in the simulated world, with the real estimator; short walks, more in benchmarks/bench_walk.py."""

import numpy as np
import pytest

from benchmarks.bench_walk import Setting, walk
from surefoot.services.walker.interface import MotionCommand


def test_walks_on_flat_ground_by_the_estimate_alone_without_sliding():
    result = walk(1, Setting(terrain="flat", distance=0.15))
    assert result.reached
    assert result.x == pytest.approx(0.15, abs=0.015)
    assert result.sliding_mm < 0.5
    assert result.tilt_deg < 3.0
    assert result.unreachable == 0


def test_walks_over_the_first_hills_of_the_demo():
    result = walk(2, Setting(distance=0.4))
    assert result.reached
    assert result.odometry_mm < 20.0


def test_turns_on_the_spot():
    yaw = []
    setting = Setting(terrain="flat", command=MotionCommand("turn", angle=0.4))
    result = walk(3, setting, lambda world, walker, out: yaw.append(world.truth().quat_wxyz))
    assert not result.fallen
    assert 2.0 * np.arctan2(yaw[-1][3], yaw[-1][0]) == pytest.approx(0.4, abs=0.03)
    assert np.hypot(result.x, result.y) < 0.02
