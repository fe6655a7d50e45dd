"""Clients of ROS 2 without ROS read by their own nodes what the bridge publishes, find it, and steer it."""

import asyncio
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from surefoot.bus.ros2 import type_hash
from surefoot.lockstep.join import TickInputs
from surefoot.schemas.cmd import WalkCommand, WalkReply
from surefoot.schemas.hw import Tick
from surefoot.schemas.topics import STATE_ODOMETRY, STATE_VELOCITY
from surefoot.services.ros2.service import Ros2Bridge, Ros2Config
from tests.lab.bags.sway import ROBOT
from tests.services.stage import Stage
from tests.surefoot.bus.test_base_state import described, kinds
from tests.surefoot.bus.test_ros2 import odometry
from tests.surefoot.net import WAIT_S, Net
from tests.surefoot.ros_clients import pyzeros_node, pyzeros_publishes, sdk_client
from tests.surefoot.toys import estimate


class Obeying(Stage):
    """Runtime whose walker accepts every order."""

    def __init__(self) -> None:
        super().__init__()
        self.orders: list[WalkCommand] = []

    def call(self, query: Any, request: Any, timeout_s: float | None) -> Any:
        self.orders.append(request)
        return WalkReply(accepted=True, id=len(self.orders), code="", reason="")


class Bridge:
    """The bridge on a router, with the same pose and velocity in each tick."""

    def __init__(self, net: Net) -> None:
        self.runtime, self.ticks = Obeying(), 0
        self.service = Ros2Bridge(Ros2Config(robot=ROBOT, router=net.address, clock="robot"))
        self.service.attach(self.runtime)
        self.service.on_start()
        self._end = 0.0

    def tick(self) -> None:
        """Run a tick; a test whose ticks take longer than `WAIT_S` fails."""
        self._end = self._end or time.monotonic() + WAIT_S
        assert time.monotonic() < self._end
        head = Tick(tick=self.ticks, roster=("ros2",), roster_version=1, due=(), mode="lockstep")
        self.service.on_tick(TickInputs(head, {STATE_ODOMETRY.key: odometry(), STATE_VELOCITY.key: estimate(0.25)}))
        self.ticks += 1


@pytest.fixture
def net() -> Iterator[Net]:
    net = Net()
    yield net
    net.close()


@pytest.fixture
def bridge(net: Net) -> Iterator[Bridge]:
    made = Bridge(net)
    yield made
    made.service.on_stop()


def check_odometry(m: Any) -> None:
    """Check a nav_msgs/Odometry, of any class, against the pose and velocity of the bridge's ticks."""
    wanted, place, turn = odometry(), m.pose.pose.position, m.pose.pose.orientation
    assert (m.header.stamp.sec, m.header.stamp.nanosec) == (1234, 567_890_123)
    assert (m.header.frame_id, m.child_frame_id) == ("odom", "base_link")
    assert (place.x, place.y, place.z) == wanted.position
    assert (turn.w, turn.x, turn.y, turn.z) == wanted.quat_wxyz
    assert [float(m.pose.covariance[7 * i]) for i in (0, 1, 2, 5)] == [0.1, 0.2, 0.3, 0.4]
    assert m.twist.twist.linear.x == 0.25


def check_order(order: WalkCommand) -> None:
    assert (order.action, order.velocity, order.angle) == ("walk", 0.05, 0.5)


def test_pyzeros_reads_odometry_and_transforms(net: Net, bridge: Bridge) -> None:
    async def read(node: Any, messages: Any) -> list[Any]:
        many = kinds.sequence[messages.TransformStamped]  # ros2-pyterfaces has no TFMessage
        topics = {"/odom": messages.Odometry, "/tf": described("tf2_msgs/msg/TFMessage", transforms=many)}
        subs = [node.create_subscriber(kind, topic) for topic, kind in topics.items()]
        waits = [asyncio.ensure_future(sub.wait_for_value()) for sub in subs]
        while not all(wait.done() for wait in waits):  # the first may be on their way before the subscription
            bridge.tick()
            await asyncio.wait(waits, timeout=0.02, return_when=asyncio.ALL_COMPLETED)
        for sub in subs:
            sub.close()
        return [wait.result() for wait in waits]

    with pyzeros_node(net) as made:
        pose, moved = asyncio.run(read(*made))
    check_odometry(pose)
    (one,) = moved.transforms
    shift, turn = one.transform.translation, one.transform.rotation
    assert (one.header.stamp.sec, one.header.frame_id, one.child_frame_id) == (1234, "odom", "base_link")
    assert (shift.x, shift.y, shift.z) == odometry().position
    assert (turn.w, turn.x, turn.y, turn.z) == odometry().quat_wxyz


@pytest.mark.slow
def test_pyzeros_steers_the_walker(net: Net, bridge: Bridge) -> None:
    pyzeros_publishes()

    async def steer(node: Any, messages: Any) -> None:
        publisher = node.create_publisher(messages.Twist, "/cmd_vel")
        forward, turn = messages.Vector3(x=0.05, y=0.0, z=0.0), messages.Vector3(x=0.0, y=0.0, z=0.25)
        while not bridge.runtime.orders:
            publisher.publish(messages.Twist(linear=forward, angular=turn))
            bridge.tick()
        publisher.close()

    with pyzeros_node(net) as made:
        asyncio.run(steer(*made))
    check_order(bridge.runtime.orders[0])


def test_the_sdk_reads_odometry_finds_the_topics_and_steers(net: Net, bridge: Bridge, tmp_path: Path) -> None:
    came: list[Any] = []
    with sdk_client(net, tmp_path) as (sdk, place):
        subscriber = sdk.ROS2Subscriber("/odom", "nav_msgs/msg/Odometry", came.append, **place)
        publisher = sdk.ROS2Publisher("/cmd_vel", "geometry_msgs/msg/Twist", **place)
        vector = sdk.get_message_class("geometry_msgs/msg/Vector3")
        while not (came and bridge.runtime.orders):
            publisher.publish(linear=vector(x=0.05, y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=0.25))
            bridge.tick()
        listed = dict(sdk.get_topic_names_and_types(**place, timeout=WAIT_S))
        (ours,) = sdk.get_topic_info("/tf", **place, timeout=WAIT_S, verbose=True).publishers
        subscriber.close()
        publisher.close()
    check_odometry(came[0])
    check_order(bridge.runtime.orders[0])
    assert (listed["/odom"], listed["/cmd_vel"]) == (["nav_msgs/msg/Odometry"], ["geometry_msgs/msg/Twist"])
    assert (ours.node_name, ours.node_namespace, ours.topic_type) == ("surefoot", "/", "tf2_msgs/msg/TFMessage")
    assert ours.type_hash == type_hash(ours.topic_type)
