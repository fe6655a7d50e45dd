"""Measures of a track over a log of others, with truth or without, and the goals of each log."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.lab.estimation.log import Log
from surefoot.lab.estimation.referees import gyro_yaw, run
from surefoot.lab.estimation.scores import base_pose, nees, score
from surefoot.lab.estimation.track import Track

Array = NDArray[np.float64]

NAN = float("nan")
INSIDE_95 = 7.815
"""Value below which 95 % of chi^2 with 3 degrees of freedom lie."""
SAMPLE_S = 0.25
"""Time between two starts of a relative pose, s; the way is that of the truth in such steps."""
WARM_ROWS = 150
"""Rows of the run that compiles the kernels before the clock starts."""
HEADERS = (
    "", "v cm/s", "0.5 s", "NEES", "in 95 %", "RPE %", "ATE cm", "end cm", "head rms", "head end", "z mm/m", "ok",
    "from s", "us/row",
)  # fmt: skip


@dataclass(frozen=True)
class ForeignScore:
    """Errors over the scored part of a log; NaN = unknown."""

    v: float = NAN  # cm/s, rms over rows
    smooth: float = NAN  # cm/s, rms of the mean over 0.5 s
    nees: float = NAN  # of v, mean; 3 = ideal
    inside: float = NAN  # share of the rows in the 95 % region
    rpe: float = NAN  # % of the log's way, rms of the relative position
    ate: float = NAN  # cm, rms of the position after alignment of place and heading
    end: float = NAN  # cm, error of the displacement at the end
    heading: float = NAN  # deg, rms
    heading_end: float = NAN  # deg
    height: float = NAN  # mm/m, rms over the log's way
    ok: float = NAN  # share of the rows with filter_ok
    start: float = NAN  # s, until initialised
    cost: float = NAN  # us a row

    def cells(self) -> tuple[str, ...]:
        """Return the cells of a table."""
        numbers = zip(vars(self).values(), (2, 2, 1, 2, 2, 1, 1, 2, 2, 1, 2, 2, 1), strict=True)
        return tuple("-" if not np.isfinite(x) else f"{x:.{digits}f}" for x, digits in numbers)


def timed(name: str, log: Log, options: Mapping[str, Any] | None = None) -> tuple[Track, float]:
    """Run an estimator over a log; return its track and us a row, kernels compiled before."""
    short = log.with_imu(np.arange(min(WARM_ROWS, len(log.stamp_ns))))
    short = replace(short.with_feet(short.foot_ns <= short.stamp_ns[-1]), rest=(0, 0))
    if not name.startswith("gtsam"):  # nothing to compile
        run(name, short, options)
    began = time.perf_counter()
    found = run(name, log, options)
    return found, 1e6 * (time.perf_counter() - began) / len(log.stamp_ns)


def scored(log: Log, found: Track, way: float, cost: float = NAN) -> ForeignScore:
    """Compare a track with the truth of its log.

    Args:
        log: with truth.
        found: track over it; one that never started has no errors.
        way: m of a relative pose.
        cost: us a row, to be printed.
    """
    initialised = found.flags["initialised"]
    if not initialised[log.scored].any():
        return ForeignScore(ok=0.0, cost=cost)
    s, rows = score(log, replace(found, p=_solvable(found.p))), log.scored
    known = np.isfinite(found.p[rows]).all() and found.p[rows][:, 3, 3].min() > 0.0
    each = nees(found.v[rows] - log.v[rows], found.p[rows][:, 3:, 3:]) if known else np.array([np.nan])
    rpe, height = relative(log, found, way)
    heading = np.degrees(turned(log, found.yaw - base_pose(log)[1]))
    return ForeignScore(
        100.0 * s.rmse, 100.0 * s.smooth, float(each.mean()), float(np.mean(each < INSIDE_95)) if known else np.nan,
        100.0 * rpe, 100.0 * absolute(log, found), 100.0 * s.odometry * s.way, float(np.sqrt(np.mean(heading**2))),
        float(heading[-1]), 1e3 * height, float(found.flags["filter_ok"][rows].mean()),
        float(log.seconds[np.argmax(initialised)]), cost,
    )  # fmt: skip


def _solvable(p: Array) -> Array:
    """Return covariances with ones on the diagonal where a referee publishes none."""
    bad = ~np.isfinite(p).all(axis=(1, 2)) | (p[:, 3, 3] <= 0.0)
    return np.where(bad[:, None, None], np.eye(6), p)


def turned(log: Log, yaw: Array) -> Array:
    """Return the scored part of a heading from its beginning, rad."""
    part = yaw[log.scored]
    return part - part[0]


def relative(log: Log, found: Track, way: float) -> tuple[float, float]:
    """Return rms errors of position and height per m over pieces of `way` m of the true path.

    Each piece is laid over the truth by place and heading at its beginning; the path is that of base_link.
    """
    true, yaw = base_pose(log)
    rows = np.flatnonzero(log.scored)[:: max(1, round(SAMPLE_S / float(np.median(np.diff(log.seconds)))))]
    gone = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(true[rows], axis=0), axis=1))])
    end = np.searchsorted(gone, gone + way)
    first = np.flatnonzero(end < len(rows))
    if not len(first):
        return NAN, NAN
    a, b = rows[first], rows[end[first]]
    error = turn(found.position[b] - found.position[a], yaw[a] - found.yaw[a]) - (true[b] - true[a])
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1)))) / way, float(np.sqrt(np.mean(error[:, 2] ** 2))) / way


def turn(x: Array, angle: Array | float) -> Array:
    """Return vectors (n, 3) turned about z by angles (n,) rad."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * x[:, 0] - s * x[:, 1], s * x[:, 0] + c * x[:, 1], x[:, 2]], axis=1)


def absolute(log: Log, found: Track) -> float:
    """Return the rms error of the position of base_link after the best alignment by place and heading, m."""
    true, seen = base_pose(log)[0][log.scored], found.position[log.scored]
    a, b = seen - seen.mean(axis=0), true - true.mean(axis=0)
    angle = np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a[:, :2] * b[:, :2]))
    return float(np.sqrt(np.mean(np.sum((turn(a, float(angle)) - b) ** 2, axis=1))))


def gyro_alone(log: Log) -> tuple[float, float]:
    """Return rms and last error of the heading by the gyro alone, deg."""
    error = np.degrees(turned(log, gyro_yaw(log) - base_pose(log)[1]))
    return float(np.sqrt(np.mean(error**2))), float(error[-1])


@dataclass(frozen=True)
class LegOut:
    """Agreement of estimates that use all legs but one; a log without truth has nothing better."""

    difference: float = NAN  # cm/s, rms over legs and rows, of the velocity against that with all legs
    worst: float = NAN  # cm/s, the same of the worst leg
    heights: float = NAN  # cm, spread of the heights at the end
    ends: float = NAN  # cm, largest distance of an end from that with all legs
    heading: float = NAN  # deg, turn by all legs minus that of the gyro
    made: float = NAN  # deg, turn by all legs minus that of the maker's attitude, NaN = there is none
    ok: float = NAN  # share of rows with filter_ok, all legs


def without_leg(log: Log, leg: int) -> Log:
    """Return the log with a foot that is never in contact."""
    contact, chance = log.contact.copy(), None if log.chance is None else log.chance.copy()
    contact[:, leg] = False
    if chance is not None:
        chance[:, leg] = 0.0
    touch = None if log.touch is None else log.touch & (np.arange(log.feet_count) != leg)[:, None]
    return replace(log, contact=contact, chance=chance, touch=touch)


def leave_one_out(log: Log, estimate: Callable[[Log], Track], made: Array | None = None) -> LegOut:
    """Run an estimator with all legs and without each in turn.

    Args:
        log: what to run over.
        estimate: runs the estimator.
        made: heading by the maker of the robot, (n,) rad.
    """
    whole, rows = estimate(log), log.scored
    if not whole.flags["initialised"][rows].any():
        return LegOut(ok=0.0)
    parts = [estimate(without_leg(log, leg)) for leg in range(log.feet_count)]
    square = [float(np.mean(np.sum((part.v - whole.v)[rows] ** 2, axis=1))) for part in parts]
    last, yaw = int(np.flatnonzero(rows)[-1]), turned(log, whole.yaw)[-1]
    ends = np.array([one.position[last] - one.position[np.argmax(rows)] for one in (whole, *parts)])
    return LegOut(
        100.0 * float(np.sqrt(np.mean(square))), 100.0 * float(np.sqrt(max(square))),
        100.0 * float(np.ptp(ends[:, 2])), 100.0 * float(np.linalg.norm(ends - ends[0], axis=1).max()),
        float(np.degrees(yaw - turned(log, gyro_yaw(log))[-1])),
        NAN if made is None else float(np.degrees(yaw - turned(log, made)[-1])),
        float(whole.flags["filter_ok"][rows].mean()),
    )  # fmt: skip


def goals_of(name: str, way: float) -> dict[str, tuple[float, float]]:
    """Return the least and most of measures that are the goals of the default estimator on a log.

    Args:
        name: of the log.
        way: m of its relative poses; NaN for a log without truth.
    """
    if name == "icub_kindyn_walk":
        return {"smooth": (0.0, 1.25), "nees": (1.0, 6.0), "rpe": (0.0, 3.3), "height": (0.0, 8.0)}
    if name == "icub3_gazebo_walk":
        return {"v": (0.0, 4.3), "smooth": (0.0, 1.8)}
    if name.startswith("go1_trot"):
        most = {"torque": 2.5, "none": 3.0}.get(name.rpartition("_")[2], 2.0)
        return {"rpe": (0.0, most), "nees": (1.0, 6.0)}
    if name == "casbot_walk_a":
        return {"end": (0.0, 2.0)}
    return {} if np.isfinite(way) else {"difference": (0.0, 5.0), "heights": (0.0, 2.0)}
