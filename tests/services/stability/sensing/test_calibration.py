"""Gains of the torque measurement from poses."""

import numpy as np
import pytest

from surefoot.robot.kinematics import com
from surefoot.services.stability.programs.contacts import StabilityError
from surefoot.services.stability.sensing.calibration import SweptPose, calibrate, gain_of_47
from surefoot.services.stability.sensing.posture import hold_feet
from tests.services.stability.sensing.test_forces import ALL, RAGNO, UP, held, standing

MOVES = [(0.0, 0.0), (0.03, 0.0), (-0.03, 0.0), (0.0, 0.02), (0.0, -0.02), (0.02, 0.02), (-0.02, 0.02)]


def poses(gain: np.ndarray, offset: tuple[float, float] = (0.0, 0.0), noise: float = 0.0) -> list[SweptPose]:
    """Standing with the trunk moved over the feet; the stated torques are the true ones divided by the gain."""
    rng = np.random.default_rng(7)
    out = []
    for x, y in MOVES:
        q, reached = hold_feet(RAGNO.model, RAGNO.neutral, np.array([x, y, 0.0]), ALL)
        assert reached
        torque = standing(held(q, com(RAGNO.model, q)[:2] + offset), q)
        out.append(SweptPose(q, (torque + noise * rng.normal(size=18)) / gain, UP, ALL))
    return out


@pytest.mark.parametrize("gain", [0.7, 0.7522, 1.3])
def test_common_gain_and_offset_without_noise(gain: float) -> None:
    found = calibrate(RAGNO, poses(np.full(18, gain), (0.004, -0.003)), 1e-8)
    assert found.common == pytest.approx(gain, abs=1e-5)
    np.testing.assert_allclose(found.offset, [0.004, -0.003], atol=1e-6)
    np.testing.assert_allclose(found.gain, gain, atol=1e-4)
    assert found.poses == len(MOVES)
    assert found.residual < 1e-4


def test_gains_of_single_joints_without_noise() -> None:
    gain = 1.0 + 0.1 * np.random.default_rng(8).normal(size=18)
    found = calibrate(RAGNO, poses(gain), 1e-10, apart_sd=0.3)
    np.testing.assert_allclose(found.gain, gain, atol=1e-4)


def test_common_gain_with_noise_lies_within_its_own_uncertainty() -> None:
    found = calibrate(RAGNO, poses(np.full(18, 0.7522), noise=0.01), 1e-4, apart_sd=0.0)
    assert abs(found.common - 0.7522) < 3.0 * found.common_sd
    assert abs(found.common / 0.7522 - 1.0) < 0.01


def test_4_7_divides_the_ways() -> None:
    """Readings of 15.27 and 11.32 cm for 10 cm each: 0.752, which makes 0.845 into 0.636 Nm/A."""
    factor = gain_of_47(20.0, [15.27, 11.32])
    assert factor == pytest.approx(0.752, abs=5e-4)
    assert 0.845 * factor == pytest.approx(0.6356, abs=5e-5)


def test_poses_that_tell_nothing_are_refused() -> None:
    bent = RAGNO.neutral.copy()
    bent[list(RAGNO.legs[0].joints)] = [0.0, 0.3, 0.0]
    useless = [SweptPose(bent, np.zeros(18), UP, ALL), SweptPose(RAGNO.neutral, np.zeros(18), UP, ~ALL)]
    for given in ([], useless):
        with pytest.raises(StabilityError) as refused:
            calibrate(RAGNO, given, 1e-4)
        assert refused.value.code == "no_pose"
