"""A standing robot that sees: the belief finds its place, a dark camera is flagged, blur takes landmarks away."""

import math
from functools import cache

import numpy as np
import pytest

from surefoot.errors import SurefootError
from surefoot.lab.vision.blur import by_speed, map_by_grid, share, still_camera
from surefoot.lab.vision.replay import RecordedMotion, WalkReplay, floor, images_of, read_motion
from surefoot.robot.kinematics import foot_positions
from surefoot.robot.reader import load_robot
from surefoot.schemas.hw import JointState
from surefoot.schemas.sim import Truth
from surefoot.schemas.state import GaitState, Odometry
from surefoot.schemas.topics import TICK_NS
from surefoot.services.simulator.physics.faults import Fault


@cache
def camera(exposure: float | None = None):
    return still_camera(floor("random", 0, "room"), exposure)


@cache
def world():
    return map_by_grid(camera(), "orb", (-0.1, 0.0, 0.1), (-0.05, 0.05))


def standing(ticks: int) -> RecordedMotion:
    """A robot that stands at the origin, its heading to the front."""
    robot = load_robot("nao")
    q = tuple(robot.neutral.tolist())
    height = -float(foot_positions(robot.model, robot.neutral)[:, 2].min())
    made = []
    for tick in range(ticks):
        head = (tick * TICK_NS, tick, 1, tick, "")
        feet = ((0.0, 0.0, 0.0),) * 2
        truth = Truth(
            position=(0, 0, height), quat_wxyz=(1, 0, 0, 0), velocity=(0, 0, 0), angular_velocity=(0, 0, 0),
            com=(0, 0, 0.2), joints=q, foot_position=feet, foot_force_n=(25, 25), foot_displacement=(0, 0),
            contact_sliding=(0, 0), stance_sliding=(0, 0), tilt=0, fallen=False,
        )  # fmt: skip
        odometry = Odometry(position=(0, 0, height), quat_wxyz=(1, 0, 0, 0), yaw=0, velocity=(0, 0, 0),
                            covariance=(0.0,) * 16, initialised=True)  # fmt: skip
        gait = GaitState(walk_id=0, state="standing", phase=0, stance=(True, True), footholds=feet, remaining=0)
        messages = {"sim/truth": truth, "state/odometry": odometry, "state/gait": gait}
        messages |= {"hw/joints": JointState(position=q)} if tick % 3 == 0 else {}
        made.append({key: message.stamped(*head) for key, message in messages.items()})
    return RecordedMotion(robot, made)


def test_the_belief_of_a_standing_robot_finds_its_place_by_images():
    motion = standing(260)
    found = WalkReplay(world(), begin=(0.04, -0.03, 0.05)).run(motion, images_of(motion, floor("random", 0, "room"), 3))
    assert math.hypot(*found[0].error[:2]) == pytest.approx(0.05)
    assert math.hypot(*found[-1].error[:2]) < 0.015
    assert abs(found[-1].error[2]) < 0.01
    assert found[-1].nees < 3.0
    assert not found[-1].lost
    assert sum(each.seen.fresh for each in found) >= 10
    assert all(each.seen.flags == () for each in found)


@pytest.mark.parametrize("kind", ["camera_dark", "camera_freeze", "camera_cover"])
def test_a_blind_camera_is_flagged_within_a_second(kind):
    motion = standing(180)
    images = images_of(motion, floor("random", 0, "room"), 3, None, [Fault(kind, 70, 10.0)])
    found = WalkReplay(world()).run(motion, images)
    flags = [each.seen.flags for each in found if each.tick >= 170]
    assert all(flags)
    assert max(math.hypot(*each.error[:2]) for each in found) < 0.05


def test_blur_takes_landmarks_away():
    sharp, slow, fast = (
        share(by_speed(camera(exposure), world(), [motion], 4))
        for exposure, motion in ((0.01, (0.0, 0.0)), (0.1, (0.05, 0.1)), (0.1, (0.1, 0.8)))
    )
    assert sharp > 0.4
    assert sharp > slow > fast
    assert fast < 0.5 * sharp


def test_a_recording_without_the_topics_is_refused(tmp_path):
    with pytest.raises(SurefootError):
        read_motion(tmp_path / "absent.mcap")
    assert np.isnan(share([]))
