"""Comparison of this project's estimators with tuned referees (those of others) by their errors on the same logs."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from surefoot.geometry.constants import GRAVITY
from surefoot.lab.estimation.blind import blind_error
from surefoot.lab.estimation.faults import FAULTS, LATE, STARTS
from surefoot.lab.estimation.scores import Score, nees, score
from surefoot.lab.estimation.track import ABLATIONS, Track, track
from surefoot.lab.estimation.walks import walk
from surefoot.lab.statistics import interval

from .sets import LogSet, synthetic_sets, tuned

RECOVERY_S = 3.0  # after another start, before scores are compared


@dataclass(frozen=True)
class Comparison:
    """Errors of several estimators over one set of logs."""

    name: str
    measure: str  # for which the referees are tuned
    scores: Mapping[str, Sequence[Score]]
    noise: Mapping[str, Mapping[str, Any]]  # of the referees

    def best_reference(self, measure: str) -> str | None:
        """Return the name of the referee with the least mean error by `measure`; None without referees."""
        means = {name: np.mean([getattr(s, measure) for s in self.scores[name]]) for name in self.noise}
        return min(means, key=lambda name: means[name]) if means else None


def compare(
    chosen: LogSet, subjects: Iterable[str], references: Iterable[str], seeds: Iterable[int], measure: str = "rmse",
    retune: bool = False,
) -> Comparison:  # fmt: skip
    """Return the errors of estimators as they are, and of referees (of others) that are tuned, on a set of logs.

    Args:
        chosen: the set of logs.
        subjects: estimators with their own settings.
        references: estimators with noise tuned for this set; `name*` in the result if it is a subject as well.
        seeds: of the logs.
        measure: error for which the referees are tuned.
        retune: search the noise of the referees again.
    """
    logs = chosen.logs(seeds)
    scores: dict[str, Sequence[Score]] = {name: [score(log, track(name, log)) for log in logs] for name in subjects}
    noise: dict[str, Mapping[str, Any]] = {}
    for name in references:
        found = tuned(chosen, name, measure, retune)
        label = f"{name}*" if name in scores else name
        noise[label] = found
        scores[label] = [score(log, track(name, log, **found)) for log in logs]
    return Comparison(chosen.name, measure, scores, noise)


def ratio(ours: Sequence[Score], theirs: Sequence[Score], measure: str) -> tuple[float, float]:
    """Return the ratio of the mean errors `ours` / `theirs` over the same logs, and half of its 95 % interval."""
    a, b = (np.array([getattr(s, measure) for s in scores]) for scores in (ours, theirs))
    value = float(a.mean() / b.mean())
    if len(a) < 2:
        return value, float("nan")
    low, high = interval((a - value * b) / b.mean())
    return value, 0.5 * (high - low)


def closed_loop(name: str, seeds: Iterable[int]) -> tuple[list[Score], int]:
    """Run walks with the present code; return scores of the published estimates, and how many walks passed."""
    walks = [walk(name, seed, fresh=True) for seed in seeds]
    return [score(one.log, one.published) for one in walks], sum(one.ok for one in walks)


def consistency(name: str, kind: str, seeds: Iterable[int]) -> tuple[float, float]:
    """Return the mean NEES of velocity (3 degrees of freedom) and tilt (2) over walks, by one random row of each."""
    v: list[float] = []
    tilt: list[float] = []
    for log in synthetic_sets([kind])[0].logs(seeds):
        found = track(name, log)
        rows = np.flatnonzero(log.scored)
        k = int(np.random.default_rng([len(v), 7]).choice(rows))
        v.append(float(nees(found.v[k : k + 1] - log.v[k : k + 1], found.p[k : k + 1, 3:, 3:])[0]))
        up = log.up[k] / GRAVITY
        across = np.linalg.svd(up[None])[2][1:]  # (2, 3), two axes normal to up
        error = across @ (found.g[k] - log.up[k])
        tilt.append(float(error @ np.linalg.solve(across @ found.p[k, :3, :3] @ across.T, error)))
    return float(np.mean(v)), float(np.mean(tilt))


def ablation(name: str, chosen: LogSet, seeds: Iterable[int]) -> dict[str, float]:
    """Return the ratio of the velocity error with a hypothesis of the estimator to that without it, by hypothesis."""
    logs = chosen.logs(seeds)
    base = np.mean([score(log, track(name, log)).rmse for log in logs])
    out: dict[str, float] = {}
    for switch, options in ABLATIONS.get(name, {}).items():
        out[switch] = float(base / np.mean([score(log, track(name, log, **options)).rmse for log in logs]))
    return out


@dataclass(frozen=True)
class FaultRatio:
    """Ratio of the errors of velocity and odometry with a fault to those without it, no unit, and a note."""

    name: str
    v: float
    odometry: float
    note: str = ""


def fault_ratios(name: str, chosen: LogSet, seeds: Iterable[int]) -> Iterator[FaultRatio]:
    """Yield the errors of an estimator with each fault of `FAULTS`, over those on the logs without it."""
    logs = chosen.logs(seeds)
    clean = [track(name, log) for log in logs]
    scores = [score(log, found) for log, found in zip(logs, clean, strict=True)]
    for fault, change in FAULTS.items():
        changed = [change(log, seed) for seed, log in enumerate(logs)]
        tracks = [track(name, log) for log in changed]
        found = [score(log, one) for log, one in zip(changed, tracks, strict=True)]
        same = sum(_same_end(a, b) for a, b in zip(clean, tracks, strict=True))
        note = f"{same} of {len(logs)} end bitwise equal" if changed[0].order is not None else ""
        if fault in LATE:
            least = [np.hypot(s.rmse, blind_error(log, LATE[fault])) for log, s in zip(logs, scores, strict=True)]
            note += f", {np.mean(least) / _mean(scores, 'rmse'):.2f} by the noise of the inertial unit alone"
        refused = sum(sum(one.refused.values()) for one in tracks) / sum(len(log.foot_ns) for log in changed)
        yield FaultRatio(
            fault, _mean(found, "rmse") / _mean(scores, "rmse"), _mean(found, "odometry") / _mean(scores, "odometry"),
            f"{note}  {100 * refused:.1f} % refused or noted".strip(),
        )  # fmt: skip


def start_ratios(name: str, chosen: LogSet, seeds: Iterable[int]) -> Iterator[FaultRatio]:
    """Yield the errors of an estimator with each fault of the start over those without it, from 3 s after it on."""
    logs = chosen.logs(seeds)
    clean = [track(name, log) for log in logs]
    for start, change in STARTS.items():
        ours: list[Score] = []
        theirs: list[Score] = []
        unstarted = 0
        for seed, (log, good) in enumerate(zip(logs, clean, strict=True)):
            other = change(log, seed)
            late = log.seconds[-1] - other.seconds[-1]  # what was cut off the beginning
            begin = max(RECOVERY_S + late, log.begin_s)
            other = replace(other, begin_s=begin - late)
            found = track(name, other)
            unstarted += not found.flags["initialised"][other.scored].all()
            ours.append(score(other, found))
            theirs.append(score(replace(log, begin_s=begin), good))
        note = f"{unstarted} of {len(logs)} not started in time" if unstarted else ""
        yield FaultRatio(
            start,
            _mean(ours, "rmse") / _mean(theirs, "rmse"),
            _mean(ours, "odometry") / _mean(theirs, "odometry"),
            note,
        )


def _same_end(a: Track, b: Track) -> bool:
    pairs = ((a.v, b.v), (a.g, b.g), (a.p, b.p), (a.position, b.position))
    return all(np.array_equal(x[-1], y[-1]) for x, y in pairs)


def _mean(scores: Sequence[Score], measure: str) -> float:
    return float(np.mean([getattr(s, measure) for s in scores]))
