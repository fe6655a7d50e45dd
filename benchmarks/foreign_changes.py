"""Estimator errors on logs by others with changed samples or wrongly stated properties: rows for `foreign`."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.lab.estimation.calibrate import calibrate, proven
from surefoot.lab.estimation.contacts import by_force
from surefoot.lab.estimation.faults import from_the_middle, turned, with_wrong_start
from surefoot.lab.estimation.log import Log
from surefoot.lab.estimation.logs import ForeignLog
from surefoot.lab.estimation.peers.inekf import InekfNoise
from surefoot.lab.estimation.planted import PLANTED, altered, named
from surefoot.lab.estimation.referees import run
from surefoot.lab.estimation.scores import smoothed, velocity_error
from surefoot.lab.estimation.track import Track
from surefoot.services.estimator.params import EstimatorParams

from .foreign_scores import scored

FACTORS = (0.2, 5.0)
"""Factors by which each stated noise is multiplied in turn."""
SCALES = (0.95, 1.05)
"""Factors by which foot positions relative to the inertial unit are multiplied, for wrongly stated leg lengths."""
LEVELS = (0.5, 2.0)
"""Factors by which the contact forces are multiplied at which a foot starts and stops to count as standing."""
OFFSET_NS = 20_000_000
"""Time by which the foot samples are shifted against the inertial ones, in either direction, ns."""
MIDDLE = 0.4
"""Share of a log, 0 to 1, after which starts in motion and planted faults begin."""
RECOVERY_S = 3.0
"""Time after a start in motion before errors count, s; at most 40 % of the rest of the log."""
DIVERGED = 2.0
"""Error, in multiples of the median error over all starts, above which a start counts as diverged."""
ALARMS = ("filter_ok", "sensors_ok", "inputs_ok")
WRONG = 0.05
"""Error of the velocity, m/s, above which a start with a wrong tilt counts as wrong."""
WATCHED_S = 5.0
"""Time after the initial rest in which wrong velocities are counted, s: later, two tracks differ by how they treat a
foot that slips."""
AFTER_S = 0.5
"""Time after its first altered sample within which a fault should be flagged, s."""


@dataclass(frozen=True)
class Change:
    """A log with one wrong statement or build, and the options of the estimator for it."""

    name: str
    log: Log
    options: Mapping[str, Any]


def noise_options(name: str, log: Log) -> dict[str, float]:
    """Return the stated noise of gyro, accelerometer and kinematics, by option of the estimator."""
    if name == "inekf":
        return {key: getattr(InekfNoise(), key) for key in ("sigma_w", "sigma_q", "sigma_p")}
    keys = ("sigma_w", "sigma_q", "sigma_point")
    return {key: float(log.sensors.get(key, getattr(EstimatorParams(), key))) for key in keys}


def changes(name: str, log: Log, row: ForeignLog | None) -> Iterator[Change]:
    """Yield changes of a log or of the estimator's options, one for each thing that a user may state or build wrongly.

    Args:
        name: name of the estimator.
        log: unchanged log.
        row: the log's row in the table of logs, which gives the forces from which on feet stand; None = unknown.
    """
    for key, value in noise_options(name, log).items():
        for factor in FACTORS:
            yield Change(f"{key} x {factor:g}", log, {key: value * factor})
    for scale in SCALES:
        wrong = replace(log, foot_position=log.foot_position * scale)
        yield Change(f"legs x {scale:g}", wrong, {})
        yield Change(f"legs x {scale:g}, calibrated", proven(calibrate(wrong)).apply(), {})
    if row is not None and row.levels is not None and log.force is not None:
        for factor in LEVELS:
            on, off = (factor * level for level in row.levels)
            yield Change(f"contact forces x {factor:g}", replace(log, contact=by_force(log.force, on, off)[0]), {})
    for shift in (-OFFSET_NS, OFFSET_NS):
        stamp = log.foot_ns + shift
        inside = np.flatnonzero((stamp >= log.stamp_ns[0]) & (stamp <= log.stamp_ns[-1])).astype(np.int64)
        moved = replace(log, foot_ns=stamp, order=None).with_feet(inside)
        yield Change(f"feet {1e-6 * shift:+.0f} ms", moved, {})
        yield Change(f"feet {1e-6 * shift:+.0f} ms, calibrated", proven(calibrate(moved)).apply(), {})


@dataclass(frozen=True)
class Starts:
    """Result of starting an estimator in motion on one log with the inertial unit in many orientations."""

    median: float  # cm/s, error over 0.5 s
    spread: float  # % of the median, standard deviation
    worst: float  # worst over median
    rpe_worst: float  # %
    diverged: int  # starts whose error is twice the median, not finite, or that never started
    slowest: float  # s until initialised, the longest
    sd: float  # m/s, published deviation of the velocity where `initialised` becomes true, the largest


def turned_starts(name: str, log: Log, way: float, count: int) -> Starts:
    """Run an estimator from a moment of fast motion on, once for each of `count` rotations of the inertial unit."""
    cut = from_the_middle(log, fast_moment(log))
    cut = replace(cut, begin_s=min(RECOVERY_S, 0.4 * float(cut.seconds[-1])))
    errors: list[float] = []
    ways: list[float] = []
    late: list[float] = []
    sds: list[float] = []
    for seed in range(count):
        other = turned(cut, seed)
        found = run(name, other)
        s = scored(other, found, way)
        errors.append(s.smooth)
        ways.append(s.rpe)
        late.append(s.start)
        first = int(np.argmax(found.flags["initialised"]))
        sds.append(float(np.sqrt(np.linalg.eigvalsh(found.p[first, 3:, 3:])[-1])) if np.isfinite(s.start) else np.nan)
    error = np.array(errors)
    median = float(np.nanmedian(error))
    good = error <= DIVERGED * median
    return Starts(
        median, 100.0 * float(np.std(error[good])) / median, _most(errors) / median, _most(ways), int((~good).sum()),
        _most(late), _most(sds),
    )  # fmt: skip


@dataclass(frozen=True)
class Tilted:
    """Result of a start at rest with a wrong tilt beside the right one, over the time watched after the rest."""

    wrong_s: float  # velocity more than `WRONG` off
    silent_s: float  # of that, `initialised` and `filter_ok` true
    last_s: float  # after the rest, until it is so for the last time


def tilted_start(name: str, log: Log, degrees: float, seed: int) -> Tilted:
    """Run an estimator over a log whose accelerometer is turned until the robot walks, and over the log as it is."""
    good, found = run(name, log), run(name, with_wrong_start(log, float(np.radians(degrees)), seed))
    since, step = log.seconds - log.seconds[log.rest[1]], float(np.median(np.diff(log.seconds)))
    wrong = (np.linalg.norm(found.v - good.v, axis=1) > WRONG) & (since > 0.0) & (since < WATCHED_S)
    silent = wrong & found.flags["initialised"] & found.flags["filter_ok"]
    return Tilted(step * wrong.sum(), step * silent.sum(), float(since[wrong][-1]) if wrong.any() else 0.0)


def fast_moment(log: Log, share: float = MIDDLE) -> float:
    """Return the first time from a share of a log on at which it moves faster than its rms, by means over 0.5 s, in s.

    Where it does not move any more, it is the last such time.
    """
    speed = np.linalg.norm(smoothed(log.v_world, log), axis=1)
    rows = np.arange(len(speed)) + (len(log.v_world) - len(speed)) // 2
    fast = np.flatnonzero(speed > np.sqrt(np.mean(speed**2)))
    at = np.searchsorted(log.seconds[rows[fast]], share * log.seconds[-1])
    return float(log.seconds[rows[fast[min(at, len(fast) - 1)]]])


def _most(values: Sequence[float]) -> float:
    """Return the largest finite one of some values; NaN = none is finite."""
    return max((x for x in values if np.isfinite(x)), default=float("nan"))


@dataclass(frozen=True)
class Planted:
    """Result of planting one sensor fault into one log: error, time until it is flagged and named."""

    ratio: float  # error over 0.5 s from the fault on, over that without it
    flagged: float  # s from the first altered sample until a flag is false that is true without the fault
    named: float  # s until its sensor and leg are named
    shown_s: float  # s of altered samples until then; a switch that hangs may be right for most of a step
    wrong: bool  # another sensor was named within `AFTER_S`, which is not without the fault
    shown: bool  # a sample was altered

    @property
    def right(self) -> bool:
        """True if the faulty sensor was named within `AFTER_S` and no other was; else False."""
        return self.named <= AFTER_S and not self.wrong

    @property
    def right_when_shown(self) -> bool:
        """True if the faulty sensor was named within `AFTER_S` of altered samples and no other was; else False."""
        return self.shown_s <= AFTER_S and not self.wrong


def planted(fault: str, log: Log, clean: Track, foot: int, name: str, at_s: float) -> Planted:
    """Plant a fault into a log, and compare an estimator with its track without the fault.

    Args:
        fault: name in `PLANTED`.
        log: log without the fault, with truth.
        clean: track of the estimator over that log.
        foot: index of the foot whose sensor is faulty.
        name: name of the estimator.
        at_s: time since the start at which the fault begins, s.
    """
    changed = PLANTED[fault](log, at_s, foot)
    bad, shown = run(name, changed), altered(log, changed, at_s)
    rows = (log.seconds >= at_s) & (log.seconds <= log.seconds[-1] - log.end_s)
    since = float(log.seconds[np.argmax(shown)]) if shown.any() else float("inf")
    soon = (log.seconds >= since) & (log.seconds <= since + AFTER_S)

    def first(mask: NDArray[np.bool_], at: NDArray[np.float64]) -> float:
        """Return the value of `at` (n,) in the first row of `mask` (n,) since the fault shows; inf: there is none."""
        later = np.flatnonzero((log.seconds >= since) & mask)
        return float(at[later[0]]) if len(later) else float("inf")

    after = log.seconds - since
    flagged = min(first(~bad.flags[flag] & clean.flags[flag], after) for flag in ALARMS)
    right, wrong = np.zeros((2, len(rows)), dtype=np.bool_)
    if bad.named is not None and clean.named is not None:
        right, wrong = named(fault, foot, log.feet_count, bad.named)
        wrong &= ~named(fault, foot, log.feet_count, clean.named)[1]
    steps = np.diff(log.seconds, prepend=log.seconds[0])
    worn = np.cumsum(np.where(shown, steps, 0.0))
    ratio = _error(log, bad, rows) / _error(log, clean, rows)
    return Planted(ratio, flagged, first(right, after), first(right, worn), bool(wrong[soon].any()), bool(shown.any()))


def _error(log: Log, found: Track, rows: NDArray[np.bool_]) -> float:
    """Return the rms of the velocity error, averaged over 0.5 s, in the rows of a log flagged in `rows` (n,), m/s."""
    error = smoothed(velocity_error(log, found)[rows], log)
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))


def alarms(log: Log, found: Track) -> float:
    """Return how often per hour `filter_ok` or `sensors_ok` becomes false in the scored part of a clean log."""
    rows = log.scored
    count = sum(int((np.diff(found.flags[flag][rows].astype(np.int8)) < 0).sum()) for flag in ALARMS[:2])
    return 3600.0 * count / float(np.ptp(log.seconds[rows]))
