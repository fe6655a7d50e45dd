"""A driver and services small enough to see through: each number depends on all inputs of its tick."""

from typing import Any

from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.driver import Driver, DueSample
from surefoot.lockstep.join import Delayed, TickInputs
from surefoot.lockstep.service import Service
from surefoot.schemas.base import Message
from surefoot.schemas.hw import Imu, JointCommand
from surefoot.schemas.state import GaitState, VelocityEstimate
from surefoot.schemas.topics import CMD_JOINTS, HW_IMU, SIM_JOIN, STATE_GAIT, STATE_VELOCITY, TICK_NS


def estimate(x: float) -> VelocityEstimate:
    """A velocity estimate whose x component is ``x``."""
    zero = (0.0, 0.0, 0.0)
    return VelocityEstimate(
        mode="ekf", velocity=(x, 0.0, 0.0), velocity_imu=zero, velocity_heading=zero, angular_velocity=zero,
        g_up=(0.0, 0.0, 9.81), roll=0.0, pitch=0.0, gyro_bias=zero, covariance=(0.0,) * 36, initialised=True,
        standing=False, inputs_ok=True, filter_ok=True, sensors_ok=True, slipping=(),
    )  # fmt: skip


class ToyDriver(Driver[ServiceConfig]):
    """Integrates the commands it gets."""

    name = "simulator"
    outputs = (HW_IMU,)
    serves = (SIM_JOIN,)

    def __init__(self) -> None:
        super().__init__(ServiceConfig())
        self.x = 0.0
        self.history: list[float] = []

    def release(self, tick: int) -> list[DueSample]:
        acc = (self.x, 0.0, 9.81)
        return [DueSample(HW_IMU, Imu(acc=acc, gyro=(0.0, 0.0, 0.0)), tick * TICK_NS, tick)]

    def actuate(self, tick: int, command: JointCommand | None) -> None:
        self.x = 0.9 * self.x + (0.0 if command is None else (command.position or (0.0,))[0])
        self.history.append(self.x)


class ToyEstimator(Service[ServiceConfig]):
    """Halves what the driver measures."""

    name = "estimator"
    inputs = (HW_IMU,)
    outputs = (STATE_VELOCITY,)

    def on_tick(self, inputs: TickInputs) -> None:
        imu = inputs.get(HW_IMU)
        assert imu is not None
        self.publish(STATE_VELOCITY, estimate(0.5 * imu.acc[0]), imu.stamp_ns)


class ToyWalker(Service[ServiceConfig]):
    """Commands from this tick's measurement and estimate and from its own last gait."""

    name = "walker"
    inputs = (HW_IMU, STATE_VELOCITY, Delayed(STATE_GAIT))
    outputs = (CMD_JOINTS, STATE_GAIT)

    def on_tick(self, inputs: TickInputs) -> None:
        imu, velocity = inputs.get(HW_IMU), inputs.get(STATE_VELOCITY)
        before = inputs.get(STATE_GAIT)
        v = -1.0 if velocity is None else velocity.velocity[0]
        assert imu is not None
        u = 1.0 + 0.1 * imu.acc[0] - 0.3 * v + (0.0 if before is None else 0.01 * before.remaining)
        gait = GaitState(walk_id=1, state="walking", phase=0.0, stance=(), footholds=(), remaining=abs(u))
        self.publish(STATE_GAIT, gait)
        self.publish(CMD_JOINTS, JointCommand(position=(u,)))


class ToyObserver(Service[ServiceConfig]):
    """Keeps what it sees."""

    name = "recorder"
    inputs = (HW_IMU, STATE_VELOCITY, STATE_GAIT)

    def __init__(self) -> None:
        super().__init__(ServiceConfig())
        self.seen: list[tuple[int, dict[str, Message]]] = []

    def on_tick(self, inputs: TickInputs) -> None:
        self.seen.append((inputs.number, dict(inputs.messages)))


def toys() -> tuple[ToyDriver, list[Service[Any]]]:
    """A driver and its three services."""
    driver = ToyDriver()
    return driver, [driver, ToyEstimator(ServiceConfig()), ToyWalker(ServiceConfig()), ToyObserver()]
