"""Collection of the inputs of a service for each control tick: the service's part of lockstep, without a bus.

A service computes each tick from its declared inputs. Inputs are matched by the tick number in their header, never by
the order of their arrival, so every run with the same seed has the same inputs.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Generic, cast

from surefoot.bus.inbox import SMALL_BYTES
from surefoot.schemas.base import Header
from surefoot.schemas.hw import Tick
from surefoot.schemas.rows import M
from surefoot.schemas.topics import HW_TICK, TICK_NS, Kind, Topic

DRIVER = "driver"
_TICK = HW_TICK.key
NAMED = ("epoch_ahead", "stale_epoch", "too_far_ahead", "stamp", "conflict", "too_much")
"""Codes of refused inputs whose log line names the key of the input and the process that sent it."""

SENDER_BYTES = 16 << 20
"""Limit on a service's waiting inputs, bytes; one of up to `SMALL_BYTES` counts 0."""

MISLED_PRIMES = 3
"""Number of primes in a row of a run not yet begun, after which a service that did ticks of that run counts as misled
by another process. More than one, because the network may deliver a prime twice, and late."""

MAX_AHEAD = 64
"""Largest lead of an input over the newest tick, ticks; an input further ahead is refused."""

MOST_KINDS = 256  # ticks that differ in samples, roster or phase, of which the wanted keys are kept

STAMP_SLACK_NS = 1_000_000_000
"""Tolerance of an input's stamp, ns, before the beginning of the run and after the input's own tick; else refused."""

PATIENCE_TICKS = 2
"""Number of later ticks, or of repetitions of the newest tick by the driver, after which a tick with missing inputs is
done in paced mode; the driver repeats before a pause and at the end."""

BACKLOG_TICKS = 8
"""Lag in paced mode, ticks, from which a service skips ticks; below it all ticks are done in order, as services that
skip every second tick would lack each other's messages for ever."""

BATCH_PATIENCE_TICKS, BATCH_BACKLOG_TICKS = 30, 1000
"""`BATCH_PATIENCE_TICKS`: number of later ticks after which a batched service does a tick with missing inputs in paced
mode; `BATCH_BACKLOG_TICKS`: lag of a batched service, ticks, from which it skips ticks."""


@dataclass(frozen=True)
class Delayed(Generic[M]):
    """Declared input that a tick takes from the tick before, so that feedback makes no cycle within a tick."""

    topic: Topic[M]


Input = Topic[Any] | Delayed[Any]


@dataclass(frozen=True)
class TickInputs:
    """Inputs of a service in one control tick: the manifest of the tick, and a message by topic key."""

    tick: Tick
    messages: dict[str, Any] = field(repr=False)
    late: dict[str, float] = field(default_factory=dict[str, float], repr=False)
    """Age of each input without a new sample for longer than its limit, s of simulated time, by key."""

    @property
    def number(self) -> int:
        """Number of the control tick that these inputs belong to."""
        return self.tick.tick

    def get(self, topic: Topic[M]) -> M | None:
        """Return a topic's message in this tick (delayed input: in the last tick; latched one: the newest), or None."""
        return cast(M | None, self.messages.get(topic.key))


class Join:
    """Collection of the inputs of one service, which returns them tick by tick (`take`)."""

    def __init__(self, service: str, inputs: Iterable[Input], batched: bool = False) -> None:
        self.service = service
        self.patience = BATCH_PATIENCE_TICKS if batched else PATIENCE_TICKS
        self.backlog = BATCH_BACKLOG_TICKS if batched else BACKLOG_TICKS
        self.same_tick: list[Topic[Any]] = []
        self.delayed: list[Topic[Any]] = []
        self.latched: list[Topic[Any]] = []
        for item in inputs:
            if isinstance(item, Delayed):
                self.delayed.append(item.topic)
            elif item.kind is Kind.LATCHED:
                self.latched.append(item)
            else:
                self.same_tick.append(item)
        self._delayed_keys = {topic.key for topic in self.delayed}
        self._samples = {topic.key for topic in self.same_tick if topic.kind is Kind.SAMPLE}
        self._latched_keys = {topic.key for topic in self.latched}
        self.owners = {topic.key: topic.owner for topic in (*self.same_tick, *self.delayed, *self.latched)}
        self.absent: set[str] = set()
        """Keys of declared inputs that will never be published, as the driver has no such sensor."""
        self.epoch = -1
        self.last = -1
        self.on_roster = self.outrun = False
        """`outrun`: True while ticks come of a later run, of which this service was not informed (by a prime)."""
        self.begun: int = 0
        """Number of times a run began, including again for a service that another process had misled."""
        self._newest = self._admitted = self._version = -1
        self._first_ns, self._last_ns = -math.inf, math.inf
        """`_first_ns`: least accepted stamp, ns; `_last_ns`: greatest one in tick 0, ns, 10 ms more per later tick."""
        self._announced = -1
        self._ticks: dict[int, Tick] = {}
        self._slots: dict[tuple[int, int], dict[str, Any]] = {}
        self._latched: dict[tuple[str, int], Any] = {}
        """Latched messages by key of the topic and run number (epoch)."""
        self._unbegun = 0
        """Number of manifests (primes) of a run not yet begun by the driver of which this service already did ticks."""
        self._previous_roster: tuple[str, ...] = ()
        self._lockstep = False
        self._cycle = math.lcm(*(max(1, topic.period_ticks) for topic in self.same_tick))
        self._wanted_of: dict[tuple[tuple[str, ...], tuple[str, ...], int], list[str]] = {}
        self._large: dict[tuple[int, int, str], int] = {}
        """Bytes of large inputs in `_slots` by epoch, tick and key; some may have been taken."""
        self._senders: dict[str, str] = {}
        """Name of the process that published the last accepted message of each topic, by key."""
        self._taken: dict[str, Any] = {}
        """Inputs of the last tick that `take` returned, by key of the topic."""
        self._repeated = 0
        """Number of times the driver repeated the newest tick since this service finished its last one."""
        self._lacking: set[str] | None = None
        """Keys of the inputs that tick ``last + 1`` still waits for; None = not computed yet."""

    def offer(
        self, topic: Topic[Any], message: Header, value: Any = None, sender: str = "", size: int = 0
    ) -> str | None:
        """Add a received input; return a code if it is refused, else None.

        Args:
            topic: row of the topic table.
            message: the message, or only its header.
            value: object that ``TickInputs.get`` returns for it, default the message.
            sender: process that published the message, "" = unknown.
            size: size of the encoded message, bytes; 0 = it came as an object.
        """
        if value is None:
            value = message
        key, epoch, tick = topic.key, message.epoch, message.tick
        here = epoch == self.epoch
        if not here:
            if epoch < self.epoch:
                return "stale_epoch"
            known = max(self.epoch, self._announced)
            early = key in self._latched_keys and epoch <= known + 1  # it may overtake the prime of its run
            if known >= 0 and epoch != self._announced and not early:
                self.outrun = self.outrun or key == _TICK
                return "epoch_ahead"
        if key == _TICK:
            return self._offer_tick(cast(Tick, message))
        if here and not self._first_ns <= message.stamp_ns <= self._last_ns + tick * TICK_NS:
            return "stamp"
        if key in self._latched_keys:
            if self._latched.get((key, epoch)) != value:  # sent again it stays the same object
                self._latched[key, epoch] = value  # services look for a new one
            if len(self._latched) > MAX_AHEAD:  # before the first tick: any epoch may be the run's
                del self._latched[next(iter(self._latched))]
            self._lacking = None
            return None
        if here:
            awaited = self.last if key in self._delayed_keys else self.last + 1
            """Number of the earliest tick whose message this input still needs; earlier messages have been used."""
            if tick < awaited:
                return self._again(key, value, sender, self._taken if tick == awaited - 1 else {})
            if tick > self._newest + MAX_AHEAD and tick > self.last + MAX_AHEAD and self.on_roster:
                return "too_far_ahead"
            if tick == awaited and self._lacking:
                self._lacking.discard(key)
        slot = self._slots.get((epoch, tick))
        if slot is not None and key in slot:
            return self._again(key, value, sender, slot)
        if size > SMALL_BYTES and not self._has_room(epoch, tick, key, size):
            return "too_much"
        self._senders[key] = sender
        if slot is None:
            self._slots[(epoch, tick)] = {key: value}
            if len(self._slots) > 4 * MAX_AHEAD:  # not on the roster: nothing is ever taken, keep the newest
                del self._slots[(max if self.on_roster else min)(self._slots)]
        else:
            slot[key] = value
        return None

    def _again(self, key: str, value: Any, sender: str, known: dict[str, Any]) -> str:
        """Return `conflict` if the process sent this message before with another content, else `duplicate`."""
        same = key not in known or sender != self._senders.get(key) or known[key] == value
        return "duplicate" if same else "conflict"

    def _has_room(self, epoch: int, tick: int, key: str, size: int) -> bool:
        """Record a large input; return False if the waiting inputs of its owner would hold too many bytes."""
        self._large = {at: n for at, n in self._large.items() if at[2] in self._slots.get(at[:2], ())}
        owner = self.owners[key]
        if sum(n for at, n in self._large.items() if self.owners[at[2]] == owner) + size > SENDER_BYTES:
            return False
        self._large[epoch, tick, key] = size
        return True

    def place(self, key: str, message: Header, sender: str) -> str:
        """Return a text for the log on a refused input: key, epoch, tick and process, and this service's last tick."""
        where = f"{key} of epoch {message.epoch}, tick {message.tick}, by process {sender!r}"
        return f"{where}; this is epoch {self.epoch}, tick {self.last}"

    def announce(self, prime: Tick) -> bool:
        """Accept the run (epoch) of a manifest by which the driver lets services test their links (prime).

        Returns:
            True if the service may report ready. If it has done ticks of a run that the driver has not begun, another
            process sent them: they are forgotten, and the result is True after `MISLED_PRIMES` such manifests.
        """
        epoch = prime.epoch
        if epoch < self.epoch:
            self._begin(epoch)
        self._announced = epoch
        if epoch == self.epoch and prime.roster_version == 0 and self.last >= 0:
            self._unbegun += 1
            if self._unbegun < MISLED_PRIMES:
                return False
            self._begin(epoch)
            self._forget(epoch)
        elif prime.roster_version == 0:
            self._forget(epoch)
        return True

    def _forget(self, epoch: int) -> None:
        """Drop the inputs of a run (epoch) that the driver has not begun: no process can have valid ones."""
        self._slots = {key: slot for key, slot in self._slots.items() if key[0] != epoch}

    def _begin(self, epoch: int) -> None:
        self.epoch = epoch
        self.begun += 1
        self._first_ns, self._last_ns = -math.inf, math.inf  # until the first tick
        self.last = self._newest = self._admitted = self._version = -1
        self.on_roster = self.outrun = False
        self._unbegun = self._repeated = 0
        self._lacking = None
        self._ticks.clear()
        self._taken = {}
        allowed = (epoch, epoch + 1)
        self._slots = {key: slot for key, slot in self._slots.items() if key[0] in allowed}
        self._latched = {key: value for key, value in self._latched.items() if key[1] in allowed}

    def _offer_tick(self, tick: Tick) -> str | None:
        self._lacking = None
        if tick.epoch > self.epoch:
            self._begin(tick.epoch)
        if self.service not in tick.roster:  # unless a later tick, of a newer roster, has overtaken this one
            self.on_roster = self.on_roster and tick.roster_version < self._version
            return "not_on_roster"
        self._version = max(self._version, tick.roster_version)
        first = dict(zip(tick.roster, tick.since, strict=False)).get(self.service, 0)
        if tick.tick < first:
            return "not_on_roster"
        if tick.tick < self._admitted and tick.roster_version <= 1:
            self._begin(tick.epoch)  # it was admitted at the start of this run, as no service was admitted later
            self._forget(tick.epoch)
        elif tick.tick <= self.last:
            return "replay"
        if not self.on_roster:
            first = tick.tick if tick.mode == "paced" else first
            if tick.tick >= first + MAX_AHEAD:
                return "too_far_ahead"
            self.on_roster = True
            self._admitted, self.last, self._taken = first, first - 1, {}  # in lockstep lost ticks are repeated
            self._previous_roster = ()  # what was published while it was away is not awaited
            oldest = (tick.epoch, first - 1)  # delayed inputs of the tick before the first are still needed
            self._slots = {key: slot for key, slot in self._slots.items() if key >= oldest}
        elif tick.mode == "lockstep" and tick.tick > self.last + MAX_AHEAD:
            return "too_far_ahead"
        self._unbegun, self.outrun = 0, False
        if tick.tick > self._newest:
            self._newest, self._repeated = tick.tick, 0
        if self._last_ns == math.inf:
            zero = tick.stamp_ns - tick.tick * TICK_NS
            self._first_ns, self._last_ns = zero - STAMP_SLACK_NS, zero + STAMP_SLACK_NS
        self._lockstep = tick.mode == "lockstep"
        held = self._ticks.get(tick.tick)
        if held is not None and tick.roster_version == held.roster_version and tick != held:
            return "conflict"
        if held is not None and tick.tick == self._newest:
            self._repeated += 1
        if held is None or tick.roster_version >= held.roster_version:
            self._ticks[tick.tick] = tick
        return None

    def _wanted(self, tick: Tick) -> list[str]:
        """Return the keys due in a tick, cached for equal samples, roster and phase of the periods."""
        due, roster = tick.due, tick.roster
        kind = (due, roster, tick.tick % self._cycle)
        known = self._wanted_of.get(kind)
        if known is not None:
            return known
        wanted: list[str] = []
        for topic in self.same_tick:
            key = topic.key
            if key in self._samples:
                if key in due:
                    wanted.append(key)
            elif topic.due(tick.tick) and (topic.owner == DRIVER or topic.owner in roster):
                wanted.append(key)
        if len(self._wanted_of) >= MOST_KINDS:
            self._wanted_of.clear()
        self._wanted_of[kind] = wanted
        return wanted

    def missing(self) -> tuple[str, ...]:
        """Return the keys of the inputs that the next tick lacks; empty also if its manifest has not come."""
        tick = self._ticks.get(self.last + 1)
        return () if tick is None else tuple(self._missing(tick))

    def _missing(self, tick: Tick) -> list[str]:
        slot = self._slots.get((tick.epoch, tick.tick), {})
        lacking = [key for key in self._wanted(tick) if key not in slot]
        before = self._slots.get((tick.epoch, tick.tick - 1), {}) if self.delayed else {}
        for topic in self.delayed:
            if topic.key in before or not topic.due(tick.tick - 1):
                continue
            if topic.owner in self._previous_roster and topic.owner in tick.roster:
                lacking.append(topic.key)
        for topic in self.latched:
            if topic.key not in self.absent and (topic.key, tick.epoch) not in self._latched:
                lacking.append(topic.key)
        return lacking

    def awaited(self) -> set[str]:
        """Return the services whose messages the next tick lacks; empty if any message may complete a tick."""
        if not self.on_roster or not self._lockstep:
            return set()
        number = self.last + 1
        tick = self._ticks.get(number)
        if tick is not None:
            if self._lacking is None:
                self._lacking = set(self._missing(tick))
            return {self.owners[key] for key in self._lacking}
        roster = self._previous_roster
        owners = {DRIVER}
        slot = self._slots.get((self.epoch, number), {})
        for topic in self.same_tick:
            if topic.owner in roster and topic.key not in slot and topic.due(number):
                owners.add(topic.owner)
        before = self._slots.get((self.epoch, number - 1), {})
        for topic in self.delayed:
            if topic.owner in roster and topic.key not in before and topic.due(number - 1):
                owners.add(topic.owner)
        return owners

    def take(self) -> TickInputs | None:
        """Return the inputs of the next tick if they are complete (paced mode: or if later ticks came), else None."""
        if not self._ticks or not self.on_roster:
            return None
        tick = self._ticks.get(self.last + 1)
        if (tick or next(iter(self._ticks.values()))).mode == "paced":
            return self._take_paced()
        if tick is None:
            return None
        if self._lacking is None:
            self._lacking = set(self._missing(tick))
        return None if self._lacking else self._bundle(tick)

    def _take_paced(self) -> TickInputs | None:
        newest, first = max(self._ticks), min(self._ticks)
        if newest - first >= self.backlog:
            first = min(n for n in self._ticks if n >= newest - self.patience)
        tick = self._ticks[first]
        overtaken = newest - first >= self.patience or self._repeated >= PATIENCE_TICKS
        if overtaken or not self._missing(tick):
            return self._bundle(tick)
        return None

    def _bundle(self, tick: Tick) -> TickInputs:
        slot = self._slots.pop((tick.epoch, tick.tick), {})
        messages: dict[str, Any] = {key: slot[key] for key in self._wanted(tick) if key in slot}
        before = self._slots.get((tick.epoch, tick.tick - 1), {})
        for topic in self.delayed:
            if topic.key in before:
                messages[topic.key] = before[topic.key]
        for topic in self.latched:
            if (topic.key, tick.epoch) in self._latched:
                messages[topic.key] = self._latched[topic.key, tick.epoch]
        self._taken = messages
        skipped = tick.tick - self.last > 1
        self.last = tick.tick
        self._repeated = 0
        self._previous_roster = tick.roster
        self._lacking = None
        kept_for_next = {key: slot[key] for key in self._delayed_keys if key in slot}
        self._slots = {k: s for k, s in self._slots.items() if k > (tick.epoch, tick.tick)} if skipped else self._slots
        self._slots.pop((tick.epoch, tick.tick - 1), None)
        if kept_for_next:
            self._slots[(tick.epoch, tick.tick)] = kept_for_next
        for number in [n for n in self._ticks if n <= tick.tick]:
            del self._ticks[number]
        return TickInputs(tick, messages)
