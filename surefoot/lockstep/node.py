"""Runtime of a service: it collects inputs, runs ticks, answers queries and publishes health, all on one thread.

All messages, from any thread, go into one inbox. ``pump`` handles those that are there; ``run`` waits for more.
"""

import math
import time
from collections import Counter, deque
from collections.abc import Callable
from contextlib import suppress
from queue import Empty
from typing import Any

from surefoot.bus.frame import Frame
from surefoot.bus.inbox import Inbox
from surefoot.bus.interface import Bus, Delivery, Incoming, Life, Publisher
from surefoot.errors import Refusal
from surefoot.heap import hand_back
from surefoot.kernels.compiling import COMPILING
from surefoot.lockstep.ages import Ages
from surefoot.lockstep.answers import Answers, LateAnswer
from surefoot.lockstep.binding import Bindings, is_prime
from surefoot.lockstep.health import health_of, join_request
from surefoot.lockstep.join import DRIVER, NAMED, Delayed, Join, TickInputs
from surefoot.lockstep.leader import KEEP_TICKS
from surefoot.lockstep.links import Links
from surefoot.lockstep.live_parameters import config_queries
from surefoot.lockstep.patience import Patience
from surefoot.lockstep.service import Service
from surefoot.logline import log_line, sendable, write_line
from surefoot.schemas.base import Message, Request, TickRequest
from surefoot.schemas.hw import Tick
from surefoot.schemas.rows import Rep, Req
from surefoot.schemas.system import Done, Health, HealthReply, LogRecord
from surefoot.schemas.topics import CMD_JOINTS, HEALTH, HEALTH_GET, HW_TICK, LOG, TICK_DONE, Kind, Query, Topic

JOIN_RETRY_S = 0.3
LOOK_S = 0.1  # a node looks into its inbox at least so often: a frame that it waits for may never come

_STOP, _TICK = object(), HW_TICK.key


class Node:
    """Runtime of one service on a bus, which runs its ticks and answers its queries."""

    def __init__(self, service: Service[Any], bus: Bus, clock: Callable[[], float] = time.monotonic) -> None:
        self.service, self.bus, self.clock = service, bus, clock
        self.name = service.name
        self.instance = bus.new_instance()
        self.inbox = Inbox()
        self.join = Join(service.name, service.inputs, service.batched)
        self.refused: Counter[str] = Counter()
        self.bindings = Bindings(bus.born_ms, self.refused, bus.add_watched)
        self._bound = self.bindings.bound
        self.ages = Ages(() if service.raw else service.inputs)
        self._logged: set[tuple[str, str]] = set()
        self.tick_us: deque[float] = deque(maxlen=2000)
        self.state, self.stopping = "starting", False
        self._publishers: dict[str, Publisher[Any]] = {}
        self._outbox: dict[tuple[int, int], list[tuple[Publisher[Any], Any]]] = {}
        self._observed = {topic.key for topic in service.observes}
        self.links = Links(bus, self.bindings, Patience(self.inbox, self.bindings, self._beat, lambda: self.stopping))
        self._answers = Answers(self.inbox.put, self.refuse, clock)
        self._tick: TickInputs | None = None
        self.epoch = -1
        self._begun: int = -1
        self._primed_at = self._next_health = self._next_join = 0.0
        self._counts_as_done = any(topic.key == CMD_JOINTS.key for topic in service.outputs)
        self._done = TICK_DONE.of(self.name)

    def start(self) -> None:
        """Declare publishers, prepare the service, declare its inputs and queries, then announce it on the bus."""
        service, put = self.service, self.inbox.put
        service.attach(self)
        for topic in self._subscriptions():
            if topic.observers_only and not service.batched:
                raise ValueError(f"{self.name} reads {topic.key!r}, which comes in batches, but is not batched")
        for topic in (*service.outputs, self._done, HEALTH.of(self.name), LOG.of(self.name)):
            self._publishers[topic.key] = self.bus.publisher(topic, self.instance)
        self.bus.announce(self.name, self.instance, ready=False)
        self.bus.serve(HEALTH_GET.of(self.name), self._early, instance=self.instance)  # all a cold service answers
        began, before = self.clock(), COMPILING.done
        with COMPILING.reporting(self._on_compile):
            service.on_start()
            service.rehearse()
        if self.state == "compiling":
            self.log("info", f"{COMPILING.done - before} kernels compiled in {self.clock() - began:.1f} s")
        for query in service.serves:
            if query.key not in service.handlers:
                raise ValueError(f"{self.name} declares {query.key!r} but registered no handler in on_start")
        self.bus.take(self._subscriptions(), put, batched=service.batched)
        for topic in service.observes:
            self.bus.subscribe(topic, lambda one, row=topic: self.inbox.put_observed(one.under(row)), bounded=True)
        for query in (*service.serves, *config_queries(service)):
            self.bus.serve(query, self.inbox.put_query, put, self.instance)
        needed = (*(t for t in self._subscriptions() if t.key != HW_TICK.key), *service.calls)
        self.bus.watch(put, {row.owner for row in needed} if self._subscriptions() else None)  # None: the driver
        self.links.need(needed)
        self.state = "joining"
        self.bus.announce(self.name, self.instance)

    def _early(self, incoming: Incoming) -> None:
        """Answer a question about health; while kernels compile it is answered at once, on the thread of the bus."""
        if self.state in ("starting", "compiling") and not incoming.probe:
            incoming.reply(HealthReply(health=self.health()))
        else:
            self.inbox.put_query(incoming)

    def _on_compile(self, name: str) -> None:
        """Publish health at each kernel that is compiled while the service prepares; log the name of the first."""
        if self.state == "starting":
            self.state = "compiling"
            self.log("info", f"compiling kernels, {name} first; `surefoot warm` does so ahead of time")
        self._publishers[f"health/{self.name}"].put(self.health())  # each kernel is progress

    def _subscriptions(self) -> list[Topic[Any]]:
        topics = [item.topic if isinstance(item, Delayed) else item for item in self.service.inputs]
        return [HW_TICK, *topics]

    def run(self) -> None:
        """Run the service until ``stop``; timed work such as heartbeats is due every ``LOOK_S`` even under load."""
        try:
            while not self.stopping:
                busy = self._work_until(self.clock() + LOOK_S)
                wait = min(self.timers(), LOOK_S)
                if busy:
                    continue
                with suppress(Empty):
                    self.handle(self.inbox.get(wait, self.join.awaited()))
        finally:
            self.state = "stopping"
            self.service.on_stop()

    def stop(self) -> None:
        """End ``run``; may be called from any thread or a signal handler."""
        self.stopping = True
        self.inbox.put(_STOP)

    def pump(self) -> bool:
        """Handle all waiting items and all ticks that are complete; return whether there was anything."""
        progressed = False
        while not self.stopping and self._turn(math.inf):
            progressed = True
        return progressed

    def _work_until(self, deadline: float) -> bool:
        """Handle waiting items until a time of the monotonic clock, s; return whether something may be left."""
        while not self.stopping and self._turn(deadline):
            if self.clock() >= deadline:
                return True
        return False

    def _turn(self, deadline: float) -> bool:
        """Handle what a tick needs, one query, one observed message, at most one tick; return whether any was there."""
        inbox, clock, endless = self.inbox, self.clock, deadline == math.inf
        items, take, progressed = inbox.tick.items, inbox.tick.get, bool(inbox.tick.items or inbox.heartbeats.items)
        while items and (endless or clock() < deadline):
            self.handle(take())
        while inbox.heartbeats.items:  # few, and a late one looks like a process that hangs
            self.handle(inbox.heartbeats.get())
        for lane in (inbox.queries, inbox.observed):
            if lane.items and clock() < deadline:
                self.handle(lane.get())
                progressed = True
        return self.work() or progressed

    def pump_once(self) -> bool:
        """Handle waiting items and at most one tick, so that nodes take turns; return whether there was anything."""
        progressed = self._turn(math.inf)
        if self._answers.late and not progressed:
            with suppress(Empty):  # an answer is worked out on another thread: there is nothing else to do
                self.handle(self.inbox.get(LOOK_S, set()))
            return True
        return progressed

    def timers(self) -> float:
        """Do the work that is due by wall time (heartbeat, request to join); return the seconds until the next."""
        self._beat()
        if (now := self.clock()) >= self._next_join:
            self._next_join = now + JOIN_RETRY_S
            if (self.join.outrun or not self.join.on_roster) and now - self._primed_at > JOIN_RETRY_S:
                self._ask_to_join()
        self._answers.expire(self.name)
        return max(0.0, min(self._next_health, self._next_join) - self.clock())

    def _beat(self) -> None:
        if (now := self.clock()) >= self._next_health:
            self._next_health = now + HEALTH.wall_period_s
            for trouble in self.bus.look_at_links():
                self.refuse(*trouble)
            self._publishers[f"health/{self.name}"].put(self.health())

    def _ask_to_join(self) -> None:
        for code in () if self.stopping else self.links.join(join_request(self)):
            self.refused[f"join_{code}"] += 1

    def handle(self, item: Any) -> None:
        """Handle one item of the inbox: message, frame, query, reply of another thread, or change of liveliness."""
        if isinstance(item, Delivery):
            owner, by = item.topic.owner, item.sender
            if not by or self._bound.get(owner) == by or not item.topic.signed or self._speaks(owner, by, item):
                if item.prime:
                    self.links.note(item.topic.key)
                else:
                    self._on_delivery(item)
        elif isinstance(item, Frame):
            self._on_frame(item)
        elif isinstance(item, Life):
            self.on_life(item)
        elif isinstance(item, LateAnswer):
            self._answers.arrived(item)
        elif item is not _STOP:
            self._on_query(item)

    def _on_frame(self, frame: Frame) -> None:
        try:
            deliveries = self.bindings.opened(frame)
        except Refusal as refusal:
            known = refusal.code != "unbound" or frame.owner in self._bound  # else it may be early, and is bound soon
            self.refuse(refusal.code, refusal.message if known else "", frame.owner)
            if refusal.code == "unbound":
                self.bindings.note_early(frame.owner, frame.instance)
            return
        owner, by = frame.owner, frame.instance
        if deliveries and (self._bound.get(owner) == by or self._speaks(owner, by, deliveries[-1])):
            for delivery in deliveries:
                delivery.sender = by
                if delivery.prime:
                    self.links.note(delivery.topic.key)
                else:
                    self._on_delivery(delivery)

    def _speaks(self, owner: str, instance: str, last: Delivery) -> bool:
        """Return whether a process is bound to the service `owner`; its first test of links (prime) may bind it."""
        before = self._bound.get(owner, "")
        if before == instance or owner == "*":
            return True
        if not is_prime(last) or not self.bindings.bind(owner, instance):
            self.refuse("unbound", before and f"{last.key} by {instance!r}, but the {owner} is {before!r}", last.key)
            self.bindings.note_early(owner, instance)
            return False
        self.refused -= Counter(unbound=self.bindings.forgive(owner, instance))
        if owner == DRIVER and before:  # a new driver begins a new count of epochs
            self.join = Join(self.name, self.service.inputs, self.service.batched)
            self.epoch, self._begun = -1, -1
            self._outbox.clear()
        return True

    def _on_delivery(self, delivery: Delivery) -> None:
        topic, key = delivery.topic, delivery.topic.key
        try:
            if key in self._observed:
                self.service.on_message(topic, delivery.message())
                return
            raw = self.service.raw and key != _TICK
            message: Any = delivery.header() if raw and topic.kind is not Kind.LATCHED else delivery.message()
        except Refusal as refusal:
            self.refuse(refusal.code, f"{key}{delivery.sender and f' by {delivery.sender!r}'}: {refusal.message}")
            return
        if key == _TICK and message.tick < 0:
            self._on_prime(message)
            return
        reason = self.join.offer(topic, message, delivery if raw else message, delivery.sender, delivery.size)
        if reason == "replay":
            self._replay(message.epoch, message.tick)
        elif reason not in (None, "duplicate"):
            self.refuse(reason, self.join.place(key, message, delivery.sender) if reason in NAMED else "", key)

    def refuse(self, reason: str, detail: str = "", about: str = "", number: int = 1) -> None:
        """Count refused items under their reason; log the first for each reason and key or service (``about``)."""
        self.refused[reason] += number
        if detail and (reason, about) not in self._logged:
            self._logged.add((reason, about))
            self.log("warning", f"refused ({reason}): {detail}")

    def _on_prime(self, prime: Tick) -> None:
        """Answer the driver's test of links (prime) by primes of all outputs; report ready once all links work."""
        self._primed_at = self.clock()
        if not self.join.announce(prime):
            self.refuse("misled", f"tick {self.join.last} of epoch {prime.epoch}, which the driver has yet to begin")
            return
        self.epoch = self.epoch if self.join.last >= 0 else -1  # -1: `on_reset` comes with the first tick
        self.bus.cork()
        for output in self.service.outputs:
            self._publishers[output.key].prime()
        self.bus.flush()
        self.join.absent = self.links.lacking(prime)
        if not self.links.prove(prime):
            return
        if self.state == "joining":
            self.state = "ready"
        self._publishers[self._done.key].put(self._done_with(-1, prime.epoch, ready=True))

    def on_life(self, life: Life) -> None:
        """Record that a process appeared or left; report a second process of a service that has one."""
        hand_back()
        if bound := self.bindings.on_life(life):
            self.refuse("second", f"process {life.instance!r} is {life.service}, too; {bound!r} is bound", life.service)

    def _on_query(self, incoming: Incoming) -> None:
        request = self._answers.request(incoming)
        if request is None:
            return
        if isinstance(request, TickRequest) and request.tick is not None and not self._has_seen(request):
            self._answers.wait(incoming, request)
            return
        self._answer(incoming, request)

    def _has_seen(self, request: TickRequest) -> bool:
        epoch = self.epoch if request.epoch is None else request.epoch
        if not self.join.same_tick and not self.join.delayed:
            return self.epoch >= epoch  # what it knows comes once per epoch, no tick changes it
        return (self.epoch, self.join.last) >= (epoch, request.tick or 0)

    def _answer(self, incoming: Incoming, request: Request) -> None:
        key, before = incoming.query.key, COMPILING.done_here
        if key == f"health/{self.name}":
            incoming.reply(HealthReply(health=self.health()))
        else:
            self._answers.settle(incoming, lambda: self.service.handlers[key](request), request)
        if COMPILING.done_here != before:  # a kernel that no rehearsal needs: never silently
            self.log("warning", f"{key} had to compile {COMPILING.last}; `surefoot warm --all` does so ahead of time")

    def work(self) -> bool:
        """Do the next tick if its inputs are complete; return whether it was done."""
        inputs = self.join.take()
        if inputs is None:
            return False
        began = time.perf_counter_ns()
        self._tick = inputs
        tick = inputs.tick
        if self.join.begun != self._begun:
            self.epoch, self._begun = tick.epoch, self.join.begun
            self._outbox.clear()
            self.ages.begin(self.service.limits)
            self._answers.begin()
            self.refused.pop("not_on_roster", None)  # ticks before it was admitted
            self.service.on_reset()
        self.ages.judge(inputs, self.join.absent, self.log)
        self.state = "running"
        self._outbox[(tick.epoch, tick.tick)] = []
        self.bus.cork()
        self.service.on_tick(inputs)
        self.bus.flush(batch=tick.report)
        if tick.report and not self._counts_as_done:
            self._send(self._done, self._done_with(tick.tick, tick.epoch))
        while len(self._outbox) > KEEP_TICKS:  # by number: a tick that was left out takes no earlier one with it
            del self._outbox[next(iter(self._outbox))]
        self._tick = None
        self.tick_us.append((time.perf_counter_ns() - began) * 1e-3)
        if self._answers.waiting:
            for incoming, request in self._answers.due(self._has_seen):
                self._answer(incoming, request)
        return True

    def _send(self, topic: Topic[Any], message: Message) -> None:
        publisher = self._publishers[topic.key]
        token = publisher.put(message)
        box = self._outbox.get((message.epoch, message.tick))
        if box is not None:
            box.append((publisher, token))

    def _replay(self, epoch: int, tick: int) -> None:
        """Publish a repeated tick's messages again, unchanged, and report the last tick that is done."""
        self.bus.cork()
        for publisher, token in self._outbox.get((epoch, tick), ()):
            publisher.resend(token)
        self.bus.flush()
        if not self._counts_as_done:
            self._publishers[self._done.key].put(self._done_with(self.join.last, epoch))

    def _done_with(self, tick: int, epoch: int, *, ready: bool = False) -> Done:
        return Done(tick=tick, epoch=epoch, source=self.name, instance=self.instance, ready=ready)

    def publish(self, topic: Topic[Any], message: Message, stamp_ns: int | None) -> None:
        if topic.key not in self._publishers:
            raise ValueError(f"{self.name} publishes {topic.key!r} but does not declare it in outputs")
        if self._tick is None:
            return self._publishers[topic.key].put(message.model_copy(update={"source": self.name}))
        tick = self._tick.tick
        stamp, seq = tick.stamp_ns if stamp_ns is None else stamp_ns, tick.tick // max(1, topic.period_ticks)
        if topic.period_ticks == 0 or topic.due(tick.tick):
            self._send(topic, message.stamped(stamp, tick.tick, tick.epoch, seq, self.name))

    def call(self, query: Query[Req, Rep], request: Req, timeout_s: float | None) -> Rep:
        if query not in self.service.calls:
            raise ValueError(f"{self.name} calls {query.key!r} but does not declare it in calls")
        return self.links.call(query, request, timeout_s, None if self._tick is None else self._tick.tick)

    def log(self, level: str, text: str) -> None:
        write_line(log_line(level, self.name, text, self.join.last))
        publisher = self._publishers.get(f"log/{self.name}")
        if publisher is not None:
            publisher.put(LogRecord(source=self.name, level=level, text=sendable(text[:2000])))  # pyright: ignore[reportArgumentType]

    def health(self) -> Health:
        """Return the present health message of this node's service."""
        return health_of(self, (*self.links.unproved, *self.join.missing()))
