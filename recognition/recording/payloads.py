"""All messages of one schema of a finished recording, in the order of recording, without looking into any other.

The file is walked from record to record by their lengths, and so is each chunk once its checksum holds: of an hour of
four cameras every chunk has to be decompressed, but few of its messages are wanted.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from io import BytesIO
from mmap import mmap
from pathlib import Path
from typing import NamedTuple

from mcap import records as r
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode

from recognition.recording.container import MAGIC, damaged, mapped
from recognition.recording.scan import FAULTS, HEADER_BYTES, chunk_data

_HEADER = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HI")
_MESSAGE_BYTES = 22
"""Channel, number and two times in front of what a message holds."""
_KNOWN = frozenset(Opcode)


class Payload(NamedTuple):
    """A message."""

    channel_id: int
    number: int
    """Among those of its topic, in the whole run."""
    data: bytes


def iter_payloads(path: Path, schema: str) -> Iterator[Payload]:
    """The messages of a schema.

    Raises:
        RecordingError: where the file is absent, unfinished or damaged.
    """
    schemas: set[int] = set()
    channels: set[int] = set()
    with mapped(path) as data:
        for start, end in _chunks(path, data):
            try:
                chunk = r.Chunk.read(ReadDataStream(BytesIO(data[start:end])))
                found = list(_wanted(chunk_data(chunk), schema, schemas, channels))
            except FAULTS as error:
                raise damaged(path, f"a chunk is damaged ({error})") from error
            yield from found


def _chunks(path: Path, data: mmap) -> Iterator[tuple[int, int]]:
    """First byte and end of what each chunk record holds."""
    offset = len(MAGIC)
    if data[:offset] != MAGIC:
        raise damaged(path, "the magic at the start is missing")
    while offset + HEADER_BYTES <= len(data):
        opcode, length = _HEADER.unpack_from(data, offset)
        start = offset + HEADER_BYTES
        offset = start + length
        if opcode not in _KNOWN or offset > len(data):
            raise damaged(path, f"no record begins at byte {start - HEADER_BYTES}")
        if opcode == Opcode.DATA_END:
            return
        if opcode == Opcode.CHUNK:
            yield start, offset
    raise damaged(path, "it ends before its index")


def _wanted(records: bytes, schema: str, schemas: set[int], channels: set[int]) -> Iterator[Payload]:
    """The messages of a chunk; remembers what schemas and channels it defines."""
    offset = 0
    while offset < len(records):
        opcode, length = _HEADER.unpack_from(records, offset)
        start = offset + HEADER_BYTES
        offset = start + length
        if offset > len(records):
            raise ValueError("a record reaches past its end")
        if opcode == Opcode.MESSAGE:
            channel_id, number = _MESSAGE.unpack_from(records, start)
            if channel_id in channels:
                yield Payload(channel_id, number, records[start + _MESSAGE_BYTES : offset])
        elif opcode == Opcode.SCHEMA:
            own = r.Schema.read(ReadDataStream(BytesIO(records[start:offset])))
            schemas |= {own.id} if own.name == schema else set()
        elif opcode == Opcode.CHANNEL:
            channel = r.Channel.read(ReadDataStream(BytesIO(records[start:offset])))
            channels |= {channel.id} if channel.schema_id in schemas else set()
