"""Rows of inertial samples: what is done where some are missing."""

import numpy as np
import pytest

from surefoot.services.estimator.filter.layout import STARTED, E, M, X
from surefoot.services.estimator.filter.noise import BestSetting, best_limits, best_noise
from surefoot.services.estimator.filter.replay import IMU_END, bring_up, clear, new_replay
from surefoot.services.estimator.filter.state import new_state
from surefoot.services.estimator.params import EstimatorParams, StartPose
from tests.services.estimator.mounts import balls

G = np.array([0.0, 0.0, 9.81])


def test_lost_inertial_samples_are_the_mean_of_their_neighbours():
    """Of a force that grows evenly the mean is exact; a held sample would be half a step off for each lost one."""
    params = EstimatorParams()
    setting = BestSetting(balls(1), best_noise(params), best_limits(params, StartPose(), True))
    kept = np.delete(np.arange(40), [10, 21, 22, 30])
    rows = np.hstack([np.zeros((40, 3)), G + 0.05 * np.arange(40)[:, None] * [1.0, 0.0, 0.0]])
    found = {}
    for name, chosen in (("all", np.arange(40)), ("kept", kept)):
        state = new_state(1)
        state.memory[M.phase], state.cov[...] = STARTED, 0.0
        replay = new_replay(1, 1)  # by the kernel that the service warms
        clear(replay, state)
        replay.samples.imu_stamps[: len(chosen)] = 10_000_000 * (chosen + 1)
        replay.samples.imu[: len(chosen)] = rows[chosen]
        replay.marks[IMU_END] = len(chosen)
        bring_up(replay, state, setting)
        found[name] = state
    assert found["kept"].x[X.vel] == pytest.approx(found["all"].x[X.vel], abs=1e-12)
    assert found["kept"].cov[E.vel, E.vel] > found["all"].cov[E.vel, E.vel] + 1e-8
