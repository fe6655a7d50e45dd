"""Logs of others: the estimator beside all referees, and how far it depends on noise, start and faults of inputs.

v = rms length of the velocity error; 0.5 s = of errors averaged over half a second; NEES of v (3 = ideal) and share of
rows in the 95 % region; RPE = error of the displacement over the log's way; ATE after alignment by place and heading;
end = error of the displacement at the end; head = heading, rms and end; z = height over the log's way; ok = share of
rows with `filter_ok`; from = time until initialised. Errors count in all rows from the log's beginning of scores on,
whatever the flags; an estimator that never starts has none. Files that are absent are skipped. `name*` is tuned on the
log itself, which favours it. Gyro alone starts from the true attitude; its bias is the mean of the standstill, if any.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.bench import Bench, goal, table, words_of
from benchmarks.foreign_changes import (
    AFTER_S,
    MIDDLE,
    alarms,
    changes,
    fast_moment,
    planted,
    tilted_start,
    turned_starts,
)
from benchmarks.foreign_scores import ForeignScore, LegOut, scored
from benchmarks.foreign_smooth import BOTH_WAYS, both_ways
from benchmarks.foreign_tables import CONTRADICTED, TUNED, agreement, errors, plain, shown, summaries
from surefoot.errors import SurefootError
from surefoot.lab.estimation.log import Log
from surefoot.lab.estimation.logs import DATA, FOREIGN, foreign
from surefoot.lab.estimation.planted import PLANTED
from surefoot.lab.estimation.referees import KNOWN, UNTUNED, available, run
from surefoot.lab.estimation.scores import score
from surefoot.lab.estimation.track import default
from surefoot.lab.estimation.walks import VARIANTS, walk
from surefoot.lab.studies import seeds_of
from surefoot.papers.wawrzynski.sets import LogSet, synthetic_sets, tuned, walk_sets
from surefoot.papers.wawrzynski.synthetic import KINDS as WALKS
from surefoot.papers.wawrzynski.synthetic import synthesize

BENCH = Bench("foreign")

SYNTHETIC = "synthetic"
"""Name of a short generated walk, which stands in for a log when no file is present."""
CHANGED = "icub_kindyn_walk,icub3_gazebo_sole,go1_trot_200_force,casbot_walk_a"
"""Names of the logs with truth, comma-separated, that the parts with changed inputs use by default."""
ONE = "--logs synthetic"


def readable(names: Sequence[str], data: Path) -> Iterator[tuple[str, float, Log]]:
    """Yield name, path length of relative poses, m (NaN: no truth), and log of readable logs; print unreadable ones.

    Raises:
        SurefootError: there is no log of this name.
    """
    for name in names:
        if name == SYNTHETIC:
            yield name, 0.1, synthesize(replace(WALKS["twist"], duration_s=6.0), 0)
            continue
        try:
            log = foreign(name, data)
        except FileNotFoundError as error:
            print(f"{name}: skipped, no file {error.filename or error}", flush=True)
        except SurefootError as error:
            if name not in FOREIGN:
                raise
            print(f"{name}: skipped, {error.message}", flush=True)
        else:
            yield name, FOREIGN[name].way if log.truth is not None else float("nan"), log


def own_sets(sets: str) -> list[LogSet]:
    """Return the sets of synthetic and recorded walks in a comma-separated list, by default all.

    Raises:
        SurefootError: there is no such set.
    """
    known = {one.name: one for one in (*synthetic_sets(), *walk_sets())}
    if unknown := [name for name in words_of(sets) if name not in known]:
        raise SurefootError("invalid", f"got {', '.join(unknown)}; known are {', '.join(known)}", "sets")
    return [known[name] for name in words_of(sets) or known]


def chosen_of(estimators: str) -> tuple[str, ...]:
    """Return the installed ones of the named estimators, all by default; print those that are not installed.

    Raises:
        SurefootError: there is no such estimator.
    """
    names = words_of(estimators) or (default(), *UNTUNED)
    if unknown := [name for name in names if name not in KNOWN]:
        raise SurefootError("invalid", f"got {', '.join(unknown)}; known are {', '.join(KNOWN)}", "estimators")
    found = available(names)
    if len(found) < len(names):
        print(f"{', '.join(sorted(set(names) - set(found)))}: skipped, pip install gtsam", flush=True)
    return found


@BENCH.part("--logs synthetic --estimators best,legs --no-tuned")
def tables(
    *, logs: str = "", estimators: str = "", no_tuned: bool = False, data: Path = DATA, json_: Path | None = None
) -> None:
    """Errors of the estimator and of all referees on each log, beside the goals.

    Args:
        logs: names of logs, comma-separated; default: all.
        estimators: names of estimators, comma-separated; default: `best` and all referees.
        no_tuned: leave out the tuned referees.
        data: folder of the files.
        json_: file for the scores as well.
    """
    chosen = chosen_of(estimators)
    kept: dict[str, Mapping[str, ForeignScore | LegOut]] = {}
    for name, way, log in readable(words_of(logs) or tuple(FOREIGN), data):
        if log.truth is None:
            kept[name] = agreement(name, log, chosen, data)
        else:
            kept[name] = errors(name, log, way, chosen, () if no_tuned else TUNED)
    summaries(kept)
    if json_ is not None:
        json_.write_text(json.dumps(plain(kept), indent=1))


def each(logs: str, data: Path) -> Iterator[tuple[str, float, Log]]:
    """Yield name, path length of relative poses, m, and log of those of the named logs that have truth."""
    for name, way, log in readable(words_of(logs), data):
        if log.truth is None:
            print(f"{name}: skipped, no truth", flush=True)
        else:
            yield name, way, log


@BENCH.part(ONE)
def noise(*, logs: str = CHANGED, estimators: str = default(), data: Path = DATA) -> None:
    """Print errors with wrongly stated noise, legs, contact levels and time offset over those of the unchanged log.

    Args:
        logs: names of the logs to use, comma-separated.
        estimators: `best` or `inekf`, comma-separated.
        data: folder of the files.
    """
    for one in words_of(estimators):
        rows: list[tuple[object, ...]] = []
        worst = 0.0
        for name, way, log in each(logs, data):
            clean = scored(log, run(one, log), way)
            for change in changes(one, log, FOREIGN.get(name)):
                s = scored(change.log, run(one, change.log, change.options), way)
                ratios = s.smooth / clean.smooth, s.rpe / clean.rpe
                rows.append((f"{name}, {change.name}", *(f"{x:.2f}" for x in ratios), f"{s.nees:.1f}", f"{s.ok:.2f}"))
                worst = max(worst, ratios[0]) if np.isfinite(ratios[0]) else float("inf")
        table(f"{one}: ratio to the log as it is", ("log, change", "0.5 s", "RPE", "NEES", "ok"), rows)
        goal(f"  {one}, worst error over 0.5 s", worst, "<=", 1.2)


@BENCH.part(f"{ONE} --count 2")
def starts(*, logs: str = CHANGED, estimators: str = default(), count: int = 100, data: Path = DATA) -> None:
    """Start in mid-walk with the inertial unit in random orientations; errors count from 3 s later.

    Args:
        logs: names of the logs to use, comma-separated.
        estimators: names of estimators, comma-separated.
        count: orientations.
        data: folder of the files.
    """
    header = ("log", "0.5 s cm/s", "spread %", "worst / median", "worst RPE %", "diverged", "start s", "sd there m/s")
    for one in words_of(estimators):
        found = {name: turned_starts(one, log, way, count) for name, way, log in each(logs, data)}
        table(
            f"{one}: {count} starts in motion",
            header,
            [(name, *map(shown, vars(s).values())) for name, s in found.items()],
        )
        for what, field, bound in (
            ("spread, %", "spread", 3.0),
            ("diverged", "diverged", 0.0),
            ("start, s", "slowest", 1.0),
        ):
            if found:
                goal(f"  {one}, {what}", max(getattr(s, field) for s in found.values()), "<=", bound)


@BENCH.part(f"{ONE} --times 1")
def faults(
    *, logs: str = CHANGED, estimators: str = default(), times: int = 2, first: float = MIDDLE, data: Path = DATA
) -> None:
    """Plant faults of one sensor in mid-walk: error over that without, and time until it is flagged and named.

    Times count from the first sample that the fault alters; "shown" counts the time of altered samples alone, for a
    switch that hangs is right until the next step. A fault that alters none before the log ends is left out.

    Args:
        logs: names of the logs to use, comma-separated.
        estimators: names of estimators, comma-separated.
        times: number of moments at which each fault is planted, for each of two feet.
        first: share of the log at which these moments begin, 0 to 1; they are spread over 0.3 of the log.
        data: folder of the files.
    """
    chosen = list(each(logs, data))
    for one in words_of(estimators):
        clean = {name: run(one, log) for name, _, log in chosen}
        rows: list[tuple[object, ...]] = []
        good = good_shown = runs = 0
        for fault in PLANTED:
            found = [
                planted(fault, log, clean[name], foot, one, fast_moment(log, first + 0.3 * k / times))
                for name, _, log in chosen for k in range(times) for foot in (0, log.feet_count - 1)
            ]  # fmt: skip
            found = [f for f in found if f.shown]
            ratios = [f.ratio for f in found]
            right = sum(f.right for f in found)
            shown = sum(f.right_when_shown for f in found)
            good, good_shown, runs = good + right, good_shown + shown, runs + len(found)
            counts = (
                f"{right} of {len(found)}", shown, sum(AFTER_S < f.named < np.inf and not f.wrong for f in found),
                sum(f.wrong for f in found), sum(not f.wrong and f.named == np.inf for f in found),
                sum(f.flagged <= AFTER_S for f in found),
            )  # fmt: skip
            rows.append((fault, float(np.median(ratios)), max(ratios), *counts))
        header = (
            "fault",
            "0.5 s ratio",
            "worst",
            f"named in {AFTER_S} s",
            "shown",
            "late",
            "wrong",
            "never",
            "flag in time",
        )
        table(f"{one}: faults", header, rows)
        goal(f"  {one}, share of faults that are named", good / max(runs, 1), ">=", 0.95)
        print(f"  {one}, named within {AFTER_S} s of altered samples: {good_shown} of {runs}")
        for name, _, log in chosen:
            goal(f"  {one}, false alarms per hour, {name}", alarms(log, clean[name]), "<=", 1.0)


@BENCH.part(f"{ONE} --sets twist --seeds 1")
def tilted(
    *, logs: str = "", sets: str = "", seeds: str = "3", degrees: float = 8.0, estimators: str = default(),
    data: Path = DATA
) -> None:  # fmt: skip
    """Start at rest with a wrong tilt: time with an error above 5 cm/s, and how much of it without a flag.

    Args:
        logs: names of logs, comma-separated; default: all that begin with a rest.
        sets: names of sets of synthetic and recorded walks, comma-separated; default: all.
        seeds: seeds of the axes and of the walks, count or first:end; the worst of them is printed.
        degrees: angle by which the accelerometer is turned until the robot walks, deg.
        estimators: names of estimators, comma-separated.
        data: folder of the files.
    """
    numbers, whole = seeds_of(seeds), tuple(name for name in FOREIGN if name not in CONTRADICTED)
    own = own_sets(sets)
    read = ((name, log) for name, _, log in readable(words_of(logs) or whole, data))
    cases = {name: [(log, seed) for seed in numbers] for name, log in read if log.rest[1]}
    cases |= {one.name: [(log, seed) for log, seed in zip(one.logs(numbers), numbers, strict=True)] for one in own}
    for name in words_of(estimators):
        found = {key: [tilted_start(name, log, degrees, seed) for log, seed in case] for key, case in cases.items()}
        rows = [
            (key, *(f"{max(getattr(one, field) for one in some):.2f}" for field in ("wrong_s", "silent_s", "last_s")))
            for key, some in found.items()
        ]
        table(f"{name}: {degrees:g} deg wrong", ("log", "wrong, s", "silent, s", "last, s"), rows)
        goal(f"  {name}, most in silence, s", max(one.silent_s for some in found.values() for one in some), "<=", 0.5)


@BENCH.part(f"{ONE} --sets twist --seeds 1")
def smoothed(*, logs: str = "", sets: str = "", seeds: str = "5", data: Path = DATA) -> None:
    """Print the errors of forward and of smoothed estimates (`surefoot estimate --smooth`), and their NEES.

    Args:
        logs: names of logs, comma-separated; default: all with truth.
        sets: names of sets of synthetic and recorded walks, comma-separated; default: all. Rows are means over seeds.
        seeds: seeds of the walks, count or first:end.
        data: folder of the files.
    """
    names = words_of(logs) or tuple(name for name in FOREIGN if name not in CONTRADICTED)
    own = own_sets(sets)
    rows = [(name, *both_ways([log], way)) for name, way, log in each(",".join(names), data)]
    rows += [(one.name, *both_ways(one.logs(seeds_of(seeds)), 0.1)) for one in own]
    table("forward / smoothed", ("log", *BOTH_WAYS), rows)


def _variant(name: str, seed: int) -> Log:
    return walk(name, seed).log


@BENCH.part("--seeds 1 --sets edges3")
def simulated(
    *, sets: str = "", estimators: str = f"{default()},inekf", seeds: str = "5", tuned_: bool = False
) -> None:
    """Print errors in walks on ice, with another inertial unit than estimators assume, and with landings on edges.

    Args:
        sets: names of sets of walks, comma-separated; default: all.
        estimators: names of estimators, comma-separated.
        seeds: seeds of the walks, count or first:end; a walk that is not in the cache takes up to half a minute.
        tuned_: add the invariant filter tuned on other seeds, `inekf*`.
    """
    made = {f"edges{deg}": replace(WALKS["edges"], edge_deg=(deg, deg)) for deg in (0, 2, 3, 4, 8)}
    names = words_of(sets) or (*VARIANTS, *made)
    if unknown := [name for name in names if name not in (*VARIANTS, *made)]:
        raise SurefootError("invalid", f"got {', '.join(unknown)}; known are {', '.join((*VARIANTS, *made))}", "sets")
    rows: list[tuple[object, ...]] = []
    for name in names:
        make = partial(_variant, name) if name in VARIANTS else partial(synthesize, made[name])
        chosen = LogSet(name, make)
        runs: list[tuple[str, str, dict[str, Any]]] = [(one, one, {}) for one in words_of(estimators)]
        if tuned_:
            runs.append(("inekf*", "inekf", tuned(chosen, "inekf")))
        logs = chosen.logs(seeds_of(seeds))
        for text, one, options in runs:
            found = [(score(log, track), track.flags["filter_ok"][log.scored].mean())
                     for log in logs for track in [run(one, log, options)]]  # fmt: skip
            numbers = [(100 * s.rmse, 100 * s.smooth, s.percent, 100 * s.odometry, s.nees, s.tilt_deg, ok)
                       for s, ok in found]  # fmt: skip
            rows.append((f"{name}, {text}", *(f"{x:.2f}" for x in np.mean(numbers, axis=0))))
    header = ("walk, estimator", "v cm/s", "0.5 s", "|avg| %", "odometry %", "NEES", "tilt deg", "ok")
    table("means over the seeds (goals: odometry on ice <= 3 %, other sensors <= 1.5 %)", header, rows)
