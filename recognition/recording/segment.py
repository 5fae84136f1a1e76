"""One file of a recording, which stands alone: rig, options, calibration and poses are in each.

Messages are numbered per topic through all segments of a run, so that a reader of two that follow each other sees
whether anything between them was lost.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from google.protobuf.message import Message
from mcap.writer import Writer
from mcap_protobuf.schema import build_file_descriptor_set

from recognition.errors import RecordingError
from recognition.recording.container import RIG_ATTACHMENT, RULES_ATTACHMENT
from recognition.recording.definitions import define_channel, define_schema
from recognition.recording.durable import DurableFile
from recognition.recording.messages import calibration, stamp, transforms
from rigcal.rig import Rig

_RIG_PERIOD_NS = 1_000_000_000
"""Calibration and transforms are repeated at this pace, so that a viewer finds them after a jump."""


@dataclass(frozen=True, slots=True)
class Outgoing:
    """A message on its way into a recording."""

    topic: str
    message: Message
    t_ns: int
    """Capture time: becomes the publish time."""
    log_ns: int
    is_key: bool | None = None
    """Of a frame of H.264: whether decoding can begin here. None: no such frame."""


@dataclass(frozen=True, slots=True)
class SegmentContent:
    """What each segment of a run begins with."""

    rig: Rig
    rig_json: bytes
    metadata: Mapping[str, Mapping[str, str]]
    """Metadata records by name."""
    fsync_interval_s: float
    rules_toml: bytes | None = None
    """The rule file that the run is judged by."""


class Segment:
    """A file that grows as ``.part``; not safe to use from several threads at once.

    Args:
        path: The file to be.
        content: What it begins with.
        numbers: Next number of each topic's messages; shared by the segments of a run and updated here.

    Raises:
        RecordingError: as :class:`recognition.recording.durable.DurableFile` does.
    """

    def __init__(self, path: Path, content: SegmentContent, numbers: dict[str, int]) -> None:
        self.path = path
        self.start_ns: int | None = None
        """Log time of its first message."""
        self.video: set[str] = set()
        """Topics of H.264 that it holds."""
        self._numbers = numbers
        self._calibrations = {topic_of(c.id, "calibration"): calibration(c, 0) for c in content.rig.cameras}
        self._transforms = transforms(content.rig, 0)
        """Messages that are repeated with another time each."""
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._rig_due_ns: int | None = 0
        self._file = DurableFile(path, fsync_interval_s=content.fsync_interval_s)
        try:
            with self._file.writing() as writer:
                writer.add_attachment(0, 0, RIG_ATTACHMENT, "application/json", content.rig_json)
                if content.rules_toml is not None:
                    writer.add_attachment(0, 0, RULES_ATTACHMENT, "application/toml", content.rules_toml)
                for name, fields in content.metadata.items():
                    writer.add_metadata(name, dict(fields))
            self._file.sync()
        except RecordingError:
            self.abandon()
            self._file.part.unlink(missing_ok=True)  # it holds nothing yet
            raise

    @property
    def part(self) -> Path:
        """The file as long as it grows."""
        return self._file.part

    @property
    def bytes(self) -> int:
        """How large it is, without the chunk that is being filled."""
        return self._file.bytes

    def write(self, items: Iterable[Outgoing]) -> int:
        """Add messages, which stay together in the file; returns how many bytes they are."""
        size = 0
        with self._file.writing() as writer:
            for item in items:
                if self._rig_due_ns is not None and item.log_ns >= self._rig_due_ns:
                    self._add_rig(writer, item.t_ns, item.log_ns)
                size += self._add(writer, item)
        return size

    def follow_up(self) -> None:
        """From here on only the rest of its videos is added, which needs no more calibration."""
        self._rig_due_ns = None

    def finish(self) -> int:
        """Write the index and give the file its name; returns its size in bytes."""
        if self.start_ns is None:
            with self._file.writing() as writer:
                self._add_rig(writer, 0, 0)
        self._file.finish()
        self._file.publish()
        return self.path.stat().st_size

    def abandon(self) -> None:
        """Finish the ``.part`` as far as the disk allows: the exception on its way says more than another."""
        with contextlib.suppress(RecordingError):
            self._file.finish()

    def _add_rig(self, writer: Writer, t_ns: int, log_ns: int) -> None:
        when = stamp(t_ns)
        for lens in self._calibrations.values():
            lens.timestamp.CopyFrom(when)
        for transform in self._transforms.transforms:
            transform.timestamp.CopyFrom(when)
        for topic, message in (*self._calibrations.items(), ("/tf", self._transforms)):
            self._add(writer, Outgoing(topic, message, t_ns, log_ns))
        self._rig_due_ns = log_ns + _RIG_PERIOD_NS

    def _add(self, writer: Writer, item: Outgoing) -> int:
        channel_id = self._channels.get(item.topic) or self._register(writer, item.topic, item.message)
        number, data = self._numbers.get(item.topic, 0), item.message.SerializeToString()
        writer.add_message(channel_id, item.log_ns, data, item.t_ns, number)
        self._numbers[item.topic] = number + 1
        if self.start_ns is None:
            self.start_ns = item.log_ns
        if item.is_key is not None:
            self.video.add(item.topic)
        return len(data)

    def _register(self, writer: Writer, topic: str, message: Message) -> int:
        schema = message.DESCRIPTOR.full_name
        if schema not in self._schemas:
            descriptors = build_file_descriptor_set(type(message)).SerializeToString(deterministic=True)
            self._schemas[schema] = define_schema(writer, schema, "protobuf", descriptors)
        self._channels[topic] = define_channel(writer, topic, "protobuf", self._schemas[schema])
        return self._channels[topic]


def topic_of(camera_id: str, kind: str) -> str:
    """The topic of a camera's messages of one kind."""
    return f"/{camera_id}/{kind}"
