"""The tilt that counts as unplanned: not a floor that turns with the heading, not a wandering estimate, but a push."""

import math

import numpy as np
import pytest

from surefoot.robot.reader import load_robot
from surefoot.services.walker.biped import feedback
from surefoot.services.walker.biped.params import BipedParams
from surefoot.services.walker.biped.state import BipedState, Mode
from surefoot.services.walker.interface import WalkerInputs
from tests.services.walker.biped.biped_plant import Plant, standing

NAO = load_robot("nao")
PARAMS = BipedParams.for_robot(NAO)
STEP_TICKS = round(PARAMS.step_s / feedback.TICK_S)


def steps_seen(tilt_deg, count):
    """Largest unplanned tilt of each of `count` steps, deg, where tick k measures roll and pitch `tilt_deg(k)`."""
    s, peaks = BipedState(NAO.nj), []
    s.rest[:] = np.radians(tilt_deg(0))
    s.mode = Mode.STEP
    for step in range(count):
        s.peak = 0.0
        for k in range(step * STEP_TICKS, (step + 1) * STEP_TICKS):
            roll, pitch = np.radians(tilt_deg(k))
            lost = feedback.watch(s, PARAMS, WalkerInputs(stamp=0.0, roll=roll, pitch=pitch, initialised=True))
            assert not lost
        peaks.append(math.degrees(s.peak))
    return np.array(peaks)


def sway(k):
    """Roll once a stride, pitch once a step, 1.5 deg each."""
    phase = math.pi * k / STEP_TICKS
    return 1.5 * np.array([math.sin(phase), math.sin(2.0 * phase)])


@pytest.mark.parametrize("turn", [-1.0, 1.0])
def test_a_slope_that_turns_with_the_heading_shortens_no_step(turn):
    def tilt(k):
        yaw = turn * PARAMS.turn_step_rad * k / STEP_TICKS
        return sway(k) + 1.0 * np.array([math.cos(yaw), math.sin(yaw)]) + (0.5, -1.0)

    peaks = steps_seen(tilt, 64)  # two full circles
    assert np.all(peaks < math.degrees(PARAMS.slow_from_rad))


def test_an_estimate_that_wanders_by_six_degrees_in_a_walk_shortens_no_step():
    peaks = steps_seen(lambda k: sway(k) - (0.0, 6.0 * (1.0 - math.exp(-k / 1500.0))), 80)
    assert np.all(peaks < math.degrees(PARAMS.slow_from_rad))


@pytest.mark.parametrize("axis", [0, 1])
def test_a_push_is_seen_at_its_size_and_hardly_moves_the_mean(axis):
    size, begin = 6.0, 10 * STEP_TICKS + 20

    def tilt(k):
        pushed = np.zeros(2)
        pushed[axis] = size * math.sin(math.pi * (k - begin) / 40.0) if 0 <= k - begin < 40 else 0.0
        return pushed

    peaks = steps_seen(tilt, 14)
    assert np.all(peaks[:10] < 1e-9)
    assert peaks[10] > 0.85 * size
    assert np.all(peaks[12:] < 0.15 * size)


@pytest.mark.parametrize(("seed", "sign"), [pytest.param(0, 1.0, marks=pytest.mark.slow), (6, -1.0)])
def test_turning_in_a_circle_takes_the_steps_of_the_plan(seed, sign):
    plant = Plant("nao", seed=seed, level=1.0).begin("turn", angle=sign * 16 * PARAMS.turn_step_rad, learn=False)
    plant.until(standing)
    assert not plant.fallen
    assert plant.out.steps in (16, 17)  # the last one closes


def test_a_robot_that_stands_does_not_tremble():
    """Its ankles answered to every rate, so that it trembled in pitch for good, and no rest showed the gyro's bias."""
    plant = Plant("nao", 600, level=1.0).stand()
    plant.run(200)
    assert plant.estimator.estimate().standing
