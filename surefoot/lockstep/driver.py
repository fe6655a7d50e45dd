"""Driver, the service that sets the time of all others, and its runtime: for simulators and hardware alike.

A driver publishes ``hw/*`` and takes ``cmd/joints``; the runtime keeps the roster of services, tests their links, sends
the manifest of each tick, waits as ``surefoot.lockstep.leader`` requires, repeats lost messages, and keeps the pace.
"""

import time
from collections.abc import Callable
from typing import Any, ClassVar, cast

from surefoot.bus.interface import Bus, Delivery, Life, Publisher
from surefoot.errors import Refusal
from surefoot.lockstep.commands import Commands
from surefoot.lockstep.join import DRIVER
from surefoot.lockstep.leader import COMMANDER, Leader
from surefoot.lockstep.node import Node
from surefoot.lockstep.pace import Pace
from surefoot.lockstep.sample import DueSample
from surefoot.lockstep.service import C, Service
from surefoot.schemas.base import Message
from surefoot.schemas.hw import JointCommand
from surefoot.schemas.system import Done, JoinReply, JoinRequest
from surefoot.schemas.topics import CMD_JOINTS, HW_TICK, SIM_JOIN, TICK_DONE, TICK_NS, Topic

PRIME_S = 0.02
JOIN_TIMEOUT_S = 90.0
"""Longest wait before tick 0 for a further service to become ready, s of wall time; after it the start is given up."""
HOLD_S = 120.0
"""Longest wait for the return of a lost member, s of wall time; after it the run ends."""
SILENCE_S, RESENDS, REPEAT_S = 0.25, 8, 1.0
"""`SILENCE_S`: wall time without progress after which the last ticks are sent again, s; `RESENDS`: number of these
repetitions after which the slowest member counts as lost; `REPEAT_S`: interval of repetitions while a lost member is
awaited, s."""
STATUS_S = 1.0
"""Longest wall time between two calls of ``Driver.on_status``, s, whether simulated time runs or not."""


class Driver(Service[C]):
    """Base of drivers: a subclass overrides `release` and `actuate`; its runtime has the roster and the clock."""

    leader: ClassVar[type[Leader]] = Leader
    lacking: tuple[Topic[Any], ...] = ()
    """Declared output topics that this hardware does not provide; no reader waits for them."""

    def release(self, tick: int) -> list[DueSample]:
        """Return the samples whose stamp is at or before the beginning of ``tick`` and that were not released yet."""
        raise NotImplementedError

    def reveal(self, tick: int) -> list[DueSample]:
        """Return the samples of ``observers_only`` topics of ``tick``; called after its frame is published.

        They are published with the next batch of ticks, or at once while an observer subscribes to one of the topics.
        """
        return []

    def actuate(self, tick: int, command: JointCommand | None) -> None:
        """Apply a joint command for one tick of time (None: keep the last one)."""
        raise NotImplementedError

    def latched(self) -> list[tuple[Topic[Any], Message]]:
        """Return the messages that hold for the whole run (latched), each with its topic."""
        return []

    def on_begin(self) -> None:
        """Prepare the first run, once, when the runtime is up."""

    def on_status(self) -> None:
        """Publish the state of simulated time, if the driver does so; called every `STATUS_S` of wall time."""

    def check(self, command: JointCommand) -> None:
        """Raise a Refusal if a joint command is one that the hardware must not obey."""

    @property
    def node(self) -> "DriverNode":
        """Runtime of the driver, which its handlers of queries use to reset, pause or step the run."""
        return cast(DriverNode, self.runtime)


class DriverNode(Node):
    """Runtime of a driver: roster, manifests of ticks, commands, pace."""

    def __init__(self, service: Driver[Any], bus: Bus, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(service, bus, clock)
        self.driver = service
        self.leader = Leader()
        self.pace = Pace(clock)
        self.commands = Commands()
        self.held = False
        """True while the joints are held, because commands stopped or are refused; False while commands apply."""
        self.gave_up = ""
        """Reason why the run was ended before its time, in words; empty = it was not."""
        self._judging = tuple(topic.key for topic in service.outputs if topic.observers_only)
        self._unrevealed: list[tuple[int, DueSample]] = []
        self._joining: dict[str, tuple[str, float]] = {}
        self._next_prime = self._next_repeat = self._next_status = 0.0
        self._since, self._resends = 0.0, 0
        self._awaited: set[str] = set()

    def start(self) -> None:
        self.service.handle(SIM_JOIN, self._on_join)
        super().start()
        self._publishers[HW_TICK.key] = self.bus.publisher(HW_TICK, self.instance)
        self.bus.take((TICK_DONE, CMD_JOINTS), self.inbox.put)
        self.bus.announce(DRIVER, self.instance)
        self.driver.on_begin()

    def _subscriptions(self) -> list[Topic[Any]]:
        return []  # the driver proves no links: participants do, and report it

    def begin(self, expect: tuple[str, ...], mode: str, rtf: float, delay: int, policy: str, seed: int) -> int:
        """Start a new run with settings as in `ResetRequest`, tick 0 once all links are tested; return its epoch."""
        leader = self.leader
        self._reveal()
        leader.expect, leader.delay, leader.seed = tuple(n for n in expect if n != self.name), delay, seed
        leader.mode, leader.policy = mode, policy  # pyright: ignore[reportAttributeAccessIssue] - literals of the request
        leader.end_tick = leader.pause_tick = None
        self.pace.begin(rtf if mode == "paced" else 0.0)
        self.commands, self.held, self.gave_up = Commands(), False, ""
        self._outbox.clear()
        self._answers.begin()
        leader.begin(leader.epoch + 1)
        self._since, self._resends = self.clock(), 0
        self.state = "ready"
        return leader.epoch

    def pause(self, at_tick: int | None, end: bool) -> int:
        """Pause time after a tick, by default the next one, and return that tick; ``end``: end the run there."""
        leader = self.leader
        tick = leader.tick + 1 if at_tick is None else at_tick
        if tick <= leader.tick:
            raise Refusal("late", f"at_tick {tick} has passed; the next tick is {leader.tick + 1}", "at_tick")
        setattr(leader, "end_tick" if end else "pause_tick", tick)
        return tick

    def resume(self, ticks: int | None) -> None:
        """Let time go on after a pause, for a number of ticks or (None) until the next request."""
        leader = self.leader
        if leader.state not in ("paused", "running"):
            raise Refusal("refused", f"the simulation is {leader.state}; only a paused one can go on")
        leader.pause_tick = None if ticks is None else leader.tick + ticks
        leader.state = self.state = "running"
        self.pace.resume(leader.tick)

    def _on_join(self, request: JoinRequest) -> JoinReply:
        if self.leader.state in ("idle", "ended"):
            return JoinReply(accepted=False, reason=f"the run is {self.leader.state}; wait for the next reset")
        if why := self.bindings.why_not(request.service, request.instance):
            return JoinReply(accepted=False, reason=why)
        self._joining[request.service] = request.instance, self.clock()
        return JoinReply(accepted=True)

    def _on_delivery(self, delivery: Delivery) -> None:
        try:
            message: Any = delivery.message()
            if isinstance(message, JointCommand):
                self._on_command(message, delivery.sender)
            elif isinstance(message, Done):
                self._on_done(message)
            else:
                self.service.on_message(delivery.topic, message)
        except Refusal as refusal:
            self.refuse(refusal.code, f"{delivery.topic.key}: {refusal.message}")

    def _on_command(self, command: JointCommand, sender: str) -> None:
        leader = self.leader
        if command.epoch != leader.epoch:
            self.refuse("stale_epoch")
            return
        try:
            self.commands.offer(command, leader.tick, self.driver.check, sender)
        except Refusal as refusal:
            if refusal.code != "stale":
                leader.on_command(command.tick)
            raise
        leader.on_command(command.tick)

    def _on_done(self, done: Done) -> None:
        if done.epoch != self.leader.epoch:
            return
        if done.tick > self.leader.tick:
            text = f"done of tick {done.tick} by {done.source} {done.instance!r}; the last one is {self.leader.tick}"
            self.refuse("too_far_ahead", text)
        elif not done.ready:
            self.leader.on_done(done.source, done.instance, done.tick)
        elif done.source in (self.name, DRIVER) or not self.bindings.bind(done.source, done.instance):
            self.refuse("unbound", f"{done.source} {done.instance!r} is ready, but is not the one that runs")
        elif self.bindings.visible(done.source, done.instance):  # else it is late, its process is gone
            self.leader.on_ready(done.source, done.instance)

    def on_life(self, life: Life) -> None:
        super().on_life(life)
        leader = self.leader
        if not life.alive:
            leader.on_gone(life.service, life.instance)
            if leader.state == "holding":
                self._since = self.clock()
        elif leader.on_back(life.service, life.instance):
            self._repeat_all()

    def work(self) -> bool:
        leader = self.leader
        if leader.state == "running":
            return self._run()
        if leader.state == "joining":
            return self._join_all()
        if leader.state == "holding":
            return self._hold()
        self.state = "ready"  # paused or ended: no tick comes
        if leader.state in ("paused", "ended") and not leader.all_done():
            self._watch_silence()  # the last messages may be lost, too
        return False

    def _join_all(self) -> bool:
        leader = self.leader
        if not leader.may_start():
            self._prime()
            awaited = set(leader.missing())
            if awaited != self._awaited:
                self._awaited, self._since = awaited, self.clock()
            if self.clock() - self._since > JOIN_TIMEOUT_S:
                missing = ", ".join(leader.missing())
                leader.reason = f"not ready after {JOIN_TIMEOUT_S:g} s: {missing}"
                leader.state = "idle"
                self.log("error", leader.reason)
            return False
        self._tell_latched()
        leader.start()
        self.state = "running"
        self.pace.resume(0)
        return True

    def _prime(self) -> None:
        now = self.clock()
        if now < self._next_prime:
            return
        self._next_prime = now + PRIME_S
        self.bus.cork()
        for topic in self.service.outputs:
            self._publishers[topic.key].prime()
        leader = self.leader
        roster = tuple(sorted({*leader.expect, *leader.members, *self._joining}))
        keys = {row.key for row in (*self.driver.outputs, *self.driver.serves)}
        due = tuple(sorted(keys - {row.key for row in self.driver.lacking}))
        self._publishers[HW_TICK.key].put(leader.prime(roster, due))
        self.bus.flush()

    def _tell_latched(self) -> None:
        """Publish the latched messages again under their first header, as they count in the hash of the run."""
        for topic, message in self.driver.latched():
            self._publishers[topic.key].put(message.relabelled(0, 0, self.leader.epoch, 0, self.name))

    def _hold(self) -> bool:
        leader = self.leader
        if leader.lost <= set(leader.ready):
            self._tell_latched()
            self._repeat(leader.rejoin())
            return True
        self._prime()
        now = self.clock()
        if now >= self._next_repeat and all(self.bindings.visible(*one) for one in leader.awaited()):
            self._next_repeat = now + REPEAT_S  # one is silent, perhaps because it asked another that lacks a tick
            self._repeat_all()
        if now - self._since > HOLD_S:
            gone = ", ".join(leader.give_up_waiting())
            self.gave_up = leader.reason = f"gave up waiting for {gone} after {HOLD_S:g} s: the run ends"
            self.log("error", leader.reason)
            leader.end_tick = leader.tick + 1
            self._repeat_all()
            return True
        return False

    def _run(self) -> bool:
        leader = self.leader
        if self._joining:
            self._admit_joiners()
        if self.pace.until_due(leader.tick + 1) > 0.0:
            return False
        # without a pace the slowest member sets it, in paced time too
        if not leader.may_advance(gives_way=self.pace.factor <= 0.0) or self._lacks_command():
            self._watch_silence()
            return False
        began = time.perf_counter_ns()
        if leader.tick >= 0:
            self.driver.actuate(leader.tick, self._command())
        if leader.newcomers():
            self._tell_latched()
        self._emit()
        self.join.last, self.epoch = leader.tick, leader.epoch  # for health
        self.tick_us.append((time.perf_counter_ns() - began) * 1e-3)
        return True

    def _lacks_command(self) -> bool:
        """Return whether lockstep lacks the joint command of this very tick; a later one does not replace it."""
        leader = self.leader
        walker, wanted = leader.members.get(COMMANDER), leader.tick - leader.delay
        if leader.mode != "lockstep" or walker is None or wanted < max(0, walker.admitted):
            return False
        return not self.commands.answered(wanted)

    def _command(self) -> JointCommand | None:
        """Return the command of tick t - delay; in paced mode the newest until then that was not obeyed yet."""
        leader = self.leader
        command = self.commands.take(leader.tick - leader.delay, exact=leader.mode == "lockstep")
        lost = self.commands.lost(leader.tick)
        if lost != self.held:
            self.held = lost
            what = "no command for 100 ms: the joints are held" if lost else "commands come again"
            self.log("warning" if lost else "info", f"{what} (tick {leader.tick})")
            self.driver.on_status()
        return command

    def _emit(self) -> None:
        leader = self.leader
        tick = leader.tick + 1
        samples = self.driver.release(tick)
        self.bus.cork()
        box = [self._notify(sample, tick) for sample in samples]
        due = (*(sample.topic.key for sample in samples), *self._judging)
        manifest = leader.advance(tick * TICK_NS, due, held=self.held)
        self._publishers[HW_TICK.key].put(manifest)
        self.bus.flush(batch=False)
        self._outbox[(leader.epoch, tick)] = box
        self._outbox.pop((leader.epoch, tick - 4 * leader.window), None)
        self._unrevealed += [(tick, sample) for sample in self.driver.reveal(tick)]
        if manifest.report or any(self._publishers[key].watched for key in self._judging):
            self.bus.cork()
            self._reveal()
            self.bus.flush(batch=manifest.report)
        self._since, self._resends = self.clock(), 0

    def _reveal(self) -> None:
        """Publish the samples of ``observers_only`` topics of the ticks since the last call."""
        for tick, sample in self._unrevealed:
            self._outbox.setdefault((self.leader.epoch, tick), []).append(self._notify(sample, tick))
        self._unrevealed.clear()

    def _notify(self, sample: DueSample, tick: int) -> tuple[Publisher[Any], Any]:
        message = sample.message() if callable(sample.message) else sample.message
        publisher = self._publishers[sample.topic.key]
        header = (sample.stamp_ns, tick, self.leader.epoch, sample.seq, self.name)
        return publisher, publisher.put(message.stamped(*header))

    def _repeat(self, ticks: range) -> None:
        for tick in ticks:
            self.bus.cork()
            for publisher, token in self._outbox.get((self.leader.epoch, tick), ()):
                publisher.resend(token)
            if (manifest := self.leader.again(tick)) is not None:
                self._publishers[HW_TICK.key].put(manifest)
            self.bus.flush()
        self._since = self._since if self.leader.state == "holding" else self.clock()

    def _repeat_all(self) -> None:
        """Send again every tick that a member may lack, from the last one that the slowest member finished."""
        first = min((member.done for member in self.leader.members.values()), default=self.leader.tick)
        self._repeat(range(max(0, min(first, self.leader.tick - self.leader.delay)), self.leader.tick + 1))

    def _watch_silence(self) -> None:
        leader = self.leader
        over = leader.state in ("paused", "ended")  # no member is dropped then; resend for HOLD_S
        if self.clock() - self._since < SILENCE_S or (over and self._resends > HOLD_S / SILENCE_S):
            return
        self._resends += 1
        if over or self._resends <= RESENDS:
            self.refused["resent_ticks"] += 1
            if any(member.done < member.admitted for member in leader.members.values()):
                self._tell_latched()  # one of them may be what a member's first tick lacks
            self._prime()  # a member that lost the prime of a new process refuses what that publishes
            self._repeat_all()
            return
        if silent := leader.slowest():
            self.log("error", f"{silent} is silent in tick {leader.tick}; it counts as lost")
            leader.drop(silent, f"{silent} is silent")
        self._resends = 0
        self._repeat_all()

    def _admit_joiners(self) -> None:
        now = self.clock()
        for service, (instance, asked) in list(self._joining.items()):
            if self.leader.knows(service, instance) or now - asked > 1.0:
                del self._joining[service]
        if self._joining:
            self._prime()

    def timers(self) -> float:
        wait = super().timers()
        leader, now = self.leader, self.clock()
        if now >= self._next_status:
            self._next_status = now + STATUS_S
            self.driver.on_status()
        if leader.state in ("joining", "holding") or self._joining:
            return min(wait, PRIME_S)
        if leader.state != "running":
            return wait
        if self.pace.factor > 0.0:
            return max(0.0, min(wait, self.pace.until_due(leader.tick + 1)))
        return min(wait, SILENCE_S)

    def _ask_to_join(self) -> None:
        return  # the driver is the one who is asked
