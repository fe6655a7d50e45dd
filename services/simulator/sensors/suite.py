"""Sensors of one robot for its own motion: read at their own times in physics steps, released in ticks."""

from typing import Any

import numpy as np

from surefoot.arrays import Array
from surefoot.robot.description import ImuProfile, Robot
from surefoot.robot.profiles import imu_profile_names, read_imu_profile

from ..physics.disturb import WorldError, by_foot
from ..physics.samples import ContactSample, ImuSample, JointSample, Samples
from . import noise as sensors

NO_LIMIT = 1e9


class SensorSuite:
    """Sensor models of a robot's inertial unit, encoders, servo currents and feet.

    Args:
        robot: the description; read only.
        profile: profile of the inertial unit, or its name; None = the robot's own; "ideal" = exact.
        rate_hz: rate of the inertial samples, Hz.
        seed: seed of all sensors.
        torque_per_ampere: true constant of the servo motors, Nm/A; None = as described.
        zero_sigma: standard deviation of each servo's zero beyond the encoder's own, rad.

    Raises:
        WorldError: no such profile.
    """

    def __init__(
        self,
        robot: Robot,
        profile: ImuProfile | str | None,
        rate_hz: float,
        seed: int,
        torque_per_ampere: float | None,
        zero_sigma: float,
    ) -> None:
        profile = robot.imu.profile if profile is None else profile
        if isinstance(profile, str):
            profile = known_imu(profile)
        self._points = tuple(len(leg.foot.points) for leg in robot.legs)
        self.limit = np.full(6, NO_LIMIT)
        """Largest magnitude that each axis of the inertial unit reports, (6,): accelerometer m/s^2, gyro rad/s."""
        if profile is not None:
            self.limit = np.repeat([profile.accel.limit, profile.gyro.limit], 3)
        self.profile_name = profile.name if profile is not None else "ideal"
        self._imu = sensors.ImuSensor(profile, seed, rate_hz)
        self._joints = sensors.JointSensor(robot.encoder, robot.current, robot.nj, seed, torque_per_ampere, zero_sigma)
        self._feet = sensors.FootSensor(robot.contacts, self._points)
        self._due: tuple[JointSample | None, ContactSample | None] = (None, None)

    @property
    def zero(self) -> Array:
        """Zero errors of the servos' encoders, (nj,), rad."""
        return self._joints.zero

    def take_kinematics(self, stamp_ns: int, seq: int, q: Array, torque: Array, sphere_force: Array) -> None:
        """Sample joints and feet now, for release at the end of the tick.

        Args:
            stamp_ns: now, ns of simulated time.
            seq: number of the sample.
            q: true joint angles, (nj,), rad.
            torque: torques of the servos, (nj,) Nm.
            sphere_force: normal force on each contact sphere of the feet, (P,) N.
        """
        touch, force = self._feet.measure(sphere_force)
        joints = JointSample(stamp_ns, seq, *self._joints.measure(q, torque))
        self._due = (joints, ContactSample(stamp_ns, seq, by_foot(touch.tolist(), self._points), force))

    def release(self, stamp_ns: int, seq: int, acc: Array, gyro: Array) -> Samples:
        """Return the samples of this tick, stamped `stamp_ns` and numbered `seq`.

        `acc`, m/s^2, and `gyro`, rad/s: exact ones in its physics steps, axes of the inertial unit, (steps, 3).
        """
        y, saturated = self._imu.measure(acc, gyro)
        joints, contacts = self._due
        self._due = (None, None)
        return Samples(ImuSample(stamp_ns, seq, y[:3], y[3:], saturated), joints, contacts)

    def state(self) -> dict[str, Any]:
        """Return random streams and biases of all sensors, as plain JSON values."""
        return {"imu": self._imu.state(), "joints": self._joints.state(), "feet": self._feet.state()}

    def restore(self, state: dict[str, Any]) -> None:
        """Set random streams and biases of all sensors to a `state` that was returned earlier."""
        self._imu.restore(state["imu"])
        self._joints.restore(state["joints"])
        self._feet.restore(state["feet"])


def known_imu(name: str) -> ImuProfile | None:
    """Return the inertial unit of a name, None = a sensor without errors (raises WorldError: unknown name)."""
    if name == "ideal":
        return None
    if name not in imu_profile_names():
        raise WorldError("imu_profile", f"got {name!r}, known are ideal, {', '.join(imu_profile_names())}")
    return read_imu_profile(name)
