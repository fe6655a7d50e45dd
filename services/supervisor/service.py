"""Supervisor service: takes part in lockstep, sends a scenario's commands in their ticks, stores messages."""

import threading
import time
from typing import Any

from surefoot.bus.interface import Delivery
from surefoot.errors import CallError
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.service import Service
from surefoot.schemas import topics
from surefoot.schemas.base import Message
from surefoot.schemas.rows import M
from surefoot.schemas.status import SimStatus
from surefoot.schemas.system import Health, SupervisorStatus
from surefoot.schemas.topics import Topic

from .scenarios.director import Director, TimedOrder
from .scenarios.limits import JUDGED
from .scenarios.scenario import COMMANDS
from .watched import Watched

WELL = ("joining", "ready", "running")
"""States in which a service counts as healthy: it answers queries, even if not all its links are proved."""

SIGN_TICKS = 10
"""Control ticks between two checks of which services have published; every periodic topic is due in such a tick."""


class Supervisor(Service[ServiceConfig]):
    """Service that watches the system, runs a scenario and stores the messages from which its metrics are computed.

    Messages of a run are stored undecoded and decoded after its end: decoding all of them would slow each tick.
    """

    name = "supervisor"
    Config = ServiceConfig
    inputs = JUDGED
    outputs = (topics.SUPERVISOR_STATUS,)
    calls = (*dict.fromkeys(query for query, _ in COMMANDS.values()), topics.SIM_PAUSE)
    observes = (topics.HEALTH, topics.SIM_STATUS)
    raw = batched = True

    def __init__(self, config: ServiceConfig, director: Director | None = None, watched: Watched | None = None) -> None:
        super().__init__(config)
        self.director = director
        self.watched = watched
        self.health: dict[str, Health] = {}
        self.status: SimStatus | None = None
        self.late: SimStatus | None = None
        """Status of the simulator or hardware when paced time last fell behind in this run; None = never."""
        self.ended = threading.Event()
        self.ticks = 0
        self.began = self.last = 0.0
        self._feedback: Delivery | None = None
        """Newest progress message of a navigator goal, not decoded; None = none yet."""
        self.kept: list[Delivery] = []
        """Messages of the topics `JUDGED`, which the verdict reads, since the start of the run, not yet decoded."""
        self.notes: list[tuple[float, str]] = []
        """Steps of the scenario that were sent: simulated time, s, and text of each."""

    @property
    def wall_s(self) -> float:
        """Wall time between the first and the last tick, s."""
        return self.last - self.began

    def stops(self) -> list[str]:
        """Return the reasons why the driver's run is not valid: an emergency stop, or diverged physics."""
        if self.status is None:
            return []
        stopped = self.status.stopped
        return [text for text in (f"emergency stop: {stopped}" if stopped else "", self.status.failed) if text]

    def on_reset(self) -> None:
        """Forget the messages and times of the run before."""
        self.ended.clear()
        self.kept.clear()
        self.notes.clear()
        self._feedback = self.late = None
        self.ticks = 0
        self.began = time.monotonic()

    def on_tick(self, inputs: TickInputs) -> None:
        """Store the messages of the tick and send the commands of the scenario that are due."""
        self.ticks, self.last = inputs.number + 1, time.monotonic()
        if self.watched is not None and inputs.number % SIGN_TICKS == 0:
            for owner in {delivery.topic.owner for delivery in inputs.messages.values()}:
                self.watched.ticked(owner)
        if self.director is not None:
            self.kept += inputs.messages.values()
            self._feedback = inputs.messages.get(topics.NAVIGATOR_FEEDBACK.key, self._feedback)
        if self.director is not None and inputs.tick.report:
            truth, gait = _read(inputs, topics.SIM_TRUTH), _read(inputs, topics.STATE_GAIT)
            fallen = truth is not None and truth.fallen
            feedback = None if self._feedback is None else self._feedback.message()
            for order in self.director.on_tick(inputs.number, gait, fallen=fallen, feedback=feedback):
                self._send(self.director, order, inputs.tick.stamp_ns * 1e-9)
        if inputs.tick.end:
            self.ended.set()

    def on_message(self, topic: Topic[Any], message: Message) -> None:
        """Record heartbeats of other services; publish the supervisor's status at each of its own heartbeats."""
        if isinstance(message, SimStatus):
            self.status = message
            self.late = message if message.late else self.late
        if not isinstance(message, Health):
            return
        self.health[message.service] = message
        if message.service == self.name:
            self.publish(topics.SUPERVISOR_STATUS, self._status())
        elif self.watched is not None and message.state != "stopping":  # the end of the process is seen anyway
            self.watched.heard(message.service, message.pid, well=message.state in WELL)

    def _send(self, director: Director, order: TimedOrder, time_s: float) -> None:
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
        scenario = self.director.scenario.name if self.director is not None else None
        if self.watched is None:
            return SupervisorStatus(system="", services=(), scenario=scenario)
        return SupervisorStatus(system=self.watched.name, services=self.watched.rows(), scenario=scenario)


def _read(inputs: TickInputs, topic: Topic[M]) -> M | None:
    delivery = inputs.messages.get(topic.key)
    return None if delivery is None else delivery.message()


SERVICE = Supervisor
