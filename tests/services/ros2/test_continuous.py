"""Odometry for ROS 2: a correction of the past is no jump."""

import math

import numpy as np
import pytest

from surefoot.geometry.rotations import matrix_from_quat, quat_from_rpy
from surefoot.schemas.state import Odometry
from surefoot.services.ros2.continuous import ContinuousOdometry, turned

SPREAD = np.diag([4e-4, 1e-4, 1e-5, 3e-5, 2e-5, 1e-3])


def odometry(x: float, y: float, yaw: float, variance: float) -> Odometry:
    """Return odometry of a robot that walks ahead at 0.2 m/s, slightly tilted."""
    return Odometry(
        position=(x, y, 0.3), quat_wxyz=quat_from_rpy(0.05, -0.03, yaw), yaw=yaw,
        velocity=(0.2 * math.cos(yaw), 0.2 * math.sin(yaw), 0.0),
        covariance=np.diag([4e-4, 1e-4, 1e-5, variance]).ravel().tolist(),
        pose_covariance=SPREAD.ravel().tolist(), initialised=True,
    )  # fmt: skip


def walk(corrections: dict[int, float]) -> list[Odometry]:
    """Return what is published of a walk along x whose heading is turned about the begin at some ticks."""
    continuous, found, turn, variance = ContinuousOdometry(), [], 0.0, 1e-3
    for tick in range(60):
        turn, variance = turn + corrections.get(tick, 0.0), variance * (0.5 if tick in corrections else 1.01)
        x = 0.02 * tick
        found.append(continuous.take(odometry(x * math.cos(turn), x * math.sin(turn), turn, variance)))
    return found


def test_without_a_correction_the_message_is_as_it_came() -> None:
    message = odometry(0.1, 0.0, 0.0, 1e-3)
    assert ContinuousOdometry().take(message) is message


@pytest.mark.parametrize("corrections", [{20: 0.4}, {20: -0.3, 40: 0.2}, {1: math.pi}])
def test_a_corrected_walk_is_published_as_one_without_a_jump(corrections: dict[int, float]) -> None:
    found = walk(corrections)
    steps = np.diff([message.position[:2] for message in found], axis=0)
    for tick, step in enumerate(steps, 1):
        assert math.hypot(*step) == pytest.approx(0.0 if tick in corrections else 0.02, abs=1e-9)
    for message in found:
        assert math.sin(message.yaw) == pytest.approx(0.0, abs=1e-9)
        assert message.position[1] == pytest.approx(0.0, abs=1e-9)
        assert message.velocity == pytest.approx((0.2, 0.0, 0.0), abs=1e-9)
        rot = matrix_from_quat(np.array(message.quat_wxyz))
        assert rot == pytest.approx(matrix_from_quat(np.array(quat_from_rpy(0.05, -0.03, 0.0))), abs=1e-9)


@pytest.mark.parametrize("turn", [0.3, -2.0])
def test_a_covariance_turns_with_its_axes(turn: float) -> None:
    rot = matrix_from_quat(np.array(quat_from_rpy(0.0, 0.0, turn)))
    whole = np.block([[rot, np.zeros((3, 3))], [np.zeros((3, 3)), rot]])
    assert turned(tuple(SPREAD.ravel()), turn) == pytest.approx((whole @ SPREAD @ whole.T).ravel().tolist())
    assert np.reshape(turned(tuple(np.eye(4).ravel()), turn), (4, 4)) == pytest.approx(np.eye(4))
