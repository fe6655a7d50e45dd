"""Measures of a track over a log of others, with truth or without, and the goals of each log."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from surefoot.arrays import Array
from surefoot.lab.estimation.log import Log
from surefoot.lab.estimation.referees import gyro_yaw, run
from surefoot.lab.estimation.scores import base_pose, score
from surefoot.lab.estimation.track import Track

NAN = float("nan")
WARM_ROWS = 150
"""Number of rows of a run that compiles the kernels before timing begins."""
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
        """Return the errors as the cells of a table row."""
        numbers = zip(vars(self).values(), (2, 2, 1, 2, 2, 1, 1, 2, 2, 1, 2, 2, 1), strict=True)
        return tuple("-" if not np.isfinite(x) else f"{x:.{digits}f}" for x, digits in numbers)


def timed(name: str, log: Log, options: Mapping[str, Any] | None = None) -> tuple[Track, float]:
    """Run an estimator over a log; return its track and the time per row, us, without compilation of kernels."""
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
        log: log with truth.
        found: track over that log; a track that never started has no errors.
        way: length of path over which relative poses are compared, m.
        cost: processor time per row of the log, us, stored in the result.
    """
    initialised = found.flags["initialised"]
    if not initialised[log.scored].any():
        return ForeignScore(ok=0.0, cost=cost)
    s, rows = score(log, found, (way,)), log.scored
    heading = np.degrees(turned(log, found.yaw - base_pose(log)[1]))
    return ForeignScore(
        100.0 * s.rmse, 100.0 * s.smooth, s.nees, s.inside, 100.0 * s.rpe, 100.0 * s.ate, 100.0 * s.odometry * s.way,
        float(np.sqrt(np.mean(heading**2))), float(heading[-1]), 1e3 * s.climb,
        float(found.flags["filter_ok"][rows].mean()), float(log.seconds[np.argmax(initialised)]), cost,
    )  # fmt: skip


def turned(log: Log, yaw: Array) -> Array:
    """Return the heading of a track in the scored part of a log, less its first value, (k,) rad.

    `yaw`: at each inertial row, (n,) rad.
    """
    part = yaw[log.scored]
    return part - part[0]


def gyro_alone(log: Log) -> tuple[float, float]:
    """Return the rms and the final error of the heading by the gyro alone, deg."""
    error = np.degrees(turned(log, gyro_yaw(log) - base_pose(log)[1]))
    return float(np.sqrt(np.mean(error**2))), float(error[-1])


@dataclass(frozen=True)
class LegOut:
    """Agreement of estimates that leave out one leg each with that by all legs, for logs without truth."""

    difference: float = NAN  # cm/s, rms over legs and rows, of the velocity against that with all legs
    worst: float = NAN  # cm/s, the same of the worst leg
    heights: float = NAN  # cm, spread of the heights at the end
    ends: float = NAN  # cm, largest distance of an end from that with all legs
    heading: float = NAN  # deg, turn by all legs minus that of the gyro
    made: float = NAN  # deg, turn by all legs minus that of the maker's attitude, NaN = there is none
    ok: float = NAN  # share of rows with filter_ok, all legs


def without_leg(log: Log, leg: int) -> Log:
    """Return the log with the contacts of one leg removed: its foot never stands."""
    contact, chance = log.contact.copy(), None if log.chance is None else log.chance.copy()
    contact[:, leg] = False
    if chance is not None:
        chance[:, leg] = 0.0
    touch = None if log.touch is None else log.touch & (np.arange(log.feet_count) != leg)[:, None]
    return replace(log, contact=contact, chance=chance, touch=touch)


def leave_one_out(log: Log, estimate: Callable[[Log], Track], made: Array | None = None) -> LegOut:
    """Return how estimates that leave out one leg in turn agree with the estimate by all legs.

    Args:
        log: log without truth.
        estimate: function that runs the estimator over a log.
        made: heading recorded by the robot's own software, (n,) rad; None = there is none.
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
    """Return the range (least, most) of each measure that is a goal of the default estimator on a log.

    Args:
        name: name of the log.
        way: length of path over which relative poses are compared, m; NaN for a log without truth.
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
