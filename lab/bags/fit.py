"""Conversion of a raw log to a robot's description: joint order, inertial rows to the IMU axes, foot contacts."""

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from surefoot.arrays import Array
from surefoot.disk import whole
from surefoot.errors import SurefootError
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.lockstep.intake import ForceContact
from surefoot.robot.description import Robot
from surefoot.robot.names import joint_columns, leg_columns
from surefoot.schemas.topics import TICK_NS

from ..estimation.contacts import mean_up
from ..estimation.go1 import OFF, ON, REST_SHARE
from ..estimation.torques import forces_by_torques
from .raw import RawLog, Stream, Transform

BODY = ("base_link", "base", "trunk", "body", "base_footprint", "torso", "root")
"""Names of frames in the transforms of a bag that are taken as the trunk."""
MOST_SHARE = 0.95
"""Quantile of a foot's measured force that is taken as the foot's usual largest force."""
LEAST_RANGE = 0.05
"""Range of a foot's force, share of the median total, up to which it counts as constant: no forces are used then."""
NEAR_M, NEAR_RAD = 0.01, 0.01
"""Largest differences between IMU frame of a log and robot description without a note: `NEAR_M`: position, m;
`NEAR_RAD`: orientation, rad."""


@dataclass
class RobotLog:
    """Log of sensors in the joint order, foot order and sensor frames of a robot description."""

    imu: Stream  # (n, 6)
    joints: Stream  # (m, nj) rad
    velocity: Array | None  # (m, nj)
    torque: Array | None  # (m, nj)
    feet: Stream | None  # (k, F) raw forces or flags
    contact: ForceContact | None  # None: flags, or no feet
    notes: list[str] = field(default_factory=list[str])


def fitted(log: RawLog, robot: Robot, stated: tuple[float, float] | None = None, imu_frame: str = "") -> RobotLog:
    """Return a log in the joint order, foot order and sensor frames of a robot.

    Args:
        log: raw log.
        robot: robot description.
        stated: foot forces (from which a foot stands, below which it is lifted), N; None = derived from the log.
        imu_frame: name of the frame of the inertial rows; `imu` = that of the description; empty = as in the log.

    Raises:
        SurefootError: joints or feet do not match the robot, or a frame has no transform.
    """
    notes = list(log.notes)
    order = _joint_order(log, robot)
    first, last = log.imu.stamp_ns[0], log.imu.stamp_ns[-1]
    keep = (log.joints.stamp_ns >= first) & (log.joints.stamp_ns <= last)
    if not keep.any():
        gap = 1e-9 * float(min(abs(log.joints.stamp_ns[0] - last), abs(first - log.joints.stamp_ns[-1])))
        raise SurefootError("invalid", f"joints and inertial rows have no time in common, {gap:.6g} s apart", "joints")
    late = 1e-9 * float(log.joints.stamp_ns[keep][0] - first)
    if late > 1.0:
        notes.append(f"joints begin {late:.2f} s after the inertial rows")
    joints = Stream(log.joints.stamp_ns[keep], log.joints.values[keep][:, order])
    _check_limits(joints.values, robot)
    more = [None if part is None else part[keep][:, order] for part in (log.velocity, log.torque)]
    imu = Stream(log.imu.stamp_ns, _turned(log, robot, imu_frame, notes))
    out = RobotLog(imu, joints, more[0], more[1], None, None, notes)
    if log.feet is not None:
        inside = (log.feet.stamp_ns >= first) & (log.feet.stamp_ns <= last)
        feet = Stream(log.feet.stamp_ns[inside], log.feet.values[inside][:, _foot_order(log, robot, notes)])
        if log.flags:
            out.feet = feet
        elif (contact := _rule(feet.values, robot, stated, notes)) is not None:
            out.feet, out.contact = feet, contact
    elif out.torque is not None and np.any(out.torque):
        _by_torques(out, robot)
    if out.feet is None:
        notes.append("no contacts: feet within 5 mm of the lowest one are taken to stand")
    return out


def _joint_order(log: RawLog, robot: Robot) -> list[int]:
    """Return the column index in the log of each joint of the robot."""
    if not log.joint_names:
        if log.joints.values.shape[1] == robot.nj:
            log.notes.append(f"joints without names: taken in the order of {robot.name}")
            return list(range(robot.nj))
        text = f"got {log.joints.values.shape[1]} joints without names, {robot.name} has {robot.nj}"
        raise SurefootError("invalid", f"{text}; name them by --joint-names", "joint-names")
    return joint_columns(log.joint_names, robot)


def _check_limits(joints: Array, robot: Robot) -> None:
    outside = (joints < robot.joint_lower - 0.2) | (joints > robot.joint_upper + 0.2)
    rows = np.argwhere(outside)
    if len(rows) > 0.05 * len(joints):
        row, joint = (int(i) for i in rows[0])
        low, high = robot.joint_lower[joint], robot.joint_upper[joint]
        text = f"joints row {row}: {robot.joint_names[joint]} is {joints[row, joint]:.3g} rad, allowed are"
        raise SurefootError("invalid", f"{text} {low:.3g} to {high:.3g}: another robot, order or unit?", "joints")


def _turned(log: RawLog, robot: Robot, imu_frame: str, notes: list[str]) -> Array:
    """Return the inertial rows of the log (n, 6), rad/s and m/s^2, rotated into the axes of the robot's IMU."""
    name = imu_frame or log.imu_frame
    own, values = matrix_from_quat(robot.imu.quat_wxyz), log.imu.values
    chain = _chain(name, log.frames, robot)
    if imu_frame == "imu" or (chain is None and (not name or "imu" in name.lower())):
        notes.append(f"frame of the inertial rows: {name or 'unnamed'!r}, taken as the unit of {robot.name}")
        return values
    if chain is None:
        text = f"the frame {name!r} of the inertial rows has no transform to {robot.name}'s trunk in the log"
        text += "; `--imu-frame imu` states that it is the unit of the description, `base_link` that it is the trunk"
        raise SurefootError("invalid", text, "imu-frame")
    place, rot = chain
    turn = own.T @ rot
    angle = float(np.arccos(np.clip(0.5 * (np.trace(turn) - 1.0), -1.0, 1.0)))
    off = float(np.linalg.norm(place - robot.imu.position))
    if off > NEAR_M:
        notes.append(f"the inertial unit is {1e3 * off:.0f} mm from its place in {robot.name}: its lever arm is wrong")
    if angle > NEAR_RAD:
        notes.append(f"inertial rows turned by {np.degrees(angle):.1f} deg from {name!r} to the unit of {robot.name}")
    return np.hstack([values[:, :3] @ turn.T, values[:, 3:] @ turn.T])


def _chain(name: str, frames: dict[str, Transform], robot: Robot) -> tuple[Array, Array] | None:
    """Return position (3,) m and rot_trunk_from_frame (3, 3) of a frame in the trunk; None = they are not connected."""
    place, rot = np.zeros(3), np.eye(3)
    for _ in range(len(frames) + 1):
        if name in BODY or name == robot.name:
            return place, rot
        if name not in frames:
            return None
        step = frames[name]
        turn = matrix_from_quat(step.quat_wxyz)
        place, rot, name = step.position + turn @ place, turn @ rot, step.parent.lstrip("/")
    return None


def _foot_order(log: RawLog, robot: Robot, notes: list[str]) -> list[int]:
    """Return the column index in the log's foot values of each leg of the robot."""
    assert log.feet is not None
    count = log.feet.values.shape[1]
    if not log.feet_names:
        if count != robot.nlegs:
            text = f"got {count} numbers a row, {robot.name} has {robot.nlegs} feet"
            raise SurefootError("invalid", f"{text}; take a part of them: TOPIC.FIELD[a:b]", "contacts")
        notes.append(f"feet taken in the order of {robot.name}: {', '.join(robot.leg_names)} (--feet)")
        return list(range(count))
    if len(log.feet_names) != count:
        raise SurefootError("invalid", f"got {count} numbers for {len(log.feet_names)} feet", "feet")
    return leg_columns(log.feet_names, robot)


def _rule(raw: Array, robot: Robot, stated: tuple[float, float] | None, notes: list[str]) -> ForceContact | None:
    """Return zero, scale and contact thresholds of raw foot forces (k, F); None = they do not show all contacts."""
    if stated is not None:
        return ForceContact((0.0,) * robot.nlegs, (1.0,) * robot.nlegs, *stated)
    low, high = np.quantile(raw, [REST_SHARE, MOST_SHARE], axis=0)
    total = float(np.median(np.sum(raw - low, axis=1)))
    still = [robot.leg_names[f] for f in np.flatnonzero(high - low <= LEAST_RANGE * np.median(np.sum(raw, axis=1)))]
    if not np.any(raw) or still or total <= 0.0:
        what = "are all zero" if not np.any(raw) else f"of {', '.join(still) or 'the feet'} never leave one value"
        notes.append(f"foot forces {what}: no zero and scale can be found, they are left out")
        return None
    even = float(np.mean(high - low)) / (high - low)  # feet of a walk carry the same at most
    scale = even * GRAVITY * robot.mass / float(np.median(np.sum(even * (raw - low), axis=1)))
    most = float(np.median(scale * (high - low)))
    found = ForceContact(tuple(map(float, low)), tuple(map(float, scale)), ON * most, OFF * most)
    notes.append(f"foot forces: zero {_list(found.zero)}, scale {_list(found.scale)} N per unit, by swing and weight")
    notes.append(f"contacts by force: from {found.on:.3g} N on, until below {found.off:.3g} N")
    return found


def _by_torques(out: RobotLog, robot: Robot) -> None:
    """Set the feet of a log to ground forces from the joint torques, N, at the last sample of each tick."""
    assert out.torque is not None
    tick = (out.joints.stamp_ns - out.imu.stamp_ns[0]) // TICK_NS
    rows = np.flatnonzero(np.diff(tick, append=tick[-1] + 1) > 0)
    stamps = out.joints.stamp_ns[rows]
    up = mean_up(out.imu.stamp_ns, out.imu.values[:, 3:], stamps) @ matrix_from_quat(robot.imu.quat_wxyz).T
    found = forces_by_torques(robot, out.joints.values[rows], out.torque[rows], up)
    most = float(np.median(np.quantile(found.force, MOST_SHARE, axis=0)))
    if most <= 0.0 or not np.isfinite(found.force).all():
        return
    out.feet = Stream(stamps, found.force)
    out.contact = ForceContact((0.0,) * robot.nlegs, (1.0,) * robot.nlegs, ON * most, OFF * most)
    out.notes.append(found.note or "ground forces by the joint torques")
    out.notes.append(f"contacts by force: from {out.contact.on:.3g} N on, until below {out.contact.off:.3g} N")


def _list(values: tuple[float, ...]) -> str:
    return json.dumps([float(f"{x:.4g}") for x in values])


def save_calibration(path: Path, contact: ForceContact) -> Path:
    """Write zero, scale and contact thresholds of foot forces as TOML for the drivers `unitree` and `ros_robot`."""
    lines = [
        f"foot_zero = {list(contact.zero)}", f"foot_scale = {list(contact.scale)}",
        f"contact_on = {contact.on}", f"contact_off = {contact.off}",
    ]  # fmt: skip
    with whole(path) as part:
        part.write_text("".join(f"[{name}]\n" + "\n".join(lines) + "\n\n" for name in ("unitree", "ros_robot")))
    return path
