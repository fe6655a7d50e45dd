"""A robot whose samples are published by a client of ROS 2 without ROS, pyzeros, is read by the driver."""

import asyncio
import time
from typing import Any

import numpy as np
import pytest

from surefoot.lockstep.driver import DueSample
from surefoot.robot.reader import load_robot
from surefoot.schemas.hw import FootContacts, Imu, JointState
from surefoot.schemas.topics import HW_CONTACTS, HW_IMU, HW_JOINTS, TICK_NS
from surefoot.services.ros_robot.service import RosRobot, RosRobotConfig
from tests.lab.bags.sway import ORDER, ROBOT
from tests.services.stage import Stage
from tests.surefoot.net import WAIT_S, Net
from tests.surefoot.ros_clients import pyzeros_node, pyzeros_publishes

NAMES = load_robot(ROBOT).joint_names
ANGLES = [0.01 * i for i in range(len(NAMES))]
STAND = dict[str, int](zip(ORDER, (1, 0, 0, 0), strict=True))
"""Flags by leg, in the order in which they are published: by the heights of the feet others would stand."""


@pytest.mark.slow
def test_samples_of_pyzeros_are_taken() -> None:
    pyzeros_publishes()
    net = Net()
    made = RosRobot(RosRobotConfig(robot=ROBOT, router=net.address, contacts="/feet", feet=ORDER))
    made.attach(Stage())
    made.on_start()
    with pyzeros_node(net) as (node, messages):
        taken = asyncio.run(published(node, messages, made))
    made.on_stop()
    net.close()
    imu, joints = taken[HW_IMU.key], taken[HW_JOINTS.key]
    assert isinstance(imu, Imu)
    assert (imu.acc, imu.gyro) == ((0.0, 0.0, 9.81), (0.25, 0.0, -0.5))
    assert isinstance(joints, JointState)
    np.testing.assert_array_equal(joints.position, ANGLES)
    assert dict(made.intake.refused) == {}


async def published(node: Any, m: Any, made: RosRobot) -> dict[str, Any]:
    """Publish a standing robot until the driver has its contacts, and return the last sample of each topic."""
    kinds = {"/imu/data": m.Imu, "/feet": m.UInt8MultiArray, "/joint_states": m.JointState}
    imu, feet, joints = (node.create_publisher(kind, topic) for topic, kind in kinds.items())
    rates, force = m.Vector3(x=0.25, y=0.0, z=-0.5), m.Vector3(x=0.0, y=0.0, z=9.81)
    wanted = tuple((bool(STAND[leg]),) for leg in made.robot.leg_names)
    taken, sent, tick, end = dict[str, Any](), 0, 0, time.monotonic() + WAIT_S
    while not holds(taken.get(HW_CONTACTS.key), wanted):
        assert time.monotonic() < end, made.intake.refused
        seconds, rest = divmod(10**18 + sent * TICK_NS, 10**9)
        head = m.Header(stamp=m.Time(sec=seconds, nanosec=rest), frame_id="imu")
        imu.publish(m.Imu(header=head, angular_velocity=rates, linear_acceleration=force))
        feet.publish(m.UInt8MultiArray(data=list(STAND.values())))
        joints.publish(m.JointState(header=head, name=list(reversed(NAMES)), position=list(reversed(ANGLES))))
        sent += 1
        made.poll()
        if made.intake.newest_ns >= 0 and made.intake.lacking_ns(tick) == 0:
            due: list[DueSample] = made.intake.release(tick)
            taken |= {sample.topic.key: sample.message for sample in due}
            tick += 1
    return taken


def holds(contacts: FootContacts | None, wanted: tuple[tuple[bool], ...]) -> bool:
    return contacts is not None and contacts.touch == wanted
