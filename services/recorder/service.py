"""Records everything on the bus into one MCAP file and computes the hash of the run."""

from pathlib import Path
from typing import Any

from surefoot.bus.codec import encode, encoding_of
from surefoot.bus.interface import Raw
from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.service import Service
from surefoot.logline import sendable
from surefoot.record.recording import RecordingWriter
from surefoot.record.runhash import RunHash
from surefoot.schemas.base import Message
from surefoot.schemas.system import RecorderReply, RecorderRequest
from surefoot.schemas.terrain import HeightMapMessage, LandmarkMap
from surefoot.schemas.topics import (
    FOOTHOLDS_CHOSEN,
    HW_IMAGE,
    HW_TICK,
    LOG,
    RECORDER_STATUS,
    SIM_STATUS,
    TOPICS,
    Kind,
    Topic,
)
from surefoot.version import VERSION

from .config import RecorderConfig

JOINED = tuple(t for t in TOPICS if t.deterministic and t.kind not in (Kind.LATCHED, Kind.STATUS))
LATCHED = tuple(t for t in TOPICS if t.deterministic and t.kind is Kind.LATCHED)


class Recorder(Service[RecorderConfig]):
    """Takes every tick whole and undecoded, so nothing is lost and nothing is written twice."""

    name = "recorder"
    Config = RecorderConfig
    inputs = (*JOINED, HW_IMAGE)
    observes = (*LATCHED, FOOTHOLDS_CHOSEN, SIM_STATUS, LOG)
    serves = (RECORDER_STATUS,)
    raw = batched = True

    def on_start(self) -> None:
        self._writer: RecordingWriter | None = None
        self._hash = RunHash()
        self._pending: list[tuple[Topic[Any], Message]] = []
        self._known: set[tuple[str, int, int]] = set()
        self._tick, self._epoch, self._files = -1, 0, 0
        self._finished, self._failed, self._path = False, False, self.config.path or ""
        self.handle(RECORDER_STATUS, self.status)

    def on_reset(self) -> None:
        self._close()
        self._hash, self._finished, self._failed = RunHash(), False, False

    def on_message(self, topic: Topic[Any], message: Message) -> None:
        if isinstance(message, HeightMapMessage | LandmarkMap):  # published again for every new participant: kept once
            identity = (topic.key, message.epoch, message.version)
            if identity in self._known:
                return
            self._known.add(identity)
        self._pending.append((topic, message))

    def on_tick(self, inputs: TickInputs) -> None:
        tick = inputs.tick
        if self._writer is None and self.config.path and not self._finished and not self._failed:
            self._open(tick.epoch, tick.seed, begun=tick.tick > 0)
        self._epoch = tick.epoch
        self._flush()
        self._write(HW_TICK, tick, Raw(*encode(tick), encoding_of(type(tick))))
        for topic in (*JOINED, HW_IMAGE) if self.config.images else JOINED:
            delivery = inputs.messages.get(topic.key)
            if delivery is not None:
                header, raw = delivery.header(), delivery.raw()
                self._hash.update(topic.key, header.epoch, header.stamp_ns, header.seq, raw.payload, raw.attachment)
                self._write(topic, header, raw)
        self._tick = tick.tick
        if tick.end:
            self._close()
            self._finished = True

    def on_stop(self) -> None:
        self._close()

    def status(self, request: RecorderRequest) -> RecorderReply:
        """Progress of the recording."""
        return RecorderReply(
            path=sendable(self._path), epoch=self._epoch, tick=self._tick, finished=self._finished,
            messages=sum(self._hash.counts.values()), run_hash=self._hash.hexdigest() if self._finished else "",
        )  # fmt: skip

    def _open(self, epoch: int, seed: int, *, begun: bool) -> None:
        """Begin a file; what an earlier process recorded of a run that has ``begun`` is not overwritten."""
        assert self.config.path is not None
        path = Path(self.config.path)
        self._files += 1
        if self._files > 1 or begun:
            path = _free(path, self._files)
        about, more = self.config.tables, {"epoch": str(epoch), "seed": str(seed), "version": VERSION}
        run = {"robot": self.config.robot, **about.pop("run", {}), **more}
        try:
            self._writer = RecordingWriter(path, run, about)
        except OSError as error:
            self._give_up(path, error)
            return
        self._path = str(path)

    def _give_up(self, path: str | Path, error: OSError) -> None:
        """A disk that fails ends the recording, not the run: the hash goes on."""
        self._writer, self._path, self._failed = None, "", True
        self.log("error", f"no recording: {path}: {error.strerror or error}")

    def _flush(self) -> None:
        pending, self._pending = self._pending, []
        for topic, message in pending:
            if topic.deterministic and message.epoch > self._epoch:
                self._pending.append((topic, message))  # early: of the run to come
                continue
            raw = Raw(*encode(message), encoding_of(type(message)))
            self._write(topic, message, raw)
            if topic.deterministic and message.epoch == self._epoch:
                self._hash.update(topic.key, message.epoch, 0, message.seq, raw.payload, raw.attachment)

    def _write(self, topic: Topic[Any], header: Any, raw: Raw) -> None:
        if self._writer is not None:
            try:
                self._writer.write(topic, header, raw)
            except OSError as error:
                self._give_up(self._path, error)

    def _close(self) -> None:
        writer, self._writer = self._writer, None
        if writer is not None:
            try:
                summary = {"run_hash": self._hash.hexdigest(), "last_tick": str(self._tick)}
                writer.close(summary, self._hash.keys())
            except OSError as error:
                self._give_up(self._path, error)


def _free(path: Path, number: int) -> Path:
    """Return the path with the first number from ``number`` on that no file has; the number 1 is not written."""
    found = path if number == 1 else path.with_stem(f"{path.stem}-{number}")
    return _free(path, number + 1) if found.exists() else found


SERVICE = Recorder
