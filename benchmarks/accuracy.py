"""Accuracy of the estimators against truth, beside referees tuned for each set of logs, and corrupted inputs.

rmse = rms length of the velocity error, cm/s; 0.5 s = that of errors averaged over half a second; avg = error of the
mean velocity along the track, %; NEES of v (3 = ideal); odo = error of the displacement per net metre, %; int = gap
between the integrated velocity and the odometry, % of the way. +- is the 95 % interval of the mean over the seeds.
Referees are tuned on seeds that are not scored (on the log itself where there is only one, which favours them).
"""

import json
import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.bench import Bench, table, words_of
from surefoot.lab.estimation.fuzz import FuzzCounts, fuzz
from surefoot.lab.estimation.scores import Score
from surefoot.lab.estimation.track import default, names
from surefoot.lab.statistics import half_width
from surefoot.lab.studies import seeds_of, study
from surefoot.papers.wawrzynski.compare import (
    Comparison,
    ablation,
    closed_loop,
    compare,
    consistency,
    fault_ratios,
    ratio,
    start_ratios,
)
from surefoot.papers.wawrzynski.sets import REFERENCES, LogSet, humanoid_sets, synthetic_sets, walk_sets
from surefoot.papers.wawrzynski.synthetic import KINDS, synthesize

BENCH = Bench("accuracy")

COLUMNS = (
    "", "rmse", "+-", "0.5 s", "+-", "|avg|", "worst", "drift", "NEES", "tilt", "odo", "worst", "z mm", "yaw", "int",
)  # fmt: skip
MEASURES = ("rmse", "smooth")


@dataclass(frozen=True)
class Parts:
    """Flags of the tables of the accuracy study to print; with none set, `synthetic` and `logs` are printed.

    Attributes:
        synthetic: synthetic walks.
        walks: recorded walks of the simulated robots.
        logs: logs of humanoids by others.
        all: every set; referees are tuned for the error over 0.5 s.
        consistency: NEES of one sample of each of 50 walks.
        ablation: ratios with and without parts of the estimator.
        faults: ratios with and without a fault of the inputs.
        closed_loop: walks with the present code, what the service published.
        retune: search the noise of the referees again.
    """

    synthetic: bool = False
    walks: bool = False
    logs: bool = False
    all: bool = False
    consistency: bool = False
    ablation: bool = False
    faults: bool = False
    closed_loop: bool = False
    retune: bool = False

    def sets(self, only: Sequence[str]) -> list[LogSet]:
        """Return the chosen sets of logs."""
        sets = synthetic_sets() if self.all or self.synthetic else []
        sets += walk_sets() if self.all or self.walks else []
        sets += humanoid_sets() if self.all or self.logs else []
        return [one for one in sets if not only or one.name in only]


def row(name: str, scores: Sequence[Score]) -> tuple[object, ...]:
    """Return one row of the table of errors of an estimator: means over logs, half-widths of intervals, extremes."""

    def of(field: str) -> list[float]:
        return [getattr(s, field) for s in scores]

    def mean(field: str) -> float:
        return float(np.mean(of(field)))

    numbers = (
        100 * mean("rmse"), 100 * half_width(of("rmse")), 100 * mean("smooth"), 100 * half_width(of("smooth")),
        mean("percent"), max(of("percent")), 100 * mean("drift"), mean("nees"), mean("tilt_deg"),
        100 * mean("odometry"), 100 * max(of("odometry")), 1e3 * mean("height"),
        float(np.mean(np.abs(of("heading_deg")))), 100 * mean("integral"),
    )  # fmt: skip
    return name, *(f"{x:.3f}" if i == 6 else f"{x:.2f}" for i, x in enumerate(numbers))


def show(found: Comparison, subjects: Sequence[str]) -> None:
    """Print estimator scores on one set of logs, the tuned noise of the referees, and ratios to the best referee."""
    count = len(next(iter(found.scores.values())))
    what = f"{found.name}, {count} log{'s' if count > 1 else ''}, referees tuned for {found.measure}"
    table(what, COLUMNS, [row(name, scores) for name, scores in found.scores.items()])
    for name, noise in found.noise.items():
        if noise:
            print(f"  {name}: " + ", ".join(f"{k} {v:.3g}" for k, v in noise.items()))
    for name in subjects:
        for measure in MEASURES:
            best = found.best_reference(measure)
            if best is not None and name not in found.noise:
                value, plus = ratio(found.scores[name], found.scores[best], measure)
                print(f"  {name} / {best} by {measure}: {value:.3f} +- {plus:.3f}")


def checked(chosen: str, known: Sequence[str]) -> tuple[str, ...]:
    """Return the names in a comma-separated list; exit if one is not among `known`."""
    found = words_of(chosen)
    if unknown := [name for name in found if name not in known]:
        raise SystemExit(f"got {', '.join(unknown)}; known are {', '.join(known)}")
    return found


@BENCH.part()
def tables(
    *, parts: Parts, seeds: str = "10", sets: str = "", estimators: str = "best,ekf",
    references: str = ",".join(REFERENCES), json_: Path | None = None,
) -> None:  # fmt: skip
    """Errors of the estimators on sets of logs.

    Args:
        parts: what to print.
        sets: names of sets, comma-separated; default: all of the parts.
        estimators: names of estimators, comma-separated.
        references: names of referees, comma-separated.
        json_: file for the scores as well.
    """
    known = names()
    subjects, referees = checked(estimators, known), checked(references, known)
    only, numbers = checked(sets, [one.name for one in Parts(all=True).sets(())]), seeds_of(seeds)
    if parts in (Parts(), Parts(retune=True)):
        parts = Parts(synthetic=True, logs=True, retune=parts.retune)
    kept = compared(parts, only, subjects, referees, numbers)
    if parts.closed_loop:
        kept |= published(only, numbers)
    if parts.consistency:
        consistent(subjects)
    if parts.ablation:
        rows = [(chosen.name, name, value) for chosen in Parts(all=True).sets(only)
                for name, value in ablation(subjects[0], chosen, numbers).items()]  # fmt: skip
        table(
            "parts on / off, rmse ratio (goal: no set worse by more than 3 % with them)", ("set", "part", "ratio"), rows
        )
    if parts.faults:
        faulty(subjects[0], only, numbers)
    if json_ is not None:
        json_.write_text(json.dumps(kept, indent=1))


def compared(
    parts: Parts, only: Sequence[str], subjects: Sequence[str], referees: Sequence[str], seeds: range
) -> dict[str, Any]:
    """Print the errors of each set; return the scores by set and estimator."""
    kept: dict[str, Any] = {}
    over: dict[str, list[float]] = {name: [] for name in subjects}
    for chosen in parts.sets(only):
        found = compare(chosen, subjects, referees, seeds, MEASURES[parts.all], parts.retune)
        show(found, subjects)
        kept[chosen.name] = {name: [asdict(s) for s in scores] for name, scores in found.scores.items()}
        best = found.best_reference("smooth")
        for name in subjects if best is not None else ():
            over[name].append(ratio(found.scores[name], found.scores[str(best)], "smooth")[0])
    if parts.all:
        rows = [(name, float(np.mean(values)), max(values)) for name, values in over.items() if values]
        what = "error over 0.5 s against the best referee of each set (goal: worst <= 1.25, mean <= 1.00)"
        table(what, ("estimator", "mean", "worst"), rows)
    return kept


def published(only: Sequence[str], seeds: range) -> dict[str, Any]:
    """Print the errors of the estimates that the service published in new walks; return the scores by set."""
    rows: list[tuple[object, ...]] = []
    kept: dict[str, Any] = {}
    for chosen in walk_sets():
        if not only or chosen.name in only:
            scores, ok = closed_loop(chosen.name, seeds)
            kept[f"closed loop {chosen.name}"] = [asdict(s) for s in scores]
            rows.append((*row(chosen.name, scores), f"{ok} of {len(scores)}"))
    table("published in the walk itself", (*COLUMNS, "good verdicts"), rows)
    return kept


def consistent(subjects: Sequence[str]) -> None:
    """Print the mean NEES of velocity (3 degrees of freedom) and of tilt (2) over one sample of each of 50 walks."""
    rows = [(f"{name}, {kind}", *consistency(name, kind, range(1000, 1050)))
            for name in subjects for kind in ("twist", "slip")]  # fmt: skip
    table(
        "mean NEES of 50 walks; 95 % bands: v 2.36 to 3.72, tilt 1.48 to 2.59", ("estimator, walks", "v", "tilt"), rows
    )


def faulty(subject: str, only: Sequence[str], seeds: range) -> None:
    """Print the ratio of the errors with each fault to those without it, means over the seeds."""
    rows = [
        (f"{chosen.name}, {fault.name}", f"{fault.v:.3f}", f"{fault.odometry:.3f}", fault.note)
        for chosen in (*synthetic_sets(["twist"]), *walk_sets(["bioloid"])) if not only or chosen.name in only
        for fault in (*fault_ratios(subject, chosen, seeds), *start_ratios(subject, chosen, seeds))
    ]  # fmt: skip
    table(f"{subject}: rmse with a fault / without", ("set, fault", "v", "odometry", ""), rows)


def corrupted(name: str, kind: str, seed: int, trials: int) -> dict[str, Any]:
    """Corrupt the inputs of an estimator on a synthetic walk at random; return the counts of the campaign."""
    return {"found": fuzz(name, synthesize(KINDS[kind], seed), trials, seed)}


def merged(parts: list[FuzzCounts]) -> FuzzCounts:
    """Return the summed counts of several fuzzing campaigns, and the largest of their speeds."""
    out = FuzzCounts()
    for part in parts:
        out.trials, out.samples = out.trials + part.trials, out.samples + part.samples
        out.fastest = max(out.fastest, part.fastest)
        for name in ("broken", "silent", "flagged", "by_kind"):
            getattr(out, name).update(getattr(part, name))
    return out


@BENCH.part("--trials 20")
def fuzzed(*, estimators: str = default(), trials: int = 20_000, seed: int = 0) -> None:
    """Corrupt walks at random: estimates must never be NaN or above 2 m/s, covariances positive, errors flagged.

    Args:
        estimators: names of estimators, comma-separated.
        trials: number of corrupted walks of each estimator.
        seed: seed of the first walk.
    """
    each, kinds = min(250, trials), ("twist", "slip", "edges")
    for name in words_of(estimators):
        jobs = [{"name": name, "kind": kinds[i % len(kinds)], "seed": seed + i, "trials": each}
                for i in range(max(1, trials // 250))]  # fmt: skip
        lines = study(corrupted, jobs, processes=max(1, (os.cpu_count() or 1) // 2))
        found = merged([line["found"] for line in lines])
        print(f"{name}: {found.trials} trials, {found.samples} corrupted inputs; fastest {found.fastest:.2f} m/s")
        failed = Counter[str]()
        for text, count in found.broken.items():
            failed[text.rpartition(": ")[2]] += count
        table(f"never allowed: {sum(failed.values())}", ("what", "trials"), failed.most_common())
        if found.broken:
            table("  by corruption, the most frequent", ("corruption", "trials"), found.broken.most_common(12))
        silent = Counter({label: n for label, n in found.silent.items() if n})
        rows = [(label, n, found.by_kind[label]) for label, n in silent.most_common(12)]
        what = f"errors over 15 cm/s for 0.2 s with no flag and no counter: {sum(silent.values())}"
        table(what, ("corruption", "trials", "of"), rows)
        single = sorted(label for label in found.by_kind if " + " not in label)
        shares = [(label, found.flagged[label] / found.by_kind[label]) for label in single]
        table("share of trials with a flag, a counter or a slipping foot", ("corruption", "share"), shares)
