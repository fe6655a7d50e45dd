"""Data behind the figures and findings of Walas & Belter (2011), section 3."""

from dataclasses import dataclass

import numpy as np

from surefoot.arrays import Array
from surefoot.services.footholds.learning.samples import StanceSample
from surefoot.services.footholds.models.learned import LearnedModel

from .foothold_runs import WalkResult


@dataclass(frozen=True, eq=False)
class FootholdStudy:
    """Results of the study of Walas & Belter, section 3: trials, learned models and walks."""

    exact: list[StanceSample]
    """Stances of trials on ground primitives without noise."""
    noisy: list[StanceSample]
    """Stances of trials on ground primitives with noise on their heights."""
    models: dict[str, LearnedModel]
    walks: dict[str, list[WalkResult]]
    """Walks of each case of Fig. 11 of Walas & Belter, by name of the case."""
    window: tuple[Array, Array, Array]
    """Heights (m), cost Q and mask (0 = free) of a window of 15 x 15 cells, (15, 15) each."""
    relearned: dict[str, list[WalkResult]]
    """Walks of each case of Fig. 12 of Walas & Belter, by name of the case."""


def predicted(model: LearnedModel, a: float, b: float) -> float:
    """Return the slip P of a model at K1 = 8 cell a, K2 = 8 cell b, cos K3 = 0, clipped to its learned ranges."""
    low, high = np.array(model.ranges).T
    return float(model.terms.values(np.clip(np.array([[a, b, 0.0]]), low, high))[0])
