"""Messages and the rig file out of a finished recording."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from google.protobuf.message import DecodeError, Message
from mcap.reader import McapReader, make_reader
from mcap_protobuf.decoder import DecoderFactory

from recognition.errors import RecordingError
from recognition.recording.container import RIG_ATTACHMENT, RIG_METADATA, opened, recover_command
from recognition.recording.scan import FAULTS


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
    with _reading(path) as reader:
        for metadata in reader.iter_metadata():
            if metadata.name == RIG_METADATA:
                return metadata.metadata
    raise _missing(path, f"a metadata record {RIG_METADATA}")


@contextmanager
def _reading(path: Path) -> Iterator[McapReader]:
    with opened(path) as stream:
        try:
            yield make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        except (*FAULTS, OSError, KeyError, DecodeError) as error:
            raise RecordingError(
                "the recording is unfinished or damaged",
                where=path,
                expected="a finished MCAP file",
                got=str(error) or type(error).__name__,
                do_next=f"run `{recover_command(path)}`",
            ) from error


def _missing(path: Path, what: str) -> RecordingError:
    return RecordingError(
        "the recording does not say which rig it is of",
        where=path,
        expected=what,
        got="none",
        do_next="use a recording that recognition run wrote",
    )
