"""Check of an MCAP file that may be cut off or damaged: which parts can be read, and how much is lost.

An ordinary reader needs the summary at the end, which a file that was cut off does not have. Here records are read from
the front, and every chunk is unpacked and its checksum compared. After an invalid record the check goes on with the
next chunk, found by the summary, or without one by a search for bytes that begin a chunk. Format: MCAP specification,
version 0.
"""

import heapq
import mmap
import struct
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Chunk, Message, MessageIndex, Metadata
from mcap.stream_reader import CRCValidationError, get_chunk_data_stream
from zstandard import ZstdError

from surefoot.record.chunks import MAGIC

BROKEN = (McapError, KeyError, ZstdError, struct.error, ValueError, EOFError, MemoryError)
"""Exceptions that reading a damaged MCAP file may raise."""

_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
"""Layout of the head of an MCAP message: channel number, sequence number, stamp and publication time, ns."""
_COMPRESSIONS = (b"\4\0\0\0zstd", b"\3\0\0\0lz4")
_BEFORE_COMPRESSION = _HEAD.size + 28
"""Length of the part of a chunk record before the name of its compression, bytes: record head, times, size,
checksum."""
_OPCODES = frozenset(int(code) for code in Opcode)
_READ = (Opcode.CHUNK, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.MESSAGE_INDEX, Opcode.METADATA, Opcode.ATTACHMENT)


class SoundChunk(NamedTuple):
    """Place of a readable chunk: offset and length of its content in the file, bytes, and its stamps' range, ns."""

    place: int
    length: int
    start_ns: int
    end_ns: int


class StoredMessage(NamedTuple):
    """A message as it is stored in an MCAP file: number of its channel, stamp, ns, and encoded data."""

    channel: int
    stamp_ns: int
    data: bytes


@dataclass
class Findings:
    """Result of the check of a recording: its readable parts, and what is damaged or lost."""

    chunks: int = 0
    damaged: int = 0
    """Number of chunks of the recording that cannot be read."""
    messages: Counter[str] = field(default_factory=Counter[str])
    """Number of messages that can be read, by key."""
    lost: int = 0
    """Number of messages that cannot be read; a lower bound if ``uncounted``."""
    uncounted: bool = False
    """True if the file has no readable summary, so the number of lost messages is a lower bound; False: it is exact."""
    problems: list[str] = field(default_factory=list[str])
    outside: int = 0
    """Number of messages that stand in no chunk, as other writers may store them."""
    size: int = 0
    """Size of the recording's file, bytes."""
    unread: int = 0
    """Number of bytes of the recording's file that cannot be read."""
    sound_to: int | None = None
    """Offset in the file before which no message is lost, bytes; None = no message is lost."""
    pieces: list[SoundChunk] = field(default_factory=list[SoundChunk])
    channels: dict[int, str] = field(default_factory=dict[int, str])
    """Key of each channel, by channel number, whose record can be read here or in the summary."""
    encodings: dict[int, str] = field(default_factory=dict[int, str])
    """Encoding of the messages of each of these channels, by channel number."""
    metadata: dict[str, dict[str, str]] = field(default_factory=dict[str, dict[str, str]])
    attachments: dict[str, bytes] = field(default_factory=dict[str, bytes], repr=False)
    """Content of the attached files by name; files whose checksum is wrong are left out."""

    @property
    def whole(self) -> bool:
        """True if the check found no problem: every message can be read and every checksum is right."""
        return not self.problems

    @property
    def lost_share(self) -> float:
        """Lost share of the messages, 0 to 1; of the bytes, if the number of messages is unknown (``uncounted``)."""
        total = self.messages.total() + self.lost
        if self.uncounted:
            return self.unread / self.size if self.size else 0.0
        return self.lost / total if total else 0.0


def check(path: Path) -> Findings:
    """Read every record of a recording, and return its readable and damaged parts (raises OSError)."""
    with path.open("rb") as file:
        return _FileCheck(file, path.stat().st_size).findings()


class _FileCheck:
    def __init__(self, file: IO[bytes], size: int) -> None:
        self.file, self.size = file, size
        self.found = Findings(size=size)
        self.channels: dict[int, Channel] = {}
        self.counts: Counter[int] = Counter()
        self.index: dict[int, list[tuple[int, int]]] | None = {}
        """Index of the messages of the last chunk, by channel: stamp, ns, and offset of each; None = the chunk is
        unreadable."""
        self.starts: list[int] = []
        self.total = self._summary()

    def _summary(self) -> int | None:
        """Return the number of messages by the summary; None if no summary can be read."""
        try:
            summary = make_reader(self.file).get_summary()
        except (*BROKEN, OSError):  # shorter than a summary: its place is before the beginning
            summary = None
        if summary is None or summary.statistics is None:
            return None
        self.channels = dict(summary.channels)
        self.starts = sorted(index.chunk_start_offset for index in summary.chunk_indexes)
        return summary.statistics.message_count

    def findings(self) -> Findings:
        found = self.found
        place = self._first()
        while place is not None:
            place = self._record(place)
        found.channels = {number: channel.topic for number, channel in self.channels.items()}
        found.encodings = {number: channel.message_encoding for number, channel in self.channels.items()}
        for number, count in self.counts.items():
            found.messages[found.channels.get(number, f"channel {number}")] += count
        if self.total is None:
            found.uncounted = True
            found.problems.append("there is no summary at the end: it was cut off, or the recorder did not finish")
        else:
            found.lost = max(found.lost, self.total - sum(self.counts.values()))
            if found.lost and found.whole:
                found.problems.append(f"the summary counts {self.total} messages")
        return found

    def _first(self) -> int | None:
        self.file.seek(0)
        if self.file.read(len(MAGIC)) == MAGIC:
            return len(MAGIC)
        return self._again(0, "the file does not begin as MCAP files do")

    def _record(self, place: int) -> int | None:
        """Read the record at an offset of the file; return the offset of the next one, None at the end of the data."""
        self.file.seek(place)
        head = self.file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return self._again(place, f"it ends at byte {self.size}, in the middle")
        code, length = _HEAD.unpack(head)
        end = place + _HEAD.size + length
        if code not in _OPCODES:
            return self._again(place, f"no record begins at byte {place}")
        if end > self.size:
            return self._again(place, f"the record at byte {place} goes beyond the end of the file, {self.size}")
        if code in (Opcode.DATA_END, Opcode.FOOTER):
            return None
        if code in _READ:
            self._take(code, ReadDataStream(BytesIO(self.file.read(length))), place, length)
        return end

    def _take(self, code: int, stream: ReadDataStream, place: int, length: int) -> None:
        found = self.found
        try:
            match code:
                case Opcode.CHUNK:
                    found.chunks, self.index = found.chunks + 1, None
                    chunk = Chunk.read(stream)
                    self.index = self._unpack(chunk)
                    self.counts.update({channel: len(entries) for channel, entries in self.index.items()})
                    piece = SoundChunk(place + _HEAD.size, length, chunk.message_start_time, chunk.message_end_time)
                    found.pieces += [piece] * bool(self.index)
                case Opcode.CHANNEL:
                    channel = Channel.read(stream)
                    self.channels[channel.id] = channel
                case Opcode.ATTACHMENT:
                    found.attachments |= _attachment(stream, length)
                case Opcode.METADATA:
                    table = Metadata.read(stream)
                    found.metadata[table.name] = dict(table.metadata)
                case Opcode.MESSAGE:
                    self.counts[Message.read(stream, length).channel_id] += 1
                    found.outside += 1
                case _:
                    self._compare(MessageIndex.read(stream))
        except BROKEN as error:
            if code == Opcode.CHUNK:
                self._lose(place)
                found.damaged += 1
            found.unread += _HEAD.size + length
            what = {Opcode.CHUNK: "chunk", Opcode.MESSAGE_INDEX: "index"}.get(Opcode(code), "record")
            why = "its checksum is wrong" if isinstance(error, CRCValidationError) else str(error)[:120]
            found.problems.append(f"the {what} at byte {place} cannot be read: {why or type(error).__name__}")

    def _unpack(self, chunk: Chunk) -> dict[int, list[tuple[int, int]]]:
        """Return the message index of a chunk made from its messages: stamp, ns, and offset of each, by channel."""
        index: dict[int, list[tuple[int, int]]] = {}
        for code, offset, record in _records(chunk):
            if code == Opcode.MESSAGE:
                channel, _, stamp_ns, _ = _MESSAGE.unpack_from(record)
                index.setdefault(channel, []).append((stamp_ns, offset))
            elif code == Opcode.CHANNEL:
                named = Channel.read(ReadDataStream(BytesIO(record)))
                self.channels[named.id] = named
        return index

    def _compare(self, told: MessageIndex) -> None:
        """Compare the index of a channel that follows a chunk with the messages of the chunk."""
        if self.index is None:
            self.found.lost += len(told.records)
        elif sorted(told.records) != sorted(self.index.get(told.channel_id, [])):
            raise ValueError("it does not name the messages of its chunk")

    def _again(self, place: int, problem: str) -> int | None:
        """Record a problem at an offset; return the offset of the next chunk, by the summary or by a search."""
        self.found.problems.append(problem)
        self._lose(place)
        following = next((start for start in self.starts if start > place), None)
        if following is None and not self.starts:
            following = self._search(place + 1)
        self.found.unread += (self.size if following is None else following) - place
        return following

    def _lose(self, place: int) -> None:
        """Record an offset, bytes, at which messages of the file are lost, unless an earlier one is known."""
        if self.found.sound_to is None:
            self.found.sound_to = place

    def _search(self, place: int) -> int | None:
        """Return the offset from `place` on at which a chunk seems to begin; None = there is none."""
        if place >= self.size:
            return None
        with mmap.mmap(self.file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            seen = [content.find(name, place + _BEFORE_COMPRESSION) for name in _COMPRESSIONS]
            while at := min((x for x in seen if x >= 0), default=0):
                begin = at - _BEFORE_COMPRESSION
                code, length = _HEAD.unpack_from(content, begin)
                if code == Opcode.CHUNK and begin + _HEAD.size + length <= self.size:
                    return begin
                seen = [content.find(name, at + 1) for name in _COMPRESSIONS]
        return None


def _attachment(stream: ReadDataStream, length: int) -> dict[str, bytes]:
    """Return the name and content of an attached file, as a dict (raises one of `BROKEN`)."""
    content = stream.read(length)
    attachment = Attachment.read(ReadDataStream(BytesIO(content)))
    if zlib.crc32(content[:-4]) != int.from_bytes(content[-4:], "little"):
        raise ValueError("its checksum is wrong")
    return {attachment.name: attachment.data}


def _records(chunk: Chunk) -> Iterator[tuple[int, int, bytes]]:
    """Yield code, place and content of the records of a chunk (raises one of `BROKEN`)."""
    stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    content, place = stream.read(size), 0
    while place < size:
        code, length = _HEAD.unpack_from(content, place)
        begin = place + _HEAD.size
        if begin + length > size:
            raise ValueError("a record goes beyond the end of its chunk")
        yield code, place, content[begin : begin + length]
        place = begin + length


def sound_messages(path: Path, pieces: Sequence[SoundChunk]) -> Iterator[StoredMessage]:
    """Yield the messages of readable chunks in the order of their stamps; only overlapping chunks are held in memory.

    Raises:
        OSError: the file cannot be read.
    """
    ordered = sorted(pieces, key=lambda piece: piece.start_ns)
    waiting: list[tuple[int, int, int, StoredMessage]] = []
    with path.open("rb") as file:
        for number, piece in enumerate(ordered):
            file.seek(piece.place)
            chunk = Chunk.read(ReadDataStream(BytesIO(file.read(piece.length))))
            for code, place, record in _records(chunk):
                if code == Opcode.MESSAGE:
                    channel, _, stamp_ns, _ = _MESSAGE.unpack_from(record)
                    stored = StoredMessage(channel, stamp_ns, record[_MESSAGE.size :])
                    heapq.heappush(waiting, (stamp_ns, piece.place, place, stored))
            until = ordered[number + 1].start_ns if number + 1 < len(ordered) else None
            while waiting and (until is None or waiting[0][0] < until):
                yield heapq.heappop(waiting)[3]
