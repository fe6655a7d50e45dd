"""Commands as advances of the trunk."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from surefoot.geometry.rotations import wrap_angle
from surefoot.robot.reader import load_robot
from surefoot.services.walker.interface import BodyPose, MotionCommand
from surefoot.services.walker.legged.params import WalkerParams
from surefoot.services.walker.legged.route import LeggedRoute, advance, finished, moved, remaining

P = WalkerParams.for_robot(load_robot("ragno"))


def follow(command, start, error=(0.0, 0.0, 0.0), steps=400):
    route, pose = (
        LeggedRoute(command, start, 1),
        BodyPose(start.x + error[0], start.y + error[1], 0.0, start.yaw + error[2]),
    )
    for n in range(steps):
        if finished(route, pose, P):
            return pose, n
        pose = moved(pose, advance(route, pose, P, 2))
    raise AssertionError("never finished")


@given(st.floats(-2.0, 2.0), st.floats(-3.0, 3.0), st.floats(-0.05, 0.05), st.floats(-0.3, 0.3))
def test_a_walk_ends_at_its_distance_on_its_line(distance, yaw, across, heading):
    start = BodyPose(0.3, -0.2, 0.0, yaw)
    pose, _ = follow(MotionCommand("walk", distance=distance), start, (0.0, 0.0, heading))
    c, s = math.cos(yaw), math.sin(yaw)
    along = c * (pose.x - start.x) + s * (pose.y - start.y)
    assert along == pytest.approx(distance, abs=P.distance_tolerance_m + 1e-9)
    if abs(distance) > 1.0:
        assert abs(-s * (pose.x - start.x) + c * (pose.y - start.y)) < 0.01
        assert abs(wrap_angle(pose.yaw - yaw)) < 0.02


@given(st.floats(-6.0, 6.0))
def test_a_turn_ends_at_its_angle_on_the_spot(angle):
    pose, _ = follow(MotionCommand("turn", angle=angle), BodyPose(1.0, 2.0, 0.0, 0.5))
    assert pose.yaw == pytest.approx(0.5 + angle, abs=P.angle_tolerance_rad + 1e-9)
    assert (pose.x, pose.y) == (1.0, 2.0)


def test_velocity_sets_the_way_of_a_step_within_the_longest_stride():
    slow = advance(LeggedRoute(MotionCommand("walk", velocity=0.02), BodyPose(), 1), BodyPose(), P, 2)
    assert slow.forward == pytest.approx(0.02 * 0.5 * P.period_s)
    fast = advance(LeggedRoute(MotionCommand("walk", velocity=1.0), BodyPose(), 1), BodyPose(), P, 2)
    assert fast.forward == pytest.approx(0.5 * P.max_stride_m)
    back = advance(LeggedRoute(MotionCommand("walk", velocity=-0.02), BodyPose(), 1), BodyPose(), P, 2)
    assert back.forward == pytest.approx(-0.01)


def test_a_walk_without_distance_never_ends_and_stand_is_done_at_once():
    route = LeggedRoute(MotionCommand("walk"), BodyPose(), 1)
    assert remaining(route, BodyPose(x=50.0)) == math.inf
    assert not finished(route, BodyPose(x=50.0), P)
    assert finished(LeggedRoute(MotionCommand("stand"), BodyPose(), 1), BodyPose(), P)
    assert advance(LeggedRoute(MotionCommand("stand"), BodyPose(), 1), BodyPose(), P, 2).forward == 0.0


@given(st.integers(2, 6))
def test_speed_of_a_cycle_does_not_depend_on_the_number_of_groups(groups):
    step = advance(LeggedRoute(MotionCommand("walk", distance=1.0), BodyPose(), 1), BodyPose(), P, groups)
    assert step.forward * groups == pytest.approx(P.stride_m)
