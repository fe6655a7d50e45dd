"""Bad inputs are named and counted."""

import numpy as np
import pytest

from surefoot.services.estimator.inputs import FROZEN_ROWS, RESYNC_AFTER, InputJudge, InputResult
from surefoot.services.estimator.params import EstimatorParams

TICK = 10_000_000
ZERO, G = np.zeros(3), np.array([0.0, 0.0, 9.81])


@pytest.fixture
def judge():
    judge = InputJudge(EstimatorParams())
    assert judge.imu(TICK, ZERO, G) == (InputResult.OK, 0)
    return judge


@pytest.mark.parametrize(
    ("stamp", "w", "q", "result"),
    [
        (2 * TICK, np.array([0.0, np.nan, 0.0]), G, InputResult.NONFINITE),
        (2 * TICK, ZERO, np.array([0.0, 0.0, np.inf]), InputResult.NONFINITE),
        (2 * TICK, np.zeros(4), G, InputResult.SHAPE),
        (TICK, ZERO, G, InputResult.DUPLICATE),
        (TICK - 1, ZERO, G, InputResult.BACKWARD),
        (2 * TICK, np.array([18.0, 0.0, 0.0]), G, InputResult.SATURATED),
        (2 * TICK, ZERO, 6.0 * G, InputResult.SATURATED),
    ],
)
def test_a_bad_sample_is_refused_counted_and_forgotten(judge, stamp, w, q, result):
    assert judge.imu(stamp, w, q)[0] is result
    assert not result.accepted
    assert judge.counts == {f"imu_{result}": 1}
    assert judge.refused == 1
    assert not judge.inputs_ok(TICK)
    assert judge.inputs_ok(12 * TICK)
    assert judge.imu(2 * TICK, ZERO, G) == (InputResult.OK, TICK)


def test_a_gap_is_accepted_and_counted(judge):
    assert judge.imu(7 * TICK + 1, ZERO, G) == (InputResult.GAP, 6 * TICK + 1)
    assert judge.refused == 0
    assert judge.counts["imu_gap"] == 1


def test_a_clock_that_restarted_is_followed(judge):
    judge.imu(1000 * TICK, ZERO, G)
    results = [judge.imu(k * TICK, ZERO, G)[0] for k in range(2, 2 + RESYNC_AFTER + 2)]
    assert results[: RESYNC_AFTER - 1] == [InputResult.BACKWARD] * (RESYNC_AFTER - 1)
    assert results[RESYNC_AFTER - 1 :] == [InputResult.RESTART, InputResult.OK, InputResult.OK]


def test_shuffled_samples_do_not_restart_the_clock(judge):
    judge.imu(1000 * TICK, ZERO, G)
    for _ in range(30):
        for stamp in (8, 5):
            assert judge.imu(stamp * TICK, ZERO, G)[0] is InputResult.BACKWARD


def test_a_frozen_unit_is_seen(judge):
    for k in range(2, FROZEN_ROWS + 5):
        judge.imu(k * TICK, ZERO, G)
    assert judge.imu_frozen
    judge.imu(100 * TICK, ZERO + 1e-3, G)
    assert not judge.imu_frozen


def test_kinematics(judge):
    feet = np.ones((2, 3))
    assert judge.kinematics(TICK, feet, TICK) is InputResult.OK
    assert judge.kinematics(TICK, feet, TICK) is InputResult.DUPLICATE
    assert judge.kinematics(TICK - 1, feet, TICK) is InputResult.BACKWARD
    assert judge.kinematics(2 * TICK, feet, 20 * TICK) is InputResult.LATE
    assert judge.kinematics(3 * TICK, feet * np.nan, 3 * TICK) is InputResult.NONFINITE
    half = feet.copy()
    half[0] = np.nan
    assert judge.kinematics(4 * TICK, half, 4 * TICK) is InputResult.OK
    assert judge.counts["kinematics_nonfinite"] == 2


def test_frozen_encoders_count_only_while_the_robot_moves(judge):
    feet = np.ones((2, 3))
    for k in range(40):
        judge.kinematics(k * TICK, feet.copy(), k * TICK)
    assert judge.joints_frozen(moving=True)
    assert not judge.joints_frozen(moving=False)
