"""Messages and the rig file out of a finished recording."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from google.protobuf.message import DecodeError, Message
from mcap import records as r
from mcap.reader import McapReader, make_reader
from mcap_protobuf.decoder import DecoderFactory

from recognition.errors import RecordingError
from recognition.recording import detections
from recognition.recording.container import (
    RIG_ATTACHMENT,
    RIG_METADATA,
    SEGMENT_METADATA,
    mapped,
    opened,
    recover_command,
)
from recognition.recording.detections import RecordedView, recorded_view
from recognition.recording.scan import FAULTS, Damage, scan


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


def iter_messages(path: Path, topics: Iterable[str] | None = None) -> Iterator[RecordedMessage]:
    """The messages of a finished recording in the order of log time; of equal times, in the order of recording.

    Raises:
        RecordingError: where the file is absent, unfinished or damaged.
    """
    wanted = None if topics is None else list(topics)
    with _reading(path) as reader:
        for _, channel, message, decoded in reader.iter_decoded_messages(wanted):
            yield RecordedMessage(channel.topic, message.log_time, message.publish_time, decoded)


def iter_detections(path: Path) -> Iterator[RecordedView]:
    """What the cameras saw, in the order of recording: the views of one instant stand together.

    Raises:
        RecordingError: where the file is absent, unfinished or damaged.
    """
    wanted: set[int] = set()
    schemas: set[int] = set()
    with mapped(path) as data:
        for part in scan(data):
            if isinstance(part, Damage):
                raise _damaged(path, part.reason)
            if isinstance(part.record, r.DataEnd):
                return
            for inner in part.contents:
                match inner.record:
                    case r.Schema(id=number, name=detections.SCHEMA):
                        schemas.add(number)
                    case r.Channel(id=number, schema_id=schema) if schema in schemas:
                        wanted.add(number)
                    case r.Message(channel_id=number, data=message) if number in wanted:
                        yield _view(path, message)
    raise _damaged(path, "it ends before its index")


def _view(path: Path, message: bytes) -> RecordedView:
    try:
        return recorded_view(message)
    except ValueError as error:
        raise _damaged(path, str(error)) from error


def read_rig_attachment(path: Path) -> bytes:
    """The bytes of the rig file that the recording was made with.

    Raises:
        RecordingError: where the file is absent, unfinished or damaged, or has no rig attachment.
    """
    with _reading(path) as reader:
        for attachment in reader.iter_attachments():
            if attachment.name == RIG_ATTACHMENT:
                return attachment.data
    raise _missing(path, f"an attachment {RIG_ATTACHMENT}")


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
        raise _damaged(path, f"the metadata record {SEGMENT_METADATA} says {found}") from error


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
            raise _damaged(path, str(error) or type(error).__name__) from error


def _damaged(path: Path, got: str) -> RecordingError:
    return RecordingError(
        "the recording is unfinished or damaged",
        where=path,
        expected="a finished MCAP file",
        got=got,
        do_next=f"run `{recover_command(path)}`",
    )


def _missing(path: Path, what: str) -> RecordingError:
    return RecordingError(
        "the recording does not say which rig it is of",
        where=path,
        expected=what,
        got="none",
        do_next="use a recording that recognition run wrote",
    )
