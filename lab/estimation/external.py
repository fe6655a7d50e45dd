"""Samples of sources outside the robot in a log, such as a camera or GNSS, as inputs of the estimator."""

from typing import Any, NamedTuple

import numpy as np

from surefoot.arrays import Array, Ints
from surefoot.errors import SurefootError
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.record.columns import Columns
from surefoot.services.estimator.filter.samples import EX, EXTERNAL_WIDTH
from surefoot.services.estimator.inputs.external import ExternalSample

PARTS = {
    "position": slice(EX.position, EX.position + 3), "yaw": slice(EX.yaw, EX.yaw + 1),
    "velocity": slice(EX.velocity, EX.velocity + 3),
    "position_covariance": slice(EX.position_covariance, EX.position_covariance + 9),
    "yaw_variance": slice(EX.yaw_variance, EX.yaw_variance + 1),
    "velocity_covariance": slice(EX.velocity_covariance, EX.velocity_covariance + 9),
}  # fmt: skip
"""Slice of each part (position, yaw, velocity, covariances ...) in the row of 26 numbers of an external sample."""
LONGEST_DELAY_S = 0.4
"""Longest delay of external samples (camera, GNSS), s; a log that states more is refused."""


class Externals(NamedTuple):
    """Poses and velocities from sources outside the robot's own sensors, such as a camera; e samples, sorted by
    stamp."""

    stamp_ns: Ints  # (e,) time at which they hold
    arrival_ns: Ints  # (e,) time at which they are known
    rows: Array  # (e, 26) see `ExternalSample.row`


def externals_of(columns: Columns, rot_base_from_imu: Array, notes: list[str]) -> Externals | None:
    """Return the poses and velocities in a log that come from a camera or the like; None if there are none.

    Args:
        columns: arrays of the log by name; those of other sources begin with `external_`: positions (e, 3) m, headings
            (e,) rad and others.
        rot_base_from_imu: rotation from IMU to base_link, (3, 3), as orientations in the log are those of the IMU,
            headings those of base_link.
        notes: gets the number of samples, and of those that cannot be used.

    Raises:
        SurefootError: the log states no noise or no heading of a source, or its delay is out of range.
    """
    stamps = columns.get("external_stamp_ns")
    if stamps is None:
        return None
    count = len(stamps)
    if count == 0:
        notes.append("external_t is empty: no samples from elsewhere")
        return None
    position, velocity = columns.get("external_position"), columns.get("external_velocity")
    yaw = _yaw(columns, rot_base_from_imu)
    if position is not None and yaw is None:
        text = "external_position needs external_yaw or external_quat_wxyz: nothing else shows how its frame is turned"
        raise SurefootError("invalid", f"{text} against odom", "external_yaw")
    spreads = {
        "position": _covariance(columns, "position", count) if position is not None else None,
        "velocity": _covariance(columns, "velocity", count) if velocity is not None else None,
        "yaw": _variance(columns, count) if yaw is not None else None,
    }
    delay = _number(columns, "external_delay", 0.0)
    if not 0.0 <= delay <= LONGEST_DELAY_S:
        raise SurefootError(
            "invalid", f"external_delay is {delay:g} s; 0 to {LONGEST_DELAY_S:g} s are allowed", "external_delay"
        )
    rows: list[Array] = []
    for i in range(count):
        part = {"position": position, "yaw": yaw, "velocity": velocity}
        given: dict[str, Any] = {key: v[i] for key, v in part.items() if v is not None and not np.isnan(v[i]).all()}
        noise: dict[str, Any] = {
            f"{key}_{'variance' if key == 'yaw' else 'covariance'}": _at(spreads[key], i) for key in given
        }
        row, result = ExternalSample(**given, **noise).row()
        rows.append(row if result.accepted else np.full_like(row, np.nan))
    table = np.array(rows).reshape(count, -1)
    good = np.flatnonzero(np.isfinite(table).any(axis=1) & (np.diff(stamps, prepend=stamps[0] - 1) > 0))
    bad = f", {count - len(good)} of them unusable" if len(good) < count else ""
    notes.append(f"{count} samples from elsewhere{bad}; {1e3 * delay:.0f} ms late")
    late = round(1e9 * delay)
    return Externals(stamps[good] - late, stamps[good].copy(), np.ascontiguousarray(table[good]))


def released_externals(columns: Columns) -> tuple[Externals | None, Ints]:
    """Return the samples of other sources in a recording that the service accepts, and the tick of each, (e,)."""
    if "external_row" not in columns:
        return None, np.empty(0, dtype=np.int64)
    parts: list[dict[str, Any]] = [
        {key: None if np.isnan(row[part]).all() else row[part] for key, part in PARTS.items()}
        for row in columns["external_row"]
    ]
    checked = [ExternalSample(**{**part, "yaw": _one(part["yaw"])}).row() for part in parts]
    good = np.flatnonzero([result.accepted for _, result in checked])
    stamp = columns["external_stamp_ns"][good]
    rows = np.array([checked[i][0] for i in good]).reshape(len(good), EXTERNAL_WIDTH)
    return Externals(stamp, stamp, rows), columns["external_tick"][good]


def _one(value: Array | None) -> float | None:
    return None if value is None else float(value[0])


def _at(values: Array | None, row: int) -> Array | None:
    return None if values is None else values[row]


def _yaw(columns: Columns, rot_base_from_imu: Array) -> Array | None:
    """Return the heading of base_link in the frame of the source, (e,) rad, NaN = unknown; None: there is none.

    `rot_base_from_imu` (3, 3): orientations in the columns are those of the IMU.
    """
    if "external_yaw" in columns:
        return np.asarray(columns["external_yaw"], dtype=np.float64)
    if "external_quat_wxyz" not in columns:
        return None
    quats = np.asarray(columns["external_quat_wxyz"], dtype=np.float64)
    base = np.array([matrix_from_quat(q) if np.isfinite(q).all() else np.full((3, 3), np.nan) for q in quats])
    base = base @ rot_base_from_imu.T
    return np.arctan2(base[:, 1, 0], base[:, 0, 0])


def _covariance(columns: Columns, name: str, count: int) -> Array:
    """Return covariances (e, 3, 3) of a part from its own column, or from one standard deviation of all axes."""
    key = f"external_{name}_covariance"
    if key in columns:
        return np.asarray(columns[key], dtype=np.float64)
    return np.broadcast_to(_number(columns, f"external_{name}_sd") ** 2 * np.eye(3), (count, 3, 3))


def _variance(columns: Columns, count: int) -> Array:
    """Return variances of the heading, (e,) rad^2, from its own column, or from one standard deviation."""
    if "external_yaw_variance" in columns:
        return np.asarray(columns["external_yaw_variance"], dtype=np.float64)
    return np.full(count, _number(columns, "external_yaw_sd") ** 2)


def _number(columns: Columns, key: str, default: float | None = None) -> float:
    """Return the number in column `key`, which must be above 0 if there is no `default`; without column the default.

    Raises:
        SurefootError: the number is missing or not allowed.
    """
    if key not in columns and default is not None:
        return default
    if key not in columns:
        part = key.removesuffix("_sd")
        other = f"{part}_variance" if part.endswith("yaw") else f"{part}_covariance"
        raise SurefootError("invalid", f"{part} needs its noise: {key} or {other}", key)
    try:
        value = float(np.ravel(columns[key])[0])
    except (ValueError, IndexError):
        value = np.nan
    if not (np.isfinite(value) and (value > 0.0 or default is not None)):
        raise SurefootError("invalid", f"{key} is {np.ravel(columns[key]).tolist()!r}; wanted is a number above 0", key)
    return value
