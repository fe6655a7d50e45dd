"""Reads a whole MCAP file, whatever has happened to it: what can be read, and how much is lost.

A reader by index trusts the summary at the end, which a file that was cut off does not have. Here records are walked
from the front, every chunk is unpacked and its checksum compared; where a record is nonsense, the summary (if there is
one) gives the place of the next chunk. Format: MCAP specification, version 0.
"""

import struct
from collections import Counter
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Message, MessageIndex
from mcap.stream_reader import CRCValidationError, get_chunk_data_stream
from zstandard import ZstdError

from surefoot.record.chunks import MAGIC

BROKEN = (McapError, KeyError, ZstdError, struct.error, ValueError, EOFError, MemoryError)
"""Errors of reading a torn file: its records, their compression and their texts may each be damaged."""

_HEAD = struct.Struct("<BQ")
_OPCODES = frozenset(int(code) for code in Opcode)


@dataclass
class Findings:
    """Content of a file."""

    chunks: int = 0
    damaged: int = 0
    """Chunks that cannot be read."""
    messages: Counter[str] = field(default_factory=Counter[str])
    """Those that can be read, by key."""
    lost: int = 0
    """Messages that cannot; the least number when ``uncounted``."""
    uncounted: bool = False
    """There is no summary: messages after the last byte are unknown."""
    problems: list[str] = field(default_factory=list[str])

    @property
    def whole(self) -> bool:
        """True if every message can be read and every checksum is right."""
        return not self.problems


def check(path: Path) -> Findings:
    """Read every record of a file (raises OSError)."""
    with path.open("rb") as file:
        return _FileCheck(file, path.stat().st_size).findings()


class _FileCheck:
    def __init__(self, file: IO[bytes], size: int) -> None:
        self.file, self.size = file, size
        self.found = Findings()
        self.names: dict[int, str] = {}
        self.counts: Counter[int] = Counter()
        self.index: dict[int, list[tuple[int, int]]] | None = {}
        """Of the last chunk, per channel; None when it could not be read: the index after it counts its messages."""
        self.starts: list[int] = []
        self.total = self._summary()

    def _summary(self) -> int | None:
        """Number of messages by the summary; None when there is none that can be read."""
        try:
            summary = make_reader(self.file).get_summary()
        except (*BROKEN, OSError):  # shorter than a summary: its place is before the beginning
            summary = None
        if summary is None or summary.statistics is None:
            return None
        self.names = {number: channel.topic for number, channel in summary.channels.items()}
        self.starts = sorted(index.chunk_start_offset for index in summary.chunk_indexes)
        return summary.statistics.message_count

    def findings(self) -> Findings:
        found = self.found
        place = self._first()
        while place is not None:
            place = self._record(place)
        for number, count in self.counts.items():
            found.messages[self.names.get(number, f"channel {number}")] += count
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
        """Take in the record at a place; return that of the next, None at the end of the data."""
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
        if code in (Opcode.CHUNK, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.MESSAGE_INDEX):
            self._take(code, ReadDataStream(BytesIO(self.file.read(length))), place, length)
        return end

    def _take(self, code: int, stream: ReadDataStream, place: int, length: int) -> None:
        found = self.found
        try:
            match code:
                case Opcode.CHUNK:
                    found.chunks, self.index = found.chunks + 1, None
                    self.index = self._unpack(Chunk.read(stream))
                    self.counts.update({channel: len(entries) for channel, entries in self.index.items()})
                case Opcode.CHANNEL:
                    channel = Channel.read(stream)
                    self.names[channel.id] = channel.topic
                case Opcode.MESSAGE:
                    self.counts[Message.read(stream, length).channel_id] += 1
                case _:
                    self._compare(MessageIndex.read(stream))
        except BROKEN as error:
            found.damaged += code == Opcode.CHUNK
            what = {Opcode.CHUNK: "chunk", Opcode.MESSAGE_INDEX: "index"}.get(Opcode(code), "record")
            why = "its checksum is wrong" if isinstance(error, CRCValidationError) else str(error)[:120]
            found.problems.append(f"the {what} at byte {place} cannot be read: {why or type(error).__name__}")

    def _unpack(self, chunk: Chunk) -> dict[int, list[tuple[int, int]]]:
        """Index of a chunk by its messages: per channel time and offset of each."""
        stream, size = get_chunk_data_stream(chunk, validate_crc=True)
        index: dict[int, list[tuple[int, int]]] = {}
        while (offset := stream.count) < size:
            code, length = stream.read1(), stream.read8()
            if code == Opcode.MESSAGE:
                message = Message.read(stream, length)
                index.setdefault(message.channel_id, []).append((message.log_time, offset))
            elif code == Opcode.CHANNEL:
                channel = Channel.read(stream)
                self.names[channel.id] = channel.topic
            else:
                stream.read(length)
        return index

    def _compare(self, told: MessageIndex) -> None:
        """Hold the index of a channel, which follows its chunk, against the messages."""
        if self.index is None:
            self.found.lost += len(told.records)
        elif sorted(told.records) != sorted(self.index.get(told.channel_id, [])):
            raise ValueError("it does not name the messages of its chunk")

    def _again(self, place: int, problem: str) -> int | None:
        """Note what is wrong here, and go on with the next chunk the summary knows."""
        self.found.problems.append(problem)
        return next((start for start in self.starts if start > place), None)
