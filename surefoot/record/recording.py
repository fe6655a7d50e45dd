"""Writing and reading of MCAP recordings of the bus: unchanged messages with their JSON Schemas."""

import json
import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from errno import EINVAL
from pathlib import Path
from typing import Any

from mcap.reader import make_reader

from surefoot.bus.codec import decode, encoding_of, json_schema
from surefoot.bus.interface import Raw
from surefoot.disk import regular_size
from surefoot.errors import SurefootError
from surefoot.record.check import BROKEN, Findings, SoundChunk, check, sound_messages
from surefoot.record.chunks import MAGIC, ChunkWriter
from surefoot.schemas.base import Bulk, Header, Message
from surefoot.schemas.topics import TOPICS, Topic
from surefoot.version import VERSION

BULK = "surefoot-bulk"
"""Name of the encoding of messages with a large array: uint32 length of the JSON header, header, raw array."""
ENCODINGS = ("json", BULK)
"""Names of the message encodings of MCAP channels that recordings of surefoot use."""
SUMMARY, HASHES = "surefoot", "hashes"
"""`SUMMARY`: name of the metadata table at the end of a recording with the run hash; `HASHES`: name of the table with a
digest for each key."""
KINDS = {".toml": "application/toml", ".json": "application/json", ".yaml": "application/yaml"}
"""Media types of attached files by suffix; a file of any other suffix is stored as bytes."""
LATEST_NS, MOST_SEQ = (1 << 64) - 1, (1 << 32) - 1
"""`LATEST_NS`: largest stamp of a message that MCAP can hold, ns; `MOST_SEQ`: largest sequence number that it can
hold."""


class RecordingWriter:
    """Writer of a recording (MCAP file); after a crash, the chunks written so far can be read."""

    def __init__(
        self,
        path: Path,
        metadata: dict[str, str],
        tables: Mapping[str, Mapping[str, str]] | None = None,
        files: Mapping[str, bytes] | None = None,
    ) -> None:
        """Begin a file.

        Args:
            path: MCAP file to write; its folder is made.
            metadata: facts of the run.
            tables: further metadata by name.
            files: content of the files to attach, by name.

        Raises:
            OSError: it cannot be written.
        """
        path.parent.mkdir(parents=True, exist_ok=True)
        self.path = path
        self.messages = 0
        self._file = path.open("wb")
        self._writer = ChunkWriter(self._file, f"surefoot {VERSION}")
        for name, values in {"run": metadata, **(tables or {})}.items():
            self._writer.add_metadata(name, values)
        for name, data in (files or {}).items():
            self._writer.add_attachment(name, media_type(name), data)
        self._channels: dict[str, tuple[int, bool]] = {}

    def write(self, topic: Topic[Any], header: Header, raw: Raw) -> None:
        """Append an encoded message to the recording, with the stamp and sequence number of its header."""
        key = topic.key if not topic.key.endswith("/*") else f"{topic.key[:-1]}{header.source}"
        channel, bulk = self._channels.get(key) or self._add_channel(key, topic.model)
        data = raw.payload
        if bulk:
            head = raw.attachment or b"{}"
            data = struct.pack("<I", len(head)) + head + raw.payload
        stamp_ns = min(max(header.stamp_ns, 0), LATEST_NS)  # a log record may carry any
        self._writer.add_message(channel, stamp_ns, header.seq & MOST_SEQ, data)
        self.messages += 1

    @property
    def waiting(self) -> int:
        """Number of messages that are not in the file yet: those of the present chunk."""
        return self.messages - self._writer.written

    def give_up(self) -> None:
        """Close the file as it is, without metadata and index, as one that cannot be written any more."""
        with suppress(OSError):  # what is buffered does not fit either
            self._file.close()

    def _add_channel(self, key: str, model: type[Message]) -> tuple[int, bool]:
        bulk = issubclass(model, Bulk)
        schema = json.dumps(json_schema(model)).encode()
        number = self._writer.add_channel(key, BULK if bulk else "json", model.schema_name(), schema)
        self._channels[key] = number, bulk
        return number, bulk

    def close(self, summary: dict[str, str], hashes: Mapping[str, str] | None = None) -> None:
        """Write metadata (`summary`, and `hashes`: a digest by key) and the index, and close the file."""
        self._writer.add_metadata(SUMMARY, summary)
        if hashes is not None:
            self._writer.add_metadata(HASHES, hashes)
        self._writer.finish()
        self._file.close()


@dataclass(frozen=True)
class Recorded:
    """One message of a recording, not yet decoded: key, stamp, ns, model (None: key unknown here), stored bytes."""

    key: str
    stamp_ns: int
    model: type[Message] | None
    data: bytes

    def raw(self) -> Raw:
        """Return the message as it was encoded on the bus: payload, attachment and encoding."""
        if self.model is not None and issubclass(self.model, Bulk):
            (length,) = struct.unpack_from("<I", self.data)
            return Raw(self.data[4 + length :], self.data[4 : 4 + length], encoding_of(self.model))
        return Raw(self.data, None, "" if self.model is None else encoding_of(self.model))

    def message(self) -> Message:
        """Return the decoded message (raises Refusal; SurefootError for a key that is no topic of this version)."""
        if self.model is None:
            raise SurefootError("unknown_key", f"{self.key!r} is not a topic of this version")
        return decode(self.model, *self.raw())


def media_type(name: str) -> str:
    """Return the media type of a file, chosen by the suffix of its name."""
    return KINDS.get(Path(name).suffix, "application/octet-stream")


def topic_of(key: str) -> Topic[Any] | None:
    """Return the row of the table of topics that a key belongs to; None: there is none."""
    for topic in TOPICS:
        if topic.key == key or (topic.key.endswith("/*") and key.startswith(topic.key[:-1])):
            return topic
    return None


def read_recording(
    path: Path, keys: tuple[str, ...] | None = None, progress: Callable[[float], None] | None = None
) -> Iterator[Recorded]:
    """Yield the messages of a recording in the order of their stamps.

    Args:
        path: MCAP file.
        keys: keys of the wanted messages; None = all.
        progress: called with the share, 0 to 1, of the recorded time that is read.

    Raises:
        SurefootError: the file cannot be read, is empty, no MCAP file, or cut off or damaged.
    """
    try:
        regular_size(path)
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            count, share_of = 0, None if progress is None else _share_of(reader)
            for _, channel, message in reader.iter_messages(topics=list(keys) if keys else None, log_time_order=True):
                row = topic_of(channel.topic)
                if row is not None and channel.message_encoding not in ENCODINGS:
                    raise _foreign(path, channel.topic, channel.message_encoding)
                yield Recorded(channel.topic, message.log_time, None if row is None else row.model, message.data)
                count += 1
                if progress is not None and share_of is not None:
                    progress(share_of(message.log_time))
            summary = reader.get_summary()
    except OSError as error:
        raise _unreadable(path, error) from None
    except BROKEN as error:
        raise _broken(path, str(error)) from None
    if summary is not None and summary.statistics is not None:
        counts = summary.statistics.channel_message_counts
        told = sum(counts.get(i, 0) for i, c in summary.channels.items() if not keys or c.topic in keys)
        if count < told:
            raise _broken(path, f"{told - count} of {told} messages cannot be read")


def _share_of(reader: Any) -> Callable[[int], float] | None:
    """Return a function from a stamp, ns, to the share of the recorded time before it; None: no times are stated."""
    summary = reader.get_summary()
    if summary is None or summary.statistics is None:
        return None
    start, end = summary.statistics.message_start_time, summary.statistics.message_end_time
    return lambda stamp_ns: (stamp_ns - start) / max(1, end - start)


def _unreadable(path: Path, error: OSError) -> SurefootError:
    """Return the error of a file that cannot be read, including one that is too short for a summary."""
    return _broken(path, "") if error.errno == EINVAL else SurefootError("unreadable", f"{path}: {error.strerror}")


def _foreign(path: Path, key: str, encoding: str) -> SurefootError:
    """Return the error of a recording whose topic of this project has an encoding that surefoot does not write."""
    return SurefootError(
        "malformed", f"{path}: {key} is encoded as {encoding!r}, allowed is 'json'", "message_encoding"
    )


def _broken(path: Path, why: str) -> SurefootError:
    """Return the error of a file that cannot be read as a recording."""
    with path.open("rb") as file:
        head, size = file.read(len(MAGIC)), path.stat().st_size
        file.seek(max(0, size - len(MAGIC)))
        if file.read() != MAGIC:
            why = "it has no summary at its end, without which nothing is found by index"
    if not head:
        return SurefootError("malformed", f"{path} is empty")
    if not MAGIC.startswith(head):
        return SurefootError("malformed", f"{path} is not an MCAP file: it begins with {head!r}")
    told = f" ({why[:120]})" if why else ""
    hint = "`surefoot bag info --verify` reports what can be read of it"
    return SurefootError("malformed", f"{path} is cut off or damaged{told}; {hint}")


def recording_info(path: Path) -> dict[str, Any]:
    """Return number of messages, in total and by topic, first and last stamp, ns, and metadata of a recording.

    Raises:
        SurefootError: the file cannot be read as a recording.
    """
    try:
        regular_size(path)
        with path.open("rb") as file:
            reader = make_reader(file)
            summary = reader.get_summary()
            metadata = {record.name: dict(record.metadata) for record in reader.iter_metadata()}
    except OSError as error:
        raise _unreadable(path, error) from None
    except BROKEN as error:
        raise _broken(path, str(error)) from None
    if summary is None or summary.statistics is None:
        raise _broken(path, "it has no summary, the recorder did not finish")
    counts = summary.statistics.channel_message_counts
    return {
        "path": str(path),
        "messages": summary.statistics.message_count,
        "start_ns": summary.statistics.message_start_time,
        "end_ns": summary.statistics.message_end_time,
        "topics": {c.topic: counts.get(i, 0) for i, c in sorted(summary.channels.items(), key=lambda p: p[1].topic)},
        "metadata": metadata,
    }


def verify_recording(path: Path) -> Findings:
    """Read all of a recording, compare its checksums, and return its readable and damaged parts.

    Raises:
        SurefootError: the file cannot be read, is empty, or no MCAP file.
    """
    try:
        regular_size(path)
        found = check(path)
    except OSError as error:
        raise SurefootError("unreadable", f"{path}: {error.strerror}") from None
    if not found.whole and not found.chunks:
        with path.open("rb") as file:
            head = file.read(len(MAGIC))
        if not head or not MAGIC.startswith(head):
            raise _broken(path, "")
    return found


@dataclass(frozen=True)
class ReadableRecording:
    """An open recording that may be damaged, of which the readable part can be read.

    Attributes:
        path: the file.
        metadata: tables of texts by name.
        start_ns, end_ns: stamps of the first and last message, ns.
        damage: text on the damage and the lost share; empty = undamaged.
    """

    path: Path
    metadata: dict[str, dict[str, str]]
    start_ns: int
    end_ns: int
    damage: str = ""
    found: Findings = field(default_factory=Findings, repr=False)

    @property
    def version(self) -> str:
        """Version of surefoot that wrote the recording, if it differs from the present one; else empty."""
        made = self.metadata.get("run", {}).get("version", VERSION)
        return "" if made == VERSION else made

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks for the user: on damage, and on a recording by another version of surefoot; empty if none."""
        part = f"only a part of the recording can be read: {self.damage}" if self.damage else ""
        return tuple(filter(None, (part, recorded_by(self.version) if self.version else "")))

    @property
    def gapless(self) -> tuple[SoundChunk, ...]:
        """Readable chunks before the first place in the file at which messages are lost; all if none are lost."""
        end = self.found.sound_to
        return tuple(piece for piece in self.found.pieces if end is None or piece.place < end)

    def messages(
        self,
        keys: tuple[str, ...] | None = None,
        progress: Callable[[float], None] | None = None,
        *,
        gapless: bool = False,
    ) -> Iterator[Recorded]:
        """Yield messages in the order of their stamps; of a damaged file those of readable chunks.

        Args:
            keys: keys of the wanted messages; None = all.
            progress: called with the share, 0 to 1, of the recorded time that is read.
            gapless: leave out all chunks after the first place at which messages are lost.

        Raises:
            SurefootError: the file cannot be read any more, or a topic of surefoot has another encoding.
        """
        if self.found.outside and not self.damage:
            yield from read_recording(self.path, keys, progress)
            return
        wanted = {number: key for number, key in self.found.channels.items() if keys is None or key in keys}
        models = {number: None if (row := topic_of(key)) is None else row.model for number, key in wanted.items()}
        try:
            for item in sound_messages(self.path, self.gapless if gapless else self.found.pieces):
                if progress is not None:
                    progress((item.stamp_ns - self.start_ns) / max(1, self.end_ns - self.start_ns))
                if item.channel not in wanted:
                    continue
                model, encoding = models[item.channel], self.found.encodings[item.channel]
                if model is not None and encoding not in ENCODINGS:
                    raise _foreign(self.path, wanted[item.channel], encoding)
                yield Recorded(wanted[item.channel], item.stamp_ns, model, item.data)
        except OSError as error:
            raise _unreadable(self.path, error) from None
        except BROKEN as error:  # written to since it was opened
            raise _broken(self.path, str(error)) from None


def recorded_by(version: str) -> str:
    """Return a remark for the user on a recording that another version of surefoot wrote."""
    return f"it was recorded by surefoot {version[:40]}, this is {VERSION}"


def open_readable(path: Path | ReadableRecording) -> ReadableRecording:
    """Open a recording that may be cut off or damaged; all of it is read once, and its checksums compared.

    A recording that is already open is returned unchanged.

    Raises:
        SurefootError: the file cannot be read, is empty, no MCAP file, or holds no message that can be read.
    """
    if isinstance(path, ReadableRecording):
        return path
    found = verify_recording(path)
    if found.whole:
        info = recording_info(path)
        return ReadableRecording(path, info["metadata"], info["start_ns"], info["end_ns"], "", found)
    pieces = found.pieces
    if not pieces:
        raise _broken(path, _loss(found))
    damage = f"{path} is cut off or damaged: {_loss(found)}"
    start, end = min(piece.start_ns for piece in pieces), max(piece.end_ns for piece in pieces)
    return ReadableRecording(path, found.metadata, start, end, damage, found)


def _loss(found: Findings) -> str:
    """Return which share of a damaged recording is lost, and the first of its faults."""
    share, parts = 100.0 * found.lost_share, f"{found.damaged} of {found.chunks} chunks are damaged"
    if found.uncounted:
        lost = f"{share:.1f} % of its bytes cannot be read, and what followed its end is unknown"
    else:
        lost = f"{share:.1f} % of its {found.messages.total() + found.lost} messages are lost"
    return f"{lost}; {parts}; {found.problems[0][:160]}"
