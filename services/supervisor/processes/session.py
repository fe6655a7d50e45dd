"""Running system: run folder, router, the supervisor's own node, and the processes of the other services."""

import os
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from surefoot.bus.endpoint import to_listen
from surefoot.bus.interface import Life, Publisher
from surefoot.bus.seals import VARIABLE, given_secret, new_secret
from surefoot.bus.tokens import SERVICES
from surefoot.bus.zenoh import DEFAULT_FLEET, ZenohBus
from surefoot.bus.zenoh import ZenohOptions as BusEndpoint
from surefoot.errors import BusError, CallError
from surefoot.heap import share_heaps
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.join import DRIVER
from surefoot.lockstep.launch import spare_collector
from surefoot.lockstep.node import Node
from surefoot.robot.reader import load_robot
from surefoot.schemas.hw import EmergencyStop
from surefoot.schemas.rows import Rep, Req
from surefoot.schemas.sim import ResetReply, ResetRequest
from surefoot.schemas.status import SimStatus, StatusRequest
from surefoot.schemas.system import Health, HealthRequest, ServiceStatus
from surefoot.schemas.topics import CMD_ESTOP, HEALTH_GET, SIM_RESET, SIM_STATUS_GET, Query

from ..scenarios.director import Director
from ..service import Supervisor
from .compose import Compose
from .ports import refuse_taken
from .reconcile import ProcessAction
from .rundir import ROW, Endpoint, RunFolder
from .status import health_row, time_row
from .still import Still
from .system import SELF, System
from .visible import Visible

STEP_S = 0.05  # s, how often the main thread looks at the processes, and at once when one has ended


def namespace_of(robot: str) -> str:
    """Return the prefix of the keys of a robot: SUREFOOT_NAMESPACE, else the default fleet's."""
    return os.environ.get("SUREFOOT_NAMESPACE") or f"{DEFAULT_FLEET}/{Path(robot).name}"


class Session:
    """Running system of `run`, `up` and `supervise`: a context manager that leaves no process behind."""

    def __init__(
        self,
        compose: Compose,
        *,
        listen: str | None = None,
        director: Director | None = None,
        environment: Mapping[str, str] | None = None,
        spawn: bool = True,
        notify: Callable[[str], None] = lambda text: None,
    ) -> None:
        share_heaps()
        self.compose = compose
        self.name = compose.name
        self.listen = to_listen(listen)
        self.robot = compose.robot
        self.namespace = namespace_of(self.robot)
        self.folder = RunFolder(compose.name)
        self._spawn = spawn
        self._notify = notify
        self._secret = given_secret() or (new_secret() if spawn else "")
        """Secret by which the processes of this system know each other; those started elsewhere need it given."""
        self._services = tuple(dict.fromkeys((*compose.services, SELF)))
        own = {
            "SUREFOOT_CONNECT": self.listen,
            VARIABLE: self._secret,
            SERVICES: ",".join(self._services) if spawn else "",
            "SUREFOOT_NAMESPACE": self.namespace,
            "SUREFOOT_ROBOT": self.robot,
            **{f"SUREFOOT_{name.upper()}_MEMORY": str(path) for name, path in self.folder.memories.items()},
        }
        self.system = System(
            compose, self.folder, environment={**own, **(environment or {})}, on_action=self._on_action
        )
        self.supervisor = Supervisor(ServiceConfig(robot=self.robot), director, self)
        self.feet: tuple[str, ...] = ()
        """Names of the legs in the order of messages, known once entered."""
        self._bus: ZenohBus | None = None
        self._node: Node | None = None
        self._thread: threading.Thread | None = None
        self._visible = Visible()
        self._driving = ""  # the process that drives, or drove last
        self._before: SimStatus | None = None  # the last report of the driver before it, not true of this one
        self._stop = ""  # the emergency stop in force when that one went, not yet confirmed by this one
        self._stops: Publisher[EmergencyStop] | None = None
        self._still, self._still_words = Still(), ""
        self.failure: BaseException | None = None
        """Error that ended the supervisor's own thread, None while it runs."""

    # -- life ---------------------------------------------------------------------------------------------------------

    def __enter__(self) -> Self:
        """Take the run folder, open the router, become visible.

        Raises:
            RobotError: no such robot.
            RunFolderError: the system is up already.
            BusError: the port is taken; the sentence names the owner and the flag.
        """
        self.feet = load_robot(self.robot).leg_names  # an unknown robot is refused now, not by each of the services
        self.folder.acquire()
        try:
            self._clean_up()
            if self._spawn:
                self.system.prepare()
            self._bus = self._open_router()
            self.folder.write_endpoint(
                Endpoint(self.listen, self.namespace, str(self.compose.path.resolve()), self.robot), self._secret
            )
            self._bus.watch(self._on_life)
            self._node = Node(self.supervisor, self._bus)
            self._node.start()
            self._thread = threading.Thread(target=self._run_node, name="supervisor", daemon=True)
            self._thread.start()
            spare_collector()
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop all processes, close the session, release the run folder."""
        self._close()

    def _close(self) -> None:
        try:
            if self._spawn and not self.system.stop():
                self._notify("some processes could not be ended")
        finally:
            if self._node is not None:
                self._node.stop()
            if self._thread is not None:
                self._thread.join(2.0)
            if self._bus is not None:
                self._bus.close()
            self.folder.release()

    def _clean_up(self) -> None:
        left = self.folder.end_leftovers()
        if left:
            self._notify(f"ended what an earlier run had left behind: {', '.join(left)}")

    def _open_router(self) -> ZenohBus:
        try:
            place = BusEndpoint("router", (), (self.listen,), self.namespace, SELF, self._secret, self._services)
            return ZenohBus(place)
        except BusError:
            refuse_taken(self.listen)
            raise

    def _run_node(self) -> None:
        assert self._node is not None
        try:
            self._node.run()
        except BaseException as error:
            self.failure = error

    # -- what happens -------------------------------------------------------------------------------------------------

    def _on_life(self, life: Life) -> None:
        self.system.seen(life.service, visible=self._visible.note(life))
        self._note_driver()

    def _note_driver(self) -> None:
        """Take over the emergency stop of the driver before, when another process drives.

        It is noticed by the new one's coming: the two tokens of the old one vanish in any order, and its last report
        may be read after them.
        """
        driver = self.instance_of(DRIVER)
        if not driver or driver == self._driving:
            return
        self._before = self.supervisor.status if self._driving else None
        self._driving = driver
        if self._before is not None and self._before.stopped:
            self._stop = self._before.stopped

    def _on_action(self, action: ProcessAction) -> None:
        self._notify(f"{action.verb} {action.service}" + (f" ({action.reason})" if action.reason else ""))

    @property
    def expected(self) -> tuple[str, ...]:
        """Names of the services that must be ready before tick 0: all but the driver, i.e. simulator or hardware."""
        driver = self.driver
        return tuple(name for name in (*self.system.service_names, SELF) if name != driver)

    @property
    def driver(self) -> str:
        """Name of the service that drives the ticks, which is visible as `driver` too; empty while there is none."""
        return self._visible.driver

    @property
    def alive(self) -> tuple[str, ...]:
        """Services that are visible on the bus."""
        return self._visible.services

    def heard(self, service: str, pid: int, *, well: bool) -> None:
        """Record a heartbeat of a service's process; `well`: it is ready for work."""
        self.system.heard(service, pid, well=well)
        if service == self.driver:
            before, now = self._still_words, time.monotonic()
            self._still.beat(self.supervisor.health[service], now)
            self._still_words = self._still.words(self.supervisor.status)
            if self._still_words and not before:
                self._notify(f"{service}: {self._still_words}")

    def ticked(self, owner: str) -> None:
        """Record that outputs of the service `owner` came in a tick."""
        name = self.driver if owner == DRIVER else owner
        self.system.ticked(name)

    def signal_kill(self, service: str) -> None:
        """Kill the process of a service at once (SIGKILL)."""
        self.system.signal_kill(service)

    def rows(self) -> tuple[ServiceStatus, ...]:
        """Return the state of every service: by its process, or by the bus if this session did not start it."""
        if self._spawn:
            current = self.supervisor.status is not self._before
            stops = self.supervisor.stops() if current else []
            why, driver = "; ".join(filter(None, (*stops, self._still_words))), self.driver
            rows = self.system.rows()
            return tuple(
                row.model_copy(update={"detail": why}) if row.service == driver and why else row for row in rows
            )
        alive = self.alive
        return tuple(
            ServiceStatus(
                service=name, state="healthy" if name in alive else "stopped", pid=None, restarts=0, detail=""
            )
            for name in self.system.service_names
        )

    def instance_of(self, service: str) -> str:
        """Return the identity of a visible service's process, empty when it is not visible."""
        return self._visible.instance_of(service)

    def step(self) -> None:
        """Check the processes once; restart, end or report them where needed.

        Raises:
            BusError: a service is not restarted any more, or the supervisor's own thread has ended.
        """
        if self.failure is not None:
            raise BusError("internal", f"the supervisor has failed: {type(self.failure).__name__}: {self.failure}")
        self._renew_stop()
        if not self._spawn:
            return
        self.system.step()
        failure = self.system.failure()
        if failure:
            raise BusError("service_failed", failure)

    def _renew_stop(self) -> None:
        """Send the emergency stop of a driver that has gone again, until the next one, running, confirms it."""
        if not self._stop or not self.driver or self._bus is None:
            return
        status = self.supervisor.status
        if status is not None and status is not self._before and status.stopped and status.tick > 0:
            self._notify(f"{self.driver} was started anew; the emergency stop stays in force ({self._stop})")
            self._stop = ""
            return
        self._stops = self._stops or self._bus.publisher(CMD_ESTOP)
        self._stops.put(EmergencyStop(source=SELF, reason=self._stop))

    def calm(self) -> bool:
        """Return True if every wanted service runs and is healthy, and no emergency stop is to be sent again."""
        return not self._stop and self.system.settled()

    def wait_for(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Check the processes until the condition holds; return False if it does not within `timeout_s`."""
        deadline = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > deadline:
                return False
            self.step()
            self.system.wait(STEP_S)
        return True

    def begin(self, request: ResetRequest, patience_s: float) -> ResetReply:
        """Request a new run from the simulator as soon as it answers; other services may still be starting.

        Args:
            request: request of the run; the services that it expects are filled in.
            patience_s: wall time until a driver must be there, s.

        Raises:
            BusError: no service drives, or the one that does is no simulator.
            CallError: the simulator refuses the request.
        """
        if not self.wait_for(lambda: bool(self.driver), patience_s):
            raise BusError("not_ready", f"no service of {self.compose.path} drives after {patience_s:g} s")
        if not self.answers(SIM_RESET):
            raise BusError("no_simulator", f"a scenario needs a simulator; {self.driver} does not answer sim/reset")
        return self.call(SIM_RESET, request.model_copy(update={"expect": self.expected}))

    def follow(self, began: float, stall_s: float, show: Callable[[int, float], None]) -> tuple[float, list[str]]:
        """Check the system until the last tick of a run.

        Args:
            began: time of the start, s, as of `time.monotonic`.
            stall_s: wall time without a tick after which the run is given up, s.
            show: called with the number of ticks and their wall time, s, as they pass.

        Returns:
            Wall time from `began` to the first tick, s, and what went wrong.
        """
        supervisor, director = self.supervisor, self.supervisor.director
        start_s, last, moved = 0.0, 0, time.monotonic()
        while not supervisor.ended.is_set():
            try:
                self.step()
            except BusError as error:  # a service is not restarted any more: the report states it
                return start_s, [error.message]
            now = time.monotonic()
            if supervisor.ticks != last:
                start_s = now - began if last == 0 else start_s
                last, moved = supervisor.ticks, now
                show(last, max(supervisor.wall_s, 1e-3))
            if now - moved > stall_s:
                waiting = {name: health.waiting_for for name, health in self.health().items() if health.waiting_for}
                words = "; ".join(f"{name} waits for {', '.join(keys)}" for name, keys in waiting.items())
                return start_s, [f"no tick for {stall_s:g} s at tick {last}" + (f": {words}" if words else "")]
            supervisor.ended.wait(STEP_S)
        cut = director is not None and not director.ended and director.scenario.steps
        return start_s, ["it was ended by max_duration_s"] if cut else []

    def call(self, query: Query[Req, Rep], request: Req, timeout_s: float | None = None) -> Rep:
        """Send a request to a service and return its reply (raises CallError)."""
        assert self._bus is not None
        return self._bus.call(query, request, timeout_s)

    def answers(self, query: Query[Req, Rep]) -> bool:
        """Return True if a service answers a query."""
        assert self._bus is not None
        return self._bus.probe(query)

    def report(self) -> dict[str, Any]:
        """Return the system as `surefoot status` shows it, with live numbers of the services."""
        health = self.health()
        rows = [row.model_dump(include=ROW) for row in self.rows()]
        services = [{**row, **(health_row(health[row["service"]]) if row["service"] in health else {})} for row in rows]
        content: dict[str, Any] = {"connect": self.listen, "namespace": self.namespace, "services": services}
        with suppress(CallError):  # the driver of a real robot has no simulated time
            content["time"] = time_row(self.call(SIM_STATUS_GET, StatusRequest(), 0.5))
        return content

    def health(self) -> dict[str, Health]:
        """Return the health of every service that answers."""
        found: dict[str, Health] = {}
        for name in self.alive:
            if name not in self._services:  # a stranger's, which may never answer
                continue
            try:
                found[name] = self.call(HEALTH_GET.of(name), HealthRequest(), 1.0).health
            except CallError:
                continue
        return found
