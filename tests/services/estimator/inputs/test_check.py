"""Bad inputs are named and counted."""

import numpy as np
import pytest

from surefoot.geometry.rotations import matrix_from_rotvec
from surefoot.services.estimator.feet.mount import bare_mount
from surefoot.services.estimator.health import flags_of, reasons
from surefoot.services.estimator.inputs.check import faults_at
from surefoot.services.estimator.inputs.clock import RESYNC_AFTER
from surefoot.services.estimator.inputs.results import InputResult
from surefoot.services.estimator.params import EstimatorParams
from surefoot.services.estimator.stream import BEST, Estimator

TICK = 10_000_000
ZERO, G = np.zeros(3), np.array([0.0, 0.0, 9.81])
TURN = np.tile(np.eye(3), (2, 1, 1))


def with_feet(feet):
    return Estimator(bare_mount(feet), EstimatorParams(), names=(BEST,))


@pytest.fixture
def estimator():
    estimator = with_feet(2)
    assert estimator.imu(TICK, ZERO, G) is InputResult.OK
    return estimator


@pytest.fixture
def check(estimator):
    return estimator.check


def faults(check, now_ns):
    return faults_at(check.state, check.limits, check.noisy, now_ns)


@pytest.mark.parametrize(
    ("stamp", "w", "q", "result"),
    [
        (2 * TICK, np.array([0.0, np.nan, 0.0]), G, InputResult.NONFINITE),
        (2 * TICK, ZERO, np.array([0.0, 0.0, np.inf]), InputResult.NONFINITE),
        (2 * TICK, np.zeros(4), G, InputResult.SHAPE),
        (10**12, ZERO, G, InputResult.AHEAD),
        (2**64, ZERO, G, InputResult.AHEAD),
        (-(2**70), ZERO, G, InputResult.AHEAD),
        (TICK - 10**9, ZERO, G, InputResult.LATE),
        (2 * TICK, np.array([18.0, 0.0, 0.0]), G, InputResult.SATURATED),
        (2 * TICK, ZERO, 6.0 * G, InputResult.SATURATED),
    ],
)
def test_a_bad_sample_is_refused_counted_and_forgotten(estimator, check, stamp, w, q, result):
    assert estimator.imu(stamp, w, q) is result
    assert not result.accepted
    assert (check.counts, check.refused) == ({f"imu_{result}": 1}, 1)
    assert faults(check, TICK).refused
    assert not faults(check, 12 * TICK).refused
    assert estimator.imu(2 * TICK, ZERO, G) is InputResult.OK


@pytest.mark.parametrize(
    "refuse",
    [
        lambda e: e.imu(2 * TICK, np.zeros(4), G), lambda e: e.imu(2 * TICK, ZERO * np.nan, G),
        lambda e: e.feet(2 * TICK, np.ones((3, 3)), TURN), lambda e: e.joints(2 * TICK, np.zeros(3)),
    ],
)  # fmt: skip
def test_a_refusal_shows_in_the_very_next_estimate(estimator, refuse):
    estimator.feet(TICK, np.ones((2, 3)), TURN)
    assert estimator.estimate().inputs_ok
    assert not refuse(estimator).accepted
    after = estimator.estimate()
    assert not after.inputs_ok
    assert any(reason.startswith("degraded input") for reason in after.reasons)


def test_a_gap_is_accepted_and_counted(estimator, check):
    assert estimator.imu(7 * TICK + 1, ZERO, G) is InputResult.GAP
    assert (check.refused, check.counts["imu_gap"]) == (0, 1)


def test_a_clock_that_restarted_is_followed(estimator):
    for k in (1000, 1001):  # the second confirms the first
        estimator.imu(k * TICK, ZERO, G)
    results = [estimator.imu(k * TICK, ZERO, G) for k in range(2, 2 + RESYNC_AFTER + 2)]
    assert results[: RESYNC_AFTER - 1] == [InputResult.LATE] * (RESYNC_AFTER - 1)
    assert results[RESYNC_AFTER - 1 :] == [InputResult.RESTART, InputResult.OK, InputResult.OK]


def test_shuffled_samples_do_not_restart_the_clock(estimator):
    for k in (1000, 1001):
        estimator.imu(k * TICK, ZERO, G)
    for _ in range(30):
        for stamp in (8, 5):
            assert estimator.imu(stamp * TICK, ZERO, G) is InputResult.LATE


@pytest.mark.parametrize("period_ns", [TICK, TICK // 10])
def test_a_unit_that_repeats_one_sample_for_a_quarter_of_a_second_is_frozen(period_ns):
    estimator = Estimator(bare_mount(2), EstimatorParams(imu_period_ns=period_ns), names=(BEST,))
    seen = []
    for k in range(1, round(0.3e9 / period_ns)):
        estimator.imu(k * period_ns, ZERO, G)
        seen.append(faults(estimator.check, estimator.stamp_ns).imu_frozen)
    assert seen.index(True) == pytest.approx(0.25e9 / period_ns, abs=1.0)
    assert "the inertial unit repeats one sample" in estimator.estimate().reasons
    estimator.imu(round(0.4e9), ZERO + 1e-3, G)
    assert not faults(estimator.check, estimator.stamp_ns).imu_frozen


def test_a_robot_without_weight_falls(estimator, check):
    for k in range(2, 32):  # a leap lasts no longer
        estimator.imu(k * TICK, ZERO + 1e-3 * k, 0.1 * G)
    assert not faults(check, 31 * TICK).weightless
    estimator.imu(32 * TICK, ZERO, 0.1 * G)
    assert faults(check, 32 * TICK).weightless
    estimator.imu(33 * TICK, ZERO, G)
    assert not faults(check, 33 * TICK).weightless


def test_kinematics(estimator, check):
    feet = np.ones((2, 3))
    assert estimator.feet(TICK, feet, TURN) is InputResult.OK
    assert estimator.feet(TICK - 1, feet, TURN) is InputResult.OK  # within the window
    assert estimator.feet(TICK - 10**9, feet, TURN) is InputResult.LATE
    assert estimator.feet(3 * TICK, feet * np.nan, TURN) is InputResult.NONFINITE
    half = feet.copy()
    half[0] = np.nan
    assert estimator.feet(4 * TICK, half, TURN) is InputResult.OK
    assert (check.counts["kinematics_nonfinite"], check.last_bad) == (2, "kinematics_nonfinite")


def test_frozen_encoders_count_only_while_the_robot_moves(estimator, check):
    feet = np.ones((2, 3))
    for k in range(40):
        estimator.feet(k * TICK, feet.copy(), TURN)
    assert faults(check, 40 * TICK).feet_repeat
    assert not estimator.initialised
    moving = estimator._best.condition._replace(initialised=True, standing=False)
    assert not flags_of(moving)[2]
    assert "repeat" in " ".join(reasons(moving, {}, "", "", np.zeros(2, dtype=bool)))
    for still in (moving._replace(initialised=False), moving._replace(standing=True)):
        assert "repeat" not in " ".join(reasons(still, {}, "", "", np.zeros(2, dtype=bool)))
    assert flags_of(moving._replace(standing=True, since_contact_s=0.0, since_feet_s=0.0))[2]


@pytest.mark.parametrize(
    ("factor", "word"),
    [
        (1.0, ""),
        (180.0 / np.pi, "the gyro measures in deg/s: factor 0.0174533"),
        (-1.0, "the gyro has the other sign: factor -1"),
    ],
)
def test_the_gyro_is_compared_with_feet_that_stand(factor, word):
    rng = np.random.default_rng(0)
    estimator = with_feet(3)
    feet = np.array([[0.1, 0.0, -0.1], [-0.1, 0.1, -0.1], [-0.1, -0.1, -0.1]])
    rot, one = np.tile(np.eye(3), (3, 1, 1)), np.ones(3)
    result = None
    for k in range(1, 1500):
        w = 0.3 * np.array([np.sin(0.05 * k), np.cos(0.07 * k), 0.3])
        feet = feet @ matrix_from_rotvec(-0.01 * w).T
        result = estimator.imu(k * TICK, factor * w + 0.005 * rng.normal(size=3), G + 0.03 * rng.normal(size=3))
        if k % 3 == 0:
            seen = feet + 3e-4 * rng.normal(size=(3, 3))
            estimator.feet(k * TICK, seen, rot, one)
    assert estimator.check.unit == word
    assert (result is InputResult.UNIT) == bool(word)
