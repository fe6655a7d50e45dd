"""What the walks of hexapods and bipeds have in common."""

from collections.abc import Sequence

import numpy as np

from surefoot.lab.runs.joined import TICK_S, sense

__all__ = ["TICK_S", "costs_us", "sense"]


def costs_us(costs: Sequence[float]) -> tuple[float, float]:
    """Median and 99th percentile of times in s, us."""
    return round(1e6 * float(np.median(costs)), 1), round(1e6 * float(np.percentile(costs, 99)), 1)
