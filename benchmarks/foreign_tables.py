"""Tables of the scores on logs of others, beside goals and referees."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from surefoot.errors import SurefootError
from surefoot.lab.estimation.contacts import without_rolling
from surefoot.lab.estimation.go1 import go1_bag
from surefoot.lab.estimation.log import Log
from surefoot.lab.estimation.logs import FOREIGN
from surefoot.lab.estimation.peers.legs import inertial_velocity
from surefoot.lab.estimation.referees import run
from surefoot.lab.estimation.scores import velocity_error
from surefoot.lab.estimation.track import Track, default
from surefoot.papers.wawrzynski.sets import LogSet, tuned

from .bench import goal, table
from .foreign_scores import HEADERS, ForeignScore, LegOut, goals_of, gyro_alone, leave_one_out, scored, timed

TUNED = ("inekf", "linear")
MEASURE = "smooth"
"""Error for which referees are tuned, over 0.5 s: truth by motion capture is noisy row by row."""
CONTRADICTED = {"casbot_walk_b": 2.9}
"""Time since the start, s, from which the feet of a log contradict its truth, by name of the log."""
RATIOS = {"rpe": "RPE", "heading": "heading", "smooth": "error over 0.5 s"}
"""Names in tables of the errors (by key) that the default estimator must not have larger than any referee."""
GYRO = "gyro alone"
UNITS = {"rpe": "% of the way", "heading": "deg rms", "smooth": "cm/s"}
LEFT_OUT = ("", "diff. cm/s", "worst leg", "heights cm", "ends cm", "head-gyro", "head-maker", "ok")


def errors(name: str, log: Log, way: float, chosen: Sequence[str], to_tune: Sequence[str]) -> dict[str, ForeignScore]:
    """Print the scores of estimators on one log, and the goals of the default one; return scores by estimator's name.

    The integral of the gyro alone is scored, too, under the name `GYRO`.

    Args:
        name: name of the log.
        log: sensor data and reference.
        way: length over which relative errors of the position are measured, m.
        chosen: names of the estimators that are run as they are.
        to_tune: names of those that are run with settings tuned on this log, scored with a * after the name.
    """
    found: dict[str, ForeignScore] = {}
    for one in chosen:
        try:
            track, cost = timed(one, log)
        except SurefootError as error:  # a referee that cannot
            print(f"  {error.message}")
            continue
        found[one] = scored(log, track, way, cost)
        if name in CONTRADICTED and one == default():
            contradicted(log, track, CONTRADICTED[name])
    for one in to_tune if name not in CONTRADICTED else ():
        options = tuned(LogSet(name, lambda seed: without_rolling(log), drawn=False), one, MEASURE)
        track, cost = timed(one, log, options)
        found[f"{one}*"] = scored(log, track, way, cost)
    rms, end = gyro_alone(log)
    gyro = ForeignScore(heading=rms, heading_end=end)
    rows = [(one, *s.cells()) for one, s in (found | {GYRO: gyro}).items()]
    table(f"{name}, {log.seconds[-1]:.0f} s, RPE over {way:g} m", HEADERS, rows)
    if default() in found and name not in CONTRADICTED:
        print_goals(name, way, found, gyro.heading)
    return found | {GYRO: gyro}


def print_goals(name: str, way: float, found: dict[str, ForeignScore], gyro: float) -> None:
    """Print the figures of the default estimator beside their goals, its ratios to referees among them."""
    ours = found[default()]
    if not np.isfinite(ours.v):
        print(f"  {default()} never started: all goals MISSED")
        return
    for measure, (least, most) in goals_of(name, way).items():
        if least > 0.0:
            goal(f"  {measure}", getattr(ours, measure), ">=", least)
        goal(f"  {measure}", getattr(ours, measure), "<=", most)
    goal("  heading / gyro alone", ours.heading / max(gyro, 1e-9), "<=", 1.0 if name.startswith("casbot") else 1.05)
    for measure, text in RATIOS.items():
        for bound, group in ((1.0, "untuned"), (1.1, "tuned")):
            theirs = {one: getattr(s, measure) for one, s in found.items()
                      if one != default() and one.endswith("*") == (group == "tuned")}  # fmt: skip
            theirs = {one: value for one, value in theirs.items() if np.isfinite(value)}
            if theirs:
                best = min(theirs, key=lambda one: theirs[one])
                goal(f"  {text} / best {group}, {best}", getattr(ours, measure) / max(theirs[best], 1e-9), "<=", bound)


def contradicted(log: Log, track: Track, since_s: float) -> None:
    """Print `filter_ok` and velocity error after the first contradiction, beside those of the inertial unit alone."""
    first = int(np.searchsorted(log.seconds, since_s))
    after = np.flatnonzero(~track.flags["filter_ok"][first:])
    late = float(log.seconds[first + after[0]] - since_s) if len(after) else float("inf")
    goal("  filter_ok false after the first contradiction, s", late, "<=", 0.5)
    error = velocity_error(log, track)[first:]
    alone = inertial_velocity(log, first) - log.v_world[first:]
    goal(
        "  velocity from then on / inertial unit alone", float(np.sqrt(np.sum(error**2) / np.sum(alone**2))), "<=", 1.0
    )


def agreement(name: str, log: Log, chosen: Sequence[str], data: Path) -> dict[str, LegOut]:
    """Print how estimates without one leg agree on a log without truth, and return it by estimator."""
    made = maker_yaw(log, data) if FOREIGN[name].file.endswith(".bag") else None
    found = {one: leave_one_out(log, lambda part, one=one: run(one, part), made) for one in chosen}
    rows = [(one, *(shown(x) for x in vars(s).values())) for one, s in found.items()]
    table(f"{name}, {log.seconds[-1]:.0f} s, no truth: one leg left out in turn", LEFT_OUT, rows)
    for measure, (_, most) in goals_of(name, float("nan")).items() if default() in found else ():
        value = getattr(found[default()], measure)
        goal(f"  {measure}", value if np.isfinite(value) else float("inf"), "<=", most)
    return found


def maker_yaw(log: Log, data: Path) -> NDArray[np.float64]:
    """Return the heading by the attitude that the robot's maker recorded in a bag, (n,) rad."""
    rot = go1_bag(data / FOREIGN[log.name].file)[1]
    return np.unwrap(np.arctan2(rot[:, 1, 0], rot[:, 0, 0]))


def summaries(kept: Mapping[str, Mapping[str, ForeignScore | LegOut]]) -> None:
    """Print one table for each measure in `RATIOS`, a row for each log with truth, a column for each estimator.

    `kept`: scores by log, then by estimator; `LegOut` marks a log without truth. Fewer than two logs with truth print
    nothing.
    """
    truths = {name: found for name, found in kept.items() if not any(isinstance(s, LegOut) for s in found.values())}
    columns = list(dict.fromkeys(one for found in truths.values() for one in found))
    for measure, text in RATIOS.items() if len(truths) > 1 else ():
        rows = [
            (name, *(shown(getattr(found[one], measure)) if one in found else "-" for one in columns))
            for name, found in truths.items()
        ]
        table(f"{text}, {UNITS[measure]}", ("", *columns), rows)


def shown(value: float) -> str:
    """Return a number as text for a table; a dash stands for NaN."""
    return f"{value:.2f}" if np.isfinite(value) else "-"


def plain(kept: Mapping[str, Mapping[str, ForeignScore | LegOut]]) -> dict[str, dict[str, dict[str, float | None]]]:
    """Return scores as numbers for JSON, None for what is unknown."""
    return {
        name: {one: {k: v if np.isfinite(v) else None for k, v in asdict(s).items()} for one, s in found.items()}
        for name, found in kept.items()
    }
