"""Recordings of this project as logs: feet by the robot description, truth of the IMU from that of base_link."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.errors import SurefootError
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.record.columns import Columns, recorded_columns
from surefoot.record.recording import ReadableRecording, open_readable
from surefoot.record.robots import robot_for
from surefoot.robot.description import Robot
from surefoot.services.estimator.feet.mount import feet_in_imu, foot_mount

from .external import released_externals
from .log import Log, TrueMotion
from .track import FLAGS, Track

REST_ROWS = 50  # of the standstill that the service starts from
SCORED_FROM_S = 2.0


def log_of_recording(path: Path | ReadableRecording, robot: str | None = None) -> Log:
    """Return the log of a recording, as far as it is sound.

    Args:
        path: MCAP file, or one that is open.
        robot: name of the description; None = the one that is attached, else the one that the recording names.

    Raises:
        SurefootError: it cannot be read, names no robot or another one, or has no joints or contacts.
    """
    opened = open_readable(path)
    described = robot_for(opened, robot)
    columns, _ = recorded_columns(opened)
    return log_of_columns(opened.path.stem, columns, described)


def log_of_columns(name: str, columns: Columns, robot: Robot, **more: Any) -> Log:
    """Return a log from the columns of a recording.

    Args:
        name: name of the log.
        columns: arrays of a recording by name, in SI units.
        robot: description of the robot.
        more: other fields of the log.

    Raises:
        SurefootError: columns are missing or do not fit the robot.
    """
    for need in ("gyro", "joints", "touch"):
        if need not in columns:
            raise SurefootError("invalid", f"{name} has no {need}", need)
    joints, legs = columns["joints"], len(robot.legs)
    if joints.shape[1] != robot.nj:
        raise SurefootError("invalid", f"{name} has {joints.shape[1]} joints, {robot.name} has {robot.nj}", "joints")
    if columns["touch"].shape[1] % legs:
        raise SurefootError("invalid", f"{columns['touch'].shape[1]} switches; {robot.name} has {legs} feet", "touch")
    mount = foot_mount(robot)
    seen = [feet_in_imu(mount, q) for q in joints]
    position, rot = (np.ascontiguousarray([pair[i] for pair in seen]) for i in range(2))
    # contacts that belong to each sample of the joints: the last that came before or with it
    pair = np.searchsorted(columns["contacts_stamp_ns"], columns["joints_stamp_ns"], side="right") - 1
    keep = np.flatnonzero(pair >= 0)
    touch = columns["touch"][pair[keep]].reshape(len(keep), legs, -1) > 0.5
    contact = np.asarray(touch.any(axis=2), dtype=np.bool_)
    force = columns["force"][pair[keep]]
    stamp = columns["stamp_ns"]
    more.setdefault("rest", _rest(columns))
    external, ticks = released_externals(columns)
    arrival = _released(columns["tick"], columns["joints_tick"][keep], ticks)
    return Log(
        name, stamp, np.ascontiguousarray(columns["gyro"]), np.ascontiguousarray(columns["acc"]),
        columns["joints_stamp_ns"][keep], position[keep], rot[keep], contact, _truth(columns, robot),
        touch=touch, force=None if np.isnan(force).all() else force, joints=joints[keep], points=_points(robot),
        radius=mount.radius, rot_base_from_imu=np.ascontiguousarray(mount.rot_imu_from_base.T),
        imu_position=mount.imu_position, robot=robot, begin_s=SCORED_FROM_S, order=arrival,
        saturated=columns["saturated"][:, 0] > 0.5, external=external, **more,
    )  # fmt: skip


def _rest(columns: Columns) -> tuple[int, int]:
    """Return first row and end of the standstill at which the service started; (0, 0): it is not recorded."""
    if "published_flags" not in columns or not columns["published_flags"][:, 0].any():
        return 0, 0
    tick = columns["published_tick"][int(np.argmax(columns["published_flags"][:, 0]))]
    end = int(np.searchsorted(columns["tick"], tick)) + 1
    return max(0, end - REST_ROWS), end


def _released(*ticks: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the order of arrival by the ticks of release of each source, (n,); in a tick sources keep their order."""
    kind = np.concatenate([np.full(len(each), k) for k, each in enumerate(ticks)])
    return np.lexsort((kind, np.concatenate(ticks)))


def _points(robot: Robot) -> Array | None:
    """Return contact points from each foot centre, foot axes, (F, K, 3) m; None: feet differ in their number."""
    counts = {len(leg.foot.points) for leg in robot.legs}
    if len(counts) != 1:
        return None
    return np.array([leg.foot.points - leg.foot.position for leg in robot.legs])


def _truth(columns: Columns, robot: Robot) -> TrueMotion | None:
    """Return the motion of the IMU from that of base_link at the stamps of its rows; None: it is not known there."""
    if "base_position" not in columns:
        return None
    rows = np.searchsorted(columns["base_stamp_ns"], columns["stamp_ns"])
    rows = np.minimum(rows, len(columns["base_stamp_ns"]) - 1)
    if not np.array_equal(columns["base_stamp_ns"][rows], columns["stamp_ns"]):
        return None
    base = np.array([matrix_from_quat(q) for q in columns["base_quat_wxyz"][rows]])
    arm = np.einsum("nij,j->ni", base, robot.imu.position)
    rate = np.einsum("nij,nj->ni", base, columns["base_rate"][rows])
    rot = base @ matrix_from_quat(robot.imu.quat_wxyz)
    return TrueMotion(
        columns["base_position"][rows] + arm, np.ascontiguousarray(rot),
        columns["base_velocity"][rows] + np.cross(rate, arm),
    )  # fmt: skip


def published(columns: Columns, robot: Robot) -> Track:
    """Return the recorded messages `state/velocity` and `state/odometry` of the estimator service as a track.

    Raises:
        SurefootError: the recording has none.
    """
    if "published_velocity_imu" not in columns:
        raise SurefootError("invalid", "the recording has no state/velocity", "state/velocity")
    to_imu = matrix_from_quat(robot.imu.quat_wxyz).T
    n = len(columns["stamp_ns"])
    last = min(len(columns["published_tick"]), len(columns["published_position"])) - 1  # cut off between the two
    rows = np.minimum(np.searchsorted(columns["published_tick"], columns["tick"]), last)
    flags = columns["published_flags"][rows] > 0.5
    return Track(
        "published", columns["published_velocity_imu"][rows], columns["published_g_up"][rows] @ to_imu.T,
        columns["published_covariance"][rows].reshape(n, 6, 6), columns["published_position"][rows],
        columns["published_yaw"][rows, 0], columns["published_velocity_odom"][rows],
        {name: flags[:, i] for i, name in enumerate(FLAGS)}, columns["published_nis"][rows, 0], {},
    )  # fmt: skip
