"""Motion of the robot in the last seconds: its pose at the time of an image, and its movement since then."""

import math
from bisect import bisect_right
from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple, TypeVar

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.linear import product
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.robot.description import Robot
from surefoot.robot.kinematics import foot_positions
from surefoot.schemas.hw import JointState
from surefoot.schemas.state import Odometry

from .view import FloorPose

T = TypeVar("T")

KEPT = 300
"""Largest number of odometry messages kept, one every 10 ms; the oldest are dropped."""
READ_WITHIN_NS = 100_000_000
"""Largest time between an image and the odometry and joint angles used with it, ns; beyond it the image is not used."""


class OdometryAt(NamedTuple):
    """Odometry pose and trunk attitude at one time."""

    stamp_ns: int
    """Simulated time of the odometry, ns."""
    pose: tuple[float, float, float]
    """Pose of base_link, x, y in m and heading in rad, frame odom."""
    rot: Array
    """Rotation by roll and pitch, from base_link to the level axes along its heading, (3, 3)."""


@dataclass
class MotionHistory:
    """Odometry and joint angles of the last seconds.

    Attributes:
        robot: description of the robot, whose feet give the height of base_link over the floor.
    """

    robot: Robot
    _last: Odometry | None = None
    _moments: deque[OdometryAt] = field(default_factory=lambda: deque[OdometryAt](maxlen=KEPT))
    _joints: deque[tuple[int, tuple[float, ...]]] = field(
        default_factory=lambda: deque[tuple[int, tuple[float, ...]]](maxlen=KEPT // 3)
    )

    def moved(self, odometry: Odometry) -> None:
        """Record the odometry of a tick; a correction of the past shifts all kept poses, as the robot did not move."""
        if not odometry.initialised:
            return
        c, s = math.cos(odometry.yaw), math.sin(odometry.yaw)
        level = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        rot = product(level, matrix_from_quat(np.array(odometry.quat_wxyz)))
        x, y, _ = odometry.position
        if self._last is not None and odometry.corrects(self._last) and self._moments:
            self._correct((x, y, odometry.yaw))
        self._last = odometry
        self._moments.append(OdometryAt(odometry.stamp_ns, (x, y, odometry.yaw), rot))

    def _correct(self, pose: tuple[float, float, float]) -> None:
        """Shift all kept poses with the last one, which was corrected although the robot did not move.

        `pose`: the last one after the correction, x, y in m and heading in rad, frame odom.
        """
        was = self._moments[-1].pose
        turn = pose[2] - was[2]
        c, s = math.cos(turn), math.sin(turn)
        for i, moment in enumerate(self._moments):
            dx, dy = moment.pose[0] - was[0], moment.pose[1] - was[1]
            moved = (pose[0] + c * dx - s * dy, pose[1] + s * dx + c * dy, moment.pose[2] + turn)
            self._moments[i] = moment._replace(pose=moved)

    def bent(self, joints: JointState) -> None:
        """Record a sample of the joint encoders."""
        self._joints.append((joints.stamp_ns, joints.position))

    @property
    def now(self) -> OdometryAt | None:
        """Last odometry received."""
        return self._moments[-1] if self._moments else None

    def at(self, stamp_ns: int) -> tuple[OdometryAt, FloorPose] | None:
        """Return odometry and pose above the floor at a simulated time, ns; None = none is known within 0.1 s of it."""
        moment = _nearest(list(self._moments), [m.stamp_ns for m in self._moments], stamp_ns)
        joints = _nearest(list(self._joints), [j[0] for j in self._joints], stamp_ns)
        if moment is None or joints is None:
            return None
        feet = foot_positions(self.robot.model, np.array(joints[1]))
        height = -float(product(feet, moment.rot.T)[:, 2].min())
        return moment, FloorPose(moment.rot, height)


def _nearest(items: list[T], stamps: list[int], stamp_ns: int) -> T | None:
    i = bisect_right(stamps, stamp_ns)
    best = min((k for k in (i - 1, i) if 0 <= k < len(items)), key=lambda k: abs(stamps[k] - stamp_ns), default=None)
    return None if best is None or abs(stamps[best] - stamp_ns) > READ_WITHIN_NS else items[best]


def since(places: Array, then: OdometryAt, now: OdometryAt) -> Array:
    """Return points forward and left of base_link at `then` in its axes at `now`, by odometry, (n, 2) m.

    `places`: the points, (n, 2) m.
    """
    dx, dy = then.pose[0] - now.pose[0], then.pose[1] - now.pose[1]
    turn = then.pose[2] - now.pose[2]
    c, s = math.cos(turn), math.sin(turn)
    cn, sn = math.cos(now.pose[2]), math.sin(now.pose[2])
    x = c * places[:, 0] - s * places[:, 1] + cn * dx + sn * dy
    y = s * places[:, 0] + c * places[:, 1] - sn * dx + cn * dy
    return np.stack((x, y), axis=1)
