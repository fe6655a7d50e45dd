"""Sensor models: statistics, quantisation, saturation, hysteresis, exact continuation."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from surefoot.robot.description import ContactSensor, CurrentSensor, Encoder, ImuProfile
from surefoot.robot.profiles import imu_profile_names, read_imu_profile
from surefoot.services.simulator.sensors.noise import (
    BLOCK,
    FootSensor,
    ImuSensor,
    JointSensor,
    NormalStream,
    window_mean,
)

REST = np.array([0.0, 0.0, 9.81, 0.0, 0.0, 0.0])
RATE = 100.0


def in_steps(exact: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same force and rate in each of two physics steps."""
    return np.tile(exact[:3], (2, 1)), np.tile(exact[3:], (2, 1))


def samples(sensor: ImuSensor, n: int) -> np.ndarray:
    return np.array([sensor.measure(*in_steps(REST))[0] for _ in range(n)])


def test_stream_continues_to_the_bit_across_blocks() -> None:
    stream = NormalStream(3, "imu", 4)
    for _ in range(BLOCK - 5):
        stream.next()
    saved = json.loads(json.dumps(stream.state()))
    ahead = np.array([stream.next() for _ in range(20)])
    again = NormalStream(99, "other", 4)
    again.restore(saved)
    np.testing.assert_array_equal(np.array([again.next() for _ in range(20)]), ahead)


def test_streams_differ_by_seed_and_name() -> None:
    rows = {NormalStream(seed, name, 2).next().tobytes() for seed in (0, 1) for name in ("imu", "joints")}
    assert len(rows) == 4


def test_ideal_sensor_is_exact() -> None:
    np.testing.assert_array_equal(ImuSensor(None, 0, RATE).measure(*in_steps(REST))[0], REST)


@pytest.mark.parametrize("name", imu_profile_names())
def test_white_noise_has_its_density(name: str) -> None:
    sensor = ImuSensor(read_imu_profile(name), 1, RATE)
    y = samples(sensor, 4000)
    for axis, columns in ((sensor.profile.accel, slice(0, 3)), (sensor.profile.gyro, slice(3, 6))):  # type: ignore[union-attr]
        expected = math.hypot(axis.noise_density * math.sqrt(RATE / 2.0), axis.lsb / math.sqrt(12.0))
        white = np.diff(y[:, columns], axis=0).std(axis=0) / math.sqrt(2.0)
        np.testing.assert_allclose(white, expected, rtol=0.05)


def test_turn_on_bias_is_drawn_once_per_seed() -> None:
    profile = read_imu_profile("adis16365")
    biases = np.array([ImuSensor(profile, seed, RATE).turn_on for seed in range(300)])
    assert biases[:, 3:].std() == pytest.approx(profile.gyro.bias_turn_on, rel=0.1)
    assert biases[:, :3].std() == pytest.approx(profile.accel.bias_turn_on, rel=0.1)
    sensor = ImuSensor(profile, 5, RATE)
    mean = samples(sensor, 2000).mean(axis=0)
    np.testing.assert_allclose((mean - REST)[3:], sensor.turn_on[3:], atol=1e-3)


def test_in_run_bias_is_gauss_markov() -> None:
    profile = read_imu_profile("adis16365")
    axis = replace(profile.gyro, bias_time_s=1.0, bias_in_run=0.1)
    sensor = ImuSensor(ImuProfile("test", axis, axis), 2, RATE)
    track = np.empty((20_000, 6))
    for row in track:
        sensor.measure(*in_steps(REST))
        row[:] = sensor.gauss_markov
    assert track.std() == pytest.approx(0.1, rel=0.1)
    lag = 100  # one time constant
    correlation = np.mean(track[:-lag] * track[lag:]) / np.mean(track**2)
    assert correlation == pytest.approx(math.exp(-1.0), abs=0.1)


def test_output_is_quantised_and_clipped() -> None:
    profile = read_imu_profile("adis16365")
    sensor = ImuSensor(profile, 1, RATE)
    y = samples(sensor, 50)
    steps = y / np.repeat([profile.accel.lsb, profile.gyro.lsb], 3)
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    hard, saturated = sensor.measure(*in_steps(np.array([1e4, -1e4, 0.0, 1e4, -1e4, 0.0])))
    assert saturated
    limits = np.repeat([profile.accel.limit, profile.gyro.limit], 2) * [1, -1, 1, -1]
    np.testing.assert_array_equal(hard[[0, 1, 3, 4]], limits)


def test_imu_continues_to_the_bit() -> None:
    sensor = ImuSensor(read_imu_profile("adis16350"), 1, RATE)
    samples(sensor, 300)
    saved = json.loads(json.dumps(sensor.state()))
    ahead = samples(sensor, 300)
    again = ImuSensor(read_imu_profile("adis16350"), 2, RATE)
    again.restore(saved)
    np.testing.assert_array_equal(samples(again, 300), ahead)


def test_window_mean() -> None:
    rng = np.random.default_rng(0)
    acc, gyro = rng.standard_normal((10, 3)), rng.standard_normal((10, 3))
    np.testing.assert_allclose(window_mean(acc, gyro), [*acc.mean(0), *gyro.mean(0)])


def test_joint_sensor_quantises_and_knows_another_constant() -> None:
    resolution = math.radians(0.29)
    sensor = JointSensor(Encoder(resolution, 0.0), CurrentSensor(0.6, 0.0), 3, 0, true_torque_per_ampere=0.5)
    q, current, torque = sensor.measure(np.array([0.1, -0.2, 1.0]), np.array([0.5, 0.0, -1.0]))
    np.testing.assert_allclose(q / resolution, np.rint(q / resolution))
    assert np.abs(q - [0.1, -0.2, 1.0]).max() <= resolution / 2
    np.testing.assert_allclose(current, [1.0, 0.0, -2.0], atol=1e-12)
    np.testing.assert_allclose(torque, [0.6, 0.0, -1.2], atol=1e-12)


def test_encoder_zero_error_is_constant() -> None:
    sensor = JointSensor(Encoder(0.0, 0.01), CurrentSensor(0.6, 0.0), 18, 4)
    a, b = (sensor.measure(np.zeros(18), np.zeros(18))[0] for _ in range(2))
    np.testing.assert_array_equal(a, b)
    assert 0.005 < a.std() < 0.02


def test_switch_has_hysteresis() -> None:
    sensor = FootSensor(ContactSensor("switch", 1, 0.7, 0.4, 0.0, math.inf), (1, 1))
    seen = [sensor.measure(np.array([f, 0.0]))[0].tolist() for f in (0.5, 0.7, 0.5, 0.4, 0.39, 0.6)]
    assert [row[0] for row in seen] == [False, True, True, True, False, False]
    assert not any(row[1] for row in seen)


def test_force_sensor_is_blind_below_and_saturates() -> None:
    sensor = FootSensor(ContactSensor("force", 1, 0.7, 0.4, 4.9, 19.6), (2, 1))
    touch, force = sensor.measure(np.array([3.0, 4.0, 2.0]))
    assert touch.tolist() == [True, True, True]
    assert force is not None
    np.testing.assert_allclose(force, [7.0, 0.0], atol=1e-12)
    assert sensor.measure(np.array([30.0, 0.0, 0.0]))[1][0] == 19.6  # type: ignore[index]
