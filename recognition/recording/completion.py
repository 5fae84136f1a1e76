"""A recording whose end the disk refused becomes a whole file where it lies, without room for a copy.

What was being written is cut off, and the index is made from what is there. Where even the index has no room, as many
bytes of the last chunks as it needs give their place to it, and no more. Layout of the end: https://mcap.dev/spec.
"""

from __future__ import annotations

import mmap
import os
import struct
import zlib
from collections.abc import Iterable, Iterator, Sequence
from io import FileIO
from pathlib import Path

from mcap import records as r
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

from recognition.errors import NoRoomError
from recognition.recording.container import MAGIC, publish, recover_command
from recognition.recording.scan import Damage, scan
from recognition.recording.structure import crc32, statistics
from recognition.recording.survey import IndexRecord, Survey, survey


def complete(part: Path, path: Path) -> int:
    """Cut a torn end off ``part``, write the index, and give the file the name ``path``.

    Returns:
        Its size in bytes.

    Raises:
        NoRoomError: where not even the index has room; ``part`` is what it was, without its torn end.
    """
    try:
        with part.open("r+b", buffering=0) as stream:  # what is refused must not stay in a buffer
            _complete(stream)
        publish(part, path)
        return path.stat().st_size
    except OSError as error:
        raise NoRoomError(
            "the recording cannot be finished",
            where=part,
            expected="room for its index",
            got=error.strerror or str(error),
            do_next=f"run `{recover_command(part)}` with a name on another disk",
        ) from error


def _complete(stream: FileIO) -> None:
    with _mapped(stream) as data:
        ends = list(_sound_ends(data))
    try:
        _end_at(stream, ends[-1])
    except OSError:
        stream.truncate(ends[-1])
        with _mapped(stream) as data:
            needed = len(_end_of_file(data))
        _end_at(stream, next((end for end in reversed(ends) if end <= ends[-1] - needed), ends[0]))


def _end_at(stream: FileIO, end: int) -> None:
    """Cut the file off at a sound end of its data, and write what belongs after it."""
    stream.truncate(end)
    with _mapped(stream) as data:
        rest = _end_of_file(data)
    stream.seek(end)
    while rest:
        rest = rest[stream.write(rest) :]
    os.fsync(stream.fileno())


def _mapped(stream: FileIO) -> mmap.mmap:
    return mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)


def _sound_ends(data: mmap.mmap) -> Iterator[int]:
    """Where the data section may end: after each record, and for a chunk after its message indexes."""
    yield len(MAGIC)
    to_be_indexed: set[int] = set()
    for placed in scan(data):
        if isinstance(placed, Damage) or isinstance(placed.record, r.DataEnd):
            return
        if isinstance(placed.record, r.Chunk):
            messages = (inner.record for inner in placed.contents if isinstance(inner.record, r.Message))
            to_be_indexed = {message.channel_id for message in messages}
        elif isinstance(placed.record, r.MessageIndex):
            to_be_indexed.discard(placed.record.channel_id)
        if not to_be_indexed:
            yield placed.end


def _end_of_file(data: mmap.mmap) -> bytes:
    """Everything that follows the data section, for a file that ends with it."""
    head = _bytes_of([r.DataEnd(crc32(data, 0, len(data)))])
    summary_start = len(data) + len(head)
    summary, offsets_start = _summary(survey(data, lambda _channel, _message: None), summary_start)
    fields = struct.pack("<BQQQ", Opcode.FOOTER, 8 + 8 + 4, summary_start, offsets_start)
    footer = r.Footer(summary_start, offsets_start, zlib.crc32(fields, zlib.crc32(summary)))
    return head + summary + _bytes_of([footer]) + MAGIC


def _summary(found: Survey, start: int) -> tuple[bytes, int]:
    """The summary section, which begins at ``start``, and where its offsets begin."""
    definitions = found.definitions.values()
    index: Iterable[IndexRecord] = found.index.values()
    groups: Sequence[tuple[Opcode, Sequence[r.McapRecord]]] = (
        (Opcode.SCHEMA, [record for record in definitions if isinstance(record, r.Schema)]),
        (Opcode.CHANNEL, [record for record in definitions if isinstance(record, r.Channel)]),
        (Opcode.STATISTICS, [statistics(found)]),
        (Opcode.CHUNK_INDEX, [record for record in index if isinstance(record, r.ChunkIndex)]),
        (Opcode.ATTACHMENT_INDEX, [record for record in index if isinstance(record, r.AttachmentIndex)]),
        (Opcode.METADATA_INDEX, [record for record in index if isinstance(record, r.MetadataIndex)]),
    )
    parts: list[bytes] = []
    offsets: list[r.McapRecord] = []
    at = start
    for opcode, records in groups:
        if records:
            parts.append(_bytes_of(records))
            offsets.append(r.SummaryOffset(opcode, at, len(parts[-1])))
            at += len(parts[-1])
    return b"".join([*parts, _bytes_of(offsets)]), at


def _bytes_of(records: Iterable[r.McapRecord]) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data
