"""Raw logs of other programs, read from bags and tables: sensor streams with stamps, names and frames."""

from dataclasses import dataclass, field
from pathlib import Path
from shlex import quote
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array, Ints
from surefoot.errors import SurefootError
from surefoot.record.tables import read_table

TABLES = (".csv", ".npz")
"""File suffixes of logs that are stored as tables."""
AHEAD_S = 10.0
"""Largest step between two successive stamps of a stream, s; above it the log is refused (the clock has jumped)."""


class Stream(NamedTuple):
    """Samples of one sensor: stamps, ns, and a row of values for each."""

    stamp_ns: Ints  # (n,)
    values: Array  # (n, k)


class Transform(NamedTuple):
    """Fixed pose of a frame in its parent frame."""

    parent: str
    position: Array  # (3,) m
    quat_wxyz: Array  # (4,) rot_parent_from_child


@dataclass
class RawLog:
    """Raw log of one robot: sensor streams, with joints and feet in the order of the log."""

    imu: Stream  # (n, 6) gyro rad/s, specific force m/s^2
    imu_frame: str
    joints: Stream  # (m, J) rad
    joint_names: tuple[str, ...]
    velocity: Array | None = None  # (m, J) rad/s
    torque: Array | None = None  # (m, J) Nm
    feet: Stream | None = None  # (k, F) forces or flags
    feet_names: tuple[str, ...] = ()  # empty = unknown
    flags: bool = False  # the feet are flags, not forces
    frames: dict[str, Transform] = field(default_factory=dict[str, Transform])  # by name of the child
    notes: list[str] = field(default_factory=list[str])


def in_order(name: str, stream: Stream, sort: bool) -> Stream:
    """Return a stream with non-decreasing stamps, checked for gaps.

    Args:
        name: name of the stream, for errors.
        stream: samples with their stamps.
        sort: True: sort the rows by stamp; False: refuse stamps that go back.

    Raises:
        SurefootError: there are no rows, all stamps are 0, they go back, or they jump ahead by more than `AHEAD_S`.
    """
    stamps = stream.stamp_ns
    if not len(stamps):
        raise SurefootError("invalid", f"{name} has no messages", name)
    if stamps.max() <= 0:
        raise SurefootError("invalid", f"{name}: all stamps are 0; `--clock record` takes the times of arrival", name)
    steps = np.diff(stamps)
    back = np.flatnonzero(steps < 0)
    if back.size and not sort:
        text = f"{name} row {back[0] + 1}: the stamp goes back by {-1e-9 * float(steps[back[0]]):.6g} s"
        raise SurefootError("invalid", f"{text}; {back.size} rows do (--sort puts them in order)", name)
    if back.size:
        order = np.argsort(stamps, kind="stable")
        stream, steps = Stream(stamps[order], stream.values[order]), np.diff(stamps[order])
    ahead = np.flatnonzero(steps > 1e9 * AHEAD_S)
    if ahead.size:
        text = f"{name} row {ahead[0] + 1}: the clock jumps ahead by {1e-9 * float(steps[ahead[0]]):.6g} s"
        raise SurefootError("invalid", f"{text}, allowed are {AHEAD_S:g} s; `--clock record` takes arrival times", name)
    return stream


def log_of_table(path: Path, sort: bool) -> RawLog:
    """Read a CSV or NPZ file with joint angles, with the column names of `surefoot estimate`; `sort`: sort by stamp.

    Raises:
        SurefootError: the file cannot be read, or has no joints.
    """
    columns = read_table(path, sort)
    if "joints" not in columns:
        other = f"`surefoot estimate {quote(str(path))}` reads logs of feet without them"
        text = f"{path} has no joint angles (joint_<name>); {other}"
        raise SurefootError("invalid", text, "joints")
    stamps = np.asarray(columns["foot_stamp_ns"], dtype=np.int64)
    log = RawLog(
        Stream(np.asarray(columns["stamp_ns"], dtype=np.int64), np.hstack([columns["gyro"], columns["acc"]])), "",
        Stream(stamps, np.asarray(columns["joints"], dtype=np.float64)),
        tuple(str(name) for name in columns.get("joint_names", ())),
        torque=columns.get("torque"),
    )  # fmt: skip
    for key in ("touch", "contact", "force"):
        if key in columns:
            values = np.asarray(columns[key], dtype=np.float64)
            values = values.max(axis=2) if values.ndim == 3 else values
            keep = np.isfinite(values).all(axis=1)
            log.feet, log.flags = Stream(stamps[keep], values[keep]), key != "force"
            break
    return log
