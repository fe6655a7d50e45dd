"""Scenario run on a live system with random faults: services killed, terminated, frozen, slowed, commands forged.

Faults are injected one at a time, the next one when the service hit has recovered, so that each has a recovery time.
"""

import signal
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Self, cast

from surefoot.bus.zenoh import ZenohBus, client_options
from surefoot.errors import CallError, SurefootError
from surefoot.record.recording import verify_recording
from surefoot.schemas.base import Message
from surefoot.schemas.hw import JointCommand
from surefoot.schemas.sim import Truth
from surefoot.schemas.status import SimStatus
from surefoot.schemas.system import Health, HealthRequest, LogRecord
from surefoot.schemas.topics import CMD_JOINTS, HEALTH_GET, LOG, SIM_TRUTH, TICK_NS, TOPICS
from surefoot.services.supervisor.processes.identity import Identity, identify
from surefoot.services.supervisor.processes.session import Session
from surefoot.services.supervisor.scenarios.scenario import Scenario
from surefoot.services.supervisor.service import WELL

from ..report.judge import RunVerdict
from ..runs.live import Options, RunProgress, run_scenario
from .events import FORGED_RAD, FORGER, LIVE, ChaosEvent, ChaosOutcome, ChaosRun, Kind, draw_events, swarm
from .run import falls_when_held

SLOW_PERIOD_S, SLOW_SHARE = 0.1, 0.7
"""Slowing of a service: `SLOW_PERIOD_S`: period, s of wall time; `SLOW_SHARE`: stopped share of a period."""
LOOK_S = 0.01
"""Interval between two checks of the live system for signs of a fault and of recovery, s of wall time."""
RECOVER_S = 90.0
"""Longest wall time from the end of a fault until its service works again, s; longer is a violation (a start takes 10 s
on a loaded machine)."""


@dataclass(frozen=True, kw_only=True)
class LiveRun(ChaosRun):
    """Result of a run of live processes with random faults."""

    bags: dict[str, int]
    """Number of readable messages in each recording of the run, by file name."""
    verdict: RunVerdict
    """Verdict on the limits of the scenario."""
    report: Path | None
    """Path of the HTML report of the run; None = none was written."""


def run_live(
    scenario: Scenario,
    seed: int,
    events: int,
    options: Options,
    *,
    kinds: Sequence[Kind] = (),
    ticks: int | None = None,
    notify: Callable[[str], None] = lambda text: None,
    show: Callable[[RunProgress], None] = lambda progress: None,
) -> LiveRun:
    """Run a scenario on a live system with random faults, check its limits, and stop the system.

    Args:
        scenario: scenario to run.
        seed: seed from which the faults are drawn.
        events: number of faults.
        options: options of a live run, as without faults.
        kinds: kinds of faults to draw from; empty = those that the seed enables.
        ticks: number of control ticks over which the faults are spread; None = half of the scenario's duration limit.
        notify: called with each notice of the system.
        show: called with the progress of the run.
    """
    made: list[Chaos] = []

    def say(text: str) -> None:
        notify(text)
        for chaos in made:
            chaos.sign("supervisor", text)

    def begin(session: Session) -> Chaos:
        services = (session.driver, *(n for n in session.system.service_names if n != session.driver))
        drawn = draw_events(LIVE, seed, events, services, ticks or scenario.max_ticks // 2, kinds)
        made.append(Chaos(session, drawn))
        return made[0]

    outcome = run_scenario(scenario, options, say, show, begin)
    if options.seed is not None:
        scenario = replace(scenario, seed=options.seed)
    (chaos,) = made
    violations = list(chaos.violations)
    violations += [f"process {pid} of {name} is left" for pid, name in orphans(chaos.processes).items()]
    bags: dict[str, int] = {}
    for path in sorted(outcome.report.parent.glob("*.mcap")) if outcome.report is not None else ():
        try:
            bags[path.name] = verify_recording(path).messages.total()
        except SurefootError as error:
            violations.append(error.message)
    fell_at = chaos.fell_at()
    if fell_at is not None:
        tick = max((o.event.tick for o in chaos.outcomes if o.event.tick <= fell_at), default=None)
        excused = tick is not None and options.rtf is not None and falls_when_held(scenario, tick)
        why = f"; it falls, too, when it is held in tick {tick}" if excused else ""
        notify(f"the robot fell in tick {fell_at}{why}")
        violations += [] if excused else [f"the robot fell in tick {fell_at}"]
    return LiveRun(
        seed=seed, outcomes=tuple(chaos.outcomes), violations=tuple(violations), ticks=chaos.session.supervisor.ticks,
        kinds=tuple(kinds) or swarm(LIVE, seed), fell_at=fell_at, bags=bags, verdict=outcome.verdict,
        report=outcome.report,
    )  # fmt: skip


def orphans(processes: set[tuple[str, int]]) -> dict[int, str]:
    """Return the processes left in the process groups of ended services: process id to service name."""
    groups = {pid: name for name, pid in processes}
    found: dict[int, str] = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
        except OSError:
            continue
        state, group = fields[0], int(fields[2])
        if group in groups and state not in ("Z", "X"):
            found[int(folder.name)] = groups[group]
    return found


class Chaos:
    """Injector of faults into the services of a live session, in its own thread; a context manager around the run."""

    def __init__(self, session: Session, events: Sequence[ChaosEvent]) -> None:
        self.session = session
        self.outcomes: list[ChaosOutcome] = []
        self.violations: list[str] = []
        self.processes: set[tuple[str, int]] = set()
        """Service name and process group id of every service process seen so far."""
        self._events = list(events)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="chaos", daemon=True)
        self._began = 0.0
        self._signs: list[tuple[float, str, str]] = []

    def __enter__(self) -> Self:
        connect = self.session.listen
        self._bus = ZenohBus(client_options(connect, self.session.namespace))
        self._bus.subscribe(LOG, lambda delivery: self._on_log(delivery.message()), bounded=True)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        while self._thread.is_alive():  # what it waits for needs processes that are looked after
            with suppress(SurefootError):
                self.session.step()
            self._thread.join(LOOK_S)
        self._bus.close()

    @property
    def notes(self) -> tuple[str, ...]:
        """Return one sentence on each fault injected so far, for the report."""
        return tuple(_words(outcome) for outcome in self.outcomes)

    def fell_at(self) -> int | None:
        """Return the first control tick in which the simulated robot has fallen (ground truth); None if it has not."""
        kept = self.session.supervisor.kept
        truths = (cast(Truth, delivery.message()) for delivery in kept if delivery.topic.key == SIM_TRUTH.key)
        return next((truth.tick for truth in truths if truth.fallen), None)

    # -- what is noticed -----------------------------------------------------------------------------------------------

    def sign(self, who: str, text: str) -> None:
        """Record a text by which participant `who` shows that it noticed a fault, with its time; from any thread."""
        self._signs.append((time.monotonic(), who, text))

    def _on_log(self, message: Message) -> None:
        if isinstance(message, LogRecord) and message.level != "info":
            self.sign(message.source, message.text)

    def _look(self, service: str, before: SimStatus | None) -> None:
        """Record signs of a service fault: in the supervisor's table, on the bus, in a newer status than `before`."""
        for row in self.session.rows():
            if row.pid is not None:
                self.processes.add((row.service, row.pid))
            if row.service == service and (row.state != "healthy" or row.detail):
                self.sign("supervisor", f"{service} is {row.state}" + f" ({row.detail})" * bool(row.detail))
        if service not in self.session.alive:
            self.sign("bus", f"the token of {service} is gone")
        status = self.session.supervisor.status
        if status is None or status is before:
            return
        driver = self.session.driver or "driver"
        if service in status.missing:
            self.sign(driver, f"{status.state}, waits for {service}")
        if status.held and service == CMD_JOINTS.owner:
            self.sign(driver, f"{service}: {status.held}")
        if status.late:
            self.sign(driver, f"{service}: late, {status.rtf:.2f} x real time")

    def _noticed(self, event: ChaosEvent, since: float) -> tuple[float, str] | None:
        """Return (monotonic time, s; text) of the first sign after `since` that names the service or its topics."""
        names = (event.service, *(t.key for t in TOPICS if t.owner == self._owner(event.service)))
        for at, who, text in self._signs:
            if at >= since and any(name in text for name in names):
                return at, f"{who}: {text}"
        return None

    def _owner(self, service: str) -> str:
        return "driver" if service == self.session.driver else service

    # -- what happens --------------------------------------------------------------------------------------------------

    def _run(self) -> None:
        supervisor = self.session.supervisor
        while supervisor.ticks == 0 and not self._over.wait(LOOK_S):
            pass
        self._began = time.monotonic()
        for event in self._events:
            while supervisor.ticks <= event.tick and not supervisor.ended.is_set() and not self._over.is_set():
                self._over.wait(LOOK_S)
            if supervisor.ended.is_set() or self._over.is_set():
                return
            try:
                self._suffer(event)
            except Exception as error:
                self.violations.append(f"{event.kind} of {event.service}: {type(error).__name__}: {error}")

    def _suffer(self, event: ChaosEvent) -> None:
        """Inject a fault into the live system, wait until the system has recovered from it, and record the outcome."""
        session = self.session
        row = next(row for row in session.rows() if row.service == event.service)
        identity = None if row.pid is None else identify(row.pid)
        if identity is None:
            self.violations.append(f"{event.service} has no process in tick {session.supervisor.ticks}")
            return
        self._signs.clear()
        since, status = time.monotonic(), session.supervisor.status
        event = replace(event, tick=session.supervisor.ticks)
        before = self._unbound()
        match event.kind:
            case "kill":
                session.signal_kill(event.service)
            case "terminate":
                identity.signal_group(signal.SIGTERM)
            case "freeze":
                self._stand(identity, since + event.size, event.service, status)
            case "slow":
                while time.monotonic() < since + event.size:
                    self._stand(identity, time.monotonic() + SLOW_PERIOD_S * SLOW_SHARE, event.service, status)
                    self._wait(time.monotonic() + SLOW_PERIOD_S * (1.0 - SLOW_SHARE), event.service, status)
            case _:
                self._forge(event.count)
        over, ticks = time.monotonic(), session.supervisor.ticks
        gone = identity if event.kind in ("kill", "terminate") else None
        back = None
        while back is None and time.monotonic() < over + RECOVER_S:
            if self._over.is_set() and not session.supervisor.ended.is_set():
                break  # the run has ended before its time
            self._look(event.service, status)
            if event.kind == "forge":
                if self._unbound() >= before + event.count:
                    self.sign("simulator", f"{event.service}: {event.count} commands of a stranger refused")
                    back = time.monotonic()
            elif self._is_back(event.service, gone, ticks):
                back = time.monotonic()
            time.sleep(LOOK_S)
        noticed = self._noticed(event, since)
        outcome = ChaosOutcome(event, since - self._began, event.count)
        if back is not None:
            outcome = replace(outcome, recovered=back - self._began)
        if noticed is not None:
            outcome = replace(outcome, noticed=noticed[0] - self._began, by=noticed[1])
        self.outcomes.append(outcome)
        if back is None:
            what = "forged commands were not all refused" if event.kind == "forge" else "is not back"
            waited = time.monotonic() - over
            self.violations.append(f"{event.service} {what} {waited:.0f} s after {event.kind} in tick {event.tick}")

    def _stand(self, identity: Identity, until: float, service: str, status: SimStatus | None) -> None:
        """Stop a process group with SIGSTOP until a time `until` of the monotonic clock, s, then continue it."""
        identity.signal_group(signal.SIGSTOP)
        try:
            self._wait(until, service, status)
        finally:
            identity.signal_group(signal.SIGCONT)

    def _wait(self, until: float, service: str, status: SimStatus | None) -> None:
        while (left := until - time.monotonic()) > 0.0:
            self._look(service, status)
            time.sleep(min(LOOK_S, left))

    def _is_back(self, service: str, gone: Identity | None, ticks: int) -> bool:
        """Return True if a service is healthy, its process not `gone` and past tick `ticks`; else False."""
        session = self.session
        row = next(row for row in session.rows() if row.service == service)
        if row.state != "healthy" or row.pid is None or (gone is not None and row.pid == gone.pid):
            return False
        health = self._health(service)
        if health is None or health.pid != row.pid:
            return False
        if session.supervisor.ended.is_set():
            return health.state in WELL
        return health.state == "running" and min(health.tick, session.supervisor.ticks) > ticks

    def _health(self, service: str) -> Health | None:
        try:
            return self.session.call(HEALTH_GET.of(service), HealthRequest(), 0.3).health
        except CallError:
            return None

    def _unbound(self) -> int:
        health = self._health(self.session.driver)
        return 0 if health is None else health.refused.get("unbound", 0)

    def _forge(self, count: int) -> None:
        """Publish `count` forged joint commands for the current ticks in the walker's name, from another process."""
        last = next((d for d in reversed(self.session.supervisor.kept) if d.topic.key == SIM_TRUTH.key), None)
        if last is None:
            return
        truth = cast(Truth, last.message())
        publisher = self._bus.publisher(CMD_JOINTS, FORGER)
        for _ in range(count):
            tick = self.session.supervisor.ticks
            forged = JointCommand(position=tuple(q + FORGED_RAD for q in truth.joints))
            publisher.put(forged.stamped(tick * TICK_NS, tick, truth.epoch, tick, CMD_JOINTS.owner))
            time.sleep(LOOK_S)


def _words(outcome: ChaosOutcome) -> str:
    event, size = outcome.event, f" for {outcome.event.size:g} s" if outcome.event.size else ""
    noticed = "not noticed" if outcome.noticed is None else f"noticed after {outcome.noticed - outcome.began:.2f} s"
    by = f" ({outcome.by})" if outcome.by else ""
    back = "never back" if outcome.recovered is None else f"as before after {outcome.recovered - outcome.began:.2f} s"
    return f"chaos: {event.kind} of {event.service}{size} in tick {event.tick}: {noticed}{by}, {back}"
