"""The service among its inputs: landmarks hold at the tick they are published in, and a camera that fails is named."""

import math
from typing import Any

import numpy as np
import pytest

from surefoot.geometry.rotations import quat_from_rpy
from surefoot.lockstep.join import TickInputs
from surefoot.robot.kinematics import foot_positions
from surefoot.schemas.hw import JointState, Tick
from surefoot.schemas.navigation import PoseBelief
from surefoot.schemas.state import Odometry, SeenLandmarks
from surefoot.schemas.topics import TICK_NS
from surefoot.services.vision.config import VisionConfig
from surefoot.services.vision.service import VisionService
from tests.services.stage import Stage
from tests.services.vision.shots import HEIGHT, shot, world

POSE = (0.12, 0.02, 0.1)


@pytest.fixture
def vision():
    made, outlet = VisionService(VisionConfig(robot="nao", features="orb")), Stage()
    made.attach(outlet)
    made.on_start()
    made.use(world())
    made.on_reset()
    made.outlet = outlet
    yield made
    made.on_stop()


def step(vision: VisionService, tick: int, pose=POSE, image=None, belief=None) -> SeenLandmarks | None:
    """Let a tick pass in which the robot is at a pose of odometry; return what is published."""
    now, robot = tick * TICK_NS, vision.robot
    lowest = float(foot_positions(robot.model, robot.neutral)[:, 2].min())
    assert pytest.approx(HEIGHT, abs=0.1) == -lowest
    x, y, yaw = pose
    odometry = Odometry(
        position=(x, y, HEIGHT), quat_wxyz=tuple(quat_from_rpy(0.0, 0.0, yaw).tolist()), yaw=yaw, velocity=(0, 0, 0),
        covariance=(0.0,) * 16, initialised=True,
    ).stamped(now, tick, 1, tick, "estimator")  # fmt: skip
    joints = JointState(position=tuple(robot.neutral.tolist())).stamped(now, tick, 1, tick, "simulator")
    messages: dict[str, Any] = {"state/odometry": odometry, "hw/joints": joints}
    messages |= {} if image is None else {"hw/image": image}
    messages |= {} if belief is None else {"state/pose": belief}
    head = Tick(roster=(), roster_version=0, due=(), mode="lockstep").stamped(now, tick, 1, tick, "simulator")
    before = len(vision.outlet.sent)
    vision.on_tick(TickInputs(head, messages))
    return vision.outlet.sent[-1][1] if len(vision.outlet.sent) > before else None


def near(sd=0.05, lost=False) -> PoseBelief:
    cov = tuple((np.eye(3) * sd**2).ravel().tolist())
    return PoseBelief(pose=POSE, covariance=cov, entropy=0.0, drift=0.0, drift_sd=0.0, map_from_odom=(0, 0, 0),
                      initialised=True, control="odometry", matched=0, lost=lost)  # fmt: skip


def image_of(vision: VisionService, stamp_ns: int, pose=POSE, noise=0):
    """Image from a pose, with the camera as high as the robot's legs put it."""
    lowest = float(foot_positions(vision.robot.model, vision.robot.neutral)[:, 2].min())
    taken = shot(pose, noise=noise, stamp_ns=stamp_ns)
    return taken.model_copy(update={"position": (*taken.position[:2], taken.position[2] + HEIGHT + lowest)})


def test_landmarks_hold_where_the_robot_is_when_they_are_published(vision):
    for tick in range(4):
        assert (step(vision, tick, belief=near()) is not None) is (tick == 0)
    step(vision, 4, image=image_of(vision, 3 * TICK_NS), belief=near())
    moved = (POSE[0] + 0.03, POSE[1] - 0.01, POSE[2] + 0.05)
    seen = step(vision, 5, pose=moved)
    assert seen is not None
    assert seen.fresh
    assert seen.flags == ()
    assert len(seen.landmarks) >= 15
    assert seen.image_stamp_ns == 3 * TICK_NS
    codes = {tuple(code): place for code, place in zip(world().codes.tolist(), world().positions, strict=True)}
    for mark in seen.landmarks:
        angle = moved[2] + mark.bearing
        at = np.array(moved[:2]) + mark.range * np.array([math.cos(angle), math.sin(angle)])
        assert np.hypot(*(at - codes[mark.descriptor])) < 0.02
    again = step(vision, 10, pose=moved)
    assert again is not None
    assert not again.fresh
    assert again.landmarks == ()


def test_without_a_belief_or_lost_the_whole_map_is_searched(vision):
    for tick, belief in ((4, None), (9, near(lost=True)), (14, near(sd=0.9))):
        step(vision, tick - 1)
        step(vision, tick, image=image_of(vision, (tick - 1) * TICK_NS, noise=tick), belief=belief)
        seen = step(vision, tick + 1)
        assert seen is not None
        assert seen.anywhere
        assert len(seen.landmarks) >= 15


def test_repeated_late_and_absent_images_are_named(vision):
    for tick in range(60):
        step(vision, tick)
    step(vision, 60, image=image_of(vision, 59 * TICK_NS))
    assert step(vision, 65).flags == ()
    step(vision, 66, image=image_of(vision, 59 * TICK_NS))
    assert step(vision, 70).flags == ("repeated",)
    step(vision, 71, image=image_of(vision, 60 * TICK_NS, noise=1))
    assert step(vision, 75).flags == ()
    step(vision, 114, image=image_of(vision, 64 * TICK_NS, noise=2))
    assert step(vision, 115).flags == ("late",)
    for tick in range(116, 206):
        found = step(vision, tick)
    assert step(vision, 210).flags == ("silent",)
    assert found is None or found.landmarks == ()
    assert [text for text in vision.outlet.logged if "repeated" in text or "silent" in text]
