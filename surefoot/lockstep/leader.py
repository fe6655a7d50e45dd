"""The driver's part of lockstep, without a bus or a clock: the roster of services, and when the next tick may come.

Protocol (a Kahn network with a bounded lag): the driver publishes tick k, and goes on when it has the command of tick
k - ``delay`` and no service on the roster lags more than ``window`` ticks. Only the driver changes the roster, between
two ticks.
"""

from dataclasses import dataclass, field
from typing import Any, Literal

from surefoot.schemas.hw import Tick
from surefoot.schemas.topics import CMD_JOINTS

State = Literal["idle", "joining", "running", "paused", "holding", "ended"]

WINDOW_TICKS = 20
"""Largest lag of the slowest member behind the driver in lockstep, ticks; beyond it the driver waits."""

PACED_COMMAND_LAG_TICKS, PACED_WINDOW_TICKS = 5, 60
"""`PACED_COMMAND_LAG_TICKS`: largest lag of the service that commands joints, ticks, in paced mode without a real-time
factor; `PACED_WINDOW_TICKS`: largest lag of other members there, ticks; beyond them the driver waits. A command is
stale after 10 ticks, a service 8 ticks behind skips ticks, and one that takes batches waits 30 ticks for a missing
input."""

KEEP_TICKS = WINDOW_TICKS + 2
"""Number of newest ticks whose outputs members keep, to send them again when the driver repeats a tick; the slowest
member may still need the tick a window before the last but one."""

REPORT_TICKS = 10
"""Interval at which members report that they have finished a tick, ticks; also before a pause or the end. It is half
the window, as each report costs the driver as much as a frame; batches go with the reports."""

COMMANDER = CMD_JOINTS.owner
"""Name of the service whose joint command a tick waits for; the command also counts as its report of the tick."""


@dataclass
class Member:
    """State of a service on the roster: its process, the last tick it has finished, the tick of its admission, and the
    tick with which its process begins: this one, or an earlier one that is sent again to a restarted process."""

    instance: str
    done: int
    admitted: int
    since: int


@dataclass
class Leader:
    """Roster of services and progress of one run, by which the driver decides when the next tick comes."""

    expect: tuple[str, ...] = ()
    delay: int = 1
    window: int = WINDOW_TICKS
    mode: Literal["lockstep", "paced"] = "lockstep"
    policy: Literal["hold", "degrade", "fail"] = "hold"
    seed: int = 0
    epoch: int = 0
    state: State = "idle"
    tick: int = -1
    """Number of the last tick published by the driver, -1 = none."""
    end_tick: int | None = None
    pause_tick: int | None = None
    comparable: bool = True
    roster_version: int = 0
    reason: str = ""
    members: dict[str, Member] = field(default_factory=dict[str, Member])
    ready: dict[str, str] = field(default_factory=dict[str, str])
    """Services that have tested their links but are not on the roster yet: name of the process by service."""
    lost: set[str] = field(default_factory=set[str])
    """Services on the roster whose process is gone and whose return is awaited."""
    _manifests: dict[int, Tick] = field(default_factory=dict[int, Tick])

    def begin(self, epoch: int) -> None:
        """Begin a new run with number ``epoch``: no service is ready until it has tested its links again."""
        self.epoch, self.tick, self.state = epoch, -1, "joining"
        self.members.clear()
        self.ready.clear()
        self.lost.clear()
        self._manifests.clear()
        self.roster_version, self.comparable, self.reason = 0, True, ""

    # -- events ------------------------------------------------------------------------------------------------

    def on_ready(self, service: str, instance: str) -> None:
        """Record that a service has tested its links and is ready to join the roster."""
        member = self.members.get(service)
        if member is None or member.instance != instance or service in self.lost:
            self.ready[service] = instance

    def knows(self, service: str, instance: str) -> bool:
        """Return whether a process is on the roster or ready to join it; another process of its service is not it."""
        member = self.members.get(service)
        return self.ready.get(service) == instance or (member is not None and member.instance == instance)

    def on_done(self, service: str, instance: str, tick: int) -> None:
        """Record that a member of the roster has finished a tick; reports of its former processes do not count."""
        member = self.members.get(service)
        if member is not None and member.instance == instance and tick > member.done:
            member.done = tick

    def on_command(self, tick: int) -> None:
        """Record that the joint command of a tick came, by which its sender reports that it has finished the tick."""
        member = self.members.get(COMMANDER)
        if member is not None and tick > member.done:
            member.done = tick

    def on_gone(self, service: str, instance: str) -> None:
        """Record that the process of a service has left the bus; if it is on the roster, `drop` it by the policy."""
        if self.ready.get(service) == instance:
            del self.ready[service]
        member = self.members.get(service)
        if member is None or member.instance != instance or self.state in ("idle", "ended"):
            return
        self.drop(service, f"{service} died")

    def on_back(self, service: str, instance: str) -> bool:
        """Record that a process is visible again; return whether it is a lost member, which goes on where it was."""
        member = self.members.get(service)
        if service not in self.lost or member is None or member.instance != instance:
            return False
        self.lost.discard(service)
        if not self.lost and self.state == "holding":
            self.state = "running"
        return True

    def drop(self, service: str, why: str) -> None:
        """Record the loss of a member: wait for its return, go on without it, or end the run, by the run's policy.

        `service`: name of the member; `why`: reason in words, kept for the status.
        """
        self.comparable = False
        self.reason = why
        if self.policy == "fail":
            self.state = "ended"
        elif self.policy == "hold" and self.mode == "lockstep":
            self.lost.add(service)
            if self.state == "running":
                self.state = "holding"
        else:
            self._remove(service)

    def awaited(self) -> list[tuple[str, str]]:
        """Return service and process of each lost member whose return is awaited."""
        return [(name, self.members[name].instance) for name in sorted(self.lost)]

    def give_up_waiting(self) -> tuple[str, ...]:
        """Remove the lost services from the roster, so that the run goes on without them, and return their names."""
        gone = tuple(sorted(self.lost))
        for service in gone:
            self._remove(service)
        self.lost.clear()
        if self.state == "holding":
            self.state = "running"
        return gone

    def _remove(self, service: str) -> None:
        self.members.pop(service, None)
        self.lost.discard(service)
        self.roster_version += 1

    # -- progress ----------------------------------------------------------------------------------------------

    def missing(self) -> tuple[str, ...]:
        """Return the services that the driver waits for: not ready before tick 0, lost, or too many ticks behind."""
        if self.state == "joining":
            return tuple(name for name in self.expect if name not in self.ready)
        if self.state == "holding":
            return tuple(sorted(self.lost))
        return tuple(name for name, member in self.members.items() if not self._far_enough(name, member))

    def _far_enough(self, name: str, member: Member) -> bool:
        if self.mode == "paced":
            lag = PACED_COMMAND_LAG_TICKS if name == COMMANDER else PACED_WINDOW_TICKS
        else:
            lag = self.delay if name == COMMANDER else self.window
        return member.done >= self.tick - lag

    def may_start(self) -> bool:
        """Return whether every expected service is ready."""
        return self.state == "joining" and not self.missing()

    def start(self) -> None:
        """Begin the run: the next tick published is tick 0."""
        self._admit()
        self.state = "running"

    def may_advance(self, *, gives_way: bool = True) -> bool:
        """Return whether the next tick may come; with ``gives_way`` only if no member lags more than allowed."""
        if self.state != "running":
            return False
        if not gives_way or self.tick < 0:
            return True
        return all(self._far_enough(name, member) for name, member in self.members.items())

    def all_done(self) -> bool:
        """Return whether every service on the roster has finished the last published tick."""
        return all(member.done >= self.tick for member in self.members.values())

    def slowest(self) -> str:
        """Return the member that lags most, of several the first in the order of ``expect``; empty: none lags."""
        order = {name: place for place, name in enumerate(self.expect)}
        behind = [name for name, member in self.members.items() if member.done < self.tick]
        return min(behind, key=lambda n: (self.members[n].done, order.get(n, len(order))), default="")

    def newcomers(self) -> bool:
        """Return whether a service is ready that is not on the roster yet."""
        return bool(self.ready)

    def _admit(self) -> None:
        if not self.ready:
            return
        for service, instance in self.ready.items():
            self.members[service] = Member(instance, self.tick, self.tick + 1, self.tick + 1)
            self.lost.discard(service)
        self.ready.clear()
        self.roster_version += 1

    def rejoin(self) -> range:
        """Admit the lost members that are ready again; return the range of ticks to send again, oldest first.

        A process that was only silent goes on where it was; a new process begins with one of these ticks.
        """
        first = min((m.done for n, m in self.members.items() if n not in self.lost), default=self.tick) + 1
        first = min(first, max(0, self.tick - self.delay))
        returned = {name: self.members[name] for name in self.lost if name in self.ready}
        self._admit()
        silent = {name for name, before in returned.items() if before.instance == self.members[name].instance}
        first = max(0, min([first, *(returned[name].done for name in silent)]))
        for name, before in returned.items():
            if name in silent:
                self.members[name] = before
            else:
                self.members[name].done, self.members[name].since = first - 1, first
        if not self.lost and self.state == "holding":
            self.state = "running"
        return range(first, self.tick + 1)

    def prime(self, roster: tuple[str, ...], due: tuple[str, ...]) -> Tick:
        """Return the manifest by which the services of ``roster`` test their links before their first tick."""
        return Tick(
            tick=-1, epoch=self.epoch, source="driver", roster=roster, roster_version=self.roster_version, due=due,
            mode=self.mode, seed=self.seed,
        )  # fmt: skip

    def advance(self, stamp_ns: int, due: tuple[str, ...], *, held: bool = False) -> Tick:
        """Advance to the next tick and return its manifest; services that are ready join the roster.

        Args:
            stamp_ns: simulated time of the tick, ns.
            due: keys of the topics with a sample in it.
            held: True if the joints are held, as commands are absent or refused.
        """
        if self.state == "running":
            self._admit()
        self.tick += 1
        end = self.tick == self.end_tick
        pause = self.pause_tick is not None and self.tick >= self.pause_tick
        manifest = Tick(
            stamp_ns=stamp_ns, tick=self.tick, epoch=self.epoch, seq=self.tick, source="driver",
            **self._roster(), due=due, mode=self.mode, seed=self.seed, end=end, held=held,
            report=end or pause or self.tick % REPORT_TICKS == REPORT_TICKS - 1,
        )  # fmt: skip
        self._manifests[self.tick] = manifest
        self._manifests.pop(self.tick - 4 * self.window, None)
        if manifest.end:
            self.state = "ended"
        elif pause:
            self.state, self.pause_tick = "paused", None
        return manifest

    def again(self, tick: int) -> Tick | None:
        """Return the manifest of an earlier tick with the present roster, to be sent again; None: no longer kept."""
        manifest = self._manifests.get(tick)
        if manifest is None:
            return None
        return manifest.model_copy(update=self._roster())

    def _roster(self) -> dict[str, Any]:
        """Return the fields of a manifest that describe the present roster."""
        roster = tuple(sorted(self.members))
        since = tuple(self.members[name].since for name in roster)
        return {"roster": roster, "roster_version": self.roster_version, "since": since if any(since) else ()}
