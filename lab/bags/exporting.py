"""Export of a recording to other formats: rosbag2, CSV, Parquet, and TUM trajectories."""

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.bus.ros2 import types
from surefoot.bus.ros_messages import (
    KINDS,
    contacts_message,
    imu_message,
    joints_message,
    odometry_message,
    transform_message,
)
from surefoot.errors import SurefootError
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.record.columns import Columns, recorded_columns
from surefoot.record.recording import ReadableRecording, open_readable
from surefoot.record.robots import robot_for
from surefoot.robot.description import Robot

from .formats import check_out, check_rate
from .foxglove import write_foxglove

TOPICS = {"imu": "/imu/data", "joints": "/joint_states", "contacts": "/foot_contacts", "odometry": "/odom", "tf": "/tf"}
"""ROS topic of each exported message in a rosbag2; `surefoot bag import` has these names as defaults."""
VERSION = 9
"""Version of the rosbag2 metadata format in exported bags."""
FRAMES = ("odom", "base_link")
Share = Callable[[float], None]
"""Progress function, called with the finished share of the work, 0 to 1."""


def export(
    recording: Path | ReadableRecording,
    kind: str,
    out: Path,
    robot: str | None = None,
    progress: Share = lambda share: None,
    rate_hz: float | None = None,
) -> Path:
    """Write the readable part of a recording in another format, completely or not at all; return the path.

    Args:
        recording: recording (MCAP), as a path or opened.
        kind: name of the format, a key of `FORMATS`.
        out: file or folder to write, which must not exist.
        robot: name or folder of the robot description; None = that of the recording.
        progress: called with the share that is done, 0 to 1.
        rate_hz: snapshots a second of a `foxglove` export; None = one for each tick.

    Raises:
        SurefootError: the format is unknown, `out` exists, the recording cannot be read, or is of another robot.
    """
    check_out(kind, out)
    check_rate(kind, rate_hz)
    opened = open_readable(recording)
    description = robot_for(opened, robot)
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.parent) as folder:
        part = Path(folder) / out.name
        more = {} if rate_hz is None else {"rate_hz": rate_hz}
        FORMATS[kind](opened, part, description, progress, **more)
        shutil.move(part, out)
    return out


def table_of(columns: Columns, robot: Robot) -> dict[str, NDArray[Any]]:
    """Return the table of a recording: columns by name, (rows,) each, SI units, with a row per stamp of IMU or joints.

    Sensor columns have the names that `surefoot estimate` reads; estimates follow. NaN = no sample at this stamp. The
    true position of base_link, if recorded, is `base_x` ...
    """
    joints, stance = columns["joints_stamp_ns"], columns["contacts_stamp_ns"]
    stamps = np.unique(np.concatenate([columns["stamp_ns"], joints]))
    out: dict[str, NDArray[Any]] = {"stamp_ns": stamps}

    def put(names: list[str], at: NDArray[Any], values: NDArray[Any]) -> None:
        rows = np.searchsorted(stamps, at)
        keep = (rows < len(stamps)) & (stamps[np.minimum(rows, len(stamps) - 1)] == at)
        for i, name in enumerate(names):
            out[name] = np.full(len(stamps), np.nan)
            out[name][rows[keep]] = values[keep, i]

    for key in ("gyro", "acc"):
        put([f"{key}_{axis}" for axis in "xyz"], columns["stamp_ns"], columns[key])
    put([f"joint_{name}" for name in robot.joint_names], joints, columns["joints"])
    pair = np.searchsorted(stance, joints, side="right") - 1
    seen = np.flatnonzero(pair >= 0)
    touch = columns["touch"].reshape(len(stance), robot.nlegs, -1)
    for f in range(robot.nlegs):
        switches = touch.shape[2]
        names = [f"contact{f}"] if switches == 1 else [f"contact{f}_{s}" for s in range(switches)]
        put(names, joints[seen], touch[pair[seen], f])
        if np.isfinite(columns["force"]).any():
            put([f"force{f}"], joints[seen], columns["force"][pair[seen], f : f + 1])
    for key, names in (
        ("published_velocity_odom", ["estimate_vx", "estimate_vy", "estimate_vz"]),
        ("published_position", ["estimate_x", "estimate_y", "estimate_z"]),
        ("published_yaw", ["estimate_yaw"]),
    ):
        if key in columns:
            put(names, columns["odometry_stamp_ns"], columns[key])
    if "base_position" in columns:
        put(["base_x", "base_y", "base_z"], columns["base_stamp_ns"], columns["base_position"])
    return out


def _table(recording: ReadableRecording, robot: Robot, progress: Share) -> dict[str, NDArray[Any]]:
    columns = recorded_columns(recording, progress)[0]
    for need in ("joints", "touch"):
        if need not in columns:
            raise SurefootError("invalid", f"{recording.path} has no {need}", need)
    _check_joints(recording, columns["joints"].shape[1], robot)
    return table_of(columns, robot)


def _check_joints(recording: ReadableRecording, count: int, robot: Robot) -> None:
    """Raise SurefootError if a recording with `count` joints does not fit the robot description."""
    if count != robot.nj:
        raise SurefootError("invalid", f"{recording.path} has {count} joints, {robot.name} has {robot.nj}", "robot")


def _csv(recording: ReadableRecording, out: Path, robot: Robot, progress: Share) -> None:
    table = _table(recording, robot, progress)
    with out.open("w", encoding="utf-8") as file:
        file.write(",".join(table) + "\n")
        for row in zip(*(values.tolist() for values in table.values()), strict=True):
            file.write(",".join("" if x != x else repr(x) for x in row) + "\n")


def _parquet(recording: ReadableRecording, out: Path, robot: Robot, progress: Share) -> None:
    try:
        import pyarrow  # pyright: ignore[reportMissingImports] - optional
        from pyarrow import parquet  # pyright: ignore[reportMissingImports] - optional
    except ImportError:
        raise SurefootError("not_installed", "Parquet needs: pip install 'surefoot[parquet]'", "to") from None
    parquet.write_table(pyarrow.table(_table(recording, robot, progress)), out)


def _tum(recording: ReadableRecording, out: Path, robot: Robot, progress: Share) -> None:
    with out.open("w", encoding="utf-8") as file:
        for item in recording.messages(("state/odometry",), progress):
            m: Any = item.message()
            w, x, y, z = m.quat_wxyz
            numbers = " ".join(f"{value:.9f}" for value in (*m.position, x, y, z, w))
            file.write(f"{m.stamp_ns * 1e-9:.9f} {numbers}\n")
        if not file.tell():
            raise SurefootError("invalid", f"{recording.path} has no state/odometry", "recording")


def _rosbag2(recording: ReadableRecording, out: Path, robot: Robot, progress: Share) -> None:
    types()
    from rosbags.rosbag2 import StoragePlugin, Writer

    rot = matrix_from_quat(robot.imu.quat_wxyz)
    velocity: Any = None
    written = 0
    with Writer(out, version=VERSION, storage_plugin=StoragePlugin.MCAP) as writer:
        links = {name: writer.add_connection(topic, KINDS[name], typestore=types()) for name, topic in TOPICS.items()}
        for item in recording.messages(
            ("hw/imu", "hw/joints", "hw/contacts", "state/velocity", "state/odometry"), progress
        ):
            m: Any = item.message()
            if m.stamp_ns < 0:
                raise SurefootError("malformed", f"{item.key}: got {m.stamp_ns}, allowed is 0 or more", "stamp_ns")
            made: dict[str, Any] = {}
            if item.key == "hw/imu":
                made["imu"] = imu_message(m, "imu")
            elif item.key == "hw/joints":
                _check_joints(recording, len(m.position), robot)
                made["joints"] = joints_message(m, robot.joint_names)
            elif item.key == "hw/contacts":
                made["contacts"] = contacts_message(m)
            elif item.key == "state/velocity":
                velocity = m
            elif velocity is not None:
                made = {"odometry": odometry_message(m, velocity, rot, FRAMES), "tf": transform_message(m, FRAMES)}
            written += len(made)
            for name, message in made.items():
                writer.write(links[name], m.stamp_ns, types().serialize_cdr(message, KINDS[name]))
    if not written:
        raise SurefootError("invalid", f"{recording.path} has none of hw/imu, hw/joints, hw/contacts", "recording")


FORMATS: dict[str, Callable[..., None]] = {
    "rosbag2": _rosbag2, "csv": _csv, "parquet": _parquet, "tum": _tum, "foxglove": write_foxglove,
}  # fmt: skip
"""Export functions by the name of their format, as in `formats.ENDINGS`."""
