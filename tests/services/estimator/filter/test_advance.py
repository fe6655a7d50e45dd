"""Rows of inertial samples: what is done where some are missing."""

import numpy as np
import pytest

from surefoot.services.estimator.filter.best import BestFilter
from surefoot.services.estimator.filter.layout import STARTED, E, M, X
from surefoot.services.estimator.filter.setting import best_limits, best_noise
from surefoot.services.estimator.inputs.counters import InputCheck
from surefoot.services.estimator.params import EstimatorParams, StartPose
from tests.services.estimator.mounts import balls

G = np.array([0.0, 0.0, 9.81])


def test_lost_inertial_samples_are_the_mean_of_their_neighbours():
    """Of a force that grows evenly the mean is exact; a held sample would be half a step off for each lost one."""
    params = EstimatorParams()
    kept = np.delete(np.arange(40), [10, 21, 22, 30])
    rows = np.hstack([np.zeros((40, 3)), G + 0.05 * np.arange(40)[:, None] * [1.0, 0.0, 0.0]])
    found = {}
    for name, chosen in (("all", np.arange(40)), ("kept", kept)):
        limits = best_limits(params, StartPose(), True, False)
        made = BestFilter(balls(1), best_noise(params), limits, InputCheck(params, 1, 1))
        state = made.parts.state
        state.memory[M.phase], state.cov[...] = STARTED, 0.0
        for k in chosen:
            made.imu(10_000_000 * (int(k) + 1), rows[k, :3], rows[k, 3:], False)
        _ = made.output  # brings the state up
        found[name] = state
    assert found["kept"].x[X.vel] == pytest.approx(found["all"].x[X.vel], abs=1e-12)
    assert found["kept"].cov[E.vel, E.vel] > found["all"].cov[E.vel, E.vel] + 1e-8
