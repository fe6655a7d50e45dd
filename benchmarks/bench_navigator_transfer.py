"""What a fit of recordings predicts of live runs: mean time to the goal of every policy, and their ranking.

The recordings are runs of other seeds than the live results (`surefoot run nao-corridor --seed N`). Their fit makes an
environment in which each policy of `bench_navigator_live`, as it ran there, walks many episodes. Live times end when
the robot stands, so the closing step is added to those of the environment. Targets: each mean within 5 % of the live
one, and all policies that differ significantly in the live runs ranked as live.

    python -m benchmarks.bench_navigator_transfer --live live.jsonl run-31.mcap run-32.mcap ...
    python -m benchmarks.bench_navigator_transfer --live live.jsonl --model fitted.toml
"""

import argparse
import itertools
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import t as student

from benchmarks.bench_navigator_live import ARMS, kept
from surefoot.lab.fit.estimate import fit
from surefoot.lab.fit.events import read_run
from surefoot.lab.fit.output import write_model
from surefoot.lab.train.evaluation import Seeds, episodes, summary
from surefoot.services.navigator.policy.arrays import arrays
from surefoot.services.navigator.policy.library import find
from surefoot.services.navigator.policy.params import NavigationModel, load

WITHIN = 5.0
"""Per cent of the live mean that a prediction may be off."""


@dataclass(frozen=True)
class Compared:
    """One policy live and in the fitted environment, s."""

    arm: str
    times: dict[int, float]
    """Live, by seed."""
    failed: int
    """Live runs that count for nothing: the goal was missed, or the robot fell."""
    predicted: float
    success: float
    """Share of the episodes that reach the goal."""

    @property
    def live(self) -> float:
        """Mean of the live times."""
        return float(np.mean(list(self.times.values())))

    @property
    def error(self) -> float:
        """Predicted against live, per cent."""
        return 100.0 * (self.predicted / self.live - 1.0)


def fitted(recordings: list[Path], params: str) -> NavigationModel:
    """Returns the model fitted to recordings, and prints its numbers."""
    base = load(params)
    found = fit([read_run(path, base) for path in recordings], base, print)
    for key, interval in sorted(found.values.items()):
        print(f"  {key:34s} {interval.value:9.4g}  {interval.low:.4g} to {interval.high:.4g}")
    print(f"  not decided: {', '.join(found.undecided) or 'none'}; {found.improvement:.1f} nats likelier than {params}")
    with tempfile.TemporaryDirectory() as folder:
        return write_model(found, params, [path.name for path in recordings], Path(folder) / "fitted.toml")


def predicted(model: NavigationModel, base: NavigationModel, arm: str, count: int) -> dict[str, Any]:
    """Returns the summary of an arm's episodes; the policy is the one made for the base model, as it ran live."""
    policy, actions = ARMS[arm]
    chosen, home = (each.model_copy(update={"use": actions}) for each in (model, base))
    return summary(episodes(arrays(chosen), find(policy, home), Seeds(0, count)))


def compare(lines: list[dict[str, Any]], model: NavigationModel, base: NavigationModel, count: int) -> list[Compared]:
    """Returns each arm that reached the goal in two live runs or more."""
    closing = model.switching.get("walk", {}).get("stand", 0.0)
    rows: list[Compared] = []
    for arm in ARMS:
        own = {line["seed"]: line for line in lines if line["arm"] == arm}
        times = {
            seed: float(line["values"]["goal_time_s"]) for seed, line in own.items()
            if line["values"]["goal_time_s"] is not None and not line["problems"]
        }  # fmt: skip
        if len(times) >= 2:
            said = predicted(model, base, arm, count)
            rows.append(Compared(arm, times, len(own) - len(times), said["mean_s"] + closing, said["success"]))
    return rows


def half_width(values: list[float]) -> float:
    """Returns half of the 95 % interval of a mean."""
    x = np.array(values)
    return float(student.ppf(0.975, len(x) - 1) * x.std(ddof=1) / np.sqrt(len(x)))


def wrong_pairs(rows: list[Compared]) -> tuple[list[tuple[str, str]], int]:
    """Returns the pairs of arms that are predicted the other way round than live, and how many differ live.

    Two arms differ live if the 95 % interval of their difference over the same seeds excludes zero.
    """
    wrong: list[tuple[str, str]] = []
    apart = 0
    for a, b in itertools.combinations(rows, 2):
        seeds = sorted(a.times.keys() & b.times.keys())
        if len(seeds) < 2:
            continue
        differences = [a.times[seed] - b.times[seed] for seed in seeds]
        mean = float(np.mean(differences))
        if abs(mean) <= half_width(differences):
            continue
        apart += 1
        if mean * (a.predicted - b.predicted) <= 0.0:
            wrong.append((a.arm, b.arm))
    return wrong, apart


def show(rows: list[Compared]) -> None:
    """Prints live and predicted times, the errors, and the ranking."""
    by_live, by_model = (sorted(rows, key=lambda row, k=k: getattr(row, k)) for k in ("live", "predicted"))
    print("policy          live runs  failed  live s          predicted s  error %  rank live  predicted")
    for row in rows:
        live = f"{row.live:6.1f} +- {half_width(list(row.times.values())):4.1f}"
        text = f"{row.arm:14s} {len(row.times):10d} {row.failed:7d}  {live} {row.predicted:14.1f}"
        print(f"{text} {row.error:+8.1f} {by_live.index(row) + 1:10d} {by_model.index(row) + 1:10d}")
    good = sum(abs(row.error) <= WITHIN for row in rows)
    wrong, apart = wrong_pairs(rows)
    least = min(row.success for row in rows)
    print(f"within {WITHIN:g} %: {good} of {len(rows)} policies; least success of a policy: {least:.4f}")
    print(f"pairs that differ in the live runs: {apart}, of these ranked otherwise: {wrong or 'none'}")


def main() -> None:
    """Fits, predicts and prints the comparison."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", nargs="*", type=Path, help="MCAP files of other seeds than the live runs")
    parser.add_argument("--live", type=Path, help="results file of bench_navigator_live")
    parser.add_argument("--world", choices=("hard", "easy"), default="hard")
    parser.add_argument("--params", help="model the fit begins with; default: that of the world")
    parser.add_argument("--model", help="a fitted model (.toml) in place of recordings, or any other")
    parser.add_argument("--episodes", type=int, default=2000, help="per policy")
    options = parser.parse_args()
    if options.live is None or not (options.recordings or options.model):
        print("needs --live, and recordings or --model: nothing to compare")
        return
    home = {"hard": "nao-paper", "easy": "nao"}[options.world]  # the model that the live policies are made for
    lines = [line for line in kept(options.live) if line["world"] == options.world]
    model = load(options.model) if options.model else fitted(options.recordings, options.params or home)
    rows = compare(lines, model, load(home), options.episodes)
    if rows:
        show(rows)
    else:
        print(f"{options.live} has no policy with two runs of the {options.world} world that reached the goal")


if __name__ == "__main__":
    main()
