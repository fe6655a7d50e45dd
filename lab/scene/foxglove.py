"""The scene in Foxglove's well-known messages (Protobuf), for recordings and live: Foxglove, Lichtblick, rerun.

Frames: ``world`` holds ``base_link`` and ``estimate``, ``base_link`` holds the links by their names.
"""

from typing import Any

import numpy as np

from surefoot.arrays import Array
from surefoot.bus.ros_messages import pose_covariance, twist_covariance
from surefoot.geometry.linear import product
from surefoot.geometry.rotations import matrix_from_quat

from .primitives import GROUND_COLOUR, Primitives, centres, sdk, surface
from .scene import RobotScene, Snapshot
from .shapes import DrawnGround
from .styles import VALUES

WORLD, BASE, ESTIMATE = "world", "base_link", "estimate"
KINDS = {
    "/tf": "FrameTransforms", "/robot": "SceneUpdate", "/scene": "SceneUpdate", "/ground": "SceneUpdate",
    "/map": "Grid", "/odometry": "Odometry", "/joint_states": "JointStates", "/pose": "PoseInFrame", "/log": "Log",
}  # fmt: skip
"""Foxglove message type of each channel by topic. Besides, `/values` is JSON, and there is a point cloud for each link
and the ground under `/shape/`, for viewers that cannot show scenes."""
LATELY_NS = 50_000_000
"""Largest age of measured joint rates and torques beside the angles of a snapshot, ns."""
LEVELS = {"debug": "Debug", "info": "Info", "warning": "Warning", "error": "Error"}


class FoxgloveScene:
    """Publisher of snapshots of a scene on Foxglove channels, to the files or servers of a Foxglove context."""

    def __init__(self, scene: RobotScene, context: Any) -> None:
        self._scene, self._make, library = scene, Primitives(), sdk()
        self._links = [BASE, *(link.name for link in scene.robot.links[1:])]
        kinds = {**KINDS, **{f"/shape/{name}": "PointCloud" for name in (*self._links, "ground")}}
        self._to = {
            topic: getattr(library.channels, f"{kind}Channel")(topic, context=context) for topic, kind in kinds.items()
        }
        properties = {name: {"type": "number", "title": f"{v[0]}, {v[1]}"} for name, v in VALUES.items()}
        schema = {"type": "object", "title": "surefoot.Values", "properties": properties}
        self._values = library.Channel("/values", schema=schema, message_encoding="json", context=context)
        self._epoch, self._text = -1, ""
        self.again()

    def again(self) -> None:
        """Make the next snapshot include robot, ground and permanent items again, for a client that just connected."""
        self._begun, self._marks = False, 0
        self._ground: DrawnGround | None = None

    def publish(self, shown: Snapshot) -> None:
        """Publish a snapshot, with the robot, the ground and permanent marks where they are new."""
        stamp, scene = round(shown.time * 1e9), self._scene
        if scene.epoch != self._epoch:
            self._epoch, self._marks = scene.epoch, 0
            every = self._make.messages.SceneEntityDeletionType.All
            gone = self._make.messages.SceneEntityDeletion(timestamp=self._make.time(stamp), type=every)
            self._send("/scene", self._make.messages.SceneUpdate(deletions=[gone]), stamp)
        if not self._begun:
            self._begun = True
            self._send_robot(stamp)
        if scene.ground is not None and scene.ground is not self._ground:
            self._ground = scene.ground
            self._send_ground(self._ground, stamp)
        m, make = self._make.messages, self._make
        self._send("/tf", self._transforms(shown, stamp), stamp)
        pose = m.PoseInFrame(timestamp=make.time(stamp), frame_id=WORLD, pose=make.pose(shown.position, shown.rot))
        self._send("/pose", pose, stamp)
        self._send("/scene", self._items(shown, stamp), stamp)
        self._send("/joint_states", self._joints(shown, stamp), stamp)
        if shown.estimate is not None:
            self._send("/odometry", self._odometry(*shown.estimate, stamp), stamp)
        self._values.log(shown.values, log_time=stamp)
        if shown.text and shown.text != self._text:
            self._text = shown.text
            self.log(stamp, "warning" if shown.fallen else "info", "walker", shown.text)

    def log(self, stamp_ns: int, level: str, name: str, text: str) -> None:
        """Publish a log line (simulated time in ns, level, name of the source, text) on the Foxglove log channel."""
        m = self._make.messages
        kind = getattr(m.LogLevel, LEVELS.get(level, "Info"))
        line = m.Log(timestamp=self._make.time(stamp_ns), level=kind, name=name, message=text)
        self._send("/log", line, stamp_ns)

    def _send(self, topic: str, message: Any, stamp_ns: int) -> None:
        self._to[topic].log(message, log_time=stamp_ns)

    def _joints(self, shown: Snapshot, stamp: int) -> Any:
        """Return the state of the joints: angles as drawn; rates and torques where `hw/joints` measured them lately."""
        m, measured, none = self._make.messages, self._scene.latest("hw/joints"), (None,) * len(shown.joints)
        if measured is None or abs(stamp - measured.stamp_ns) > LATELY_NS:  # beside the truth a live view asks for none
            rates = torques = none
        else:
            rates, torques = measured.velocity or none, measured.torque or none
        named = [
            m.JointState(name=name, position=angle, velocity=rate, effort=torque)
            for name, angle, rate, torque in zip(
                self._scene.robot.joint_names, shown.joints.tolist(), rates, torques, strict=True
            )
        ]
        return m.JointStates(timestamp=self._make.time(stamp), joints=named)

    def _odometry(self, position: Array, rot: Array, stamp: int) -> Any:
        """Return the estimate of base_link in the world, position (3,) m, rotation (3, 3), with its uncertainty."""
        make, robot = self._make, self._scene.robot
        odometry, velocity = self._scene.latest("state/odometry"), self._scene.latest("state/velocity")
        turn = np.zeros((6, 6))  # world from odom, of the place and of the rotation about its axes
        turn[:3, :3] = turn[3:, 3:] = product(rot, matrix_from_quat(np.array(odometry.quat_wxyz)).T)
        covariance = product(product(turn, pose_covariance(odometry).reshape(6, 6)), turn.T)
        motion: dict[str, Any] = {}
        if velocity is not None and velocity.initialised:
            linear, angular = (make.vector(np.array(x)) for x in (velocity.velocity, velocity.angular_velocity))
            own = twist_covariance(velocity, matrix_from_quat(robot.imu.quat_wxyz))
            motion = {"linear_velocity": linear, "angular_velocity": angular, "velocity_covariance": own.tolist()}
        return make.messages.Odometry(
            timestamp=make.time(stamp), frame_id=WORLD, body_frame_id=ESTIMATE, pose=make.pose(position, rot),
            pose_covariance=covariance.ravel().tolist(), **motion,
        )  # fmt: skip

    def _transforms(self, shown: Snapshot, stamp: int) -> Any:
        """Return the poses of trunk and estimate in the world, and of the links in the trunk."""
        make = self._make
        found = [(WORLD, BASE, shown.position, shown.rot)]
        if shown.estimate is not None:
            found.append((WORLD, ESTIMATE, *shown.estimate))
        for i, name in enumerate(self._links[1:], 1):
            place = shown.rot.T @ (shown.link_position[i] - shown.position)
            found.append((BASE, name, place, shown.rot.T @ shown.link_rot[i]))
        made: list[Any] = []
        for parent, child, position, rot in found:
            made.append(
                make.messages.FrameTransform(
                    timestamp=make.time(stamp), parent_frame_id=parent, child_frame_id=child,
                    translation=make.vector(position), rotation=make.turn(rot),
                )
            )  # fmt: skip
        return make.messages.FrameTransforms(transforms=made)

    def _send_robot(self, stamp: int) -> None:
        """Publish the shape of each link of the robot on the Foxglove scene channel, fixed to the link's frame."""
        make, body, entities = self._make, self._scene.body, list[Any]()
        for number, name in enumerate(self._links):
            parts = make.parts(body, number)
            entities.append(
                make.messages.SceneEntity(
                    timestamp=make.time(stamp), frame_id=name, id=name, frame_locked=True, **parts
                )
            )
            places, colours = surface(body, number)
            self._send(f"/shape/{name}", make.cloud(places, colours, name, stamp), stamp)
        self._send("/robot", make.messages.SceneUpdate(entities=entities), stamp)
        for note in body.notes:
            self.log(stamp, "warning", "meshes", note)

    def _items(self, shown: Snapshot, stamp: int) -> Any:
        """Return the scene update with the items drawn beside the robot in a snapshot, and with new permanent items."""
        make, extent, marks = self._make, self._scene.body.extent, self._scene.marks
        entity = {"timestamp": make.time(stamp), "frame_id": WORLD}
        entities = [make.messages.SceneEntity(id="now", **entity, **make.drawn(shown.items, extent))]
        while self._marks < len(marks) and marks[self._marks].time <= shown.time:
            drawn = make.drawn((marks[self._marks].item,), extent)
            entities.append(make.messages.SceneEntity(id=f"mark {self._marks}", **entity, **drawn))
            self._marks += 1
        return make.messages.SceneUpdate(entities=entities)

    def _send_ground(self, ground: DrawnGround, stamp: int) -> None:
        """Publish the ground as a grid of heights, as triangles and as points."""
        make = self._make
        self._send("/map", make.grid(ground, WORLD, stamp), stamp)
        entity = make.messages.SceneEntity(
            timestamp=make.time(stamp), frame_id=WORLD, id="ground", triangles=[make.mesh(ground)]
        )
        self._send("/ground", make.messages.SceneUpdate(entities=[entity]), stamp)
        known = centres(ground)[np.isfinite(ground.heights).ravel()]
        self._send("/shape/ground", make.cloud(known, [GROUND_COLOUR] * len(known), WORLD, stamp), stamp)
