"""One pass over a recording that tabulates what it holds: the index as it should be, and the index as it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from mmap import mmap

from mcap import records as r

from recognition.recording.scan import Damage, Placed, scan

IndexRecord = r.ChunkIndex | r.AttachmentIndex | r.MetadataIndex


@dataclass(slots=True)
class ChannelSurvey:
    """The messages of one channel, in file order."""

    id: int
    topic: str
    schema: str
    log_ns: list[int] = field(default_factory=list)
    publish_ns: list[int] = field(default_factory=list)
    sequences: list[int] = field(default_factory=list)


Visit = Callable[[ChannelSurvey, r.Message], None]


@dataclass(slots=True)
class Survey:
    """What a recording holds; filled by :func:`survey`."""

    header: r.Header | None = None
    damages: list[Damage] = field(default_factory=list)
    channels: dict[int, ChannelSurvey] = field(default_factory=dict)
    definitions: dict[tuple[type, int], r.McapRecord] = field(default_factory=dict)
    """Schemas and channels of the data."""
    stated_definitions: dict[tuple[type, int], r.McapRecord] = field(default_factory=dict)
    """Schemas and channels that the index repeats."""
    attachments: list[r.Attachment] = field(default_factory=list)
    metadata: list[r.Metadata] = field(default_factory=list)
    chunks: int = 0
    orphans: int = 0
    """Messages whose channel is not defined before them."""
    index: dict[int, IndexRecord] = field(default_factory=dict)
    """The index as it should be, by the offset of what it points to."""
    stated_index: dict[int, IndexRecord] = field(default_factory=dict)
    """The index as it is."""
    message_index: dict[tuple[int, int], list[tuple[int, int]]] = field(default_factory=dict)
    """By chunk offset and channel: time and offset of each message."""
    stated_message_index: dict[tuple[int, int], list[tuple[int, int]]] = field(default_factory=dict)
    statistics: r.Statistics | None = None
    data_end: Placed | None = None
    footer: Placed | None = None


def survey(data: mmap, visit: Visit) -> Survey:
    """Tabulate a recording; ``visit`` sees every message whose channel is known, in file order."""
    found, chunk = Survey(), None
    for part in scan(data):
        if isinstance(part, Damage):
            found.damages.append(part)
            chunk = None
        elif isinstance(part.record, r.Chunk):
            chunk = _add_chunk(found, part, part.record, visit)
        elif isinstance(part.record, r.MessageIndex):
            if chunk is not None:
                _add_message_index(found, chunk, part, part.record)
        elif found.data_end is None:
            _add_data(found, part, visit)
        else:
            _add_summary(found, part)
    return found


def _add_chunk(found: Survey, placed: Placed, record: r.Chunk, visit: Visit) -> r.ChunkIndex:
    times = []
    for inner in placed.contents:
        _add_data(found, inner, visit)
        if isinstance(inner.record, r.Message):
            key = (placed.offset, inner.record.channel_id)
            found.message_index.setdefault(key, []).append((inner.record.log_time, inner.offset))
            times.append(inner.record.log_time)
    index = r.ChunkIndex(
        chunk_length=placed.end - placed.offset,
        chunk_start_offset=placed.offset,
        compression=record.compression,
        compressed_size=len(record.data),
        message_end_time=max(times, default=0),
        message_index_length=0,
        message_index_offsets={},
        message_start_time=min(times, default=0),
        uncompressed_size=record.uncompressed_size,
    )
    found.chunks += 1
    found.index[placed.offset] = index
    return index


def _add_message_index(found: Survey, chunk: r.ChunkIndex, placed: Placed, record: r.MessageIndex) -> None:
    found.stated_message_index[chunk.chunk_start_offset, record.channel_id] = record.records
    chunk.message_index_offsets[record.channel_id] = placed.offset
    chunk.message_index_length += placed.end - placed.offset


def _add_data(found: Survey, placed: Placed, visit: Visit) -> None:
    match placed.record:
        case r.Header() as record:
            found.header = record
        case r.Schema() as record:
            found.definitions[r.Schema, record.id] = record
        case r.Channel() as record:
            schema = found.definitions.get((r.Schema, record.schema_id))
            name = schema.name if isinstance(schema, r.Schema) else ""
            found.definitions[r.Channel, record.id] = record
            found.channels.setdefault(record.id, ChannelSurvey(record.id, record.topic, name))
        case r.Message() as record:
            _add_message(found, record, visit)
        case r.Attachment() as record:
            found.attachments.append(record)
            found.index[placed.offset] = r.AttachmentIndex(
                offset=placed.offset,
                length=placed.end - placed.offset,
                log_time=record.log_time,
                create_time=record.create_time,
                data_size=len(record.data),
                name=record.name,
                media_type=record.media_type,
            )
        case r.Metadata() as record:
            found.metadata.append(record)
            found.index[placed.offset] = r.MetadataIndex(placed.offset, placed.end - placed.offset, record.name)
        case r.DataEnd():
            found.data_end = placed


def _add_message(found: Survey, message: r.Message, visit: Visit) -> None:
    channel = found.channels.get(message.channel_id)
    if channel is None:
        found.orphans += 1
        return
    channel.log_ns.append(message.log_time)
    channel.publish_ns.append(message.publish_time)
    channel.sequences.append(message.sequence)
    visit(channel, message)


def _add_summary(found: Survey, placed: Placed) -> None:
    match placed.record:
        case r.Schema() | r.Channel() as record:
            found.stated_definitions[type(record), record.id] = record
        case r.ChunkIndex() as record:
            found.stated_index[record.chunk_start_offset] = record
        case r.AttachmentIndex() | r.MetadataIndex() as record:
            found.stated_index[record.offset] = record
        case r.Statistics() as record:
            found.statistics = record
        case r.Footer():
            found.footer = placed
