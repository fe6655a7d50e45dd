"""Differences between two outputs of `surefoot estimate`, or between the estimates of two recordings."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from surefoot.arrays import Array, Flags, Ints
from surefoot.disk import regular_size
from surefoot.errors import SurefootError
from surefoot.npz import BROKEN_NPZ, damage_of
from surefoot.record.columns import recorded_columns
from surefoot.record.recording import open_readable
from surefoot.record.robots import robot_of

from .recorded import log_of_columns, published
from .results import FILE_NAMES, SUMMARY, plain
from .scores import score

PARTS = ("v", "g", "position", "yaw")


@dataclass(frozen=True, eq=False)
class Estimated:
    """Estimates of one run of an estimator over a log, at n inertial rows."""

    path: Path
    stamp_ns: Ints  # (n,)
    started: Flags  # (n,)
    v: Array  # (n, 3) m/s, IMU axes
    g: Array  # (n, 3) m/s^2, IMU axes, points up
    position: Array  # (n, 3) m, base_link in odom
    yaw: Array  # (n,) rad, not wrapped
    errors: dict[str, Any]  # against the truth, by name; empty without one
    notes: tuple[str, ...] = ()  # on what of it could be read


class Departure(NamedTuple):
    """Difference of one quantity (m/s, m or deg) between two estimates: rms, largest value, and time of the largest."""

    rms: float
    largest: float
    at_s: float  # time of the largest, since the first common row


def load_estimated(path: Path) -> Estimated:
    """Return the estimates of a file or folder.

    Args:
        path: folder or `estimates.npz` of `surefoot estimate -o`, or a recording (.mcap), of which the published
            estimates are taken.

    Raises:
        SurefootError: there are no estimates.
    """
    file = path / "estimates.npz" if path.is_dir() else path
    if not file.exists():
        raise SurefootError(
            "unreadable", f"{file}: no such file; `surefoot estimate LOG -o DIR` writes it", "estimates"
        )
    if file.suffix.lower() == ".mcap":
        return _of_recording(file)
    names = {part: FILE_NAMES.get(part, part) for part in PARTS}
    try:
        regular_size(file)
        with file.open("rb") as stream, np.load(stream, allow_pickle=False) as columns:
            missing = [key for key in ("stamp_ns", "initialised", *names.values()) if key not in columns.files]
            if missing:
                text = f"{file} has no {missing[0]!r}; wanted is what `surefoot estimate -o` writes"
                raise SurefootError("invalid", text, missing[0])
            found = {part: columns[key] for part, key in names.items()}
            stamps, started = columns["stamp_ns"], columns["initialised"]
    except (OSError, *BROKEN_NPZ) as error:
        why = error.strerror if isinstance(error, OSError) and error.strerror else damage_of(file)
        raise SurefootError("malformed", f"{file} {why}", "estimates") from None
    beside = file.with_name(SUMMARY)
    errors = json.loads(beside.read_text()).get("errors", {}) if beside.exists() else {}
    return Estimated(path, stamps, started, **found, errors=errors)


def _of_recording(path: Path) -> Estimated:
    recording = open_readable(path)
    columns, _ = recorded_columns(recording)
    robot = robot_of(recording)
    track, log = published(columns, robot), log_of_columns(path.stem, columns, robot)
    errors = {} if log.truth is None else plain(asdict(score(log, track)))
    started = track.flags["initialised"]
    return Estimated(path, log.stamp_ns, started, track.v, track.g, track.position, track.yaw, errors, recording.notes)


def departures(a: Estimated, b: Estimated) -> dict[str, Departure]:
    """Return the differences of two estimates over their common time, by name: rms, largest and its time.

    Names and units are velocity m/s, tilt deg, position m, heading deg. Position and heading are compared relative to
    the first row at which both have started.

    Raises:
        SurefootError: the two have no time in common.
    """
    rows = np.flatnonzero(a.started & (a.stamp_ns >= b.stamp_ns[0]) & (a.stamp_ns <= b.stamp_ns[-1]))
    rows = rows[np.interp(a.stamp_ns[rows], b.stamp_ns, b.started.astype(np.float64)) >= 1.0]
    if len(rows) == 0:
        ranges = (f"{1e-9 * x.stamp_ns[0]:.3f} to {1e-9 * x.stamp_ns[-1]:.3f} s" for x in (a, b))
        raise SurefootError("invalid", f"no common time of started estimates: {' and '.join(ranges)}", "estimates")
    at = a.stamp_ns[rows]
    v, g, place = (np.stack([np.interp(at, b.stamp_ns, x) for x in part.T], axis=1) for part in (b.v, b.g, b.position))
    turn = np.interp(at, b.stamp_ns, b.yaw)
    ours = _from_start(a.position[rows], a.yaw[rows])
    theirs = _from_start(place, turn)
    up = a.g[rows]
    tilt = np.arctan2(np.linalg.norm(np.cross(up, g), axis=1), np.einsum("ni,ni->n", up, g))
    off = {
        "velocity": np.linalg.norm(a.v[rows] - v, axis=1), "tilt": np.degrees(tilt),
        "position": np.linalg.norm(ours[0] - theirs[0], axis=1), "heading": np.degrees(np.abs(ours[1] - theirs[1])),
    }  # fmt: skip
    seconds = 1e-9 * (at - at[0])
    return {
        name: Departure(float(np.sqrt(np.mean(x**2))), float(x.max()), float(seconds[int(np.argmax(x))]))
        for name, x in off.items()
    }


def _from_start(position: Array, yaw: Array) -> tuple[Array, Array]:
    """Return positions (n, 3) m and headings (n,) rad relative to the first pose, in its heading axes."""
    c, s = np.cos(yaw[0]), np.sin(yaw[0])
    return (position - position[0]) @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), yaw - yaw[0]
