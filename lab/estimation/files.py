"""Reading of logs from files: recordings of this project (MCAP), and CSV and NPZ of other programs."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.arrays import Array, Flags
from surefoot.errors import SurefootError
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.record.columns import FEET_METADATA, Columns
from surefoot.record.recording import open_readable
from surefoot.record.tables import read_table, unread
from surefoot.robot.description import Robot
from surefoot.robot.names import joint_order
from surefoot.robot.reader import load_robot
from surefoot.services.estimator.feet.contact import contact_points
from surefoot.services.estimator.feet.mount import feet_in_imu, foot_mount

from .align import Alignment, align, aligned
from .checks import check_kinematics
from .external import externals_of
from .feet import UNSTATED, FeetOptions, contacts, shape, up_at
from .log import Log
from .recorded import log_of_recording
from .torques import forces_by_torques
from .truth import truth_of
from .units import check_units, quietest

STANDSTILL = {"standstill_gyro_sd": 0.05, "standstill_acc_sd": 0.5}
"""Standard deviations of gyro, rad/s, and accelerometer, m/s^2, of unknown sensors above which a robot does not stand
still."""


@dataclass(frozen=True)
class Opened:
    """Log with notes on what was assumed about it."""

    log: Log
    notes: tuple[str, ...]
    alignment: Alignment | None = None  # of the truth with the sensors, where that was taken out


def open_log(
    path: Path, robot: str | None = None, sort: bool = False, feet: FeetOptions = UNSTATED, aligning: bool = False,
    **sensors: float,
) -> Opened:  # fmt: skip
    """Return a log from a file, checked and completed, with notes on what was assumed.

    Args:
        path: `.mcap`, `.csv` or `.npz`.
        robot: name of a description, for logs with joint angles; a recording names its own.
        sort: put rows into the order of their stamps.
        feet: statements on the feet of a log without a robot; they count more than the metadata of the file.
        aligning: align the truth with the sensors; else a note reports a truth that is not aligned.
        sensors: parameters of the estimator that are known of the sensors, e.g. `sigma_w`.

    Raises:
        SurefootError: the log cannot be used; with row, column and factor as far as they are known.
    """
    if not path.exists():
        raise SurefootError("invalid", f"{path}: no such file", "log")
    if path.suffix.lower() == ".mcap":
        if feet is not UNSTATED and feet != UNSTATED:
            raise SurefootError("invalid", "a recording names the robot, and with it feet and contacts", "feet")
        recording = open_readable(path)
        log, notes = log_of_recording(recording, robot), recording.notes
    else:
        log, notes = _of_table(path, sort, None if robot is None else load_robot(robot), feet)
    check_units(log)
    if path.suffix.lower() != ".mcap":
        notes += check_kinematics(log)
    if log.robot is None:
        noise = quietest(log)
        found = {
            "sigma_w": noise.sigma_w, "sigma_q": noise.sigma_q, **STANDSTILL,
            "imu_period_ns": int(np.median(np.diff(log.stamp_ns))),
        }  # fmt: skip
        if len(log.foot_ns) > 1:
            found["kinematics_period_ns"] = int(np.median(np.diff(log.foot_ns)))
        quiet = f"gyro {noise.sigma_w:.2g} rad/s, accelerometer {noise.sigma_q:.2g} m/s^2"
        notes += (f"noise of the quiet part: {quiet}",)
        log = replace(log, sensors=found | sensors)
    else:
        log = replace(log, sensors={**log.sensors, **sensors})
    if log.truth is None or path.suffix.lower() == ".mcap":
        if aligning:
            raise SurefootError("invalid", f"{path} has no truth of others that could be aligned", "align")
        return Opened(log, notes)
    found = align(log)
    if aligning:
        return Opened(aligned(log, found), notes, found)
    return Opened(log, notes + found.notes(float(np.median(np.diff(log.seconds)))))


def _of_table(path: Path, sort: bool, robot: Robot | None, feet: FeetOptions) -> tuple[Log, tuple[str, ...]]:
    """Return the log of a CSV or NPZ file, and notes that name its arrays or columns that are not read.

    Raises:
        SurefootError: the file is no log; the text ends with those where the name of one is nearly known.
    """
    try:
        log, notes = log_of_table(path.stem, read_table(path, sort), robot, feet)
    except SurefootError as error:
        others = unread(path) if error.code == "invalid" and path.is_file() else ""
        if "did you mean" in others:
            raise SurefootError(error.code, f"{error.message}; {others}", error.field) from None
        raise
    others = unread(path)
    return log, (*notes, others) if others else notes


def log_of_table(
    name: str, columns: Columns, robot: Robot | None = None, feet: FeetOptions = UNSTATED, **more: Any
) -> tuple[Log, tuple[str, ...]]:
    """Return a log from checked columns of a table, and notes on what was assumed.

    Args:
        name: name of the log.
        columns: arrays by name, in SI units.
        robot: description, needed if the feet come as joint angles.
        feet: statements on the feet; they count more than those among the columns.
        more: other fields of the log.

    Raises:
        SurefootError: the columns do not fit the robot, or there are no feet.
    """
    notes: list[str] = []
    columns, position, rot, joints = _kinematics(name, columns, robot, notes)
    gyro, acc = (np.ascontiguousarray(columns[key], dtype=np.float64) for key in ("gyro", "acc"))
    given = feet.over(FeetOptions.of({key: columns[key] for key in FEET_METADATA if key in columns}))
    contact, touch = contacts(columns, position, given, notes)
    truth = truth_of(columns, notes)
    mounted: dict[str, Any]
    if robot is not None:
        mounted = _mounted(name, robot, given, position.shape[1], touch, notes)
    else:
        mounted = {**shape(given, columns, position, rot, contact, notes)}
        if truth is not None:
            mounted["rot_base_from_imu"] = np.ascontiguousarray(truth.rot[0])  # base_link is level where the log begins
    base = mounted.get("rot_base_from_imu", np.eye(3))
    mounted["external"] = externals_of(columns, base, notes)
    saturated = columns["saturated"] > 0.5 if "saturated" in columns else None
    stamp = np.ascontiguousarray(columns["stamp_ns"])
    log = Log(
        name, stamp, gyro, acc, np.ascontiguousarray(columns["foot_stamp_ns"]), np.ascontiguousarray(position),
        np.ascontiguousarray(rot), contact, truth, touch=touch, force=columns.get("force"), joints=joints,
        saturated=saturated, **(mounted | more),
    )  # fmt: skip
    if len(stamp) < 50:
        notes.append(f"{len(stamp)} rows are too few for a standstill of 50")
    return log, tuple(notes)


def _kinematics(
    name: str, columns: Columns, robot: Robot | None, notes: list[str]
) -> tuple[Columns, Array, Array, Array | None]:
    """Return columns, feet (m, F, 3) m, IMU axes, rotations from foot to IMU (m, F, 3, 3), joints (m, nj) rad or None.

    Forces by joint torques are added to the columns of a log that has no measured forces.
    """
    if "foot_position" in columns:
        return columns, *_feet(columns, notes), None
    if "joints" in columns:
        if robot is None:
            raise SurefootError("invalid", f"{name} has joint angles; name the robot they belong to (--robot)", "robot")
        order, joints = _joints(columns, robot)
        mount = foot_mount(robot)
        seen = [feet_in_imu(mount, q) for q in joints]
        if "torque" in columns and "force" not in columns:
            up = up_at(columns) @ mount.rot_imu_from_base
            found = forces_by_torques(robot, joints, np.asarray(columns["torque"], dtype=np.float64)[:, order], up)
            columns = {**columns, "force": found.force}
            notes.append(found.note or "ground forces by the joint torques")
        return columns, np.array([pair[0] for pair in seen]), np.array([pair[1] for pair in seen]), joints
    notes.append("no feet: only the inertial unit is left")
    columns = {**columns, "foot_stamp_ns": np.empty(0, dtype=np.int64), "contact": np.empty((0, 1))}
    return columns, np.empty((0, 1, 3)), np.empty((0, 1, 3, 3)), None


def _mounted(
    name: str, robot: Robot, given: FeetOptions, feet: int, touch: Flags | None, notes: list[str]
) -> dict[str, Any]:
    """Return the fields of a log that a robot description gives: radius, mounting of the IMU, robot.

    `feet`: number of feet in the log; `touch`: its switches, (m, F, S) or None.
    """
    mount = foot_mount(robot)
    if given.shaped:
        raise SurefootError("invalid", f"the feet are those of {robot.name}; leave --feet or --robot out", "feet")
    if feet != len(robot.legs):
        raise SurefootError("invalid", f"{name} has {feet} feet; {robot.name} has {len(robot.legs)}", "robot")
    places = contact_points(robot).switches.shape[1]
    if touch is not None and places > 1 and touch.shape[2] not in (1, places):
        notes.append(
            f"{touch.shape[2]} switches a foot, {robot.name} has places for {places}: taken as one flag a foot"
        )
    return {
        "radius": mount.radius, "rot_base_from_imu": np.ascontiguousarray(mount.rot_imu_from_base.T),
        "imu_position": mount.imu_position, "robot": robot,
    }  # fmt: skip


def _feet(columns: Columns, notes: list[str]) -> tuple[Array, Array]:
    position = np.asarray(columns["foot_position"], dtype=np.float64)
    if "foot_rotation" in columns:
        rot = np.asarray(columns["foot_rotation"], dtype=np.float64)
        off = np.abs(np.einsum("mfji,mfjk->mfik", rot, rot) - np.eye(3)).max(axis=(2, 3))
        bad = np.argwhere(off > 1e-2)
        if bad.size:
            row, foot = (int(i) for i in bad[0])
            text = f"row {row}, foot {foot}: the orientation is no rotation (off by {off[row, foot]:.3g})"
            raise SurefootError("invalid", f"{text}; {len(bad)} are so", "foot_rotation")
        return position, rot
    if "foot_quat_wxyz" in columns:
        quat = np.asarray(columns["foot_quat_wxyz"], dtype=np.float64)
        rot = np.array([[matrix_from_quat(q) for q in row] for row in quat])
        return position, rot.reshape(*quat.shape[:2], 3, 3)
    notes.append("feet without orientation: velocity by kinematics alone needs three of them")
    return position, np.broadcast_to(np.eye(3), (*position.shape, 3)).copy()


def _joints(columns: Columns, robot: Robot) -> tuple[list[int], Array]:
    """Return the column index of each joint of the robot, and the joint angles (m, nj) rad in the robot's order."""
    joints, order = np.asarray(columns["joints"], dtype=np.float64), list(range(columns["joints"].shape[1]))
    if "joint_names" in columns:
        names = [str(name) for name in columns["joint_names"]]
        by_name = joint_order(names, robot)
        missing = [] if by_name else [name for name in robot.joint_names if name not in names]
        if missing and not all(name.isdigit() for name in names):
            known = ", ".join(robot.joint_names)
            raise SurefootError(
                "invalid", f"no column joint_{missing[0]}; {robot.name} has {known}", f"joint_{missing[0]}"
            )
        if by_name:
            order = by_name
            joints = joints[:, order]
    if joints.shape[1] != robot.nj:
        raise SurefootError("invalid", f"{joints.shape[1]} joints; {robot.name} has {robot.nj}", "joints")
    low, high = robot.joint_lower - 0.2, robot.joint_upper + 0.2
    bad = np.argwhere((joints < low) | (joints > high))
    if len(bad) > 0.05 * len(joints):
        row, joint = (int(i) for i in bad[0])
        value = joints[row, joint]
        hint = (
            "in deg? multiply by 0.0174533" if np.nanmax(np.abs(joints)) > 6.3 else "another robot, or another order?"
        )
        raise SurefootError(
            "invalid", f"row {row}, joint {robot.joint_names[joint]}: {value:.3g} rad is outside "
            f"{robot.joint_lower[joint]:.3g} .. {robot.joint_upper[joint]:.3g} of {robot.name}; {hint}", "joints",
        )  # fmt: skip
    return order, np.ascontiguousarray(joints)
