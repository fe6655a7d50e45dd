"""Bridge to ROS 2 over Zenoh, without ROS: odometry, transforms, joints and heights out, velocity commands in."""

from collections import deque
from typing import Any, Literal

from pydantic import Field

from surefoot.bus import ros_messages as ros
from surefoot.bus.ros2 import Ros2Node, WallOffset
from surefoot.errors import CallError
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.service import Service
from surefoot.robot.reader import load_robot
from surefoot.schemas.terrain import HeightMapMessage
from surefoot.schemas.topics import (
    CMD_WALK,
    HW_CONTACTS,
    HW_IMU,
    HW_JOINTS,
    STATE_ODOMETRY,
    STATE_VELOCITY,
    TERRAIN_MAP,
    TICK_S,
)

from .continuous import ContinuousOdometry
from .steering import Steering

MAP_TICKS = 100
"""Number of ticks after which an unchanged map is published again, for subscribers that join later."""


class Ros2Config(ServiceConfig):
    """Settings of the bridge: names on ROS 2; a topic with an empty name is left out."""

    router: str = Field(default="tcp/127.0.0.1:7447", description="endpoint of rmw_zenohd, or of our own router")
    domain: int = Field(default=0, ge=0, le=232, description="number of the ROS domain, ROS_DOMAIN_ID")
    odom: str = Field(default="/odom", description="nav_msgs/Odometry")
    tf: str = Field(default="/tf", description="tf2_msgs/TFMessage, odom to base_link")
    joint_states: str = Field(default="/joint_states", description="sensor_msgs/JointState")
    imu: str = Field(default="", description="sensor_msgs/Imu")
    contacts: str = Field(default="", description="std_msgs/UInt8MultiArray, a flag a foot")
    height_map: str = Field(default="/height_map", description="grid_map_msgs/GridMap")
    cmd_vel: str = Field(default="/cmd_vel", description="geometry_msgs/Twist, obeyed by the walker")
    base_state: str = Field(default="", description="state of the base for Quadruped-PyMPC")
    base_state_type: Literal["BaseState", "BaseStateMsg"] = Field(
        default="BaseState", description="dls2_interface/BaseState of /base_state, dls2_msgs/BaseStateMsg of /dls2/..."
    )
    odom_frame: str = Field(default="odom", description="name of the frame odom")
    base_frame: str = Field(default="base_link", description="name of the frame base_link")
    clock: Literal["wall", "robot"] = Field(default="wall", description="time of the stamps")


class Ros2Bridge(Service[Ros2Config]):
    """Service that publishes ROS 2 topics over Zenoh as rmw_zenoh does, and takes velocity commands."""

    name = "ros2"
    Config = Ros2Config
    inputs = (HW_IMU, HW_JOINTS, HW_CONTACTS, STATE_VELOCITY, STATE_ODOMETRY, TERRAIN_MAP)
    calls = (CMD_WALK,)

    def on_start(self) -> None:
        """Open the node and its publishers."""
        c, self.robot = self.config, load_robot(self.config.robot)
        self._rot_base_from_imu = matrix_from_quat(self.robot.imu.quat_wxyz)
        self.connection = Ros2Node("surefoot", c.router, c.domain)
        named = {"odometry": c.odom, "tf": c.tf, "joints": c.joint_states, "imu": c.imu, "contacts": c.contacts,
                 "map": c.height_map, c.base_state_type: c.base_state}  # fmt: skip
        self._out = {kind: self.connection.publisher(topic, ros.KINDS[kind]) for kind, topic in named.items() if topic}
        hips = [leg.hip for leg in self.robot.legs]
        self._legs = sorted(range(len(hips)), key=lambda i: (hips[i][0] < 0.0, -hips[i][1]))  # fore left first
        self._twists = deque[Any](maxlen=1)  # the newest counts
        self._broken = 0
        if c.cmd_vel:
            self.connection.subscribe(c.cmd_vel, ros.KINDS["cmd_vel"], self._twists.append, self._on_broken)
        self.on_reset()

    def on_reset(self) -> None:
        """Reset the bridge because a new run begins: no velocity command is under way, the clock is measured again."""
        self.steering, self._offset_ns, self._wall = Steering(), 0, WallOffset()
        self._continuous = ContinuousOdometry()
        self._twists.clear()  # velocities of before are of another run
        self._map: HeightMapMessage | None = None
        self._stance = (False,) * self.robot.nlegs

    def on_tick(self, inputs: TickInputs) -> None:
        """Publish the messages of the tick on ROS 2, and pass velocity commands to the walker."""
        if self.config.clock == "wall":
            self._offset_ns = self._wall.measure(inputs.tick.stamp_ns)
        c, frames = self.config, (self.config.odom_frame, self.config.base_frame)
        velocity, odometry = inputs.get(STATE_VELOCITY), inputs.get(STATE_ODOMETRY)
        if odometry is not None and odometry.initialised:
            odometry = self._continuous.take(odometry)
        if (contacts := inputs.get(HW_CONTACTS)) is not None:
            self._stance = tuple(any(contacts.touch[leg]) for leg in self._legs)
            self._put("contacts", ros.contacts_message(contacts))
        if velocity is not None and odometry is not None and odometry.initialised:
            made = ros.odometry_message(odometry, velocity, self._rot_base_from_imu, frames)
            self._put("odometry", made)
            self._put("tf", ros.transform_message(odometry, frames))
            if c.base_state:
                kind, robot = c.base_state_type, self.robot.name
                self._put(kind, ros.base_state_message(odometry, velocity, self._stance, frames[0], robot, kind))
        if (joints := inputs.get(HW_JOINTS)) is not None:
            self._put("joints", ros.joints_message(joints, self.robot.joint_names))
        if c.imu and (imu := inputs.get(HW_IMU)) is not None:
            self._put("imu", ros.imu_message(imu, "imu"))
        heights = inputs.get(TERRAIN_MAP)
        if heights is not None and (heights is not self._map or inputs.number % MAP_TICKS == 0):
            self._map = heights
            self._put("map", ros.map_message(heights))
        self._steer(inputs.number * TICK_S)

    def on_stop(self) -> None:
        """Close the ROS 2 node."""
        self.connection.close()

    def _put(self, kind: str, message: Any) -> None:
        if kind in self._out:
            ros.delay(message, self._offset_ns)
            self._out[kind].put(message)

    def _steer(self, now_s: float) -> None:
        while self._twists:
            twist = self._twists.popleft()
            self.steering.take(now_s, twist.linear.x, twist.angular.z)
        order = self.steering.order(now_s)
        if order is None:
            return
        try:
            reply = self.call(CMD_WALK, order, 0.2)
        except CallError as error:
            self.log("warning", f"{self.config.cmd_vel}: {error.message}")
            self.steering.unanswered(now_s)
            return
        if not reply.accepted:
            self.log("warning", f"{self.config.cmd_vel}: {order.action} refused, {reply.reason}")
            self.steering.refused(reply.code)

    def _on_broken(self, text: str) -> None:
        self._broken += 1
        if self._broken == 1:
            self.log("warning", f"refused: {text}")


SERVICE = Ros2Bridge
