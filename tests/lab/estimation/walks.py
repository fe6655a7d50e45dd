"""Short synthetic logs that several tests share."""

from functools import cache

from surefoot.lab.estimation.log import Log
from surefoot.papers.wawrzynski.synthetic import KINDS, WalkParams, synthesize

CLEAN = WalkParams(
    duration_s=6.0, sigma_w=0.0, sigma_q=0.0, gyro_bias=0.0, acc_bias=0.0, encoders=False, sigma_foot=0.0
)


@cache
def clean(seed: int = 0) -> Log:
    """A walk with perfect sensors."""
    return synthesize(CLEAN, seed)


@cache
def noisy(kind: str = "twist", seed: int = 0) -> Log:
    """A walk of a kind, as long as the benchmark's."""
    return synthesize(KINDS[kind], seed)
