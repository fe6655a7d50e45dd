"""Dead reckoning from the truth errs by the noise of the samples and by nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.lab.estimation.blind import blind_error
from surefoot.lab.estimation.log import Log, TrueMotion

ROWS, SIGMA = 2000, 0.05


def standing():
    """A unit at rest for 20 s, 100 samples a second, without noise."""
    rot = np.tile(np.eye(3), (ROWS, 1, 1))
    zero, up = np.zeros((ROWS, 3)), np.array([0.0, 0.0, 9.81])
    return Log(
        "standing", 10_000_000 * np.arange(ROWS), zero, zero + up, np.array([0]), np.zeros((1, 1, 3)),
        np.eye(3)[None, None], np.ones((1, 1), dtype=bool), TrueMotion(zero, rot, zero),
    )  # fmt: skip


def test_without_noise_nothing_errs_and_a_bias_is_taken_out():
    log = standing()
    assert blind_error(replace(log, w=log.w + 0.02, q=log.q + 0.1), 0.25) < 1e-3


@pytest.mark.parametrize("seconds", [0.05, 0.25])
def test_noise_of_the_accelerometer_adds_up_as_a_random_walk(seconds):
    log = standing()
    q = log.q + SIGMA * np.random.default_rng(0).normal(size=log.q.shape)
    expected = SIGMA * 0.01 * np.sqrt(3.0 * seconds / 0.01)
    assert blind_error(replace(log, q=q), seconds) == pytest.approx(expected, rel=0.15)
