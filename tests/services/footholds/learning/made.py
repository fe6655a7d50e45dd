"""Samples with a known law, for the tests of learning."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from surefoot.services.footholds.learning.samples import SampleSet, StanceSample
from surefoot.services.footholds.learning.samples import gather as of_planes
from surefoot.services.footholds.models.bases import Gaussians

CELL = 0.005
FOOT = 0.008


def law(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Mean slip of scaled coefficients."""
    return 0.02 + 0.3 * b * b + 0.1 * np.maximum(a, 0.0) + 0.05 * np.maximum(c, 0.0)


def plane(slope: float) -> tuple[int, ...]:
    """Heights of 7 x 7 cells on a plane that rises along x, micrometres."""
    row = [round(1e6 * CELL * slope * k) for k in range(-3, 4)]
    return tuple(row * 7)


def gather(found: Iterable[StanceSample]) -> SampleSet:
    """The samples as arrays of the paper's coefficients, which follow the law."""
    return of_planes(found, relief=False)


def samples(count: int, seed: int = 0, trials: int = 10, noise: float = 0.0) -> list[StanceSample]:
    """Stances whose slip follows the law."""
    rng = np.random.default_rng(seed)
    b = rng.uniform(0.0, 0.8, count)
    a, c = rng.uniform(-1.0, 1.0, count) * b, np.clip(rng.normal(0.0, 0.3, count), -1.0, 1.0) * np.minimum(1.0, 2 * b)
    r = law(a, b, c) * (1.0 + noise * rng.standard_normal(count)) if noise else law(a, b, c)
    return [
        StanceSample(
            trial=f"t{k % trials:02d}", leg=k % 6, step=k, k1=float(a[k] * 8 * CELL), k2=float(b[k] * 8 * CELL),
            cos_k3=float(c[k]), k4=0.01, stroke=(-0.025, 0.0, 0.0), sliding=float(max(r[k], 0.0) * 0.025),
            displacement=float(max(r[k], 0.0) * 0.03), load=7.0, friction=0.5, cell=CELL, smooth=True, foot_radius=FOOT,
            robot="ragno", robot_hash="0", source="made", heights_um=plane(float(b[k])),
        )
        for k in range(count)
    ]  # fmt: skip


def spoiled(sample: StanceSample, **changes: object) -> StanceSample:
    """The sample with other values."""
    return replace(sample, **changes)  # type: ignore[arg-type]


def random_start(
    rng: np.random.Generator, m: int, d: int, centres: tuple[float, float], widths: tuple[float, float],
    constant: bool = False,
) -> Gaussians:  # fmt: skip
    """Return Gaussians with evenly drawn centres and widths."""
    return Gaussians(rng.uniform(*centres, (m, d)), rng.uniform(*widths, (m, d)), constant)
