"""Rows of the table of smoothed estimates beside those of the forward pass."""

from collections.abc import Sequence

import numpy as np

from surefoot.lab.estimation.log import Log
from surefoot.lab.estimation.scores import Score, score
from surefoot.lab.estimation.smooth import smooth
from surefoot.lab.estimation.track import Track, default, track

BOTH_WAYS = (
    "v cm/s",
    "0.5 s cm/s",
    "NEES/3",
    "in 95 %",
    "tilt deg",
    "RPE %",
    "1 s mm",
    "ATE mm",
    "heading rms",
    "z mm/m",
)


def both_ways(logs: Sequence[Log], way: float) -> tuple[str, ...]:
    """Return the cells of a table row: mean errors over logs, forward estimates / smoothed estimates.

    Args:
        logs: logs with truth.
        way: length of path over which relative poses are compared, m.
    """
    pairs = [(_numbers(log, track(default(), log), way), _numbers(log, smooth(default(), log), way)) for log in logs]
    ahead, both = np.mean(pairs, axis=0)
    return tuple(f"{a:.2f} / {b:.2f}" for a, b in zip(ahead, both, strict=True))


def _numbers(log: Log, found: Track, way: float) -> tuple[float, ...]:
    s: Score = score(log, found, (way,))
    return (
        100 * s.rmse, 100 * s.smooth, s.nees / 3, 100 * s.inside, s.tilt_deg, 100 * s.rpe, 1e3 * s.rpe_1s, 1e3 * s.ate,
        s.heading_rms_deg, 1e3 * s.climb,
    )  # fmt: skip
