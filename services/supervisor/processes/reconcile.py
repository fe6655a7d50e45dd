"""Decisions of the supervisor: from wanted and observed services to actions. Pure functions: times are arguments.

Time in which a process waited for a processor does not count as silence, since it could not report then.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from surefoot.errors import EXIT_USAGE

from .compose import ComposeService, Restart

BACKOFF_FIRST_S = 0.1  # s, wait before the first restart: a robot stands and waits meanwhile
BACKOFF_FACTOR = 2.0  # each further restart waits this much longer
BACKOFF_MAX_S = 10.0  # s
MAX_FAILURES = 8  # ends in a row after which the reconciler gives up (0.1 s .. 10 s: about 23 s of trying)
STABLE_S = 10.0  # s of health after which earlier failures are forgotten
LEAST_SILENCE = 0.1  # of the time without a sign of life counts, however busy the machine is: a hang is found at last

Phase = Literal["absent", "running", "exited"]
Verb = Literal["start", "stop", "kill", "wait", "give_up"]


@dataclass(frozen=True)
class Wanted:
    """Demands of the compose file on one service that decide about actions.

    Attributes:
        name: name of the service.
        after: (service, must be healthy) pairs that have to hold before the start.
        restart: what to do when the process ends by itself.
        max_failures: ends in a row after which the reconciler gives up.
        grace_s: wall time between SIGTERM and SIGKILL, s.
        start_period_s: wall time a new process may take to become healthy, s.
        watched: True if health is checked; False: a running process counts as healthy.
    """

    name: str
    after: tuple[tuple[str, bool], ...] = ()
    restart: Restart = "no"
    max_failures: int = MAX_FAILURES
    grace_s: float = 2.0
    start_period_s: float = 20.0
    watched: bool = True


@dataclass(frozen=True)
class Observed:
    """Observed state of one service, by its process and by the bus. Times are wall seconds of one monotonic clock.

    Attributes:
        phase: absent (never started), running or exited.
        since: when the phase began.
        healthy: True if heartbeats come and the service reports that it is well.
        healthy_since: when `healthy` last became true in the life of this process, None before that.
        unhealthy_since: when health was last lost while running, None before that.
        stopping_since: when SIGTERM was sent, None before that.
        killed: True if SIGKILL was sent.
        exit_code: exit code of the exited process, negative for a signal; None before its end.
        failures: ends (or losses of health) in a row, this one included.
        progress: last sign of progress while starting; the start period counts from there. None: from `since`.
        why: in words, which signs of life of an unhealthy process are missing.
    """

    phase: Phase = "absent"
    since: float = 0.0
    healthy: bool = False
    healthy_since: float | None = None
    unhealthy_since: float | None = None
    stopping_since: float | None = None
    killed: bool = False
    exit_code: int | None = None
    failures: int = 0
    progress: float | None = None
    why: str = ""


@dataclass(frozen=True)
class ProcessAction:
    """One action that the supervisor has to take on the process of a service.

    Attributes:
        verb: start, stop (SIGTERM), kill (SIGKILL), wait, give_up.
        service: name of the service.
        reason: in words, for the log and for `surefoot status`.
        until: time at which a wait ends, s, on the clock of `plan`; None for other actions.
    """

    verb: Verb
    service: str
    reason: str = ""
    until: float | None = None


ABSENT = Observed()


@dataclass(frozen=True)
class Signs:
    """Signs of life of one process: start, heartbeats, ticks. Times are wall seconds of one monotonic clock.

    Attributes:
        since: when the process was started.
        progress: its last sign of progress: start, heartbeat of any state, tick.
        starved: seconds waited for a processor until its silence was noticed; None while it is not silent.
        well: True once a heartbeat or a tick showed that the process is ready for work.
        hidden: when its liveliness token was lost, None while it is visible.
    """

    since: float
    progress: float
    starved: float | None = None
    well: bool = False
    hidden: float | None = None

    def heard(self, now: float, *, well: bool) -> "Signs":
        """Return the signs of life after a heartbeat or tick at time `now`, s; `well`: it showed readiness for work."""
        return replace(self, progress=now, starved=None, well=self.well or well)

    def seen(self, now: float, *, visible: bool) -> "Signs":
        """Return the signs of life after the liveliness token appeared (`visible`) or vanished at time `now`, s."""
        return replace(self, hidden=None if visible else now)

    def quiet(self, now: float) -> float:
        """Return the time since the last sign of progress, s."""
        return max(0.0, now - self.progress)

    def silence(self, now: float, starved: float) -> float:
        """Return the time since the last sign of progress without the time waited for a processor, s.

        At least a tenth of the time counts, as the waits of several threads may add up to more than it. `now`: wall
        time, s; `starved`: seconds that the process has waited for a processor so far.
        """
        waited = max(0.0, starved - self.starved) if self.starved is not None else 0.0
        return max(self.quiet(now) - waited, LEAST_SILENCE * self.quiet(now))

    def words(self, now: float) -> str:
        """Return in words for how long heartbeat and liveliness token have been missing."""
        lost = f"no heartbeat for {now - self.progress:.1f} s"
        return lost if self.hidden is None else f"{lost}, {self.token(now)}"

    def token(self, now: float) -> str:
        """Return in words for how long the liveliness token has been missing; empty while the process is visible."""
        return "" if self.hidden is None else f"not visible on the bus for {now - self.hidden:.1f} s"


def wanted_from(service: ComposeService) -> Wanted:
    """Return the demands on a service that decide about actions, from its entry in a compose file."""
    check = service.healthcheck
    return Wanted(
        name=service.name,
        after=tuple((name, condition == "service_healthy") for name, condition in service.depends_on),
        restart=service.restart,
        max_failures=MAX_FAILURES if service.max_restarts is None else service.max_restarts + 1,
        grace_s=service.stop_grace_s,
        start_period_s=check.start_period_s if check else 0.0,
        watched=check is not None,
    )


def backoff_s(failures: int) -> float:
    """Return the wait before a restart after `failures` ends in a row, s."""
    exponent = min(max(failures, 1) - 1, 60)
    return min(BACKOFF_FIRST_S * BACKOFF_FACTOR**exponent, BACKOFF_MAX_S)


def failures_after(observed: Observed, now: float) -> int:
    """Return the failures in a row when the process of `observed` has just ended by itself."""
    stable = observed.healthy_since is not None and now - observed.healthy_since >= STABLE_S
    return 1 if stable else observed.failures + 1


def plan(
    wanted: Sequence[Wanted], observed: Mapping[str, Observed], now: float, *, shutdown: bool = False
) -> tuple[ProcessAction, ...]:
    """Decide at most one action per service.

    Args:
        wanted: the services that should run.
        observed: what is known about each; missing ones are absent.
        now: wall time on the clock of `observed`, s.
        shutdown: True stops everything; a service stops before the ones it depends on.

    Returns:
        Actions in the order of `wanted`, then stops of services that are not wanted any more. No action for a service
        that is as it should be.
    """
    names = {item.name for item in wanted}
    actions = [
        _stop_in_order(item, wanted, observed, now) if shutdown else _run(item, observed, now) for item in wanted
    ]
    strangers = [name for name in observed if name not in names]
    actions += [_stop(Wanted(name), observed[name], now, "not wanted any more") for name in strangers]
    return tuple(action for action in actions if action is not None)


def settled(wanted: Sequence[Wanted], observed: Mapping[str, Observed]) -> bool:
    """Return True if every wanted service runs and is healthy."""
    return all(_satisfied(observed.get(item.name, ABSENT), healthy=item.watched) for item in wanted)


def _satisfied(state: Observed, *, healthy: bool) -> bool:
    return state.phase == "running" and state.stopping_since is None and (state.healthy or not healthy)


def _run(item: Wanted, observed: Mapping[str, Observed], now: float) -> ProcessAction | None:
    state = observed.get(item.name, ABSENT)
    match state.phase:
        case "running":
            if state.stopping_since is not None:
                return _stop(item, state, now, "")
            return _watch(item, state, now)
        case "exited":
            ended_as_unwell = state.stopping_since is not None and item.restart != "no"
            if not ended_as_unwell and not _wants_restart(item.restart, state.exit_code):
                return None
            if state.exit_code == EXIT_USAGE and state.healthy_since is None:  # the same again would end the same way
                return ProcessAction("give_up", item.name, f"{_ending(state)}: it cannot use its configuration")
            if state.failures >= item.max_failures:
                return ProcessAction(
                    "give_up", item.name, f"ended {state.failures} times in a row, last {_ending(state)}"
                )
            due = state.since + backoff_s(state.failures)
            if now < due:
                return ProcessAction("wait", item.name, f"{_ending(state)}; restart in {due - now:.1f} s", due)
            return _start(item, observed, f"restart after it {_ending(state)}")
        case "absent":
            return _start(item, observed, "wanted")


def _watch(item: Wanted, state: Observed, now: float) -> ProcessAction | None:
    """Return the action on a running process: None if healthy or still starting, else to end it because it hangs."""
    if not item.watched or state.healthy:
        return None
    if state.unhealthy_since is not None:
        if item.restart == "no":
            return ProcessAction("wait", item.name, state.why or "unhealthy")
        return ProcessAction("stop", item.name, state.why or "unhealthy")
    deadline = (state.since if state.progress is None else state.progress) + item.start_period_s
    if now < deadline or item.restart == "no":
        return ProcessAction("wait", item.name, "starting", deadline if now < deadline else None)
    return ProcessAction("stop", item.name, f"no progress for {item.start_period_s:g} s of its start")


def _start(item: Wanted, observed: Mapping[str, Observed], reason: str) -> ProcessAction:
    missing = [name for name, healthy in item.after if not _satisfied(observed.get(name, ABSENT), healthy=healthy)]
    if missing:
        return ProcessAction("wait", item.name, f"waits for {', '.join(missing)}")
    return ProcessAction("start", item.name, reason)


def _stop_in_order(
    item: Wanted, wanted: Sequence[Wanted], observed: Mapping[str, Observed], now: float
) -> ProcessAction | None:
    users = [
        other.name
        for other in wanted
        if item.name in (name for name, _ in other.after) and observed.get(other.name, ABSENT).phase == "running"
    ]
    state = observed.get(item.name, ABSENT)
    if users and state.phase == "running" and state.stopping_since is None:
        return ProcessAction("wait", item.name, f"stops after {', '.join(users)}")
    return _stop(item, state, now, "shutdown")


def _stop(item: Wanted, state: Observed, now: float, reason: str) -> ProcessAction | None:
    if state.phase != "running":
        return None
    if state.stopping_since is None:
        return ProcessAction("stop", item.name, reason)
    deadline = state.stopping_since + item.grace_s
    if now >= deadline and not state.killed:
        return ProcessAction("kill", item.name, f"did not end within {item.grace_s:g} s")
    return ProcessAction("wait", item.name, "stopping", None if state.killed else deadline)


def _wants_restart(restart: Restart, exit_code: int | None) -> bool:
    if restart == "on-failure":
        return exit_code != 0
    return restart in ("always", "unless-stopped")


def _ending(state: Observed) -> str:
    code = state.exit_code
    if code is None:
        return "ended"
    return f"was killed by signal {-code}" if code < 0 else f"ended with exit code {code}"
