"""The supervisor as a participant of lockstep: sends a scenario's commands in their tick, collects what happens."""

import threading
import time
from typing import Any, Protocol, TypeVar

from surefoot.bus.interface import Delivery
from surefoot.errors import CallError
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.service import Service
from surefoot.schemas.base import Message
from surefoot.schemas.sim import SimStatus
from surefoot.schemas.system import Health, ServiceStatus, SupervisorStatus
from surefoot.schemas.topics import (
    HEALTH,
    NAVIGATOR_FEEDBACK,
    SIM_PAUSE,
    SIM_STATUS,
    SIM_TRUTH,
    STATE_GAIT,
    STATE_ODOMETRY,
    STATE_POSE,
    STATE_STABILITY,
    STATE_VELOCITY,
    STATE_VELOCITY_EKF,
    STATE_VELOCITY_IMU,
    STATE_VELOCITY_KINEMATICS,
    STATE_VELOCITY_KINEMATICS_GYRO,
    SUPERVISOR_STATUS,
    TERRAIN_MAP,
    Topic,
)

from .scenarios.director import Director, Order
from .scenarios.scenario import COMMANDS

M = TypeVar("M", bound=Message)

WELL = ("joining", "ready", "running")
"""States of a service in which it is healthy: it answers queries; whether all links are proved is another matter."""

SIGN_TICKS = 10
"""In every tenth tick what has come is a sign of life of those who published it; every periodic topic is due there."""

JUDGED: tuple[Topic[Any], ...] = (
    SIM_TRUTH,
    STATE_VELOCITY,
    STATE_ODOMETRY,
    STATE_GAIT,
    STATE_STABILITY,
    STATE_VELOCITY_IMU,
    STATE_VELOCITY_KINEMATICS,
    STATE_VELOCITY_KINEMATICS_GYRO,
    STATE_VELOCITY_EKF,
    TERRAIN_MAP,
    STATE_POSE,
    NAVIGATOR_FEEDBACK,
)
"""What the verdict is made from."""


class Watched(Protocol):
    """The system around the supervisor, as far as it needs it."""

    name: str

    def heard(self, service: str, pid: int, *, well: bool) -> None:
        """Note a heartbeat."""

    def ticked(self, owner: str) -> None:
        """Note that what a service publishes came in a tick."""

    def signal_kill(self, service: str) -> None:
        """End a service without warning."""

    def rows(self) -> tuple[ServiceStatus, ...]:
        """Return how every service does."""
        ...


class Supervisor(Service[ServiceConfig]):
    """Watches the system, conducts a scenario, keeps what the verdict is made from.

    Messages of a run are kept as they came and read after its end: to read all of them at once would cost each tick.
    """

    name = "supervisor"
    Config = ServiceConfig
    inputs = JUDGED
    outputs = (SUPERVISOR_STATUS,)
    calls = (*dict.fromkeys(query for query, _ in COMMANDS.values()), SIM_PAUSE)
    observes = (HEALTH, SIM_STATUS)
    raw = batched = True

    def __init__(
        self,
        config: ServiceConfig,
        director: Director | None = None,
        watched: Watched | None = None,
    ) -> None:
        super().__init__(config)
        self.director = director
        self.watched = watched
        self.health: dict[str, Health] = {}
        self.status: SimStatus | None = None
        self.late: SimStatus | None = None
        """What the driver reported when paced time last fell behind in this run."""
        self.ended = threading.Event()
        self.ticks = 0
        self.began = self.last = 0.0
        self._feedback: Delivery | None = None
        """The latest progress of a goal."""
        self.kept: list[Delivery] = []
        """Every message of `JUDGED` since the start of the run, as it came."""
        self.notes: list[tuple[float, str]] = []
        """What the scenario did, with its simulated time in s."""

    @property
    def wall_s(self) -> float:
        """Wall time between the first and the last tick, s."""
        return self.last - self.began

    def stops(self) -> list[str]:
        """Return what the driver said why the run is no run: an emergency stop, physics that diverged."""
        status = self.status
        if status is None:
            return []
        stopped = [f"emergency stop: {status.stopped}"] if status.stopped else []
        return [*stopped, status.failed] if status.failed else stopped

    def on_reset(self) -> None:
        """A new run: forget the one before."""
        self.ended.clear()
        self.kept.clear()
        self.notes.clear()
        self._feedback = self.late = None
        self.ticks = 0
        self.began = time.monotonic()

    def on_tick(self, inputs: TickInputs) -> None:
        """Keep what happened; send what the scenario asks for."""
        self.ticks, self.last = inputs.number + 1, time.monotonic()
        if self.watched is not None and inputs.number % SIGN_TICKS == 0:
            for owner in {delivery.topic.owner for delivery in inputs.messages.values()}:
                self.watched.ticked(owner)
        if self.director is not None:
            self.kept += inputs.messages.values()
            self._feedback = inputs.messages.get(NAVIGATOR_FEEDBACK.key, self._feedback)
        if self.director is not None and inputs.tick.report:
            truth, gait = _read(inputs, SIM_TRUTH), _read(inputs, STATE_GAIT)
            fallen = truth is not None and truth.fallen
            feedback = None if self._feedback is None else self._feedback.message()
            for order in self.director.on_tick(inputs.number, gait, fallen=fallen, feedback=feedback):
                self._send(self.director, order, inputs.tick.stamp_ns * 1e-9)
        if inputs.tick.end:
            self.ended.set()

    def on_message(self, topic: Topic[Any], message: Message) -> None:
        """Heartbeats feed the reconciler; the own one also paces the supervisor's status."""
        if isinstance(message, SimStatus):
            self.status = message
            self.late = message if message.late else self.late
        if not isinstance(message, Health):
            return
        self.health[message.service] = message
        if message.service == self.name:
            self.publish(SUPERVISOR_STATUS, self._status())
        elif self.watched is not None and message.state != "stopping":  # an end shows by itself
            self.watched.heard(message.service, message.pid, well=message.state in WELL)

    def _send(self, director: Director, order: Order, time_s: float) -> None:
        self.notes.append((time_s, order.text))
        if order.kill and self.watched is not None:
            self.watched.signal_kill(order.kill)
        if order.query is None or order.request is None:
            return
        try:
            director.answered(order, self.call(order.query, order.request))
        except CallError as error:
            director.failed(order, error.code, error.message)

    def _status(self) -> SupervisorStatus:
        rows = self.watched.rows() if self.watched is not None else ()
        return SupervisorStatus(
            system=self.watched.name if self.watched is not None else "",
            services=rows,
            scenario=self.director.scenario.name if self.director is not None else None,
        )


def _read(inputs: TickInputs, topic: Topic[M]) -> M | None:
    delivery = inputs.messages.get(topic.key)
    return None if delivery is None else delivery.message()


SERVICE = Supervisor
