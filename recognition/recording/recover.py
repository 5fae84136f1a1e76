"""What can be saved of a recording that was cut, killed or damaged.

Nothing was lost only where the end of the data was reached and every byte before it is sound. Where the end is
missing, something may have been lost even though every byte that is there is sound: the recorder's last moments never
reached the file.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from mmap import mmap
from pathlib import Path
from types import MappingProxyType

from mcap import records as r
from mcap.writer import Writer

from recognition.errors import RecordingError
from recognition.recording.check import message_counts, require_mcap
from recognition.recording.container import mapped, open_writer, publish
from recognition.recording.content import missing_messages
from recognition.recording.definitions import is_definition, repeated_definitions
from recognition.recording.scan import Damage, Placed, scan
from recognition.recording.structure import data_checksum_holds, index_checksum_holds, structure_findings
from recognition.recording.survey import ChannelSurvey, Survey, survey


@dataclass(frozen=True, slots=True)
class Recovery:
    """What a recovery kept and what it could not."""

    messages: Mapping[str, int]
    """Messages kept, per topic."""
    missing: Mapping[str, int]
    """Messages known to be missing before the last one kept, per topic, by the recorder's numbering."""
    chunks: int
    """Sound chunks of the source."""
    bytes_discarded: int
    """Bytes of the source that could not be read."""
    losses: tuple[str, ...]
    """What was lost, in words; empty where nothing was."""
    last_ns: int
    """Latest log time kept, rig time in nanoseconds."""

    @property
    def lost(self) -> bool:
        """Whether anything was lost, or may have been."""
        return bool(self.losses)


def recover_recording(source: Path, destination: Path) -> Recovery:
    """Copy everything sound of ``source`` into a new, finished recording; the source is only read.

    Messages, schemas, channels, attachments and metadata keep their bytes, times and order; the index is built anew.
    ``destination`` appears, and replaces what was there, when it is complete and was read back without a fault.

    Raises:
        RecordingError: where the source is no MCAP file or holds no readable message, or the destination cannot be
            written.
    """
    if destination.resolve() == source.resolve():
        raise RecordingError(
            "a recording cannot be recovered onto itself",
            where=source,
            expected="another file to write to",
            got=destination,
            do_next="give another name with -o; the source stays as it is",
        )
    temporary = destination.with_name(destination.name + ".tmp")
    with mapped(source) as data:
        found = survey(data, _no_visit)
        require_mcap(source, data, found)
        try:
            if not _write_copy(data, found, temporary):
                raise RecordingError(
                    "nothing can be recovered",
                    where=source,
                    expected="at least one readable message",
                    got=f"none in {len(data)} bytes",
                    do_next="record again; the run ended, or the file is damaged, before its first message",
                )
            recovery = _recovery(data, found, _read_back(temporary))
            publish(temporary, destination)
        except OSError as error:
            raise RecordingError(
                "cannot write the recovered recording",
                where=destination,
                expected="a folder that exists, can be written and has room",
                got=error.strerror or str(error),
                do_next="give another name with -o, or make room; the source stays as it is",
            ) from error
        finally:
            temporary.unlink(missing_ok=True)
    return recovery


def _no_visit(_channel: ChannelSurvey, _message: r.Message) -> None:
    """The survey alone is wanted."""


def _write_copy(data: mmap, found: Survey, temporary: Path) -> int:
    """Write everything sound to a new file; how many messages that was."""
    count = 0
    header = found.header or r.Header("", "")
    with temporary.open("wb") as stream:
        writer = open_writer(stream, profile=header.profile, library=header.library)
        channel_ids = _define(writer, found, index_is_sound=index_checksum_holds(data, found.footer))
        for record in _sound_records(data):
            if isinstance(record, r.Message) and record.channel_id in channel_ids:
                channel_id = channel_ids[record.channel_id]
                writer.add_message(channel_id, record.log_time, record.data, record.publish_time, record.sequence)
                count += 1
            elif isinstance(record, r.Attachment):
                writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
            elif isinstance(record, r.Metadata) and not is_definition(record):
                writer.add_metadata(record.name, record.metadata)
        writer.finish()  # type: ignore[no-untyped-call]
        stream.flush()
        os.fsync(stream.fileno())
    return count


def _sound_records(data: mmap) -> Iterator[r.McapRecord]:
    """The records of the data section, those of chunks among them."""
    for part in scan(data):
        if isinstance(part, Placed):
            if isinstance(part.record, r.DataEnd):
                return
            yield part.record
            yield from (inner.record for inner in part.contents)


def _define(writer: Writer, found: Survey, *, index_is_sound: bool) -> dict[int, int]:
    """Register every schema and channel that is known from anywhere; the new id of each channel."""
    schemas: dict[int, r.Schema] = {}
    channels: dict[int, r.Channel] = {}
    for record in (
        *repeated_definitions(found.metadata),
        *(found.stated_definitions.values() if index_is_sound else ()),
        *found.definitions.values(),
    ):
        if isinstance(record, r.Schema):
            schemas[record.id] = record
        elif isinstance(record, r.Channel):
            channels[record.id] = record
    schema_ids = {0: 0}  # 0: a channel without a schema
    for key, schema in sorted(schemas.items()):
        schema_ids[key] = writer.register_schema(schema.name, schema.encoding, schema.data)
    return {
        key: writer.register_channel(
            channel.topic, channel.message_encoding, schema_ids[channel.schema_id], channel.metadata
        )
        for key, channel in sorted(channels.items())
        if channel.schema_id in schema_ids
    }


def _read_back(temporary: Path) -> Survey:
    """The survey of the new file, which must be without a fault."""
    with mapped(temporary) as data:
        kept = survey(data, _no_visit)
        for finding in structure_findings(data, kept):
            raise RecordingError(
                "the recovered recording cannot be read back",
                where=temporary,
                expected="a sound file",
                got=finding.text,
                do_next="check the disk, and recover to another one; the source stays as it is",
            )
    return kept


def _recovery(data: mmap, found: Survey, kept: Survey) -> Recovery:
    end = found.data_end.offset if found.data_end else len(data)
    damages = [damage for damage in found.damages if damage.offset < end]
    missing = {channel.topic: count for channel in kept.channels.values() if (count := missing_messages(kept, channel))}
    return Recovery(
        messages=message_counts(kept),
        missing=MappingProxyType(missing),
        chunks=found.chunks,
        bytes_discarded=sum(damage.end - damage.offset for damage in damages),
        losses=tuple(_losses(data, found, kept, damages, missing)),
        last_ns=max(t_ns for channel in kept.channels.values() for t_ns in channel.log_ns),
    )


def _losses(
    data: mmap, found: Survey, kept: Survey, damages: list[Damage], missing: Mapping[str, int]
) -> Iterator[str]:
    orphans = found.orphans + _message_count(found) - _message_count(kept)
    for damage in damages:
        yield f"bytes {damage.offset} to {damage.end}: {damage.reason}"
    if damages or orphans:  # else they were missing before
        yield from (f"{topic}: {count} messages are missing" for topic, count in missing.items())
    if orphans:
        yield f"{orphans} messages are of channels whose definition is lost"
    if found.data_end is None:
        yield "the end is missing: messages of the last second before the cut may never have reached the file"
    elif not damages and not data_checksum_holds(data, found.data_end):
        yield "the header, the metadata or an index was changed: the checksum of the data is wrong"


def _message_count(found: Survey) -> int:
    return sum(len(channel.log_ns) for channel in found.channels.values())
