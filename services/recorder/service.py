"""Recorder service: records the messages on the bus, of a whole run or its last seconds, and hashes the run."""

import json
import time
from collections.abc import Callable
from typing import Any

from surefoot.bus.codec import encode, encoding_of
from surefoot.bus.interface import Delivery, Raw
from surefoot.errors import Refusal
from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.service import Service
from surefoot.logline import sendable
from surefoot.record.runhash import RunHash
from surefoot.schemas import topics
from surefoot.schemas.base import Message
from surefoot.schemas.system import Health, RecorderReply, RecorderRequest, SaveReply, SaveRequest
from surefoot.schemas.topics import Kind, Topic

from .config import RecorderConfig
from .outputs import Output, output_of

JOINED = tuple(t for t in topics.TOPICS if t.deterministic and t.kind not in (Kind.LATCHED, Kind.STATUS))
IMAGES = (topics.HW_IMAGE, topics.HW_DEPTH)
LATCHED = tuple(t for t in topics.TOPICS if t.deterministic and t.kind is Kind.LATCHED)
MOST_SERVICES = 64  # whose configuration is noted; strangers can send the health of any number


class Recorder(Service[RecorderConfig]):
    """Service that records the messages of each tick undecoded, so that none is lost or written twice."""

    name = "recorder"
    Config = RecorderConfig
    inputs = (*JOINED, *IMAGES, *LATCHED)
    observes = (topics.FOOTHOLDS_CHOSEN, topics.SIM_STATUS, topics.LOG, topics.HEALTH)
    serves = (topics.RECORDER_STATUS, topics.RECORDER_SAVE)
    raw = batched = timed = True  # not timed: an imported log, whose recordings are equal to the byte

    def on_start(self) -> None:
        self._output = output_of(self.config, self._facts)
        self._hash = RunHash()
        self._pending: list[tuple[Topic[Any], Message]] = []
        self._latched: dict[str, Delivery] = {}
        """Newest message of each latched key."""
        self._known: set[tuple[str, int, int]] = set()
        self._tick, self._epoch, self._finished = -1, 0, False
        self._began_s: float | None = None  # wall time of the first tick of the epoch
        self._configs: dict[str, str] = {}
        """Hash of the configuration of each service that is alive, by name."""
        self.handle(topics.RECORDER_STATUS, self.status)
        self.handle(topics.RECORDER_SAVE, self.save)

    def on_reset(self) -> None:
        self._close()
        self._hash, self._finished, self._began_s, self.trouble = RunHash(), False, None, ""
        self._latched, self._known = {}, set()  # a driver that was started again counts its epochs from 1

    def on_message(self, topic: Topic[Any], message: Message) -> None:
        if not isinstance(message, Health):
            self._pending.append((topic, message))
        elif message.service in self._configs or len(self._configs) < MOST_SERVICES:
            self._configs[message.service] = message.config_hash

    def _take_latched(self, inputs: TickInputs) -> None:
        """Record each version of a latched message once, though it is published again for every new participant."""
        for topic in LATCHED:
            delivery: Delivery | None = inputs.messages.get(topic.key)
            if delivery is None or delivery is self._latched.get(topic.key):
                continue
            self._latched[topic.key] = delivery
            message: Any = delivery.message()
            identity = (topic.key, message.epoch, message.version)
            if identity not in self._known:
                self._known.add(identity)
                self._pending.append((topic, message))

    def on_tick(self, inputs: TickInputs) -> None:
        tick = inputs.tick
        self._epoch, self._tick = tick.epoch, tick.tick
        self._began_s = time.monotonic() if self._began_s is None else self._began_s
        if self._output is not None and not self._finished and not self.trouble:
            self._try(lambda output: output.begin(tick.epoch, tick.seed, begun=tick.tick > 0))
        self._take_latched(inputs)
        self._flush()
        self._write(topics.HW_TICK, tick, Raw(*encode(tick), encoding_of(type(tick))))
        for topic in (*JOINED, *IMAGES) if self.config.images else JOINED:
            delivery = inputs.messages.get(topic.key)
            if delivery is not None:
                header, raw = delivery.header(), delivery.raw()
                self._hash.update(topic.key, header.epoch, header.stamp_ns, header.seq, raw.payload, raw.attachment)
                self._write(topic, header, raw)
        if tick.end:
            self._close()
            self._finished = True

    def on_stop(self) -> None:
        self._close()

    def status(self, request: RecorderRequest) -> RecorderReply:
        """Return path, number of messages and, after the last tick, hash of the recording (`recorder/status`)."""
        path = "" if self._output is None or self.trouble else self._output.path
        return RecorderReply(
            path=sendable(path), epoch=self._epoch, tick=self._tick, finished=self._finished,
            messages=sum(self._hash.counts.values()), run_hash=self._hash.hexdigest() if self._finished else "",
            trouble=sendable(self.trouble))  # fmt: skip

    def save(self, request: SaveRequest) -> SaveReply:
        """Write the messages of the last seconds to a file; return its path and their number (`recorder/save`)."""
        if self._output is None:
            raise Refusal("refused", "path is empty: nothing is recorded", "path")
        self._flush()
        try:
            path, messages = self._output.save(request.reason)
        except OSError as error:
            raise Refusal("refused", f"{error.filename}: {error.strerror}", "path") from None
        return SaveReply(path=sendable(path), messages=messages)

    def _try(self, work: Callable[[Output], None]) -> None:
        """Call `work` with the output; an OSError ends the recording, not the run, and the hash is still computed."""
        if self._output is None or self.trouble:
            return
        try:
            work(self._output)
        except OSError as error:
            since = self._tick if self._output.unsaved is None else self._output.unsaved
            self.trouble = f"nothing is recorded from tick {since} on: {self.config.path}: {error.strerror or error}"
            self.log("error", self.trouble)

    def _flush(self) -> None:
        pending, self._pending = self._pending, []
        for topic, message in pending:
            self._write(topic, message, raw := Raw(*encode(message), encoding_of(type(message))))
            if topic.deterministic:
                self._hash.update(topic.key, message.epoch, 0, message.seq, raw.payload, raw.attachment)

    def _write(self, topic: Topic[Any], header: Any, raw: Raw) -> None:
        self._try(lambda output: output.write(topic, header, raw, self._tick))

    def _close(self) -> None:
        self._try(lambda output: output.end({"run_hash": self._hash.hexdigest(), **self._facts()}, self._hash.keys()))

    def _facts(self) -> dict[str, str]:
        """Return last tick, wall time (if it counts) and the hash of each service's configuration until now."""
        facts = {"last_tick": str(self._tick), "configuration": json.dumps(dict(sorted(self._configs.items())))}
        if self.timed and self._began_s is not None:
            facts["wall_s"] = f"{time.monotonic() - self._began_s:.3f}"
        return facts


SERVICE = Recorder
