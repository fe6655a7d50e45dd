"""Logs from files: recordings of this project (MCAP), CSV and NPZ of others."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.errors import SurefootError
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.record.columns import Columns
from surefoot.record.tables import read_table
from surefoot.robot.description import Robot
from surefoot.robot.reader import load_robot
from surefoot.services.estimator.feet.contact import contact_points
from surefoot.services.estimator.feet.mount import feet_in_imu, foot_mount

from .log import Log, TrueMotion
from .recorded import log_of_recording
from .units import check_units, quietest

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

ON, OFF = 0.25, 0.15
"""Shares of the usual total force: a foot stands from the first on, until its force falls below the second."""
STANDSTILL = {"standstill_gyro_sd": 0.05, "standstill_acc_sd": 0.5}
"""Limits of a rest where the sensors are unknown, rad/s and m/s^2; the feet must not move either."""
LOWEST_M = 0.005
"""Height over the lowest foot up to which a foot stands, where contacts and forces are unknown, m."""


@dataclass(frozen=True)
class Opened:
    """A log, and notes on what was assumed about it."""

    log: Log
    notes: tuple[str, ...]


def open_log(path: Path, robot: str | None = None, sort: bool = False, **sensors: float) -> Opened:
    """Read, check and complete a log.

    Args:
        path: `.mcap`, `.csv` or `.npz`.
        robot: name of a description, for logs with joint angles; a recording names its own.
        sort: put rows into the order of their stamps.
        sensors: parameters of the estimator that are known of the sensors, e.g. `sigma_w`.

    Raises:
        SurefootError: the log cannot be used; with row, column and factor as far as they are known.
    """
    if not path.exists():
        raise SurefootError("unreadable", f"{path}: no such file", "log")
    if path.suffix.lower() == ".mcap":
        log, notes = log_of_recording(path, robot), ()
    else:
        log, notes = log_of_table(path.stem, read_table(path, sort), None if robot is None else load_robot(robot))
    check_units(log)
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
    return Opened(log, notes)


def log_of_table(name: str, columns: Columns, robot: Robot | None = None, **more: Any) -> tuple[Log, tuple[str, ...]]:
    """Return a log from checked columns, and notes on what was assumed.

    Args:
        name: of the log.
        columns: see `surefoot.record.tables`.
        robot: description, needed if the feet come as joint angles.
        more: other fields of the log.

    Raises:
        SurefootError: the columns do not fit the robot, or there are no feet.
    """
    notes: list[str] = []
    n = len(columns["stamp_ns"])
    if "foot_position" in columns:
        position, rot = _feet(columns, notes)
        joints = None
    elif "joints" in columns:
        if robot is None:
            raise SurefootError("invalid", f"{name} has joint angles; name the robot they belong to (--robot)", "robot")
        joints = _joints(columns, robot)
        mount = foot_mount(robot)
        seen = [feet_in_imu(mount, q) for q in joints]
        position, rot = (np.array([pair[i] for pair in seen]) for i in range(2))
    else:
        position, rot, joints = np.empty((0, 1, 3)), np.empty((0, 1, 3, 3)), None
        columns = {**columns, "foot_stamp_ns": np.empty(0, dtype=np.int64), "contact": np.empty((0, 1))}
        notes.append("no feet: only the inertial unit is left")
    gyro, acc = (np.ascontiguousarray(columns[key], dtype=np.float64) for key in ("gyro", "acc"))
    contact, touch = _contact(columns, position, acc, notes)
    mounted: dict[str, Any] = {}
    if robot is not None:
        mount = foot_mount(robot)
        if position.shape[1] != len(robot.legs):
            raise SurefootError(
                "invalid", f"{name} has {position.shape[1]} feet; {robot.name} has {len(robot.legs)}", "robot"
            )
        places = contact_points(robot).switches.shape[1]
        if touch is not None and places > 1 and touch.shape[2] not in (1, places):
            notes.append(
                f"{touch.shape[2]} switches a foot, {robot.name} has places for {places}: taken as one flag a foot"
            )
        mounted = {
            "radius": mount.radius, "rot_base_from_imu": np.ascontiguousarray(mount.rot_imu_from_base.T),
            "imu_position": mount.imu_position, "robot": robot.name,
        }  # fmt: skip
    truth = _truth(columns)
    if truth is not None and robot is None:
        mounted["rot_base_from_imu"] = np.ascontiguousarray(truth.rot[0])  # base_link is level where the log begins
    saturated = columns["saturated"] > 0.5 if "saturated" in columns else None
    stamp = np.ascontiguousarray(columns["stamp_ns"])
    log = Log(
        name, stamp, gyro, acc, np.ascontiguousarray(columns["foot_stamp_ns"]), np.ascontiguousarray(position),
        np.ascontiguousarray(rot), contact, truth, touch=touch, force=columns.get("force"), joints=joints,
        saturated=saturated, **(mounted | more),
    )  # fmt: skip
    if n < 50:
        notes.append(f"{n} rows are too few for a standstill of 50")
    return log, tuple(notes)


def _feet(columns: Columns, notes: list[str]) -> tuple[Array, Array]:
    position = np.asarray(columns["foot_position"], dtype=np.float64)
    if "foot_rotation" in columns:
        rot = np.asarray(columns["foot_rotation"], dtype=np.float64)
        off = np.abs(np.einsum("mfji,mfjk->mfik", rot, rot) - np.eye(3)).max(axis=(2, 3))
    elif "foot_quat_wxyz" in columns:
        quat = np.asarray(columns["foot_quat_wxyz"], dtype=np.float64)
        off = np.abs(np.linalg.norm(quat, axis=2) - 1.0)
        rot = np.array([[matrix_from_quat(q) for q in row] for row in quat]).reshape(*quat.shape[:2], 3, 3)
    else:
        notes.append("feet without orientation: velocity by kinematics alone needs three of them")
        return position, np.broadcast_to(np.eye(3), (*position.shape, 3)).copy()
    bad = np.argwhere(off > 1e-2)
    if bad.size:
        row, foot = (int(i) for i in bad[0])
        text = f"row {row}, foot {foot}: the orientation is no rotation (off by {off[row, foot]:.3g})"
        raise SurefootError("invalid", f"{text}; {len(bad)} are so", "foot_rotation")
    return position, rot


def _joints(columns: Columns, robot: Robot) -> Array:
    """Return joint angles (m, nj) rad in the order of the description."""
    joints = np.asarray(columns["joints"], dtype=np.float64)
    if "joint_names" in columns:
        names = [str(name) for name in columns["joint_names"]]
        missing = [name for name in robot.joint_names if name not in names]
        if missing and not all(name.isdigit() for name in names):
            known = ", ".join(robot.joint_names)
            raise SurefootError(
                "invalid", f"no column joint_{missing[0]}; {robot.name} has {known}", f"joint_{missing[0]}"
            )
        if not missing:
            joints = joints[:, [names.index(name) for name in robot.joint_names]]
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
    return np.ascontiguousarray(joints)


def _contact(columns: Columns, position: Array, acc: Array, notes: list[str]) -> tuple[Flags, Flags | None]:
    """Return contacts (m, F) and switches (m, F, S), from the columns that show them."""
    if "touch" in columns:
        touch = columns["touch"] > 0.5
        return np.asarray(touch.any(axis=2), dtype=np.bool_), touch
    if "contact" in columns:
        contact = np.asarray(columns["contact"], dtype=np.float64)
        outside = np.argwhere((contact < 0.0) | (contact > 1.0))
        if outside.size:
            row, foot = (int(i) for i in outside[0])
            value = contact[row, foot]
            raise SurefootError(
                "invalid", f"row {row}: contact{foot} is {value:.3g}, wanted is 0 to 1", f"contact{foot}"
            )
        return contact > 0.5, None
    if "force" in columns:
        force = np.nan_to_num(np.asarray(columns["force"], dtype=np.float64))
        usual = float(np.median(force.sum(axis=1)))
        notes.append(f"contacts by force: from {ON * usual:.0f} N on, until below {OFF * usual:.0f} N")
        contact = np.zeros(force.shape, dtype=np.bool_)
        now = np.zeros(force.shape[1], dtype=np.bool_)
        for k, row in enumerate(force):
            now = (row > ON * usual) | (now & (row >= OFF * usual))
            contact[k] = now
        return contact, None
    notes.append("no contacts: feet within 5 mm of the lowest one are taken to stand")
    rows = np.clip(np.searchsorted(columns["stamp_ns"], columns["foot_stamp_ns"]), 0, len(acc) - 1)
    total = np.nancumsum(np.vstack([np.zeros(3), acc]), axis=0)
    low, high = np.maximum(rows - 25, 0), np.minimum(rows + 25, len(acc))
    up = total[high] - total[low]
    up /= np.maximum(np.linalg.norm(up, axis=1), 1e-9)[:, None]
    height = np.einsum("mfi,mi->mf", position, up)
    return height < np.nanmin(height, axis=1, initial=np.inf)[:, None] + LOWEST_M, None


def _truth(columns: Columns) -> TrueMotion | None:
    """Return the motion of the IMU if position and orientation are known; without velocity that by differences."""
    if "true_position" not in columns or not ("true_rotation" in columns or "true_quat_wxyz" in columns):
        return None
    position = np.asarray(columns["true_position"], dtype=np.float64)
    if "true_rotation" in columns:
        rot = np.asarray(columns["true_rotation"], dtype=np.float64)
    else:
        rot = np.array([matrix_from_quat(q) for q in columns["true_quat_wxyz"]])
    if "true_velocity" in columns:
        v = np.asarray(columns["true_velocity"], dtype=np.float64)
    else:
        v = np.gradient(position, 1e-9 * (columns["stamp_ns"] - columns["stamp_ns"][0]), axis=0)
    if not (np.isfinite(position).all() and np.isfinite(rot).all() and np.isfinite(v).all()):
        raise SurefootError(
            "invalid", "the truth has numbers that are not finite; leave its columns out", "true_position"
        )
    return TrueMotion(position, rot, v)
