"""Flags of an estimate and their reasons: each condition that spoils a flag spoils that one alone, and is named."""

import math

import numpy as np
import pytest

from surefoot.services.estimator import health
from surefoot.services.estimator.inputs.check import Faults

NO_FAULTS = Faults(False, False, False, False, False)
WELL = health.Condition(True, False, True, 3.0, False, 1.0, NO_FAULTS, 0.0, 0.0, 0.0, health.NO_LEGS, False)
ALL = (True, True, True)
INPUTS, FILTER, SENSORS = (False, True, True), (True, False, True), (True, True, False)


def below(limit: float) -> float:
    return math.nextafter(limit, 0.0)


def words(c: health.Condition) -> str:
    return " / ".join(health.reasons(c, {}, "", "imu_late", np.array([c.slipping, False])))


@pytest.mark.parametrize(
    ("change", "found", "word"),
    [
        ({"initialised": False}, FILTER, "waiting for a start"),
        ({"healthy": False}, FILTER, "out of all bounds"),
        ({"nis": health.MAX_NIS}, FILTER, "inconsistent"),
        ({"since_velocity_s": health.UNCORRECTED_S}, FILTER, "no correction by the feet"),
        ({"since_feet_s": health.SILENT_S}, (False, True, False), "no joint angles"),
        ({"since_contact_s": health.NO_CONTACT_S}, SENSORS, "no foot in contact"),
        ({"faults": NO_FAULTS._replace(refused=True)}, INPUTS, "degraded input: imu_late"),
        ({"faults": NO_FAULTS._replace(saturated=True)}, SENSORS, "end of its range"),
        ({"faults": NO_FAULTS._replace(weightless=True)}, SENSORS, "no weight"),
        ({"faults": NO_FAULTS._replace(imu_frozen=True)}, SENSORS, "inertial unit repeats"),
        ({"faults": NO_FAULTS._replace(feet_repeat=True)}, SENSORS, "joint angles repeat"),
        ({"legs": health.NO_LEGS._replace(left_out=2)}, SENSORS, "left out: foot 1, which contradicts"),
        ({"legs": health.NO_LEGS._replace(switches=1)}, SENSORS, "switch of foot 0"),
        ({"legs": health.NO_LEGS._replace(jumping=3)}, SENSORS, "encoders of foot 0, 1 jump"),
        ({"legs": health.NO_LEGS._replace(still=2)}, SENSORS, "foot 1, whose encoders stand still"),
        ({"legs": health.NO_LEGS._replace(swapped=2)}, SENSORS, "encoders of foot 1 are swapped"),
        ({"legs": health.NO_LEGS._replace(late_ns=30_000_000)}, SENSORS, "30 ms late"),
        ({"blind": True, "legs": health.NO_LEGS._replace(left_out=3)}, (True, False, False), "left out: foot 0, 1"),
        ({"unsettled": True}, FILTER, "velocity was lost"),
        ({"slipping": True}, ALL, "slipping: foot 0"),
        ({"excess": health.ROUGH_EXCESS}, ALL, "counts 3 times that"),
        ({"external_out": 2}, ALL, "2 samples from elsewhere"),
    ],
)
def test_a_condition_spoils_its_flags_alone_and_is_named(change, found, word):
    c = WELL._replace(**change)
    assert health.flags(c) == health.flags_of(c) == found
    assert word in words(c)
    assert " / " not in words(c)
    assert not health.is_quiet(c)


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"nis": below(health.MAX_NIS)},
        {"since_velocity_s": below(health.UNCORRECTED_S)},
        {"since_feet_s": below(health.SILENT_S)},
        {"since_contact_s": below(health.NO_CONTACT_S)},
        {"excess": below(health.ROUGH_EXCESS)},
    ],
)
def test_just_below_its_limit_a_number_is_no_reason(change):
    for standing in (False, True):
        c = WELL._replace(standing=standing, **change)
        assert health.flags(c) == health.flags_of(c) == ALL
        assert health.reasons(c, {}, "", "", np.zeros(2, dtype=bool)) == (health.STANDING if standing else ())
        assert health.is_quiet(c)


@pytest.mark.parametrize("change", [{"standing": True}, {"initialised": False}])
def test_encoders_repeat_themselves_where_nothing_moves_or_before_the_start(change):
    c = WELL._replace(faults=NO_FAULTS._replace(feet_repeat=True), **change)
    assert health.flags(c)[2] is health.flags_of(c)[2] is True
    assert "repeat" not in words(c)


def test_an_innovation_that_is_no_number_is_no_sound_estimate():
    c = WELL._replace(nis=math.nan)
    assert health.flags(c) == health.flags_of(c) == FILTER
    assert not health.is_quiet(c)


def test_silent_inputs_and_wrong_units_are_named():
    found = health.reasons(WELL, {"hw/imu": 0.31}, "the gyro measures in deg/s", "", np.zeros(2, dtype=bool))
    assert found == ("refused: the gyro measures in deg/s", "hw/imu is silent for 0.3 s")
