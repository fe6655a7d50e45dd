"""Slip of stances as the robot measures it, beside the truth: rough ground, noisy sensors, hundreds of stances.

    python -m benchmarks.bench_slip --seeds 0:12 --results slip.jsonl
    python -m benchmarks.bench_slip --relearn samples.jsonl --seeds 50:54

Walks of 0.9 m over rough ground of 4 cm at friction 0.5 with a noisy map, half of them with random footholds, half with
those of the hand-made score. The robot's measure comes from encoders of 0.29 deg at 30 Hz, foot switches and the
estimator's odometry. AUC: how well it tells stances that slid more than 2 mm. `inside`: truth between the first and the
last sample with contact of the stance; `whole`: truth since the stance before, with what a foot too light to close its
switch has slid. Intervals: 95 % of 2000 resamplings of the walks. The constants of the measure were set on seeds 700 to
705. Walks in the results file are not walked again; a results file belongs to one state of the code.

With ``--relearn`` and a file of samples (`surefoot footholds collect`), edges are withheld from a first model, half of
the seeds make a round of walks in which half of the choices explore, the other half a second round with the model of
the first; the share of the gap to all data that each model closes is printed, by own slip and by truth, in the counted
form (c = 1) and in that of the paper (c = 1, then 0.5). The walks are those of the model of own slip.
"""

import argparse
import json
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.lab.footholds.campaign import read
from surefoot.lab.footholds.relearning import closed, explored, rough, start
from surefoot.lab.footholds.rules import model_rule, random_rule
from surefoot.lab.footholds.slip import SlipFollower, auc, rms
from surefoot.lab.footholds.walks import JoinedWalk, Setting
from surefoot.services.footholds.learning.merge import candidate_of
from surefoot.services.footholds.learning.relearn import relearned
from surefoot.services.footholds.models.files import load, shipped
from surefoot.services.footholds.models.score import HandScore
from surefoot.services.footholds.select import SelectParams

SETTING = Setting("rough", 0.9, 0.04, 0.5, profile="noise")
RULES = ("random", "hand")
FAR_MM = 2.0
RESAMPLINGS = 2000


def walked(seed: int, rule: str) -> dict[str, Any]:
    """One walk: own slip and both truths of every stance, mm."""
    joined = JoinedWalk(
        seed, SETTING, random_rule(seed) if rule == "random" else model_rule(HandScore(), SelectParams())
    )
    follower = SlipFollower(joined)
    while joined.tick():
        follower.look()
    rows = [[round(1e3 * v, 4) for v in (each.own, each.inside, each.whole)] for each in follower.found]
    return {"seed": seed, "rule": rule, "stances": rows}


def kept(path: Path | None) -> list[dict[str, Any]]:
    """Complete lines of a results file."""
    found: list[dict[str, Any]] = []
    if path is not None and path.exists():
        for text in path.read_text(encoding="utf-8").splitlines():
            try:
                found.append(json.loads(text))
            except ValueError:
                continue  # a torn line
    return found


def interval(walks: list[np.ndarray], column: int, statistic: Any) -> tuple[float, float, float]:
    """A statistic of own slip and one truth over all stances, and its 95 % interval over resampled walks."""
    rng = np.random.default_rng(0)

    def of(chosen: list[np.ndarray]) -> float:
        rows = np.concatenate(chosen)
        return statistic(rows[:, 0], rows[:, column])

    many = [of([walks[k] for k in rng.integers(0, len(walks), len(walks))]) for _ in range(RESAMPLINGS)]
    low, high = np.nanpercentile(many, [2.5, 97.5])
    return of(walks), float(low), float(high)


def report(lines: list[dict[str, Any]]) -> None:
    """Print AUC and error of all walks."""
    walks = [np.array(line["stances"]).reshape(-1, 3) for line in lines if line["stances"]]
    rows = np.concatenate(walks)
    far = float(np.mean(rows[:, 2] > FAR_MM))
    print(f"{len(walks)} walks, {len(rows)} stances, {100 * far:.0f} % of them slid over {FAR_MM:g} mm")
    for column, name in ((1, "inside"), (2, "whole")):
        area = interval(walks, column, lambda own, true: auc(own, true > FAR_MM))
        error = interval(walks, column, lambda own, true: rms(own - true))
        bias = interval(walks, column, lambda own, true: float(np.mean(own - true)))
        print(
            f"  {name:<7} AUC {area[0]:.3f} ({area[1]:.3f} to {area[2]:.3f})  "
            f"RMSE {error[0]:.2f} mm ({error[1]:.2f} to {error[2]:.2f})  bias {bias[0]:+.2f} mm  "
            f"mean of the truth {rows[:, column].mean():.2f} mm"
        )


def relearn(path: Path, seeds: Sequence[int], share: float = 0.5) -> None:
    """Print what two rounds of re-learning close of the gap to all data."""
    shape = candidate_of(load(shipped("ragno") or ""))
    begin = start(read(path)[0], shape)
    models = {(form, slip): begin.first for form in ("counted", "paper") for slip in ("own", "truth")}
    for number, part in enumerate((seeds[: len(seeds) // 2], seeds[len(seeds) // 2 :])):
        found = [explored(seed, SETTING, models["counted", "own"], share) for seed in part]
        batches = {"own": [s for own, _ in found for s in own], "truth": [s for _, true in found for s in true]}
        new = sum(map(rough, batches["own"]))
        print(f"round {number + 1}: {len(part)} walks, {len(batches['own'])} stances, {new} on withheld ground")
        for form, slip in models:
            weight = 1.0 if form == "counted" or number == 0 else 0.5
            models[form, slip] = relearned(models[form, slip], batches[slip], form, weight)
            gap, old = closed(models[form, slip], begin)
            print(f"  {form:<8} {slip:<6} closes {100 * gap:.0f} %, error on old ground x {old:.3f}", flush=True)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="0:12", help="first:end")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--relearn", type=Path, metavar="SAMPLES", help="judge re-learning instead")
    parser.add_argument("--results", type=Path, help="file to go on with, one line a walk")
    args = parser.parse_args()
    first, end = (int(value) for value in args.seeds.split(":"))
    if args.relearn is not None:
        relearn(args.relearn, range(first, end))
        return
    lines = kept(args.results)
    done = {(line["seed"], line["rule"]) for line in lines}
    wanted = [(seed, rule) for seed in range(first, end) for rule in RULES if (seed, rule) not in done]
    with ProcessPoolExecutor(args.jobs) as pool:
        for future in as_completed([pool.submit(walked, *each) for each in wanted]):
            lines.append(future.result())
            if args.results is not None:
                with args.results.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps(lines[-1]) + "\n")
    report([line for line in lines if first <= line["seed"] < end])


if __name__ == "__main__":
    main()
