"""Fast writer of MCAP files, which uses the record types of the `mcap` library.

The library's own writer spends five calls on each message and compresses at a higher level, which slowed down a run by
a sixth. Here a message is one `struct.pack`; all other records are written once per chunk or once per file, by the
library. Format: MCAP specification, version 0.
"""

import struct
import zlib
from collections.abc import Mapping
from typing import IO

import zstandard
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

MAGIC = b"\x89MCAP0\r\n"
CHUNK_BYTES = 1 << 18
LEVEL = 1
"""Compression level of zstd for the chunks of a recording; 1 is the fastest of its usual levels."""

_message_head = struct.Struct("<BQHIQQ").pack  # opcode, length of the rest, channel, sequence, log and publish time
_REST = 22  # bytes of a message's record besides opcode, length and data


class ChunkWriter:
    """Writer of one MCAP file: schemas, channels, messages in compressed chunks, metadata, an index at the end."""

    def __init__(self, file: IO[bytes], library: str) -> None:
        self._file = file
        self._position = 0
        self.written = 0
        """Number of messages in chunks that are written to the file."""
        self._schemas: list[records.Schema] = []
        self._channels: list[records.Channel] = []
        self._metadata: list[records.MetadataIndex] = []
        self._attachments: list[records.AttachmentIndex] = []
        self._chunks: list[records.ChunkIndex] = []
        self._counts: dict[int, int] = {}
        self._compressor = zstandard.ZstdCompressor(level=LEVEL)
        self._begin_chunk()
        self._write(MAGIC)
        self._write(_encoded(records.Header(profile="", library=library)))

    def add_channel(self, key: str, encoding: str, schema: str, text: bytes) -> int:
        """Declare a topic with name (`schema`) and text of its JSON Schema; return the number of its channel.

        `key`: key of the topic; `encoding`: encoding of its messages, such as `json`.
        """
        number = len(self._channels) + 1
        self._schemas.append(records.Schema(id=number, data=text, encoding="jsonschema", name=schema))
        self._channels.append(
            records.Channel(id=number, topic=key, message_encoding=encoding, metadata={}, schema_id=number)
        )
        self._counts[number] = 0
        self._add(_encoded(self._schemas[-1]) + _encoded(self._channels[-1]))
        return number

    def add_message(self, channel: int, stamp_ns: int, seq: int, data: bytes) -> None:
        """Append a message to the present chunk; a full chunk is compressed and written to the file.

        Args:
            channel: number of its channel, as `add_channel` returned it.
            stamp_ns: time of the message, ns.
            seq: sequence number.
            data: encoded message.
        """
        places = self._places.get(channel)
        if places is None:
            places = self._places[channel] = []
        places += (stamp_ns, self._size)
        self._add(_message_head(Opcode.MESSAGE, _REST + len(data), channel, seq, stamp_ns, stamp_ns) + data)
        if self._size >= CHUNK_BYTES:
            self._end_chunk()

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Add a named table of texts to the metadata of the recording."""
        data, start = _encoded(records.Metadata(name=name, metadata=dict(values))), self._position
        self._write(data)
        self._metadata.append(records.MetadataIndex(offset=start, length=len(data), name=name))

    def add_attachment(self, name: str, kind: str, data: bytes) -> None:
        """Attach the content of a file to the recording; `kind`: its media type."""
        record = _encoded(records.Attachment(create_time=0, log_time=0, name=name, media_type=kind, data=data))
        index = records.AttachmentIndex(
            offset=self._position, length=len(record), create_time=0, log_time=0, data_size=len(data), name=name,
            media_type=kind,
        )  # fmt: skip
        self._write(record)
        self._attachments.append(index)

    def finish(self) -> None:
        """Write the last chunk, the summary and the index; the file stays open."""
        self._end_chunk()
        self._write(_encoded(records.DataEnd(data_section_crc=0)))
        start = self._position
        statistics = records.Statistics(
            attachment_count=len(self._attachments), channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks), message_count=sum(self._counts.values()),
            message_end_time=max((c.message_end_time for c in self._chunks), default=0),
            message_start_time=min((c.message_start_time for c in self._chunks), default=0),
            metadata_count=len(self._metadata), schema_count=len(self._schemas),
        )  # fmt: skip
        indices = (*self._chunks, *self._attachments, *self._metadata)
        for record in (*self._schemas, *self._channels, statistics, *indices):
            self._write(_encoded(record))
        self._write(_encoded(records.Footer(summary_start=start, summary_offset_start=0, summary_crc=0)))
        self._write(MAGIC)

    def _add(self, record: bytes) -> None:
        self._parts.append(record)
        self._size += len(record)

    def _begin_chunk(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0
        self._places: dict[int, list[int]] = {}
        """Stamp, ns, and offset in the chunk of each message in turn, by channel."""

    def _end_chunk(self) -> None:
        if not self._parts:
            return
        data = b"".join(self._parts)
        stamps = [stamp for places in self._places.values() for stamp in places[::2]] or [0]
        packed = self._compressor.compress(data)
        chunk = _encoded(
            records.Chunk(
                compression="zstd", data=packed, message_end_time=max(stamps), message_start_time=min(stamps),
                uncompressed_crc=zlib.crc32(data), uncompressed_size=len(data),
            )
        )  # fmt: skip
        start, offsets = self._position, dict[int, int]()
        self._write(chunk)
        for channel, places in self._places.items():
            offsets[channel] = self._position
            self._counts[channel] += len(places) // 2
            pairs = list(zip(places[::2], places[1::2], strict=True))
            self._write(_encoded(records.MessageIndex(channel_id=channel, records=pairs)))
        self._chunks.append(
            records.ChunkIndex(
                chunk_length=len(chunk), chunk_start_offset=start, compression="zstd", compressed_size=len(packed),
                message_end_time=max(stamps), message_index_length=self._position - start - len(chunk),
                message_index_offsets=offsets, message_start_time=min(stamps), uncompressed_size=len(data),
            )
        )  # fmt: skip
        self._file.flush()
        self.written += sum(len(places) // 2 for places in self._places.values())
        self._begin_chunk()

    def _write(self, data: bytes) -> None:
        self._file.write(data)
        self._position += len(data)


def _encoded(record: records.McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()
