"""Whether a recording is sound as an MCAP file: both magics, every checksum, and an index that says what is there."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Mapping
from mmap import mmap
from typing import Any

from mcap import records as r

from recognition.recording.container import MAGIC
from recognition.recording.findings import Finding, error
from recognition.recording.scan import HEADER_BYTES, Placed
from recognition.recording.survey import Survey

_BLOCK_BYTES = 1 << 20
_FOOTER_OFFSETS_BYTES = 16
"""The footer's own checksum covers its two offsets."""


def structure_findings(data: mmap, found: Survey) -> Iterator[Finding]:
    """Faults of the file, from its bytes and their survey."""
    for damage in found.damages:
        yield error(f"bytes {damage.offset} to {damage.end} are damaged: {damage.reason}")
    if found.orphans:
        yield error(f"{found.orphans} messages belong to no known channel")
    if found.data_end is None or found.footer is None or data[found.footer.end :] != MAGIC:
        yield error("the file does not end as a finished recording does: it was cut, or its recorder was killed")
    if found.data_end is not None:
        yield from _checksum_findings(data, found.data_end, found.footer)
        yield from _index_findings(found)


def _checksum_findings(data: mmap, data_end: Placed, footer: Placed | None) -> Iterator[Finding]:
    if not data_checksum_holds(data, data_end):
        yield error("the checksum of the data section is wrong")
    if footer is None or not isinstance(footer.record, r.Footer):
        return
    start = footer.record.summary_start
    if start == 0:
        yield error("the file has no index")
        return
    if start != data_end.end or not index_checksum_holds(data, footer):
        yield error("the checksum or the place of the index is wrong")


def data_checksum_holds(data: mmap, data_end: Placed) -> bool:
    """Whether the bytes before the end of the data section are those that were written, as far as it says."""
    stated = struct.unpack_from("<I", data, data_end.offset + HEADER_BYTES)[0]
    return stated in (0, crc32(data, 0, data_end.offset))


def index_checksum_holds(data: mmap, footer: Placed | None) -> bool:
    """Whether the bytes of the index are those that were written, as far as the footer says."""
    if footer is None or not isinstance(footer.record, r.Footer):
        return False
    end = footer.offset + HEADER_BYTES + _FOOTER_OFFSETS_BYTES
    return footer.record.summary_crc in (0, crc32(data, footer.record.summary_start, end))


def crc32(data: mmap, start: int, end: int) -> int:
    """The checksum of some of a file's bytes."""
    crc = 0
    for offset in range(start, end, _BLOCK_BYTES):
        crc = zlib.crc32(data[offset : min(offset + _BLOCK_BYTES, end)], crc)
    return crc


def _index_findings(found: Survey) -> Iterator[Finding]:
    pairs: tuple[tuple[str, Mapping[Any, Any], Mapping[Any, Any]], ...] = (
        ("chunks, attachments and metadata", found.index, found.stated_index),
        ("messages of a chunk", found.message_index, found.stated_message_index),
        ("schemas and channels", found.definitions, found.stated_definitions),
    )
    for name, is_there, stated in pairs:
        differ = sum(is_there.get(key) != stated.get(key) for key in is_there.keys() | stated.keys())
        if differ:
            yield error(f"the index of {name} differs from what is there in {differ} of {len(is_there)} entries")
    if found.statistics != statistics(found):
        yield error(f"the statistics say {found.statistics}, the file holds {statistics(found)}")


def statistics(found: Survey) -> r.Statistics:
    """The statistics record that a file should have."""
    times = [t_ns for channel in found.channels.values() for t_ns in channel.log_ns]
    return r.Statistics(
        attachment_count=len(found.attachments),
        channel_count=len(found.channels),
        channel_message_counts={c.id: len(c.log_ns) for c in found.channels.values() if c.log_ns},
        chunk_count=found.chunks,
        message_count=len(times),
        message_end_time=max(times, default=0),
        message_start_time=min(times, default=0),
        metadata_count=len(found.metadata),
        schema_count=sum(kind is r.Schema for kind, _ in found.definitions),
    )
