"""Base of drivers for robots with their own walking controller: ticks follow the clock of the robot's sensors."""

import time
from collections.abc import Callable
from typing import Any, ClassVar, Generic, TypeVar

from pydantic import Field

from surefoot.errors import Refusal
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.driver import Driver, DueSample
from surefoot.lockstep.intake import ForceContact, Intake
from surefoot.lockstep.pace import Pace
from surefoot.robot.reader import load_robot
from surefoot.schemas.base import Message
from surefoot.schemas.hw import EmergencyStop, JointCommand
from surefoot.schemas.status import SimStatus
from surefoot.schemas.topics import CMD_ESTOP, HW_CONTACTS, HW_IMU, HW_JOINTS, SIM_JOIN, SIM_STATUS, TICK_S, Topic

PATIENCE_S = 0.05
"""Wall time without a sensor sample after which ticks follow the wall clock, s."""
POLL_S, EARLY_S = 0.001, 0.00025
"""`POLL_S`: shortest interval between two polls of the sensors while a sample is overdue, s; `EARLY_S`: time by which
the first poll for a tick comes before the tick may be due, s, so that the delay from a sample to its tick shrinks."""
MISSED_S = 5.0
"""Wall time without the first inertial sample after which a warning is logged, s."""


class SensedConfig(ServiceConfig):
    """Configuration of a `SensedDriver`: services to wait for, force sensors of the feet, permission of commands."""

    expect: tuple[str, ...] = Field(default=("estimator",), description="services that must be ready before tick 0")
    foot_zero: tuple[float, ...] = Field(default=(), description="raw force of each foot in the air, robot's leg order")
    foot_scale: tuple[float, ...] = Field(default=(), description="N per raw unit of each foot; empty = uncalibrated")
    contact_on: float = Field(default=30.0, gt=0, description="N, force from which a foot stands")
    contact_off: float = Field(default=18.0, gt=0, description="N, force below which it stands no more")
    command: bool = Field(default=False, description="send joint commands to the robot; false = it is only watched")

    def contact(self, feet: int) -> ForceContact | None:
        """Return the rule of foot contact by force; None = not calibrated (raises Refusal: not one value per foot)."""
        if not self.foot_scale and not self.foot_zero:
            return None
        for name in ("foot_zero", "foot_scale"):
            if len(getattr(self, name)) != feet:
                raise Refusal("invalid", f"got {len(getattr(self, name))} numbers, wanted is one of {feet} feet", name)
        return ForceContact(self.foot_zero, self.foot_scale, self.contact_on, self.contact_off)


class SensorPace(Pace):
    """Pace of ticks by the clock of the sensors, and by the wall clock while no samples come.

    Args:
        intake: buffer of the sensors' samples.
        poll: moves received samples into the buffer.
        clock: returns monotonic wall time, s.
    """

    def __init__(self, intake: Intake, poll: Callable[[], None], clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(clock)
        self._intake, self._poll = intake, poll
        self._last: float = clock()
        self._next_look = self._last
        self._due = -1
        """Number of the last tick that was found to be due; -1 = none."""

    def until_due(self, tick: int) -> float:
        """Return the wall time after which to call again, s; 0 = the tick is due."""
        now = self._clock()
        if tick == self._due:
            return 0.0
        if now < self._next_look:
            return self._next_look - now
        self._poll()
        lacking_s = 1e-9 * self._intake.lacking_ns(tick)
        wait_s = min(max(lacking_s / 4.0, POLL_S), TICK_S)  # fewer polls where samples are rarer
        if self._intake.newest_ns < 0:
            self._last, wait_s = now, TICK_S
        elif lacking_s <= 0.0:
            self._last, self._due = now, tick
            late_s = min(now - self._next_look, POLL_S)
            wait_s = 1e-9 * self._intake.lacking_ns(tick + 1) - EARLY_S - late_s
        elif now - self._last >= PATIENCE_S:
            self._last, self._due, wait_s = max(self._last + TICK_S, now - 2 * PATIENCE_S), tick, TICK_S
        self._next_look = now + wait_s
        return 0.0 if tick == self._due else wait_s


S = TypeVar("S", bound=SensedConfig)


class SensedDriver(Driver[S], Generic[S]):
    """Base of drivers for robots with their own controller.

    A subclass overrides `open` and `poll`, and `send` if it can send commands to the robot.
    """

    Config = SensedConfig
    outputs = (HW_IMU, HW_JOINTS, HW_CONTACTS, SIM_STATUS)
    observes, serves = (CMD_ESTOP,), (SIM_JOIN,)
    sends: ClassVar[bool] = False
    """True if the subclass overrides `send` and can command the robot; False: it only reads sensors."""

    def open(self) -> None:
        """Open the connection to the robot."""
        raise NotImplementedError

    def poll(self) -> None:
        """Move the samples received since the last call into `self.intake`."""
        raise NotImplementedError

    def send(self, command: JointCommand) -> None:
        """Send a command to the robot; called only if the configuration asks for commands."""
        raise NotImplementedError

    def on_start(self) -> None:
        """Load the robot, open its sensors (raises Refusal: `command` is set, but this driver cannot send commands)."""
        if self.config.command and not self.sends:
            raise Refusal("shadow", f"{self.name} sends no commands; `command` must be false", "command")
        self.robot = load_robot(self.config.robot)
        self.intake = Intake(self.robot, self.config.contact(self.robot.nlegs), self._refused)
        self.stopped, self._asked, self._warned = "", time.monotonic(), False
        self.open()

    def on_begin(self) -> None:
        """Begin a run whose ticks follow the clock of the sensors."""
        self.node.begin(self.config.expect, "paced", 1.0, 1, "degrade", 0)
        self.node.pace = SensorPace(self.intake, self.poll)
        self.node.pace.factor = 1.0

    def release(self, tick: int) -> list[DueSample]:
        """Return the sensor samples of a tick, and remove them from `self.intake`."""
        return self.intake.release(tick)

    def actuate(self, tick: int, command: JointCommand | None) -> None:
        """Send a command to the robot, if the configuration permits commands and no emergency stop came."""
        if command is not None and self.config.command and not self.stopped:
            self.send(command)

    def check(self, command: JointCommand) -> None:
        """Refuse every command, unless the configuration permits commands (raises Refusal)."""
        if not self.config.command:
            raise Refusal("shadow", f"{self.name} only watches; `command = true` lets commands pass", "command")

    def on_message(self, topic: Topic[Any], message: Message) -> None:
        """Obey an emergency stop: no further command is sent."""
        if isinstance(message, EmergencyStop):
            self.stopped = message.reason or "no reason given"
            self.on_status()

    def on_status(self) -> None:
        """Publish the state of time; log a warning once if no inertial sample comes."""
        run = self.node.leader
        if self.intake.newest_ns < 0 and not self._warned and time.monotonic() - self._asked > MISSED_S:
            self._warned = True
            self.log("warning", f"no inertial sample for {MISSED_S:g} s: time begins with the first")
        now = {"state": run.state, "ticks": run.tick + 1, "tick": run.tick, "epoch": run.epoch, "rtf": 1.0}
        self.publish(SIM_STATUS, SimStatus.model_validate({**now, "comparable": False, "stopped": self.stopped}))

    def _refused(self, code: str, text: str) -> None:
        self.log("warning", f"refused ({code}): {text}")
