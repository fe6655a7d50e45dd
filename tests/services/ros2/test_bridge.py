"""The bridge publishes what the services publish, under the names of its configuration, and passes velocities on."""

from collections import defaultdict
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from surefoot.bus.ros2 import types
from surefoot.lab.bags.fit import fitted
from surefoot.lab.bags.importing import Player
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.local import LocalSystem
from surefoot.lockstep.service import Service
from surefoot.robot.reader import load_robot
from surefoot.schemas.cmd import WalkCommand, WalkReply
from surefoot.schemas.hw import JointCommand
from surefoot.schemas.topics import CMD_JOINTS, CMD_WALK, HW_IMU
from surefoot.services.estimator.config import EstimatorConfig
from surefoot.services.estimator.service import EstimatorService
from surefoot.services.ros2 import service as bridge
from tests.lab.bags.sway import ROBOT, sway
from tests.lab.bags.test_bad_bags import log_of_rows


class Wire:
    """Stands in for the node: keeps what is published, as bytes would bring it."""

    def __init__(self, *_: Any) -> None:
        self.sent: defaultdict[str, list[Any]] = defaultdict(list)
        self.sinks: dict[str, Callable[[Any], None]] = {}

    def publisher(self, topic: str, kind: str) -> Any:
        sent, store = self.sent[topic], types()

        class Publisher:
            def put(self, message: Any) -> None:
                sent.append(store.deserialize_cdr(store.serialize_cdr(message, kind), kind))

        return Publisher()

    def subscribe(self, topic: str, kind: str, sink: Callable[[Any], None], failed: Callable[[str], None]) -> None:
        self.sinks[topic] = sink

    def close(self) -> None:
        """Nothing to close."""


class Walker(Service[ServiceConfig]):
    """Accepts walks, and refuses arcs."""

    name = "walker"
    inputs = (HW_IMU,)
    outputs = (CMD_JOINTS,)
    serves = (CMD_WALK,)

    def on_start(self) -> None:
        self.orders: list[WalkCommand] = []
        self.handle(CMD_WALK, self.answer)

    def answer(self, order: WalkCommand) -> WalkReply:
        self.orders.append(order)
        arc = order.action == "walk" and order.angle is not None
        return WalkReply(accepted=not arc, id=0 if arc else 1, code="unsupported" if arc else "", reason="arc")

    def on_tick(self, inputs: TickInputs) -> None:
        self.publish(CMD_JOINTS, JointCommand(position=None))


def test_odometry_joints_and_velocities(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bridge, "Ros2Node", Wire)
    log = fitted(log_of_rows(sway().cut(slice(0, 500))), load_robot(ROBOT))
    config = bridge.Ros2Config(
        robot=ROBOT, odom="/odometry/filtered", tf="", contacts="/feet", base_state="/base_state", clock="robot"
    )
    made, walker = bridge.Ros2Bridge(config), Walker(ServiceConfig(robot=ROBOT))
    player = Player(ServiceConfig(robot=ROBOT), log)
    system = LocalSystem([player, EstimatorService(EstimatorConfig(robot=ROBOT)), walker, made])
    wire: Any = made.connection
    vector = types().types["geometry_msgs/msg/Vector3"]
    twist = types().types["geometry_msgs/msg/Twist"](linear=vector(0.05, 0.0, 0.0), angular=vector(0.0, 0.0, 0.5))
    player.node.begin(("estimator", "walker", "ros2"), "lockstep", 0.0, 1, "fail", 0)
    leader = player.node.leader
    leader.end_tick = player.last_tick
    system.run_until(lambda: leader.tick >= 0)
    wire.sinks["/cmd_vel"](twist)
    system.run_until(lambda: leader.state == "ended" and leader.all_done())
    system.close()
    sent = wire.sent
    assert set(sent) == {"/odometry/filtered", "/joint_states", "/feet", "/height_map", "/base_state"}
    assert len(sent["/joint_states"]) == player.last_tick + 1
    assert sent["/joint_states"][3].name == list(load_robot(ROBOT).joint_names)
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in sent["/odometry/filtered"]]
    assert stamps
    assert (np.diff(stamps) > 0).all()
    assert all((np.linalg.eigvalsh(m.pose.covariance.reshape(6, 6)) > -1e-12).all() for m in sent["/odometry/filtered"])
    for state, pose in zip(sent["/base_state"], sent["/odometry/filtered"], strict=True):
        place, turn = pose.pose.pose.position, pose.pose.pose.orientation
        assert state.pose.position.tolist() == [place.x, place.y, place.z]
        assert state.pose.orientation.tolist() == [turn.x, turn.y, turn.z, turn.w]
        assert state.timestamp == pytest.approx(pose.header.stamp.sec + 1e-9 * pose.header.stamp.nanosec)
    assert sent["/base_state"][0].stance_status.tolist() == [True] * 4
    assert all(m.data.tolist() == [1, 1, 1, 1] for m in sent["/feet"][:20])
    assert [order.action for order in walker.orders] == ["walk", "turn", "stop"]
