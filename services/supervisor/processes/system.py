"""Processes of a running system: observed, compared with the compose file, started and stopped."""

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Protocol

from surefoot.logline import said
from surefoot.schemas.system import ServiceStatus

from .compose import Compose, ComposeService
from .forks import ForkServer, fork_server
from .identity import await_end
from .logs import tail
from .process import Child
from .reconcile import (
    ABSENT,
    Observed,
    ProcessAction,
    Signs,
    failures_after,
    plan,
    settled,
    wanted_from,
)
from .rundir import RunFolder

SELF = "supervisor"  # listed in the compose file for container engines; here it is this very process
STEP_S = 0.02  # s, how often processes are looked at
NOTICED_S = 1.25  # s without a sign of life (heartbeats come each second): its waiting for a processor is read
LAST_LINES = 50  # of a log, among which its last words are looked for
PAUSE_S = 1.0  # s; a longer gap between two looks means that the machine was suspended


class Process(Protocol):
    """Interface of a process: `Child`, or a stand-in in tests."""

    pid: int

    def poll(self) -> int | None:
        """Exit code of the process, negative for a signal; None while it runs."""

    def terminate(self) -> None:
        """Request the end of the process (SIGTERM)."""

    def kill(self) -> None:
        """End the process at once (SIGKILL)."""

    def starved_s(self) -> float:
        """Seconds that threads of the process, and those of this one, have waited for a processor."""
        ...


class System:
    """Processes of the services of a compose file, started, watched and ended by the reconciler's plan."""

    def __init__(
        self,
        compose: Compose,
        folder: RunFolder,
        *,
        environment: Mapping[str, str] | None = None,
        extra_arguments: Mapping[str, tuple[str, ...]] | None = None,
        clock: Callable[[], float] = time.monotonic,
        spawn: Callable[[ComposeService], Process] | None = None,
        on_action: Callable[[ProcessAction], None] = lambda action: None,
    ) -> None:
        self.compose = compose
        self.folder = folder
        self._environment = dict(environment or {})
        self._arguments = dict(extra_arguments or {})
        self._clock = clock
        self._spawn = spawn or self._start_process
        self._forks: ForkServer | None = None
        self._on_action = on_action
        self._services = {name: service for name, service in compose.services.items() if name != SELF}
        self._wanted = tuple(
            replace(wanted, after=tuple(need for need in wanted.after if need[0] != SELF))
            for wanted in map(wanted_from, self._services.values())
        )
        self._processes: dict[str, Process] = {}
        self._observed: dict[str, Observed] = {}
        self._signs: dict[str, Signs] = {}
        self._notes: dict[str, ProcessAction] = {}
        self._noting = threading.Lock()
        self._restarts = dict.fromkeys(self._services, 0)
        self._looked: float | None = None
        self._unstored = False
        """True while processes have changed since their identities were last stored."""

    @property
    def service_names(self) -> tuple[str, ...]:
        """Services that are processes of their own, in dependency order."""
        return tuple(self._services)

    def prepare(self) -> None:
        """Start a process that imports the services, from which each is forked; no service starts before it is done."""
        self._forks = fork_server(self._services.values())

    def heard(self, service: str, pid: int, *, well: bool) -> None:
        """Record a heartbeat of a process; `well` false: it is still starting. Any thread may call it.

        One of a process that is not of this system is ignored, whatever service it names.
        """
        process = self._processes.get(service)
        if process is not None and process.pid == pid:
            self._note(service, well=well)

    def ticked(self, service: str) -> None:
        """Record that a service's outputs came in a tick. Any thread may call it."""
        self._note(service, well=True)

    def seen(self, service: str, *, visible: bool) -> None:
        """Record that a service's liveliness token appeared or vanished. Any thread may call it."""
        with self._noting:
            signs = self._signs.get(service)
            if signs is not None:
                self._signs[service] = signs.seen(self._clock(), visible=visible)

    def _note(self, service: str, *, well: bool) -> None:
        with self._noting:
            signs = self._signs.get(service)
            if signs is not None:
                self._signs[service] = signs.heard(self._clock(), well=well)

    def step(self, *, shutdown: bool = False) -> tuple[ProcessAction, ...]:
        """Check every process once; carry out and return the actions that the reconciler decides on."""
        if self._forks is not None and not self._forks.ready() and not shutdown:
            return ()
        now = self._clock()
        if self._looked is not None and now - self._looked > PAUSE_S:
            self._forgive_silence(now)
        self._looked = now
        for name in self._services:
            self._observed[name] = self._observe(name, now)
        actions = plan(self._wanted, self._observed, now, shutdown=shutdown)
        self._notes = {action.service: action for action in actions}
        for action in actions:
            self._unstored |= self._act(action, now)
        if self._unstored:
            self._unstored = not self._store()
        return actions

    def settled(self) -> bool:
        """Return True if every wanted service runs and is healthy."""
        return settled(self._wanted, self._observed)

    def given_up(self) -> tuple[str, ...]:
        """Return the services that are not restarted any more although they should run."""
        ended = {name for name, state in self._observed.items() if state.phase == "exited" and name not in self._notes}
        given_up = {name for name, note in self._notes.items() if note.verb == "give_up"}
        return tuple(name for name in self._services if name in ended | given_up)

    def failure(self) -> str:
        """Return the reason why a service does not run and is not restarted any more, empty while there is none."""
        for name in self.given_up():
            log = self.folder.log(name)
            words = said(next((line.strip() for line in reversed(tail(log, LAST_LINES)) if line.strip()), ""))[:300]
            why = self._row(name).detail or "ended"
            return f"{name} does not run ({why})" + (f": {words}" if words else "") + f"; see {log}"
        return ""

    def running(self) -> bool:
        """Return True if a process of the system lives."""
        return any(process.poll() is None for process in self._processes.values())

    def wait(self, patience_s: float) -> None:
        """Wait until a process ends, at most `patience_s` of wall time."""
        running = [self._processes[name].pid for name, state in self._observed.items() if state.phase == "running"]
        if not await_end(running, patience_s):
            time.sleep(patience_s)

    def stop(self, patience_s: float = 30.0) -> bool:
        """End all processes in order, within `patience_s` of wall time; return True when all are gone."""
        deadline = self._clock() + patience_s
        while self.running() and self._clock() < deadline:
            self.step(shutdown=True)
            self.wait(STEP_S)
        self.step(shutdown=True)
        if self._forks is not None:
            self._forks.close()
        return not self.running()

    def signal_kill(self, service: str) -> None:
        """Kill the process of a service at once (SIGKILL), for a `kill` step of a scenario."""
        process = self._processes.get(service)
        if process is not None:
            process.kill()

    def rows(self) -> tuple[ServiceStatus, ...]:
        """Return the rows of `surefoot status`: state, process id and restarts of each service."""
        return tuple(self._row(name) for name in self._services)

    def _row(self, name: str) -> ServiceStatus:
        state = self._observed.get(name, ABSENT)
        note = self._notes.get(name)
        words = {"absent": "stopped", "exited": "stopped", "running": "healthy" if state.healthy else "starting"}
        word = words[state.phase]
        if state.phase == "running" and not state.healthy and state.unhealthy_since is not None:
            word = "unhealthy"
        if note is not None and state.phase == "exited":
            word = "failed" if note.verb == "give_up" else "backoff"
        pid = self._processes[name].pid if state.phase == "running" else None
        signs = self._signs.get(name)
        hidden = signs.token(self._clock()) if signs is not None and state.healthy else ""
        detail = note.reason if note else hidden
        return ServiceStatus(service=name, state=word, pid=pid, restarts=self._restarts[name], detail=detail)

    def _observe(self, name: str, now: float) -> Observed:
        """Return the present state of the process of a service."""
        state = self._observed.get(name, ABSENT)
        if state.phase != "running":
            return state
        code = self._processes[name].poll()
        if code is not None:
            failures = failures_after(state, now)
            ended = Observed(phase="exited", since=now, exit_code=code, failures=failures)
            return replace(ended, healthy_since=state.healthy_since, stopping_since=state.stopping_since)
        signs, check = self._signs[name], self._services[name].healthcheck
        silence = (
            0.0 if check is None else self._silence(name, now, min(NOTICED_S, 0.5 * check.interval_s * check.retries))
        )
        well = check is None or (signs.well and silence <= check.interval_s * check.retries)
        if not well and not state.healthy:
            return replace(state, progress=now - silence, why=signs.words(now))
        if well == state.healthy:
            return state
        if well:
            return replace(state, healthy=True, healthy_since=now, unhealthy_since=None, why="")
        return replace(state, healthy=False, unhealthy_since=now, why=signs.words(now))

    def _silence(self, name: str, now: float, noticed: float) -> float:
        """Return the time in which a process could have given a sign of life and gave none, s.

        Waits for a processor are read only once a process is silent for `noticed` s: each has some thirty threads.
        """
        if self._signs[name].quiet(now) < noticed:
            return self._signs[name].quiet(now)
        starved = self._processes[name].starved_s()
        with self._noting:
            signs = self._signs[name]
            if signs.starved is None and signs.quiet(now) >= noticed:
                self._signs[name] = signs = replace(signs, starved=starved)
        return signs.silence(now, starved)

    def _forgive_silence(self, now: float) -> None:
        """Count silence from now on: while this process slept, no sign of life could reach it."""
        with self._noting:
            self._signs = {name: replace(signs, progress=now, starved=None) for name, signs in self._signs.items()}

    def _act(self, action: ProcessAction, now: float) -> bool:
        """Carry out one action; return True if the set of processes changed."""
        name = action.service
        state = self._observed.get(name, ABSENT)
        if action.verb not in ("start", "stop", "kill"):
            return False
        self._on_action(action)
        match action.verb:
            case "start":
                if state.phase == "exited":
                    self._restarts[name] += 1
                try:
                    self._processes[name] = self._spawn(self._services[name])
                except OSError:
                    ended = Observed(phase="exited", since=now, exit_code=127, failures=state.failures + 1)
                    self._observed[name] = ended
                    return False
                self._signs[name] = Signs(now, now, self._processes[name].starved_s())
                self._observed[name] = Observed(phase="running", since=now, failures=state.failures)
            case "stop":
                self._processes[name].terminate()
                self._observed[name] = replace(state, stopping_since=now)
            case "kill":
                self._processes[name].kill()
                self._observed[name] = replace(state, killed=True)
        return True

    def _start_process(self, service: ComposeService) -> Process:
        command = (*service.command, *self._arguments.get(service.name, ()))
        environment = {**self._environment, **service.environment}
        return Child(service.name, command, environment, self.folder.log(service.name), self._forks)

    def _store(self) -> bool:
        """Store the identities of the system's processes for a successor, in case this supervisor dies.

        Return False if that failed, as on a full disk.
        """
        found = {
            name: process.identity
            for name, process in self._processes.items()
            if isinstance(process, Child) and process.identity is not None and process.poll() is None
        }
        return self.folder.write_processes(found)
