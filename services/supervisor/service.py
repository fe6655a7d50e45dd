"""The supervisor as a participant of lockstep: sends a scenario's commands in their tick, collects what happens."""

import threading
from collections.abc import Callable
from typing import Any

from schemas.base import Message
from schemas.sim import SimStatus, Truth
from schemas.system import Health, ServiceStatus, SupervisorStatus
from schemas.topics import (
    CMD_WALK,
    HEALTH,
    SIM_FAULT,
    SIM_PAUSE,
    SIM_PUSH,
    SIM_SET,
    SIM_STATUS,
    SIM_TRUTH,
    STATE_GAIT,
    STATE_ODOMETRY,
    STATE_STABILITY,
    STATE_VELOCITY,
    SUPERVISOR_STATUS,
    TERRAIN_MAP,
    Topic,
)
from services.supervisor.director import Director, Order
from services.supervisor.system import System
from services.supervisor.traces import Traces
from surefoot.config import ServiceConfig
from surefoot.errors import CallError
from surefoot.join import TickInputs
from surefoot.service import Service

WELL = ("joining", "ready", "running")
"""States of a service in which it is healthy: it answers queries; whether all links are proved is another matter."""


JUDGED: tuple[Topic[Any], ...] = (
    SIM_TRUTH,
    STATE_VELOCITY,
    STATE_ODOMETRY,
    STATE_GAIT,
    STATE_STABILITY,
    TERRAIN_MAP,
)
"""What the verdict is made from."""


class Supervisor(Service[ServiceConfig]):
    """Watches the system, conducts a scenario, keeps the traces of the run."""

    name = "supervisor"
    Config = ServiceConfig
    inputs = JUDGED
    outputs = (SUPERVISOR_STATUS,)
    calls = (CMD_WALK, SIM_PUSH, SIM_SET, SIM_FAULT, SIM_PAUSE)
    observes = (HEALTH, SIM_STATUS)

    def __init__(
        self,
        config: ServiceConfig,
        director: Director | None = None,
        system: System | None = None,
        kill: Callable[[str], None] = lambda service: None,
    ) -> None:
        super().__init__(config)
        self.director = director
        self.system = system
        self.traces = Traces()
        self.health: dict[str, Health] = {}
        self.status: SimStatus | None = None
        self.ended = threading.Event()
        self.ticks = 0
        self._kill = kill

    def on_reset(self) -> None:
        """A new run: the traces begin anew by the epoch of their messages."""
        self.ended.clear()
        self.ticks = 0

    def on_tick(self, inputs: TickInputs) -> None:
        """Keep what happened; send what the scenario asks for."""
        for topic in JUDGED:
            message = inputs.get(topic)
            if message is not None:
                self.traces.feed(topic.key, message)
        self.ticks = inputs.number + 1
        if self.director is not None:
            truth: Truth | None = inputs.get(SIM_TRUTH)
            fallen = truth is not None and truth.fallen
            for order in self.director.on_tick(inputs.number, inputs.get(STATE_GAIT), fallen=fallen):
                self._send(self.director, order, inputs.tick.stamp_ns * 1e-9)
        if inputs.tick.end:
            self.ended.set()

    def on_message(self, topic: Topic[Any], message: Message) -> None:
        """Heartbeats feed the reconciler; the own one also paces the supervisor's status."""
        if isinstance(message, SimStatus):
            self.status = message
        if not isinstance(message, Health):
            return
        self.health[message.service] = message
        if message.service == self.name:
            self.publish(SUPERVISOR_STATUS, self._status())
        elif self.system is not None:
            self.system.heard(message.service, well=message.state in WELL)

    def _send(self, director: Director, order: Order, time: float) -> None:
        self.traces.note(time, order.text)
        if order.kill:
            self._kill(order.kill)
        if order.query is None or order.request is None:
            return
        try:
            director.answered(order, self.call(order.query, order.request))
        except CallError as error:
            director.failed(order, error.message)

    def _status(self) -> SupervisorStatus:
        rows = self.system.rows() if self.system is not None else ()
        return SupervisorStatus(
            system=self.system.compose.name if self.system is not None else "",
            services=tuple(
                ServiceStatus(service=r.service, state=r.state, pid=r.pid, restarts=r.restarts, detail=r.detail)
                for r in rows
            ),
            scenario=self.director.scenario.name if self.director is not None else None,
        )


SERVICE = Supervisor
