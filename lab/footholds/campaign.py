"""Campaigns of simulated walks with random footholds, whose stances become samples in an append-only file.

One process writes, any number simulate. A trial counts only once its last line is written, so a worker that dies
loses none. A campaign that is started again with the same file runs the trials that the file lacks.
"""

import itertools
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path

from surefoot.errors import SurefootError
from surefoot.services.footholds.ground import FootholdGround
from surefoot.services.footholds.learning.samples import StanceSample, read_lines, trial_lines
from surefoot.services.footholds.models.files import load
from surefoot.services.footholds.outcomes import sample_at
from surefoot.services.footholds.select import SelectParams

from ..pools import worker_processes
from .rules import exploring_rule, model_rule, random_rule
from .walks import ChosenStance, JoinedWalk, Setting

RESTARTS = 3
"""Largest number of times that a pool of worker processes is replaced after the death of a worker."""


@dataclass(frozen=True)
class Trial:
    """Settings of one simulated walk of a campaign: seed, conditions, and the choice of footholds."""

    seed: int
    setting: Setting
    model: str = ""
    """Path of the slip model that chooses footholds; empty = every foothold is random."""
    explore: float = 1.0
    """Share of steps with a random foothold, 0 to 1; the slip model of `model` chooses the other footholds."""

    @property
    def name(self) -> str:
        """Name of the trial in the sample file; two trials of one name are the same walk."""
        s = self.setting
        amplitude = "" if s.amplitude is None else f"-{s.amplitude:g}"
        rule = "" if not self.model else f"-{Path(self.model).stem}-{self.explore:g}"
        return f"{s.robot}-{s.terrain}{amplitude}-{s.friction:g}-{s.profile}-{s.distance:g}{rule}-{self.seed}"


def planned(
    grounds: Sequence[Setting], profiles: Sequence[str], seeds: Iterable[int], model: str = "", explore: float = 1.0
) -> list[Trial]:
    """Return a trial (one simulated walk) for each combination of ground, map profile and seed, sorted by seed.

    Args:
        grounds: conditions of the walks.
        profiles: kinds of errors of the robot's map: exact, noise or shifted.
        seeds: seeds of the walks.
        model: slip model that chooses footholds; empty = all are drawn at random.
        explore: share of the steps that are drawn at random, 0 to 1.
    """
    return [
        Trial(seed, replace(setting, profile=profile), model, explore)
        for seed, setting, profile in itertools.product(seeds, grounds, profiles)
    ]


def walked(trial: Trial) -> list[StanceSample]:
    """Simulate the walk of a trial and return a learning sample for each of its stances."""
    rule = random_rule(trial.seed)
    if trial.model:
        rule = exploring_rule(trial.seed, trial.explore, model_rule(load(trial.model), SelectParams()))
    joined = JoinedWalk(trial.seed, trial.setting, rule).run()
    ground, robot = joined.selector.ground, joined.robot
    s = trial.setting
    source = f"{'random' if not trial.model else 'explore'} {s.terrain} {s.profile}"
    made = (sample_of(stance, ground, trial.name) for stance in joined.stances.found)
    return [replace(each, friction=s.friction, robot=robot.name, robot_hash=robot.hash, source=source) for each in made]


def sample_of(stance: ChosenStance, ground: FootholdGround, trial: str) -> StanceSample:
    """Return a stance as a learning sample: ground coefficients K1 to K4 of its cell, slip and load.

    `ground`: map on which the foothold was chosen; `trial`: name of the trial.
    """
    return sample_at(
        ground, stance.planned, stance.nominal, stance.stroke, stance.sliding, (trial, stance.leg, stance.step),
        stance.displacement, stance.load,
    )  # fmt: skip


def read(path: Path) -> tuple[list[StanceSample], dict[str, int], int]:
    """Read a sample file: return the samples of complete trials, their number by trial, and the number of bad lines.

    Raises:
        SurefootError: the file cannot be read.
    """
    try:
        with path.open(encoding="utf-8", errors="replace") as stream:
            return read_lines(stream)
    except OSError as error:
        raise SurefootError("unreadable", f"{str(path)!r} cannot be read: {error.strerror}", "samples") from None


def append(path: Path, trial: str = "", samples: Sequence[StanceSample] = ()) -> None:
    """Append the samples of a trial to a sample file, on new lines even after a line that was cut off.

    Raises:
        SurefootError: the folder cannot be written, or the disk is full.
    """
    text = "\n" + "\n".join(trial_lines(trial, samples) if trial else ()) + "\n"
    try:
        with path.open("a", encoding="utf-8") as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
    except OSError as error:
        raise SurefootError("unwritable", f"{str(path)!r} cannot be written: {error.strerror}", "out") from None


def collect(
    trials: Sequence[Trial], out: Path, jobs: int = 1, show: Callable[[Trial, int], None] = lambda trial, count: None
) -> int:
    """Run the trials that a sample file lacks and append their samples; return how many trials were run.

    Args:
        trials: all trials of the campaign.
        out: sample file.
        jobs: number of walks simulated in parallel, each in a process.
        show: called with each finished trial and its number of samples.
    """
    done = read(out)[1] if out.exists() else {}
    missing = [trial for trial in trials if trial.name not in done]
    append(out)  # fails before the first walk, not after it
    for trial, samples in _walks(missing, jobs):
        append(out, trial.name, samples)
        show(trial, len(samples))
    return len(missing)


def _walks(trials: Sequence[Trial], jobs: int) -> Iterator[tuple[Trial, list[StanceSample]]]:
    """Yield each trial with its samples as it finishes; a process pool that has lost a worker is replaced."""
    if jobs <= 1:
        for trial in trials:
            yield trial, walked(trial)
        return
    waiting = dict.fromkeys(trials)
    for attempt in itertools.count():
        try:
            with worker_processes(jobs) as pool:
                futures = {pool.submit(walked, trial): trial for trial in waiting}
                for future in as_completed(futures):
                    samples = future.result()
                    del waiting[futures[future]]
                    yield futures[future], samples
            return
        except BrokenProcessPool:
            if attempt >= RESTARTS:
                raise SurefootError("worker_died", f"{RESTARTS} pools of walks have lost a worker") from None
