"""Trials and walks behind Figs. 7 to 12 of Walas & Belter (2011), kept in a folder so that a study can be continued.

Walks are tripod walks of 0.9 m at friction 0.5 over the ground of section 3.4 (`mixed`: flagstones, hills, depressions,
stones; +8.7 to -0.35 cm) with its exact map. Walks that collect samples have other seeds.
"""

import json
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.lab.footholds.campaign import read, sample_of
from surefoot.lab.footholds.primitives import own_worker, paper_trials, run_trials
from surefoot.lab.footholds.rules import model_rule, random_rule
from surefoot.lab.footholds.walks import JoinedWalk, Rule, Setting
from surefoot.lab.pools import worker_processes
from surefoot.robot.reader import load_robot
from surefoot.services.footholds.learning.samples import StanceSample
from surefoot.services.footholds.select import SelectParams

from .finders import kept

ROBOT = "ragno"
GROUND = Setting("mixed", 0.9, None, 0.5, profile="exact")
FLAT = replace(GROUND, terrain="flat")
NOISE = 0.003
"""Standard deviation of the noise on the heights of the ground primitives of Fig. 9 of Walas & Belter, m."""


@dataclass(frozen=True)
class WalkKey:
    """Settings of one walk of the study: case, seed, conditions, and the model that chooses footholds."""

    case: str
    seed: int
    setting: Setting = GROUND
    model: str = ""
    """Path of the file of the slip model that chooses; empty: random cells in the case `random`, else nominal
    footholds."""
    weight: float | None = None
    """Weight k, 1/m, of the distance K4 in the cost Q = P + k K4, P the predicted slip; None = that of the model."""

    def rule(self) -> Rule | None:
        """Return the rule of footholds: least cost Q of single cells, random draws, or None for nominal footholds."""
        if self.model:
            return model_rule(kept(self.model), SelectParams(robust=False, distance_weight=self.weight))
        return random_rule(self.seed) if self.case.startswith("random") else None


@dataclass(frozen=True)
class WalkResult:
    """Outcome of one walk of the study: whether the robot fell, and its stances."""

    case: str
    seed: int
    fell: bool
    rows: tuple[tuple[int, float, float], ...]
    """For each stance: number of the step, sliding over stroke length, and displacement d over stroke length, no
    unit."""
    samples: tuple[StanceSample, ...]

    def accumulated(self, steps: int, column: int = 1) -> np.ndarray:
        """Return S(n), the sum of a column of `rows` over all stances up to step n, (steps,), no unit.

        `column`: 1 = sliding, 2 = displacement, each over the length of the stroke.
        """
        total = np.zeros(steps)
        for row in self.rows:
            if 1 <= row[0] <= steps:
                total[row[0] - 1] += row[column]
        return np.cumsum(total)

    @property
    def steps(self) -> int:
        """Number of the last step of the walk in which a stance ended; 0 if none did."""
        return max((row[0] for row in self.rows), default=0)


def walked(key: WalkKey) -> dict[str, Any]:
    """Simulate one walk; return its outcome as plain values, as they are kept in the folder of the study."""
    joined = JoinedWalk(key.seed, key.setting, key.rule()).run()
    robot, ground = joined.robot, joined.selector.ground
    facts = {"friction": key.setting.friction, "robot": robot.name, "robot_hash": robot.hash, "source": f"{key.case}"}
    found = [s for s in joined.stances.found if float(np.hypot(*s.stroke[:2])) > 1e-3]
    rows = [(s.step, *(v / float(np.hypot(*s.stroke[:2])) for v in (s.sliding, s.displacement))) for s in found]
    samples = [replace(sample_of(s, ground, f"{key.case} {key.seed}"), **facts) for s in found]
    return {
        "case": key.case, "seed": key.seed, "fell": joined.verdict().fallen, "rows": rows,
        "samples": [asdict(each) for each in samples if not each.problem],
    }  # fmt: skip


class Runs:
    """Walks and trials of a study, kept in a folder so that they are done only once."""

    def __init__(
        self, folder: Path, jobs: int | None = None, progress: Callable[[str], None] = lambda step: None
    ) -> None:
        """Read what a folder holds.

        Args:
            folder: made if it is missing.
            jobs: walks at a time; None = one a core.
            progress: gets each walk and each trial that is done, in words.
        """
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self.jobs, self._progress = folder, jobs or os.cpu_count() or 1, progress
        self._file = folder / "walks.jsonl"
        self._done: dict[tuple[str, int], dict[str, Any]] = {}
        for line in self._file.read_text(encoding="utf-8").splitlines() if self._file.exists() else ():
            try:
                found = json.loads(line)
                self._done[found["case"], found["seed"]] = found
            except (ValueError, KeyError):
                continue  # a torn line

    def walks(self, keys: Sequence[WalkKey]) -> list[WalkResult]:
        """Return the results of walks, in the order of `keys`; those that the folder lacks are done and added to it."""
        missing = [key for key in keys if (key.case, key.seed) not in self._done]
        for key in (key for key in keys if key not in missing):
            self._progress(f"walk of before: {key.case}, seed {key.seed}")
        for found in self._walk(missing):
            self._done[found["case"], found["seed"]] = found
            with self._file.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(found) + "\n")
            self._progress(f"walk: {found['case']}, seed {found['seed']}")
        return [_result(self._done[key.case, key.seed]) for key in keys]

    def primitives(self, seeds: Sequence[int], noise: float) -> list[StanceSample]:
        """Return samples of trials on ground primitives, which are done where the folder lacks them.

        `seeds`: one set of trials each; `noise`: standard deviation of the heights, m.
        """
        robot, out = load_robot(ROBOT), self.folder / "primitives.jsonl"
        trials = paper_trials(noise=noise, seeds=seeds)
        run_trials(robot, trials, out, [own_worker(robot)])
        self._progress(f"{len(trials)} trials with primitives, noise {1e3 * noise:g} mm")
        wanted = {f"-{trial.noise:g}-{trial.stance}-{trial.stroke:g}-{trial.seed}" for trial in trials}
        return [each for each in read(out)[0] if any(each.trial.endswith(end) for end in wanted)]

    def _walk(self, keys: Sequence[WalkKey]) -> Iterator[dict[str, Any]]:
        if self.jobs == 1 or len(keys) < 2:
            yield from map(walked, keys)
            return
        with worker_processes(self.jobs) as pool:
            for future in as_completed([pool.submit(walked, key) for key in keys]):
                yield future.result()


def _result(found: dict[str, Any]) -> WalkResult:
    samples = tuple(
        StanceSample(**{**each, "stroke": tuple(each["stroke"]), "heights_um": tuple(each["heights_um"])})
        for each in found["samples"]
    )
    rows = tuple((int(a), float(b), float(c)) for a, b, c in found["rows"])
    return WalkResult(found["case"], found["seed"], bool(found["fell"]), rows, samples)
