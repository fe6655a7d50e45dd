"""Stamps of the feet that step ahead of their motion, while feet turn round and while samples are lost."""

import numpy as np
import pytest

from surefoot.services.estimator.inputs.stamps import late_by

STEP_NS, GAP_NS = 5_000_000, 50_000_000


def swinging(rng: np.random.Generator) -> np.ndarray:
    """Return places of two feet that turn round together at 4 Hz, (120, 2, 3) m, 200 a second, with noise."""
    t = 1e-9 * STEP_NS * np.arange(120)[:, None, None]
    size, phase = rng.uniform(0.03, 0.1, (2, 3)), rng.uniform(0.0, 0.6, (2, 3))
    return size * np.sin(2.0 * np.pi * 4.0 * t + phase) + rng.normal(0.0, 1e-4, (120, 2, 3))


def found(stamps: np.ndarray, feet: np.ndarray) -> int:
    """Return the first time, ns, by which stamps are late as the samples come one by one; 0: they never were."""
    return next((late for k in range(2, len(stamps) + 1) for _, late in [late_by(stamps[:k], feet[:k])] if late), 0)


@pytest.mark.parametrize("seed", range(3))
def test_stamps_that_step_are_found_wherever_the_feet_are(seed: int) -> None:
    rng, late = np.random.default_rng(seed), []
    for _ in range(40):
        stamps, feet = 1 + STEP_NS * np.arange(120), swinging(rng)
        stamps[rng.integers(30, 90) :] += GAP_NS
        late.append(found(stamps, feet))
    assert sum(abs(ns - GAP_NS) <= STEP_NS for ns in late) >= 35


@pytest.mark.parametrize("seed", range(3))
def test_lost_samples_are_no_step(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(40):
        keep = np.ones(120, dtype=np.bool_)
        at = rng.integers(30, 80)
        keep[at : at + rng.integers(2, 20)] = False
        assert found(1 + STEP_NS * np.flatnonzero(keep), swinging(rng)[keep]) == 0


@pytest.mark.parametrize("jitter", [0.1, 0.2, 0.3])
def test_stamps_that_come_unevenly_have_not_stepped(jitter: float) -> None:
    rng = np.random.default_rng(4)
    for _ in range(40):
        off = jitter * STEP_NS * rng.normal(0.0, 1.0, 120).clip(-2.0, 2.0)
        stamps = np.maximum.accumulate(1 + STEP_NS * np.arange(120) + off.astype(np.int64)) + np.arange(120)
        assert found(stamps, swinging(rng)) == 0
