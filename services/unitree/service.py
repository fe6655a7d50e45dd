"""Unitree's quadrupeds (Go1, Go2, B2) over DDS, beside the manufacturer's controller: `rt/lowstate` in, nothing out."""

from operator import itemgetter
from typing import Any

from pydantic import Field, ValidationError

from surefoot.bus.codec import refusal_of
from surefoot.errors import SurefootError
from surefoot.lockstep.driver import DueSample
from surefoot.lockstep.sensed import SensedConfig, SensedDriver
from surefoot.robot.names import joint_columns, leg_columns
from surefoot.schemas.hw import MakerMotion
from surefoot.schemas.topics import CMD_ESTOP, HW_CONTACTS, HW_IMU, HW_JOINTS, HW_MAKER, SIM_STATUS, TICK_NS

INSTALL = "pip install 'surefoot[unitree]'"
"""Command that installs the optional DDS library."""
MS = 1_000_000
WRAP = 2**32
"""Number of milliseconds after which the robot's counter `tick` restarts at 0: 49.7 days."""
MOST = 64
"""Largest number of received messages that wait to be read; beyond it the oldest are dropped."""
MOTORS = 20
"""Number of motors in a LowState message; a quadruped has twelve."""
LEGS = ("fr", "fl", "rr", "rl")


class UnitreeConfig(SensedConfig):
    """Settings of the Unitree driver: network of the robot, and the manufacturer's order of joints and feet."""

    interface: str = Field(default="lo", description="network interface of the robot, e.g. eth0")
    domain: int = Field(default=0, ge=0, le=230, description="number of the DDS domain")
    joints: tuple[str, ...] = Field(
        default=tuple(f"{leg}_{part}" for leg in LEGS for part in ("hip", "thigh", "calf")),
        max_length=MOTORS,
        description="names of the first motors in the maker's order",
    )
    feet: tuple[str, ...] = Field(default=LEGS, max_length=4, description="legs in the order of the foot forces")
    check_crc: bool = Field(default=True, description="refuse messages with a wrong check sum")


class Unitree(SensedDriver[UnitreeConfig]):
    """Driver that watches a Unitree robot over DDS; its ticks follow the robot's own counter.

    The manufacturer's own estimate is recorded as `hw/maker`.
    """

    name = "unitree"
    Config = UnitreeConfig
    outputs = (HW_IMU, HW_JOINTS, HW_CONTACTS, HW_MAKER, SIM_STATUS)
    observes = (CMD_ESTOP,)

    def open(self) -> None:
        """Open the DDS readers (raises SurefootError: DDS is not installed, or there is no such network interface)."""
        c = self.config
        self._readers = self._open()
        from .messages import check_sum, sensors_of  # needs DDS

        self._check_sum, self._sensors_of = check_sum, sensors_of
        self._joints = itemgetter(*joint_columns(c.joints, self.robot))
        self._feet = itemgetter(*leg_columns(c.feet, self.robot))
        self._now_ms: int | None = None
        self._lost: tuple[float, ...] = ()
        self._maker: Any = None

    def _open(self) -> tuple[Any, Any]:
        c = self.config
        try:
            from cyclonedds.core import DDSException
            from cyclonedds.domain import Domain, DomainParticipant
            from cyclonedds.qos import Policy, Qos
            from cyclonedds.sub import DataReader
            from cyclonedds.topic import Topic

            from .messages import LOW_STATE, ON_INTERFACE, SPORT_STATE, LowState, MemoryAsSent, SportModeState
        except ImportError:
            raise SurefootError("not_installed", f"Unitree's robots need DDS: {INSTALL}", "unitree") from None
        try:
            self._held: list[Any] = [Domain(c.domain, ON_INTERFACE.format(c.interface))]
            participant = DomainParticipant(c.domain)
            quality = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(MOST))
            low: Any = Topic(participant, LOW_STATE, LowState)
            low.data_type = MemoryAsSent  # it decodes, too
            sport = Topic(participant, SPORT_STATE, SportModeState)
            made = [DataReader(participant, low, quality), DataReader(participant, sport, quality)]
        except DDSException as error:
            text = f"no DDS on interface {c.interface!r} ({str(error)[:120]}); `ip link` lists the interfaces"
            raise SurefootError("unreachable", text, "interface") from None
        self._held.append(participant)
        return made[0], made[1]

    def poll(self) -> None:
        """Move the received DDS messages into the intake, which releases their samples tick by tick."""
        for state in self._readers[0].take(N=MOST):
            if isinstance(state, bytes):  # else: the writer has gone
                self.take(state)
        for state in self._readers[1].take(N=MOST):
            if hasattr(state, "position"):
                self._maker = state

    def take(self, memory: Any) -> None:
        """Store what a LowState message has, as it lies in the robot's memory: joints, inertial unit, foot forces."""
        m = self._sensors_of(memory)
        if self.config.check_crc and (wanted := self._check_sum(memory)) != m.crc:
            self.intake.refuse("crc", f"rt/lowstate: check sum {m.crc:#x}, wanted is {wanted:#x}")
            return
        stamp = self._time(m.tick) * MS
        self.intake.imu(stamp, m.gyroscope, m.accelerometer)
        if not any(m.foot_force):
            self.intake.refuse("feet_zero", "rt/lowstate: all foot forces are zero; without them the feet go by height")
        elif self.intake.contact is not None:
            self.intake.feet(stamp, self._feet(m.foot_force))
        before, self._lost = self._lost or m.lost, m.lost
        changed = zip(self.config.joints, before, m.lost, strict=False) if m.lost != before else ()
        for name, was, now in changed:
            if now > was:
                self.intake.refuse("motor_lost", f"rt/lowstate: the motor {name} is lost, {now} answers so far")
                return
        self.intake.joints(stamp, self._joints(m.q), self._joints(m.dq), self._joints(m.tau_est))

    def release(self, tick: int) -> list[DueSample]:
        """Return the samples of a tick, and the manufacturer's state estimate if there is a new one."""
        out, maker, self._maker = self.intake.release(tick), self._maker, None
        if maker is None:
            return out
        try:
            message = MakerMotion(
                position=tuple(maker.position), velocity=tuple(maker.velocity), yaw_speed=maker.yaw_speed,
                quat_wxyz=tuple(maker.imu_state.quaternion), gait=maker.gait_type,
            )  # fmt: skip
        except ValidationError as error:
            refusal = refusal_of(error, "rt/sportmodestate")
            self.intake.refuse("maker_nonfinite", refusal.message)
            return out
        return [*out, DueSample(HW_MAKER, message, tick * TICK_NS, tick)]

    def _time(self, tick_ms: int) -> int:
        """Return the time of the robot, ms, with its counter unwrapped."""
        if self._now_ms is None:
            self._now_ms = tick_ms
        self._now_ms += (tick_ms - self._now_ms + WRAP // 2) % WRAP - WRAP // 2
        return self._now_ms


SERVICE = Unitree
