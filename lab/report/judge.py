"""Metrics of a run and the verdict on their limits, computed from the traces of the run without side effects."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.services.supervisor.scenarios.limits import LIMITS, Side

from ..statistics import REGION_95, nees
from .traces import VARIANTS, Traces

DEG = math.degrees(1.0)


@dataclass(frozen=True)
class Metric:
    """Description of a metric of a run, as the report prints it.

    Attributes:
        title: name of the quantity in the report.
        unit: unit printed after the value; empty = no unit.
        digits: number of printed decimals.
        lasting: True if a missed limit stays missed whatever follows in the run, as of an extreme; False otherwise.
    """

    title: str
    unit: str = ""
    digits: int = 3
    lasting: bool = False


METRICS: Mapping[str, Metric] = {
    "fell": Metric("fell (tilt over 45 deg or trunk contact)", lasting=True),
    "touches": Metric("obstacles touched", "", 0, lasting=True),
    "distance_m": Metric("distance walked along the first heading", "m"),
    "max_tilt_deg": Metric("largest tilt", "deg", 1, lasting=True),
    "mean_slip_mm": Metric("contact sliding per stance, mean", "mm", 2),
    "max_slip_mm": Metric("contact sliding per stance, worst", "mm", 2, lasting=True),
    "max_twist_deg": Metric("turn of a sole in its stance, worst", "deg", 2, lasting=True),
    "velocity_rmse_mps": Metric("velocity error against truth, RMS", "m/s", 4),
    "odometry_error_m": Metric("odometry error at the end, horizontal", "m"),
    "odometry_error_percent": Metric("odometry error per way walked", "%", 1),
    "heading_error_deg": Metric("heading error of the odometry at the end", "deg", 2),
    "min_margin_m": Metric("smallest static margin, planned CoM", "m", 4, lasting=True),
    "min_margin_measured_m": Metric("smallest static margin, measured CoM", "m", 4, lasting=True),
    "goals_missed": Metric("goals that were not reached", "", 0),
    "goal_error_m": Metric("true distance from the goal when it was reached, worst", "m", lasting=True),
    "goal_time_s": Metric("time from goal to goal reached, all goals", "s", 1, lasting=True),
    "recoveries": Metric("recoveries of the navigator", "", 0, lasting=True),
    "pose_error_m": Metric("error of the pose in the map, horizontal, RMS", "m"),
    "pose_nees": Metric("NEES of the pose per degree of freedom, mean", "", 2),
    "pose_inside": Metric("poses within their 95 % region", "%", 1),
    "duration_s": Metric("simulated time", "s", 2),
    "ticks": Metric("control ticks", "", 0),
    "real_time_factor": Metric("real-time factor", "x", 1),
}
"""Description of every metric of a run by its key, in the order of the verdict table."""


SIBLINGS = {"min_margin_measured_m": "min_margin_m"}
"""Metrics without a limit of their own; each maps to the metric with whose limit a note compares it."""


@dataclass(frozen=True)
class Row:
    """One row of the verdict table.

    Attributes:
        name: key of `METRICS`.
        value: value in the unit of the metric; None when the run has no data on it.
        limits: (side, limit) pairs that the value was compared with.
        ok: True if all limits are met, False if one is missed or a live run lacks the value; None without a limit, or
            if a recording lacks the value.
    """

    name: str
    value: float | None
    limits: tuple[tuple[Side, float], ...] = ()
    ok: bool | None = None

    @property
    def text(self) -> str:
        """Value of the metric as text, with its unit."""
        metric = METRICS[self.name]
        if self.name == "fell":
            return "-" if self.value is None else ("yes" if self.value else "no")
        return "-" if self.value is None else f"{self.value:.{metric.digits}f} {metric.unit}".rstrip()

    @property
    def limit_text(self) -> str:
        """Limits of the metric as text, `>= 0.1, <= 2`; `none` without one."""
        if not self.limits:
            return "none"
        if self.name == "fell":
            return "no"
        return ", ".join(f"{'>=' if side == 'least' else '<='} {limit:g}" for side, limit in self.limits)


@dataclass(frozen=True)
class RunVerdict:
    """Verdict on a run: its metrics compared with their limits, and other problems.

    Attributes:
        rows: one per metric.
        problems: failures besides missed limits, in words: a service that died, a refused command, ...
        message_hash: hash of all deterministic messages, empty when unknown.
        comparable: True if runs can be compared by the hash, False after a time-out, a restart or a degraded tick.
        watched: True if all problems of the run are known, False for a recording, which does not hold all of them.
        partly: True if only a part of a recording can be read, False if all of it was.
        why: sentence on the first cause of what went wrong, which the head of the report shows; it is one of the notes.
            Empty = nothing went wrong, or the run was not recorded.
    """

    rows: tuple[Row, ...]
    problems: tuple[str, ...] = ()
    message_hash: str = ""
    comparable: bool = True
    notes: tuple[str, ...] = field(default=())
    watched: bool = True
    partly: bool = False
    why: str = ""

    @property
    def ok(self) -> bool:
        """True if every limit is met and nothing else went wrong."""
        return not self.problems and all(row.ok is not False for row in self.rows)

    @property
    def word(self) -> str:
        """Return FAIL, PASS, or for a recording without a problem LIMITS MET or NO VERDICT: it may lack problems.

        A recording that lacks a part, or the data of a limit, and misses no other limit has no verdict.
        """
        if not self.ok:
            return "FAIL"
        if self.watched:
            return "PASS"
        limited = [row.ok for row in self.rows if row.limits]
        return "LIMITS MET" if limited and all(limited) and not self.partly else "NO VERDICT"

    def of_a_part(self) -> "RunVerdict":
        """Return the verdict on a recording of which only a part can be read.

        A missed limit stays missed only where the lost part cannot change that, as for the largest tilt, but not for
        the distance walked; every other limit, also one that is met, is left open (`ok` None).
        """
        rows = tuple(
            row if METRICS[row.name].lasting and row.ok is False else replace(row, ok=None) for row in self.rows
        )
        titles = [METRICS[row.name].title for row in rows if row.limits and row.value is not None and row.ok is None]
        note = f"only a part of the run can be read, which leaves open: {', '.join(titles)}"
        return replace(self, rows=rows, partly=True, notes=(*self.notes, note) if titles else self.notes)

    def value(self, name: str) -> float | None:
        """Return the value of a metric of `METRICS`, in its unit; None: the run has no data on it."""
        return next(row.value for row in self.rows if row.name == name)


def judge(
    traces: Traces,
    limits: Mapping[str, float],
    *,
    wall_s: float | None = None,
    message_hash: str = "",
    comparable: bool = True,
    problems: tuple[str, ...] = (),
    notes: tuple[str, ...] = (),
    watched: bool = True,
) -> RunVerdict:
    """Compare the numbers of a run with its limits, and return the verdict.

    Args:
        traces: time series of the run.
        limits: limits by key of `LIMITS`.
        wall_s: wall time between the first and the last tick, for the real-time factor.
        message_hash: hash of the run.
        comparable: True if runs can be compared by the hash, False if not.
        problems: failures besides missed limits, in words; with any the verdict is not ok.
        notes: remarks for the reader of the report.
        watched: True if all problems of the run are known: a limit on a value without data is missed; else left open.
    """
    values = measure(traces, wall_s)
    rows: list[Row] = []
    for name in METRICS:
        value = values.get(name)
        held: tuple[tuple[Side, float], ...] = tuple(
            (LIMITS[key].side, limit) for key, limit in limits.items() if LIMITS[key].metric == name
        )
        rows.append(Row(name, value, held, _meets(value, held) if held and (watched or value is not None) else None))
    notes = (*notes, *_below_siblings(rows), *(() if watched else _without_data(rows)))
    return RunVerdict(tuple(rows), problems, message_hash, comparable, notes, watched)


def _without_data(rows: list[Row]) -> list[str]:
    """Return a sentence on the limits for which a recording holds no data; an empty list if it holds all."""
    titles = [METRICS[row.name].title for row in rows if row.limits and row.value is None]
    return [f"the recording holds no data on: {', '.join(titles)}"] if titles else []


def _below_siblings(rows: list[Row]) -> list[str]:
    """Return a sentence on each metric without a limit that would miss the limit of its sibling in `SIBLINGS`."""
    by_name, found = {row.name: row for row in rows}, list[str]()
    for name, sibling in SIBLINGS.items():
        row, other = by_name[name], by_name[sibling]
        if row.value is not None and not row.limits and other.limits and not _meets(row.value, other.limits):
            title = METRICS[sibling].title
            found.append(f"{METRICS[name].title}: {row.text}, has no limit; that of the {title} is {other.limit_text}")
    return found


def _meets(value: float | None, held: tuple[tuple[Side, float], ...]) -> bool:
    if value is None:
        return False
    return all(value >= limit if side == "least" else value <= limit for side, limit in held)


def measure(traces: Traces, wall_s: float | None = None) -> dict[str, float]:
    """Return every metric that the traces have data on, by key of `METRICS`."""
    values: dict[str, float] = {}
    truth = traces.series("sim/truth")
    if len(truth):
        duration = truth[-1, 0] - truth[0, 0]
        values |= {
            "fell": float(traces.fallen_at is not None),
            "distance_m": distance(truth),
            "max_tilt_deg": float(truth[:, 8].max() * DEG),
            "duration_s": float(duration),
        }
        if traces.touches is not None:
            values["touches"] = float(traces.touches)
        if wall_s is not None and wall_s > 0.0:
            values["real_time_factor"] = duration / wall_s
    elif len(seen := traces.series("state/velocity")):
        values["duration_s"] = float(seen[-1, 0] - seen[0, 0])
    if traces.last_tick >= 0:
        values["ticks"] = float(traces.last_tick + 1)
    if traces.stances:
        sliding = 1000.0 * np.array([stance.sliding for stance in traces.stances])
        values |= {"mean_slip_mm": float(sliding.mean()), "max_slip_mm": float(sliding.max())}
    twists = [abs(stance.twist) for stance in traces.stances if stance.twist is not None]
    if twists:
        values["max_twist_deg"] = max(twists) * DEG
    error = velocity_error(truth, traces.series("state/velocity"))
    if len(error):
        values["velocity_rmse_mps"] = rms(error[:, 1:])
    drift = odometry_error(truth, traces.series("state/odometry"))
    if len(drift):
        values["odometry_error_m"] = float(drift[-1, 1])
        values["heading_error_deg"] = float(abs(drift[-1, 2]) * DEG)
        way = path_length(truth)
        if way > 0.1:
            values["odometry_error_percent"] = 100.0 * float(drift[-1, 1]) / way
    values |= navigation(traces, truth)
    stability = since_ready(traces.series("state/stability"), traces.series("state/gait"))
    for name, column in (("min_margin_m", 1), ("min_margin_measured_m", 2)):
        if len(stability) and np.isfinite(stability[:, column]).any():
            values[name] = float(np.nanmin(stability[:, column]))
    return values


def navigation(traces: Traces, truth: Array) -> dict[str, float]:
    """Return the metrics of goals and of the pose in the map, by key of `METRICS`; none without a navigator.

    Errors are in m, times in s. `truth`: a row per message, (n, 12): time s, position m and velocity m/s (3 each), yaw
    and tilt rad, CoM m (3).
    """
    values: dict[str, float] = {}
    if traces.goals and len(truth):
        reached = [goal for goal in traces.goals if goal.state == "succeeded"]
        values["goals_missed"] = float(sum(goal.state == "failed" for goal in traces.goals))
        values["recoveries"] = float(sum(goal.recoveries for goal in traces.goals))
        if reached:
            ends = [truth[min(int(np.searchsorted(truth[:, 0], goal.time)), len(truth) - 1), 1:3] for goal in reached]
            errors = [float(np.hypot(*(end - goal.place))) for end, goal in zip(ends, reached, strict=True)]
            values["goal_error_m"] = max(errors)
            values["goal_time_s"] = sum(goal.seconds for goal in reached)
    error, cov = pose_error(truth, traces.series("state/pose"))
    if len(error):
        values["pose_error_m"] = rms(error[:, 1:3])
        squares = nees(error[:, 1:], cov)
        values["pose_nees"], values["pose_inside"] = (
            float(squares.mean() / 3.0),
            100.0 * float((squares < REGION_95).mean()),
        )
    return values


def pose_error(truth: Array, belief: Array) -> tuple[Array, Array]:
    """Return rows (time s, error x, y in m, yaw in rad) of the pose in the map, (n, 4), and its covariances (n, 3, 3).

    Args:
        truth: a row per message: time s, position m and velocity m/s (3 each), yaw rad, and others.
        belief: a row per message: time s, x, y m, yaw rad, their covariance (9), and others.
    """
    if not len(truth) or not len(belief):
        return np.empty((0, 4)), np.empty((0, 3, 3))
    _, here, there = np.intersect1d(stamps(truth), stamps(belief), return_indices=True)
    real, found = truth[here], belief[there]
    turn = np.angle(np.exp(1j * (found[:, 3] - real[:, 7])))
    return np.column_stack([found[:, 0], found[:, 1:3] - real[:, 1:3], turn]), found[:, 4:13].reshape(-1, 3, 3)


def since_ready(rows: Array, gait: Array) -> Array:
    """Return the rows from the moment the walker is ready on, (k, c): none if it never is, all without gait messages.

    A robot that was set down on rough ground rests on few feet until it has put down the others.

    Args:
        rows: time s first, then anything, (n, c).
        gait: a row per message, (g, 6): time s, remaining, margin, steps, feet in stance, 1 = waiting.
    """
    if not len(rows) or not len(gait):
        return rows
    ready = gait[gait[:, 5] == 0.0, 0]
    return rows[rows[:, 0] >= ready[0]] if len(ready) else rows[:0]


def distance(truth: Array) -> float:
    """Return the displacement from start to end along the initial heading, m.

    `truth`: a row per message, (n, 12): time s, position m and velocity m/s (3 each), yaw rad, and others.
    """
    step = truth[-1, 1:3] - truth[0, 1:3]
    yaw = truth[0, 7]
    return float(step[0] * np.cos(yaw) + step[1] * np.sin(yaw))


def path_length(truth: Array) -> float:
    """Return the length of the horizontal path, m, in chords of 0.5 s, which leave out the sway.

    `truth`: a row per message, each 10 ms: time s, position (3) m, and others, (n, c).
    """
    corners = truth[::50, 1:3]
    return float(np.linalg.norm(np.diff(corners, axis=0), axis=1).sum())


def velocity_error(truth: Array, estimate: Array) -> Array:
    """Return rows (time s, error of the velocity x, y, z in m/s), (k, 4), base_link axes, of initialised estimates.

    Args:
        truth: a row per message: time s, position m and velocity m/s (3 each), and others.
        estimate: a row per message: time s, velocity m/s (3), 1 = initialised, and others.
    """
    if not len(truth) or not len(estimate):
        return np.empty((0, 4))
    valid = estimate[estimate[:, 4] > 0.5]
    _, here, there = np.intersect1d(stamps(truth), stamps(valid), return_indices=True)
    return np.column_stack([valid[there, 0], valid[there, 1:4] - truth[here, 4:7]])


def odometry_error(truth: Array, odometry: Array) -> Array:
    """Return rows (time s, horizontal distance m, heading error rad) between odometry and truth, (k, 3).

    Both are compared relative to the first initialised sample: where `odom` lies in the world is a matter of the
    start pose, not of the odometry.

    Args:
        truth: a row per message: time s, position m and velocity m/s (3 each), yaw rad, and others.
        odometry: a row per message: time s, position m (3), yaw rad, deviations (2), 1 = initialised.
    """
    if not len(truth) or not len(odometry):
        return np.empty((0, 3))
    valid = odometry[odometry[:, 7] > 0.5]
    _, here, there = np.intersect1d(stamps(truth), stamps(valid), return_indices=True)
    if not len(here):
        return np.empty((0, 3))
    real, found = truth[here], valid[there]
    turn = real[0, 7] - found[0, 4]
    rot = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])  # rot_world_from_odom
    placed = (found[:, 1:3] - found[0, 1:3]) @ rot.T
    gap = np.linalg.norm(placed - (real[:, 1:3] - real[0, 1:3]), axis=1)
    heading = found[:, 4] - real[:, 7] + turn
    return np.column_stack([found[:, 0], gap, np.angle(np.exp(1j * heading))])


def variants(traces: Traces) -> dict[str, float]:
    """Return the RMS velocity error of each recorded velocity estimator, m/s, by name, best first."""
    truth = traces.series("sim/truth")
    found: dict[str, float] = {}
    for name in VARIANTS:
        error = velocity_error(truth, traces.series(f"state/velocity/{name}"))
        if len(error):
            found[name] = rms(error[:, 1:])
    return dict(sorted(found.items(), key=lambda item: item[1]))


def rms(error: Array) -> float:
    """Return the root of the mean squared length of vectors (n, d), in their unit."""
    return float(np.sqrt(np.square(error).sum(axis=1).mean()))


def stamps(rows: Array) -> NDArray[np.int64]:
    """Return the first column of rows (n, c), s, as whole microseconds, so that equal stamps compare equal."""
    return np.round(rows[:, 0] * 1e6).astype(np.int64)
