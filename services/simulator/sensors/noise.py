"""Sensor models: what the hardware would report, given the exact physics.

One seeded random stream per sensor, derived from (seed, name), drawn in blocks. Each model can be saved and restored
to the bit: `state()` holds plain JSON values only.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.kernels.jit import kernel
from surefoot.robot.description import ContactSensor, CurrentSensor, Encoder, ImuProfile

from ..ground.grid import random_stream

BLOCK = 256  # rows of normal numbers drawn at once


class NormalStream:
    """Rows of standard normal numbers, drawn in blocks; its state is that of the generator and the row in the block."""

    def __init__(self, seed: int, name: str, width: int) -> None:
        self.rng = random_stream(seed, name)
        self.width = width
        self._fill()

    def _fill(self) -> None:
        self.start: Any = self.rng.bit_generator.state
        self.block: Array = self.rng.standard_normal((BLOCK, self.width))
        self.row = 0

    def next(self) -> Array:
        """Return the next row of standard normal numbers, (width,), no unit; a view that stays valid."""
        if self.row == BLOCK:
            self._fill()
        self.row += 1
        return self.block[self.row - 1]

    def state(self) -> dict[str, Any]:
        """Return the state of the generator and the row in the present block, as plain JSON values."""
        return {"start": self.start, "row": self.row}

    def restore(self, state: dict[str, Any]) -> None:
        """Set generator and row in the block to a `state` that was returned earlier."""
        self.rng.bit_generator.state = state["start"]
        self._fill()
        self.row = int(state["row"])


class ImuSensor:
    """Sensor model of the inertial unit: y = LSB round((x + b0 + b(t) + n) / LSB), clipped at the range.

    b0 is drawn once (turn-on), b(t) is a first-order Gauss-Markov process, n is white. `x` is the mean over the
    physics steps of one sample, so aliasing of the leg impacts does not occur.

    Args:
        profile: numbers of the sensor; None = ideal: y = x.
        seed: seed of the run.
        rate_hz: samples per second; sigma of n = density sqrt(rate / 2).
    """

    def __init__(self, profile: ImuProfile | None, seed: int, rate_hz: float) -> None:
        self.profile = profile
        self.gauss_markov = np.zeros(6)
        self.turn_on = np.zeros(6)
        if profile is None:
            return
        axes = [profile.accel] * 3 + [profile.gyro] * 3
        self.normal = NormalStream(seed, "imu", 12)
        self.turn_on = np.array([a.bias_turn_on for a in axes]) * self.normal.next()[:6]
        decay = [math.exp(-1.0 / (rate_hz * a.bias_time_s)) for a in axes]
        # rows: LSB, range, sigma of n, decay of b, sigma of the drive of b
        self.table = np.array(
            [
                [a.lsb for a in axes],
                [a.limit for a in axes],
                [a.noise_density * math.sqrt(0.5 * rate_hz) for a in axes],
                decay,
                [a.bias_in_run * math.sqrt(1.0 - d * d) for a, d in zip(axes, decay, strict=True)],
            ]
        )
        self.gauss_markov = np.array([a.bias_in_run for a in axes]) * self.normal.next()[:6]

    def measure(self, acc: Array, gyro: Array) -> tuple[Array, bool]:
        """Return one sample of the inertial unit.

        Args:
            acc: exact specific force in the n physics steps of the sample, IMU frame, (n, 3), m/s2.
            gyro: exact angular rate in these steps, (n, 3), rad/s.

        Returns:
            Measured acceleration and rate, (6,) m/s2 and rad/s, and True if an axis is at the end of its range.
        """
        if self.profile is None:
            return window_mean(acc, gyro), False
        out = np.empty(6)
        return out, _imu(acc, gyro, self.turn_on, self.gauss_markov, self.normal.next(), self.table, out)

    def state(self) -> dict[str, Any]:
        """Return biases of accelerometer and gyro and the random stream, for a checkpoint; empty without a profile."""
        if self.profile is None:
            return {}
        return {"turn_on": self.turn_on.tolist(), "b": self.gauss_markov.tolist(), "normal": self.normal.state()}

    def restore(self, state: dict[str, Any]) -> None:
        """Set biases and random stream to a `state` that was returned earlier."""
        if self.profile is not None:
            self.turn_on, self.gauss_markov = np.array(state["turn_on"]), np.array(state["b"])
            self.normal.restore(state["normal"])


@kernel
def window_mean(acc: Array, gyro: Array) -> Array:
    """Return the mean over the n steps of accelerometer (n, 3) m/s2, then gyro (n, 3) rad/s, as one array (6,)."""
    out = np.zeros(6)
    n = acc.shape[0]
    for i in range(n):
        for k in range(3):
            out[k] += acc[i, k]
            out[3 + k] += gyro[i, k]
    return out / n


@kernel
def _imu(acc: Array, gyro: Array, turn_on: Array, gauss_markov: Array, normal: Array, table: Array, out: Array) -> bool:
    exact = window_mean(acc, gyro)
    saturated = False
    for i in range(6):
        gauss_markov[i] = table[3, i] * gauss_markov[i] + table[4, i] * normal[6 + i]
        y = exact[i] + turn_on[i] + gauss_markov[i] + table[2, i] * normal[i]
        lsb, limit = table[0, i], table[1, i]
        if lsb > 0.0:
            y = lsb * np.rint(y / lsb)
        out[i] = min(max(y, -limit), limit)
        saturated = saturated or abs(out[i]) >= limit
    return saturated


class JointSensor:
    """Sensor model of the encoders and servo currents.

    position = resolution round((q + zero error) / resolution); current = torque / k + noise, k the torque per ampere;
    the torque is what a driver would compute from the current with the k it knows, which may differ from the true one.
    """

    def __init__(
        self,
        encoder: Encoder,
        current: CurrentSensor,
        nj: int,
        seed: int,
        true_torque_per_ampere: float | None = None,
        more_zero_sigma: float = 0.0,
    ) -> None:
        self.resolution, self.noise_ampere = float(encoder.resolution), float(current.noise_ampere)
        self.known_k = float(current.torque_per_ampere)
        self.true_k = float(true_torque_per_ampere or self.known_k)
        self.normal = NormalStream(seed, "joints", nj)
        self.zero = math.hypot(encoder.zero_sigma, more_zero_sigma) * self.normal.next()

    def measure(self, position: Array, torque: Array) -> Array:
        """Return one sample by rows, (3, nj): position rad, current A, torque Nm.

        position, torque: true ones of each joint, (nj,) rad and (nj,) Nm.
        """
        normal = self.normal.next()
        return _joints(
            position, torque, self.zero, normal, self.resolution, self.true_k, self.known_k, self.noise_ampere
        )

    def state(self) -> dict[str, Any]:
        """Return the zero errors of the encoders, rad, and the state of the random stream, for a checkpoint."""
        return {"zero": self.zero.tolist(), "normal": self.normal.state()}

    def restore(self, state: dict[str, Any]) -> None:
        """Set zero errors and random stream to a `state` that was returned earlier."""
        self.zero = np.array(state["zero"])
        self.normal.restore(state["normal"])


@kernel
def _joints(
    position: Array,
    torque: Array,
    zero: Array,
    normal: Array,
    resolution: float,
    true_k: float,
    known_k: float,
    noise_ampere: float,
) -> Array:
    out = np.empty((3, position.shape[0]))
    for i in range(position.shape[0]):
        q = position[i] + zero[i]
        if resolution > 0.0:
            q = resolution * np.rint(q / resolution)
        current = torque[i] / true_k + noise_ampere * normal[i]
        out[0, i], out[1, i], out[2, i] = q, current, known_k * current
    return out


class FootSensor:
    """Sensor model of foot switches with hysteresis; the kind `force` also reports a force per foot.

    A switch closes at `on_n` and opens below `off_n`. A force sensor reports 0 below `min_n` and `max_n` at most.
    """

    def __init__(self, sensor: ContactSensor, points: tuple[int, ...]) -> None:
        self.sensor = sensor
        self.points = points  # contact spheres per foot
        self.ends = np.cumsum((0, *points))
        self.closed = np.zeros(int(self.ends[-1]), dtype=np.bool_)

    def measure(self, force: Array) -> tuple[NDArray[np.bool_], Array | None]:
        """Return one sample of the foot sensors.

        Args:
            force: normal force on each contact sphere, N, feet one after the other, (P,).

        Returns:
            Switches of the spheres, (P,), True = closed, and, for the kind `force`, the force per foot (L,) in N, else
            None.
        """
        s = self.sensor
        self.closed = (force >= s.on_n) | (self.closed & (force >= s.off_n))
        if s.kind != "force":
            return self.closed, None
        total = np.add.reduceat(force, self.ends[:-1])
        return self.closed, np.where(total < s.min_n, 0.0, np.minimum(total, s.max_n))

    def state(self) -> dict[str, Any]:
        """Return the state of each foot switch, true if closed, for a checkpoint."""
        return {"closed": self.closed.tolist()}

    def restore(self, state: dict[str, Any]) -> None:
        """Set the foot switches to a `state` that was returned earlier."""
        self.closed = np.array(state["closed"], dtype=np.bool_)


def rehearse() -> None:
    """Call every kernel of the sensor models once with made-up arguments, so that none is loaded in a tick."""
    acc, one = np.zeros((1, 3)), np.zeros(1)
    window_mean(acc, acc)
    _imu(acc, acc, np.zeros(6), np.zeros(6), np.zeros(12), np.ones((5, 6)), np.zeros(6))
    _joints(one, one, one, one, 1.0, 1.0, 1.0, 1.0)
