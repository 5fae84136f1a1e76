"""Messages and the rig file out of a finished recording."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from google.protobuf.message import DecodeError, Message
from mcap import records as r
from mcap.data_stream import ReadDataStream
from mcap.reader import McapReader, make_reader
from mcap.stream_reader import breakup_chunk
from mcap_protobuf.decoder import DecoderFactory

from recognition.errors import RecordingError
from recognition.recording import detections, tracks
from recognition.recording.container import (
    RIG_ATTACHMENT,
    RIG_METADATA,
    RULES_ATTACHMENT,
    SEGMENT_METADATA,
    damaged,
    opened,
)
from recognition.recording.detections import RecordedView, recorded_view
from recognition.recording.payloads import iter_payloads
from recognition.recording.scan import FAULTS, HEADER_BYTES
from recognition.recording.tracks import TrackedInstant, tracked_instant

_LATEST_NS = 2**63 - 1


@dataclass(frozen=True, slots=True)
class RecordedMessage:
    """A message as it was recorded."""

    topic: str
    log_ns: int
    """Receive time where live, else capture time; rig time in nanoseconds."""
    publish_ns: int
    """Capture time; rig time in nanoseconds."""
    message: Message
    """The Foxglove message, decoded by the schema in the file."""


def iter_messages(
    path: Path,
    topics: Iterable[str] | None = None,
    *,
    start_ns: int | None = None,
    end_ns: int | None = None,
    newest_first: bool = False,
) -> Iterator[RecordedMessage]:
    """The messages of a finished recording in the order of log time; of equal times, in the order of recording.

    The index leads to them: chunks that hold no such topic, or only other times, are not read.

    Args:
        path: One file.
        topics: Only these.
        start_ns: Only messages logged from this time on.
        end_ns: Only messages logged up to this time.
        newest_first: The other way round.

    Raises:
        RecordingError: where the file is absent, unfinished or damaged.
    """
    wanted = None if topics is None else list(topics)
    with _reading(path) as reader:
        found = reader.iter_decoded_messages(wanted, starting_at=start_ns, ending_at=end_ns, reverse=newest_first)
        for _, channel, message, decoded in found:
            yield RecordedMessage(channel.topic, message.log_time, message.publish_time, decoded)


def iter_detections(path: Path, *, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[RecordedView]:
    """What the cameras saw, in the order of recording: the views of one instant stand together.

    Args:
        path: One file.
        start_ns: Only what was logged from this time on; found by the index, without reading what was before.
        end_ns: Only what was logged up to this time.

    Raises:
        RecordingError: where the file is absent, unfinished or damaged.
    """
    if start_ns is None and end_ns is None:
        return (_view(path, payload.data) for payload in iter_payloads(path, detections.SCHEMA))
    return _detections_between(path, start_ns or 0, _LATEST_NS if end_ns is None else end_ns)


def iter_tracks(path: Path) -> Iterator[tuple[int, TrackedInstant]]:
    """What was judged at each instant, in the order of recording, and which of the run's instants it was, from 0.

    Raises:
        RecordingError: where the file is absent, unfinished or damaged.
    """
    for payload in iter_payloads(path, tracks.SCHEMA):
        try:
            yield payload.number, tracked_instant(payload.data)
        except ValueError as error:
            raise damaged(path, str(error)) from error


def holds_tracks(files: Iterable[Path]) -> bool:
    """Whether the files of a recording hold tracks, and so does each of them that holds detections.

    Raises:
        RecordingError: where a file is absent, unfinished or damaged.
    """
    held = [_schemas(file) for file in files]
    lacking = [own for own in held if detections.SCHEMA in own and tracks.SCHEMA not in own]
    return not lacking and any(tracks.SCHEMA in own for own in held)


def _schemas(path: Path) -> set[str]:
    """Schemas of the messages in a file."""
    with _reading(path) as reader:
        summary = reader.get_summary()
        if summary is None or summary.statistics is None:
            raise damaged(path, "it has no index")
        held = (summary.channels[number] for number, n in summary.statistics.channel_message_counts.items() if n)
        return {summary.schemas[channel.schema_id].name for channel in held if channel.schema_id}


def _detections_between(path: Path, start_ns: int, end_ns: int) -> Iterator[RecordedView]:
    with _reading(path) as reader, opened(path) as stream:
        summary = reader.get_summary()
        if summary is None:
            raise damaged(path, "it has no index")
        schemas = {number for number, schema in summary.schemas.items() if schema.name == detections.SCHEMA}
        wanted = {number for number, channel in summary.channels.items() if channel.schema_id in schemas}
        for chunk in sorted(summary.chunk_indexes, key=lambda chunk: chunk.chunk_start_offset):
            if chunk.message_end_time < start_ns or chunk.message_start_time > end_ns:
                continue
            stream.seek(chunk.chunk_start_offset + HEADER_BYTES)
            for record in breakup_chunk(r.Chunk.read(ReadDataStream(stream)), validate_crc=True):
                if not isinstance(record, r.Message) or record.channel_id not in wanted:
                    continue
                if start_ns <= record.log_time <= end_ns:
                    yield _view(path, record.data)


def _view(path: Path, message: bytes) -> RecordedView:
    try:
        return recorded_view(message)
    except ValueError as error:
        raise damaged(path, str(error)) from error


def read_rig_attachment(path: Path) -> bytes:
    """The bytes of the rig file that the recording was made with.

    Raises:
        RecordingError: where the file is absent, unfinished or damaged, or has no rig attachment.
    """
    found = _attachment(path, RIG_ATTACHMENT)
    if found is None:
        raise _missing(path, f"an attachment {RIG_ATTACHMENT}")
    return found


def read_rules_attachment(path: Path) -> bytes | None:
    """The bytes of the rule file that the run was judged by; None where it was judged by none.

    Raises:
        RecordingError: where the file is absent, unfinished or damaged.
    """
    return _attachment(path, RULES_ATTACHMENT)


def read_metadata(path: Path) -> dict[str, str]:
    """What the recorder wrote of the run: the rig's digests and verdict, version and options.

    Raises:
        RecordingError: where the file is absent, unfinished or damaged, or has no such record.
    """
    found = _metadata(path, RIG_METADATA)
    if found is None:
        raise _missing(path, f"a metadata record {RIG_METADATA}")
    return found


def read_segment(path: Path) -> tuple[str, int] | None:
    """Which run a file is a segment of, and which one of it, from 0; None where it is a recording of its own.

    Raises:
        RecordingError: where the file is absent, unfinished or damaged.
    """
    found = _metadata(path, SEGMENT_METADATA)
    try:
        return None if found is None else (found["run"], int(found["index"]))
    except (KeyError, ValueError) as error:
        raise damaged(path, f"the metadata record {SEGMENT_METADATA} says {found}") from error


def _attachment(path: Path, name: str) -> bytes | None:
    with _reading(path) as reader:
        return next((one.data for one in reader.iter_attachments() if one.name == name), None)


def _metadata(path: Path, name: str) -> dict[str, str] | None:
    with _reading(path) as reader:
        for metadata in reader.iter_metadata():
            if metadata.name == name:
                return metadata.metadata
    return None


@contextmanager
def _reading(path: Path) -> Iterator[McapReader]:
    with opened(path) as stream:
        try:
            yield make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        except (*FAULTS, OSError, KeyError, DecodeError) as error:
            raise damaged(path, str(error) or type(error).__name__) from error


def _missing(path: Path, what: str) -> RecordingError:
    return RecordingError(
        "the recording does not say which rig it is of",
        where=path,
        expected=what,
        got="none",
        do_next="use a recording that recognition run wrote",
    )
