"""A standing quadruped that sways over its feet, as the rows of an inertial unit, of encoders and of raw foot forces.

Numbers are float32, as robots send them; stamps are whole ms. Written as ROS 1 and ROS 2 bags and as CSV.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from surefoot.geometry.constants import GRAVITY
from surefoot.record.columns import recorded_columns
from surefoot.robot.kinematics import foot_positions, legs_ik
from surefoot.robot.reader import load_robot

ROBOT = "lupo"
MS = 1_000_000
START_NS = 1_700_000_000 * 10**9
ZERO, PER_NEWTON = 40.0, 2.0  # of the raw foot forces
ORDER = ("rf", "lf", "rh", "lh")  # of the raw forces, as a maker has it


@dataclass(frozen=True)
class Sway:
    """Rows at the same stamps."""

    stamp_ns: NDArray[np.int64]  # (n,)
    gyro: NDArray[np.float32]  # (n, 3)
    acc: NDArray[np.float32]  # (n, 3)
    joints: NDArray[np.float32]  # (n, nj)
    raw: NDArray[np.float32]  # (n, 4) in `ORDER`

    def cut(self, rows: slice) -> "Sway":
        return replace(self, **{name: part[rows] for name, part in vars(self).items()})


@cache
def sway(seconds: float = 1.6, rate_hz: int = 500) -> Sway:
    """Stand for 0.8 s, then sway by 1 cm at 1 Hz; two feet at a time carry nothing, as their forces show."""
    robot, rng = load_robot(ROBOT), np.random.default_rng(3)
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    moving = np.clip(t - 0.8, 0.0, None)
    x = 0.01 * (1.0 - np.cos(2.0 * np.pi * moving))
    ax = 0.01 * (2.0 * np.pi) ** 2 * np.cos(2.0 * np.pi * moving) * (moving > 0.0)
    feet = foot_positions(robot.model, robot.neutral)
    joints = np.array([legs_ik(robot.model, feet - np.array([shift, 0.0, 0.0]))[0] for shift in x])
    acc = rng.normal(0.0, 0.02, (len(t), 3)) + np.column_stack([ax, 0.0 * ax, GRAVITY + 0.0 * ax])
    force = np.full((len(t), 4), 0.25 * GRAVITY * robot.mass)
    for pair, other in ((0, 3), (1, 2)), ((1, 2), (0, 3)):
        light = (t > 0.8) & (np.floor(10.0 * t) % 2 == pair[0])
        force[np.ix_(light, pair)], force[np.ix_(light, other)] = 0.0, 0.5 * GRAVITY * robot.mass
    stamps = START_NS + np.round(t * 1000).astype(np.int64) * MS
    gyro = rng.normal(0.0, 0.003, (len(t), 3))
    parts = (gyro, acc, joints, ZERO + PER_NEWTON * force)
    return Sway(stamps, *(part.astype(np.float32) for part in parts))


def recorded_walk(path: Path, rate_hz: int) -> Sway:
    """Return the sensor numbers of a recorded walk at a rate; standing feet weigh 45 N, lifted ones 3 N."""
    c = recorded_columns(path)[0]
    first, last = (fit(c["stamp_ns"][k], c["joints_stamp_ns"][k]) for fit, k in ((max, 0), (min, -1)))
    at = first + np.arange((last - first) * rate_hz // 10**9 + 1) * (10**9 // rate_hz)
    row = np.searchsorted(c["joints_stamp_ns"], at, side="right") - 1
    force = np.where(c["touch"][row] > 0.5, 45.0, 3.0)[:, [load_robot(ROBOT).leg_names.index(leg) for leg in ORDER]]

    def between(stamps: NDArray[np.int64], values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.column_stack([np.interp(at, stamps, column) for column in values.T])

    parts = (between(c["stamp_ns"], c["gyro"]), between(c["stamp_ns"], c["acc"]))
    rest = (between(c["joints_stamp_ns"], c["joints"]), force)
    return Sway(START_NS + at - first, *(part.astype(np.float32) for part in (*parts, *rest)))


def messages(log: Sway, store: Any, names: Sequence[str], frame: str = "imu_link") -> dict[str, list[tuple[int, Any]]]:
    """Return the messages of `/imu/data`, `/joint_states` and `/feet` with their stamps."""
    kinds = store.types
    one = {"seq": 0} if store.types["std_msgs/msg/Header"].__dataclass_fields__.get("seq") else {}

    def header(stamp: int, name: str) -> Any:
        time = kinds["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        return kinds["std_msgs/msg/Header"](stamp=time, frame_id=name, **one)

    def vector(x: NDArray[np.float32]) -> Any:
        return kinds["geometry_msgs/msg/Vector3"](*map(float, x))

    out: dict[str, list[tuple[int, Any]]] = {"/imu/data": [], "/joint_states": [], "/feet": []}
    turn, none, empty = kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0), np.zeros(9), np.zeros(0)
    state = kinds["sensor_msgs/msg/JointState"]
    for k, stamp in enumerate(log.stamp_ns.tolist()):
        w, a = vector(log.gyro[k]), vector(log.acc[k])
        out["/imu/data"].append(
            (stamp, kinds["sensor_msgs/msg/Imu"](header(stamp, frame), turn, none, w, none, a, none))
        )
        joints, raw = log.joints[k].astype(np.float64), log.raw[k].astype(np.float64)
        out["/joint_states"].append((stamp, state(header(stamp, ""), list(names), joints, empty, empty)))
        out["/feet"].append((stamp, state(header(stamp, ""), [], empty, empty, raw)))
    return out


def write_ros1(path: Path, log: Sway, names: Sequence[str], **more: Any) -> Path:
    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer1(path) as writer:
        for topic, rows in messages(log, store, names, **more).items():
            link = writer.add_connection(topic, rows[0][1].__msgtype__, typestore=store)
            for k, (_, message) in enumerate(rows):
                writer.write(link, START_NS + 2 * k * MS, store.serialize_ros1(message, message.__msgtype__))
    return path


def write_ros2(path: Path, log: Sway, names: Sequence[str], mcap: bool = True, **more: Any) -> Path:
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3) as writer:
        for topic, rows in messages(log, store, names, **more).items():
            link = writer.add_connection(topic, rows[0][1].__msgtype__, typestore=store)
            for stamp, message in rows:
                writer.write(link, stamp, store.serialize_cdr(message, message.__msgtype__))
    return path


def write_csv(path: Path, log: Sway, names: Sequence[str]) -> Path:
    legs = load_robot(ROBOT).leg_names
    columns = ["stamp_ns", *(f"gyro_{a}" for a in "xyz"), *(f"acc_{a}" for a in "xyz"), *(f"joint_{n}" for n in names)]
    columns += [f"force{f}" for f in range(4)]
    raw = log.raw[:, [ORDER.index(leg) for leg in legs]]
    with path.open("w") as file:
        file.write(",".join(columns) + "\n")
        for k, stamp in enumerate(log.stamp_ns.tolist()):
            numbers = np.concatenate([log.gyro[k], log.acc[k], log.joints[k], raw[k]]).astype(np.float64)
            file.write(",".join([str(stamp), *map(repr, numbers.tolist())]) + "\n")
    return path
