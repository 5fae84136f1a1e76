"""Records of an MCAP file in file order, damaged or not: the base of check and recover.

The stock sequential reader stops at the first fault, and allocates what a damaged length field says. Here a record's
length is bounded by the bytes that are left before anything is read, chunks and attachments are held against their
checksums, and after a fault the scan goes on at the next place that has the whole form of a chunk, an attachment, a
metadata record or the end of the data. Record layouts: https://mcap.dev/spec.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from io import BytesIO
from mmap import mmap
from types import MappingProxyType

import zstandard
from mcap import records as r
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.stream_reader import get_chunk_data_stream

from recognition.recording.container import MAGIC

HEADER_BYTES = 9
"""Opcode and length in front of each record."""
MAX_CHUNK_BYTES = 1 << 30
"""Limit of a decompressed chunk, as the reference command-line tool has it; a damaged size field stops here."""

_READERS: Mapping[int, Callable[[ReadDataStream], r.McapRecord]] = MappingProxyType(
    {
        Opcode.HEADER: r.Header.read,
        Opcode.FOOTER: r.Footer.read,
        Opcode.SCHEMA: r.Schema.read,
        Opcode.CHANNEL: r.Channel.read,
        Opcode.CHUNK: r.Chunk.read,
        Opcode.MESSAGE_INDEX: r.MessageIndex.read,
        Opcode.CHUNK_INDEX: r.ChunkIndex.read,
        Opcode.ATTACHMENT: r.Attachment.read,
        Opcode.ATTACHMENT_INDEX: r.AttachmentIndex.read,
        Opcode.STATISTICS: r.Statistics.read,
        Opcode.METADATA: r.Metadata.read,
        Opcode.METADATA_INDEX: r.MetadataIndex.read,
        Opcode.SUMMARY_OFFSET: r.SummaryOffset.read,
        Opcode.DATA_END: r.DataEnd.read,
    }
)
FAULTS = (ValueError, struct.error, OverflowError, RuntimeError, McapError, zstandard.ZstdError)
"""What reading damaged records raises, the stock reader included; lz4 raises RuntimeError."""
_ANCHOR = re.compile(
    rb"(?=\x06.{4}\x00{4}.{28}(?:\x00{4}|\x03\x00{3}lz4|\x04\x00{3}zstd)"  # chunk
    rb"|\x09.{4}\x00{4}.{16}.{2}\x00{2}"  # attachment, its name shorter than 64 KiB
    rb"|\x0c.{2}\x00{6}.{2}\x00{2}"  # metadata shorter than 64 KiB
    rb"|\x0f\x04\x00{7})",  # end of the data section
    re.DOTALL,
)
"""Where a record may begin that can prove by its own lengths that it is one."""


@dataclass(frozen=True, slots=True)
class Placed:
    """A sound record and its place."""

    offset: int
    """First byte of its header, in the file or in its decompressed chunk."""
    end: int
    """First byte after it."""
    record: r.McapRecord
    contents: tuple[Placed, ...] = ()
    """Of a chunk: the records inside."""


@dataclass(frozen=True, slots=True)
class Damage:
    """Bytes that are no sound record."""

    offset: int
    end: int
    reason: str


class _ExactStream(ReadDataStream):
    """Reads all that is asked for, or fails: the stock stream returns less without a word."""

    def read(self, length: int) -> bytes:
        data = super().read(length)
        if len(data) != length:
            raise EndOfFile
        return data


def scan(data: mmap) -> Iterator[Placed | Damage]:
    """Every byte of a file but its magics, as sound records and damage, up to the footer or the file's end."""
    if data[: len(MAGIC)] != MAGIC:
        yield Damage(0, min(len(MAGIC), len(data)), "the magic at the start is missing")
    offset, chunked = len(MAGIC), False
    while offset < len(data):
        placed = _place(data, offset, len(data))
        if isinstance(placed, Placed) and isinstance(placed.record, r.Message) and chunked:
            placed = Damage(offset, offset, "a message stands outside the chunks")
        if isinstance(placed, Damage):
            placed = Damage(offset, _next_anchor(data, offset + 1), placed.reason)
        else:
            placed = _verified(data, placed)
        yield placed
        offset = placed.end
        if isinstance(placed, Placed):
            chunked |= isinstance(placed.record, r.Chunk)
            if isinstance(placed.record, r.Footer):
                return


def _place(data: mmap | bytes, offset: int, end: int) -> Placed | Damage:
    """The record at ``offset``, none of whose lengths reaches past ``end``, or the reason why there is none."""
    left = end - offset - HEADER_BYTES
    if left < 0:
        return Damage(offset, end, "the file ends inside the header of a record")
    opcode, length = struct.unpack_from("<BQ", data, offset)
    if length > left:
        return Damage(offset, end, f"a record says {length} bytes where {left} are left")
    start = offset + HEADER_BYTES
    if opcode != Opcode.MESSAGE and opcode not in _READERS:
        return Damage(offset, end, f"a record is of no known kind ({opcode})")
    stream = _ExactStream(BytesIO(data[start : start + length]))
    try:
        record = r.Message.read(stream, length) if opcode == Opcode.MESSAGE else _READERS[opcode](stream)
    except FAULTS as error:
        return Damage(offset, end, f"a record cannot be read ({type(error).__name__})")
    if stream.count != length:
        return Damage(offset, end, f"a record says {length} bytes and has {stream.count}")
    return Placed(offset, start + length, record)


def _verified(data: mmap, placed: Placed) -> Placed | Damage:
    """The record after its checksum; a chunk with its contents."""
    if isinstance(placed.record, r.Attachment):
        stated = struct.unpack_from("<I", data, placed.end - 4)[0]
        if stated not in (0, zlib.crc32(data[placed.offset + HEADER_BYTES : placed.end - 4])):
            return Damage(placed.offset, placed.end, f"the checksum of attachment {placed.record.name!r} is wrong")
    if isinstance(placed.record, r.Chunk):
        try:
            contents = _contents(placed.record)
        except FAULTS as error:
            return Damage(placed.offset, placed.end, f"a chunk is damaged ({error})")
        return Placed(placed.offset, placed.end, placed.record, contents)
    return placed


def chunk_data(chunk: r.Chunk) -> bytes:
    """The decompressed records of a chunk whose checksum is right; one of :data:`FAULTS` where it is not."""
    if chunk.uncompressed_size > MAX_CHUNK_BYTES:
        raise ValueError(f"it says {chunk.uncompressed_size} bytes, the limit is {MAX_CHUNK_BYTES}")
    if chunk.compression not in ("", "lz4", "zstd"):
        raise ValueError(f"unknown compression {chunk.compression!r}")
    if chunk.compression == "zstd" and zstandard.frame_content_size(chunk.data) not in (-1, chunk.uncompressed_size):
        raise ValueError("its compressed data is of another size")
    stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    return stream.read(size)


def _contents(chunk: r.Chunk) -> tuple[Placed, ...]:
    """The records of a chunk whose checksum is right; ValueError and the like where it is not."""
    data, offset, contents = chunk_data(chunk), 0, []
    while offset < len(data):
        placed = _place(data, offset, len(data))
        if isinstance(placed, Damage):
            raise ValueError(placed.reason)
        contents.append(placed)
        offset = placed.end
    return tuple(contents)


def _next_anchor(data: mmap, start: int) -> int:
    """Where the next record begins that proves itself, or the end of the file."""
    offset = start
    while match := _ANCHOR.search(data, offset):
        offset = match.start()
        if isinstance(_place(data, offset, len(data)), Placed):
            return offset
        offset += 1
    return len(data)
