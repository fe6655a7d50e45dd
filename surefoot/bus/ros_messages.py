"""Conversion of this project's messages to ROS 2 messages (REP-103, REP-105), for the bridge and for bags.

Each function returns a message of the store of `surefoot.bus.ros2.types`; frames: `odom`, `base_link`, `map`.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from surefoot.arrays import Array
from surefoot.bus.ros2 import types
from surefoot.geometry.linear import product
from surefoot.schemas.hw import FootContacts, Imu, JointState
from surefoot.schemas.state import Odometry, VelocityEstimate
from surefoot.schemas.terrain import HeightMapMessage

KINDS = {
    "imu": "sensor_msgs/msg/Imu", "joints": "sensor_msgs/msg/JointState", "contacts": "std_msgs/msg/UInt8MultiArray",
    "odometry": "nav_msgs/msg/Odometry", "tf": "tf2_msgs/msg/TFMessage", "map": "grid_map_msgs/msg/GridMap",
    "cmd_vel": "geometry_msgs/msg/Twist", "BaseState": "dls2_interface/msg/BaseState",
    "BaseStateMsg": "dls2_msgs/msg/BaseStateMsg",
}  # fmt: skip
"""Type name of the ROS 2 message for each kind of content, such as `imu`."""
UNKNOWN = -1.0
"""First element of a covariance matrix in sensor_msgs by which the quantity it belongs to is marked as not measured."""


def _make(kind: str, **fields: Any) -> Any:
    return types().types[kind](**fields)


def header(stamp_ns: int, frame: str) -> Any:
    """Return a ROS header with a stamp, ns of the robot's clock, and the name of a frame."""
    time = _make("builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return _make("std_msgs/msg/Header", stamp=time, frame_id=frame)


def _vector(x: Sequence[float], kind: str = "Vector3") -> Any:
    return _make(f"geometry_msgs/msg/{kind}", x=x[0], y=x[1], z=x[2])


def _quaternion(wxyz: Sequence[float]) -> Any:
    return _make("geometry_msgs/msg/Quaternion", x=wxyz[1], y=wxyz[2], z=wxyz[3], w=wxyz[0])


def imu_message(m: Imu, frame: str) -> Any:
    """Return specific force and rates as `sensor_msgs/msg/Imu`; orientation and covariances are unknown."""
    unknown = np.zeros(9)
    unknown[0] = UNKNOWN
    return _make(
        KINDS["imu"], header=header(m.stamp_ns, frame), orientation=_quaternion((1.0, 0.0, 0.0, 0.0)),
        orientation_covariance=unknown, angular_velocity=_vector(m.gyro), angular_velocity_covariance=np.zeros(9),
        linear_acceleration=_vector(m.acc), linear_acceleration_covariance=np.zeros(9),
    )  # fmt: skip


def joints_message(m: JointState, names: Sequence[str]) -> Any:
    """Return joint angles, rates and torques by name, as `sensor_msgs/msg/JointState`."""
    velocity, effort = (np.array(part if part is not None else (), dtype=np.float64) for part in (m.velocity, m.torque))
    position = np.array(m.position, dtype=np.float64)
    return _make(
        KINDS["joints"], header=header(m.stamp_ns, ""), name=list(names), position=position, velocity=velocity,
        effort=effort,
    )  # fmt: skip


def _layout(sizes: Sequence[tuple[str, int]]) -> Any:
    dim: list[Any] = []
    for i, (label, size) in enumerate(sizes):
        stride = int(np.prod([n for _, n in sizes[i:]]))
        dim.append(_make("std_msgs/msg/MultiArrayDimension", label=label, size=size, stride=stride))
    return _make("std_msgs/msg/MultiArrayLayout", dim=dim, data_offset=0)


def contacts_message(m: FootContacts) -> Any:
    """Return a `std_msgs/msg/UInt8MultiArray` of one flag per foot, in the leg order of the description, 1 = stands."""
    flags = np.array([any(foot) for foot in m.touch], dtype=np.uint8)
    return _make(KINDS["contacts"], layout=_layout([("foot", len(flags))]), data=flags)


def pose_covariance(m: Odometry) -> Array:
    """Return the covariance (36,) of x, y, z, m, and the rotation about the axes of odom, rad."""
    if m.pose_covariance is not None:
        return np.array(m.pose_covariance, dtype=np.float64)
    out, known = np.zeros((6, 6)), np.array(m.covariance, dtype=np.float64).reshape(4, 4)
    place = (0, 1, 2, 5)
    for i, row in enumerate(place):
        for k, column in enumerate(place):
            out[row, column] = known[i, k]
    return out.ravel()


def twist_covariance(v: VelocityEstimate, rot_base_from_imu: Array) -> Array:
    """Return the covariance (36,) of velocity, m/s, and turning rate, base_link; zero for the rate, as not known."""
    own = np.array(v.covariance, dtype=np.float64).reshape(6, 6)[3:, 3:]
    out = np.zeros((6, 6))
    out[:3, :3] = product(product(rot_base_from_imu, own), rot_base_from_imu.T)
    return out.ravel()


def odometry_message(pose: Odometry, v: VelocityEstimate, rot_base_from_imu: Array, frames: tuple[str, str]) -> Any:
    """Return a `nav_msgs/msg/Odometry`: pose, m, in odom and twist, m/s and rad/s, in base_link, with covariances.

    Args:
        pose: pose of base_link in odom.
        v: velocity estimate of the same time; its covariance is of gravity and velocity in IMU axes.
        rot_base_from_imu: rotation from IMU to base_link axes, (3, 3).
        frames: names of odom and base_link.
    """
    place = _make("geometry_msgs/msg/Pose", position=_vector(pose.position, "Point"),
                  orientation=_quaternion(pose.quat_wxyz))  # fmt: skip
    speed = _make("geometry_msgs/msg/Twist", linear=_vector(v.velocity), angular=_vector(v.angular_velocity))
    sure = twist_covariance(v, rot_base_from_imu)
    return _make(
        KINDS["odometry"], header=header(pose.stamp_ns, frames[0]), child_frame_id=frames[1],
        pose=_make("geometry_msgs/msg/PoseWithCovariance", pose=place, covariance=pose_covariance(pose)),
        twist=_make("geometry_msgs/msg/TwistWithCovariance", twist=speed, covariance=sure),
    )  # fmt: skip


def base_state_message(
    pose: Odometry, v: VelocityEstimate, stance: Sequence[bool], frame: str, robot: str, kind: str
) -> Any:
    """Return the state of the base for Quadruped-PyMPC; its accelerations are not known and zero.

    Position and linear velocity in `frame` (odom), orientation x, y, z, w, angular velocity in axes of base_link.

    Args:
        pose: pose of base_link in odom.
        v: velocity estimate of the same time.
        stance: feet that stand: fore left, fore right, hind left, hind right.
        frame: name of odom.
        robot: name of the robot.
        kind: `BaseState`, or `BaseStateMsg`, which is flat.
    """
    w, x, y, z = pose.quat_wxyz
    place, turn, speed, rate = map(np.array, (pose.position, (x, y, z, w), pose.velocity, v.angular_velocity))
    head = {"frame_id": frame, "sequence_id": pose.seq % 2**32, "timestamp": 1e-9 * pose.stamp_ns, "robot_name": robot}
    zero = np.zeros(3)
    if kind == "BaseStateMsg":
        return _make(
            KINDS[kind], **head, position=place, orientation=turn, linear_velocity=speed, angular_velocity=rate,
            linear_acceleration=zero, angular_acceleration=zero, stance_status=_four(stance),
        )  # fmt: skip
    screw, package = "dls2_interface/msg/Screw", "dls2_interface/msg/Pose"
    return _make(
        KINDS[kind], **head, pose=_make(package, position=place, orientation=turn),
        velocity=_make(screw, linear=speed, angular=rate), acceleration=_make(screw, linear=zero, angular=zero),
        stance_status=np.array(stance, dtype=np.bool_),
    )  # fmt: skip


def _four(stance: Sequence[bool]) -> Array:
    """Return the contacts of the first four feet as numbers (4,), 1 = stands; 0 where there are fewer feet."""
    out = np.zeros(4)
    out[: len(stance)] = stance[:4]
    return out


def transform_message(pose: Odometry, frames: tuple[str, str]) -> Any:
    """Return a `tf2_msgs/msg/TFMessage`, the transform from base_link to odom; `frames`: names of odom, base_link."""
    turn = _make("geometry_msgs/msg/Transform", translation=_vector(pose.position),
                 rotation=_quaternion(pose.quat_wxyz))  # fmt: skip
    one = _make("geometry_msgs/msg/TransformStamped", header=header(pose.stamp_ns, frames[0]),
                child_frame_id=frames[1], transform=turn)  # fmt: skip
    return _make(KINDS["tf"], transforms=[one])


def map_message(m: HeightMapMessage) -> Any:
    """Return a `grid_map_msgs/msg/GridMap` with the heights, m, as layer `elevation`.

    grid_map counts rows from x-max and columns from y-max on.
    """
    heights = np.frombuffer(m.data, dtype="<f4").reshape(m.rows, m.cols)  # row = y, column = x
    cells = np.ascontiguousarray(heights[::-1, ::-1])  # column-major (x, y) from the far corner = row-major (y, x)
    size = (m.cols * m.cell, m.rows * m.cell)
    centre = (m.origin[0] + 0.5 * (m.cols - 1) * m.cell, m.origin[1] + 0.5 * (m.rows - 1) * m.cell, 0.0)
    pose = _make("geometry_msgs/msg/Pose", position=_vector(centre, "Point"),
                 orientation=_quaternion((1.0, 0.0, 0.0, 0.0)))  # fmt: skip
    info = _make("grid_map_msgs/msg/GridMapInfo", resolution=m.cell, length_x=size[0], length_y=size[1], pose=pose)
    layout = _layout([("column_index", m.rows), ("row_index", m.cols)])
    data = _make("std_msgs/msg/Float32MultiArray", layout=layout, data=cells.ravel())
    return _make(
        KINDS["map"], header=header(m.stamp_ns, m.frame), info=info, layers=["elevation"], basic_layers=["elevation"],
        data=[data], outer_start_index=0, inner_start_index=0,
    )  # fmt: skip


def stamp_of(message: Any) -> int:
    """Return the time of the header of a message, ns; 0 = it has none."""
    own = getattr(message, "header", None)
    return 0 if own is None else own.stamp.sec * 10**9 + own.stamp.nanosec


def delay(message: Any, offset_ns: int) -> None:
    """Add `offset_ns` to all time stamps of a ROS message, in place."""
    for each in getattr(message, "transforms", [message]):
        if offset_ns and hasattr(each, "header"):
            each.header = header(stamp_of(each) + offset_ns, each.header.frame_id)
        elif hasattr(each, "timestamp"):
            each.timestamp += 1e-9 * offset_ns
