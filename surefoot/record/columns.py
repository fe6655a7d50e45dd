"""Samples of a recording as arrays, with the column names of logs in CSV and NPZ files (docs/estimate.md)."""

from array import array
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from surefoot.errors import SurefootError
from surefoot.record.recording import ReadableRecording, read_recording, recording_info
from surefoot.schemas.base import Message
from surefoot.schemas.hw import ExternalMotion, FootContacts, Imu, JointState
from surefoot.schemas.sim import Truth
from surefoot.schemas.state import Odometry, VelocityEstimate

Columns = dict[str, NDArray[Any]]
SHAPES: dict[str, tuple[int | str, ...]] = {
    "t": ("n",), "stamp_ns": ("n",), "gyro": ("n", 3), "acc": ("n", 3), "saturated": ("n",), "foot_t": ("m",),
    "foot_stamp_ns": ("m",), "foot_position": ("m", "F", 3), "foot_rotation": ("m", "F", 3, 3),
    "foot_quat_wxyz": ("m", "F", 4), "contact": ("m", "F"), "touch": ("m", "F", "S"), "force": ("m", "F"),
    "joints": ("m", "J"), "torque": ("m", "J"), "true_position": ("n", 3), "true_rotation": ("n", 3, 3),
    "true_quat_wxyz": ("n", 4), "true_velocity": ("n", 3),
    "external_t": ("e",), "external_stamp_ns": ("e",), "external_position": ("e", 3),
    "external_yaw": ("e",), "external_quat_wxyz": ("e", 4), "external_velocity": ("e", 3),
    "external_position_covariance": ("e", 3, 3), "external_velocity_covariance": ("e", 3, 3),
    "external_yaw_variance": ("e",),
}  # fmt: skip
"""Shape of each column of a log, by name: n inertial rows, m foot samples, F feet, S switches, J joints, e external
samples."""
FEET_METADATA = ("feet", "foot_radius", "sole_size", "contact_on", "contact_off")
"""Names of log metadata about the feet: names of the feet, radius, sole size and contact thresholds."""
METADATA = (*FEET_METADATA, "external_position_sd", "external_velocity_sd", "external_yaw_sd", "external_delay")
"""Names of log metadata: further arrays in NPZ files, lines such as `# sole_size = 0.2, 0.1` at the top of CSV
files."""


class _KeyRows:
    """Numbers of the messages of one key, one row for each message; every row must be as long as the first."""

    def __init__(self) -> None:
        self.stamps, self.ticks = array("q"), array("q")
        self.values: dict[str, array[float]] = {}
        self.widths: dict[str, int] = {}

    def add(self, key: str, message: Message, parts: dict[str, tuple[float, ...]]) -> None:
        for name, numbers in parts.items():
            width = self.widths.setdefault(name, len(numbers))
            if len(numbers) != width:
                row = len(self.stamps)
                raise SurefootError("malformed", f"{key} row {row}: {len(numbers)} numbers after rows of {width}", name)
            self.values.setdefault(name, array("d")).extend(numbers)
        try:
            self.stamps.append(message.stamp_ns)
            self.ticks.append(message.tick)
        except OverflowError:
            text = f"{key} row {len(self.stamps)}: got {message.stamp_ns} and {message.tick}, allowed are 64 bits"
            raise SurefootError("malformed", text, "stamp_ns") from None

    def columns(self, prefix: str) -> Columns:
        out: Columns = {
            f"{prefix}stamp_ns": np.array(self.stamps, dtype=np.int64),
            f"{prefix}tick": np.array(self.ticks, dtype=np.int64),
        }
        for name, numbers in self.values.items():
            out[name] = np.array(numbers, dtype=np.float64).reshape(len(self.stamps), self.widths[name])
        return out


def _imu(message: Message) -> dict[str, tuple[float, ...]]:
    m = cast(Imu, message)
    return {"gyro": m.gyro, "acc": m.acc, "saturated": (float(m.saturated),)}


def _joints(message: Message) -> dict[str, tuple[float, ...]]:
    return {"joints": cast(JointState, message).position}


def _contacts(message: Message) -> dict[str, tuple[float, ...]]:
    m = cast(FootContacts, message)
    width = max((len(foot) for foot in m.touch), default=1)
    touch = tuple(float(s) for foot in m.touch for s in (*foot, *((False,) * (width - len(foot)))))
    force = tuple(float("nan") if f is None else f for f in m.normal_force_n)
    return {"touch": touch, "force": force}


def _truth(message: Message) -> dict[str, tuple[float, ...]]:
    m = cast(Truth, message)
    return {
        "base_position": m.position, "base_quat_wxyz": m.quat_wxyz, "base_velocity": m.velocity,
        "base_rate": m.angular_velocity, "base_joints": m.joints,
    }  # fmt: skip


def _velocity(message: Message) -> dict[str, tuple[float, ...]]:
    m = cast(VelocityEstimate, message)
    flags = (m.initialised, m.standing, m.inputs_ok, m.filter_ok, m.sensors_ok)
    return {
        "published_velocity_imu": m.velocity_imu, "published_velocity_heading": m.velocity_heading,
        "published_g_up": m.g_up, "published_covariance": m.covariance,
        "published_flags": tuple(float(flag) for flag in flags),
        "published_nis": (float("nan") if m.nis is None else m.nis,),
    }  # fmt: skip


def _odometry(message: Message) -> dict[str, tuple[float, ...]]:
    m = cast(Odometry, message)
    return {"published_position": m.position, "published_yaw": (m.yaw,), "published_velocity_odom": m.velocity}


def _external(message: Message) -> dict[str, tuple[float, ...]]:
    return {"external_row": external_numbers(cast(ExternalMotion, message))}


def external_numbers(m: ExternalMotion) -> tuple[float, ...]:
    """Return an external motion sample as 26 numbers, NaN = absent.

    Position (3), yaw, velocity (3), covariance of position (9), variance of yaw, covariance of velocity (9).
    """
    nan = float("nan")

    def three(value: tuple[float, ...] | None, size: int) -> tuple[float, ...]:
        return (nan,) * size if value is None else value

    yaw, spread = (nan if x is None else x for x in (m.yaw, m.yaw_variance))
    return (
        *three(m.position, 3), yaw, *three(m.velocity, 3), *three(m.position_covariance, 9), spread,
        *three(m.velocity_covariance, 9),
    )  # fmt: skip


READ: dict[str, tuple[str, Callable[[Message], dict[str, tuple[float, ...]]]]] = {
    "hw/imu": ("", _imu),
    "hw/joints": ("joints_", _joints),
    "hw/contacts": ("contacts_", _contacts),
    "hw/external": ("external_", _external),
    "sim/truth": ("base_", _truth),
    "state/velocity": ("published_", _velocity),
    "state/odometry": ("odometry_", _odometry),
}
"""Prefix of a topic's columns of stamps and ticks, and the function that returns a message's numbers by name of the
column, by key of the topic."""


def recorded_columns(
    path: Path | ReadableRecording, progress: Callable[[float], None] | None = None
) -> tuple[Columns, str]:
    """Return the hardware samples, the truth and the published estimates of the last run (epoch) in a recording.

    Args:
        path: MCAP file, which must be undamaged, or an open recording, whose readable part is read.
        progress: called with the share, 0 to 1, that is read.

    Returns:
        Arrays by name, each with one row per sample, and the name of the robot (empty: unknown).

    Raises:
        SurefootError: the file cannot be read as a recording, has no inertial samples, or rows of changing length.
    """
    tables = {key: _KeyRows() for key in READ}
    epoch = -1
    opened = isinstance(path, ReadableRecording)
    keys, file = tuple(READ), path.path if opened else path
    for recorded in path.messages(keys, progress) if opened else read_recording(path, keys, progress):
        message = recorded.message()
        if message.epoch < epoch:
            continue
        if message.epoch > epoch:
            tables, epoch = {key: _KeyRows() for key in READ}, message.epoch
        tables[recorded.key].add(recorded.key, message, READ[recorded.key][1](message))
    if not tables["hw/imu"].stamps:
        raise SurefootError("invalid", f"{file} has no hw/imu", "hw/imu")
    out: Columns = {}
    for key, table in tables.items():
        if table.stamps:
            out.update(table.columns(READ[key][0]))
    metadata = path.metadata if opened else recording_info(path)["metadata"]
    return out, str(metadata.get("run", {}).get("robot", ""))
