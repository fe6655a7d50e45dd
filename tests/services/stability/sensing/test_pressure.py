"""The force-sensing resistor under a foot."""

import numpy as np
import pytest

from surefoot.services.stability.sensing.pressure import PressureSensor, read_loads

SENSOR = PressureSensor()


def test_characteristic_rises_and_turns_round() -> None:
    force = np.linspace(0.1, 30.0, 200)
    voltage = SENSOR.voltage(force)
    assert (np.diff(voltage) > 0.0).all()
    assert 0.0 < voltage[0] < voltage[-1] < SENSOR.supply
    np.testing.assert_allclose(SENSOR.force(voltage), force, rtol=1e-12)
    assert SENSOR.voltage(np.zeros(1))[0] == pytest.approx(0.0, abs=1e-12)


def test_nearly_linear_from_half_a_kilogram_to_two() -> None:
    """4.5: "in the required range from 0.5 to 2 kg could be linearized"; outside it could not."""
    assert SENSOR.linearity_error() < 0.06 * SENSOR.most
    outside = np.array([1.0, 40.0])
    missed = np.abs(SENSOR.linearised(SENSOR.voltage(outside)) - outside)
    assert (missed > 1.5 * SENSOR.linearity_error()).all()


def test_loads_outside_of_the_range_say_less() -> None:
    load = np.array([0.0, 9.81, SENSOR.most, np.nan])
    value, variance = read_loads(load, SENSOR)
    np.testing.assert_allclose(value, [0.5 * SENSOR.least, 9.81, np.nan, np.nan])
    assert variance[1] == pytest.approx((0.02 * 9.81) ** 2, rel=0.1)
    assert variance[0] > 10.0 * variance[1]


def test_variance_is_that_of_random_readings() -> None:
    rng = np.random.default_rng(0)
    force = 9.81 * (1.0 + SENSOR.repeatability * rng.normal(size=20000))
    voltage = SENSOR.step * np.round(SENSOR.voltage(force) / SENSOR.step)
    read = SENSOR.force(voltage)
    assert np.var(read) == pytest.approx(float(SENSOR.variance(np.array(9.81))), rel=0.05)
