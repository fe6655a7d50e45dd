"""Choice of the weight k, 1/m, of the distance K4 to the nominal foothold by whole walks instead of single steps."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from surefoot.services.footholds.models.learned import LearnedModel
from surefoot.services.footholds.select import SelectParams

from ..pools import worker_processes
from .rules import model_rule
from .walks import Setting, walk


@dataclass(frozen=True)
class Tried:
    """Result of the simulated walks under one weight of the distance to the nominal foothold, over grounds and
    seeds."""

    weight: float
    """Weight k of the distance from nominal to chosen foothold in these walks, 1/m."""
    sliding_mm: tuple[float, ...]
    """Mean sliding of the contact point per stance on each kind of ground, mm."""
    failed: int
    """Number of walks under this weight that did not reach the commanded distance."""

    @property
    def mean(self) -> float:
        """Geometric mean of the sliding per stance over the grounds, mm, so that rough grounds do not dominate."""
        return float(np.exp(np.mean(np.log(self.sliding_mm))))


def try_weights(
    model: LearnedModel, grounds: Sequence[Setting], seeds: Iterable[int], weights: Sequence[float], jobs: int = 1,
    progress: Callable[[float], None] = lambda share: None,
) -> list[Tried]:  # fmt: skip
    """Simulate a walk for every weight, ground and seed; return the result of each weight.

    `weights`: in 1/m; `seeds`: training seeds, to differ from those of a later comparison; `jobs`: walks simulated in
    parallel; `progress`: called with the share that is done, 0 to 1.
    """
    wanted = list(seeds)
    out: list[Tried] = []
    with worker_processes(jobs) as pool:
        for number, weight in enumerate(weights):
            tuned = replace(model, distance_weight=weight)
            jobs_ = [(tuned, ground, seed) for ground in grounds for seed in wanted]
            walks: list[tuple[float, bool]] = []
            for found in pool.map(_walked, jobs_):
                walks.append(found)
                progress((number + len(walks) / len(jobs_)) / len(weights))
            rows = np.array([each[0] for each in walks]).reshape(len(grounds), len(wanted))
            out.append(Tried(weight, tuple(rows.mean(axis=1).tolist()), sum(not each[1] for each in walks)))
    return out


def best_of(tried: Sequence[Tried]) -> Tried:
    """Return the result of the weight with the fewest failed walks; of equal ones, that with the least mean sliding."""
    return min(tried, key=lambda each: (each.failed, each.mean))


def _walked(job: tuple[LearnedModel, Setting, int]) -> tuple[float, bool]:
    model, setting, seed = job
    found = walk(seed, setting, model_rule(model, SelectParams()))
    return found.sliding_mm, found.reached
