"""A robot that publishes on ROS 2, as the driver: its inertial unit, joints and feet come over Zenoh, without ROS."""

from collections import deque
from functools import partial
from typing import Any

import numpy as np
from pydantic import Field

from surefoot.bus.ros2 import Ros2Node
from surefoot.bus.ros_messages import KINDS, stamp_of
from surefoot.errors import SurefootError
from surefoot.geometry.linear import product
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.lockstep.sensed import SensedConfig, SensedDriver
from surefoot.record.fields import FieldPath
from surefoot.robot.names import joint_columns, leg_columns

MOST = 10_000
"""Largest number of received messages that wait to be read; beyond it the oldest are dropped."""


class RosRobotConfig(SensedConfig):
    """ROS 2 topics by which the robot's driver is reached."""

    router: str = Field(default="tcp/127.0.0.1:7447", description="endpoint of rmw_zenohd, or of our own router")
    domain: int = Field(default=0, ge=0, le=232, description="number of the ROS domain, ROS_DOMAIN_ID")
    imu: str = Field(default="/imu/data", description="topic of a sensor_msgs/Imu")
    imu_frame: str = Field(
        default="imu", pattern="imu|base_link", description="axes of its rows: unit of the robot, or trunk"
    )
    joints: str = Field(default="/joint_states", description="topic of a sensor_msgs/JointState")
    contacts: str = Field(default="", description="TOPIC[.FIELD[a:b]] of foot forces or flags; empty = by height")
    contacts_type: str = Field(default=KINDS["contacts"], description="type of that topic")
    feet: tuple[str, ...] = Field(default=(), description="legs in the order of the contacts; empty = the robot's")


class RosRobot(SensedDriver[RosRobotConfig]):
    """Driver that watches a robot on ROS 2: it reads inertial unit, joints and foot contacts, and sends nothing."""

    name = "ros_robot"
    Config = RosRobotConfig

    def open(self) -> None:
        """Subscribe to the topics of the robot."""
        c, self._queue = self.config, deque[tuple[str, Any]](maxlen=MOST)
        self._columns: tuple[tuple[str, ...], list[int]] = ((), [])
        self._stamp_ns = 0
        self._names = c.feet or self.robot.leg_names
        self._feet = leg_columns(self._names, self.robot)
        self._place = FieldPath.of(c.contacts) if c.contacts else None
        imu_from_base = matrix_from_quat(self.robot.imu.quat_wxyz).T
        self._turn = imu_from_base if c.imu_frame == "base_link" else None
        self.connection = Ros2Node(self.name, c.router, c.domain)
        wanted = {"imu": (c.imu, KINDS["imu"]), "joints": (c.joints, KINDS["joints"])}
        if self._place is not None:
            wanted["feet"] = (self._place.topic, c.contacts_type)
        for kind, (topic, type_name) in wanted.items():
            self.connection.subscribe(topic, type_name, partial(self.take, kind), partial(self.take, "broken"))

    def take(self, kind: str, message: Any) -> None:
        """Queue a message of the topic of `imu`, `joints` or `feet`; from any thread."""
        self._queue.append((kind, message))

    def poll(self) -> None:
        """Move the received messages into the intake, which releases them tick by tick."""
        while self._queue:
            kind, m = self._queue.popleft()
            try:
                self._read(kind, m)
            except SurefootError as error:
                self.intake.refuse(f"{kind}_{error.code}", error.message)

    def on_stop(self) -> None:
        """Close the connection to the robot's network."""
        self.connection.close()

    def _read(self, kind: str, m: Any) -> None:
        if kind == "broken":
            self.intake.refuse("encoding", m)
        elif kind == "imu":
            w, a = (np.array((v.x, v.y, v.z)) for v in (m.angular_velocity, m.linear_acceleration))
            if self._turn is not None:
                w, a = product(self._turn, w), product(self._turn, a)
            self._stamp_ns = stamp_of(m)
            self.intake.imu(self._stamp_ns, w.tolist(), a.tolist())
        elif kind == "joints":
            names = tuple(m.name)
            if names != self._columns[0]:
                self._columns = names, joint_columns(names, self.robot)
            rows = self._columns[1]
            parts = [part[rows] if len(part) == len(names) else None for part in (m.position, m.velocity, m.effort)]
            self._stamp_ns = stamp_of(m)
            self.intake.joints(self._stamp_ns, parts[0] if parts[0] is not None else (), parts[1], parts[2])
        elif self._place is not None:
            values = self._place.values(m)
            if len(values) != len(self._names):
                text = f"{self._place.topic}: got {len(values)} numbers, wanted are {len(self._names)}"
                raise SurefootError("shape", text, "contacts")
            self.intake.feet(stamp_of(m) or self._stamp_ns, values[self._feet].tolist())


SERVICE = RosRobot
