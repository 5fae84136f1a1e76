"""Whether a recording is fit for use: its rig, calibration, poses, video and times."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from itertools import pairwise
from statistics import median
from typing import Any

from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from google.protobuf.message import DecodeError
from mcap import records as r

from recognition.recording.container import LIBRARY_NAME, RIG_ATTACHMENT, RIG_METADATA
from recognition.recording.findings import Finding, error, warning
from recognition.recording.h264 import has_b_slice, is_key_frame, starts_with_start_code
from recognition.recording.survey import ChannelSurvey, Survey

GAP_FACTOR = 5.0
"""A pause longer than this many median spacings is a gap: at 30 Hz, five frames lost in a row."""
_EVENT_TOPICS = ("/log",)
"""Topics without a pace, where a pause is no gap."""


class ContentVisitor:
    """Looks into the messages of video and poses while the file is surveyed."""

    def __init__(self) -> None:
        self.frames: set[str] = set()
        """Frames that a transform places."""
        self._seen: set[str] = set()
        self._faults: dict[tuple[str, str], int] = {}

    def __call__(self, channel: ChannelSurvey, message: r.Message) -> None:
        """Look into one message."""
        try:
            if channel.schema == "foxglove.FrameTransforms":
                placed = FrameTransforms.FromString(message.data).transforms
                self.frames |= {transform.child_frame_id for transform in placed}
            elif channel.schema == "foxglove.CompressedVideo":
                self._look_at_video(channel.topic, CompressedVideo.FromString(message.data))
        except DecodeError:
            self._count(channel.topic, f"messages are no {channel.schema}")

    def findings(self) -> Iterator[Finding]:
        """Faults of the messages."""
        for (topic, fault), count in self._faults.items():
            yield error(f"{topic}: {count} {fault}")

    def _look_at_video(self, topic: str, video: CompressedVideo) -> None:
        if not starts_with_start_code(video.data):
            self._count(topic, "frames do not begin with an H.264 start code (Annex B)")
        elif topic not in self._seen and not is_key_frame(video.data):
            self._count(topic, "frame at the start is no key frame with SPS and PPS: the video cannot be decoded")
        elif has_b_slice(video.data):
            self._count(topic, "frames are B frames, which viewers cannot show")
        self._seen.add(topic)

    def _count(self, topic: str, fault: str) -> None:
        self._faults[topic, fault] = self._faults.get((topic, fault), 0) + 1


def rig_findings(found: Survey, frames: set[str]) -> Iterator[Finding]:
    """The attached rig file against its own digest, the metadata, and what is recorded of its cameras."""
    attached = [attachment.data for attachment in found.attachments if attachment.name == RIG_ATTACHMENT]
    stated = [record.metadata.get("digest") for record in found.metadata if record.name == RIG_METADATA]
    if len(attached) != 1:
        yield error(f"{len(attached)} attachments are called {RIG_ATTACHMENT}, one was expected")
        return
    try:
        document = json.loads(attached[0])
        camera_ids = [camera["id"] for camera in document["cameras"]]
    except (ValueError, KeyError, TypeError):
        yield error(f"the attachment {RIG_ATTACHMENT} is no rig file")
        return
    digest = rig_digest(document)
    if document.get("digest") != digest:
        yield error(f"the rig file's digest is {digest}, it says {document.get('digest')}: it was changed")
    if stated != [digest]:
        yield error(f"the rig file's digest is {digest}, the metadata says {', '.join(map(str, stated)) or 'nothing'}")
    calibrated = {channel.topic for channel in found.channels.values() if channel.log_ns}
    for camera_id in camera_ids:
        if f"/{camera_id}/calibration" not in calibrated:
            yield error(f"camera {camera_id} has no calibration message")
        if camera_id not in frames:
            yield error(f"/tf does not say where camera {camera_id} stands")


def rig_digest(document: dict[str, Any]) -> str:
    """The digest of a rig file: SHA-256 of its UTF-8 JSON without ``digest``, keys sorted, no spaces."""
    rest = {key: value for key, value in document.items() if key != "digest"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return f"sha256:{hashlib.sha256(text.encode()).hexdigest()}"


def time_findings(found: Survey) -> Iterator[Finding]:
    """Times that run backwards, pauses, and messages that are missing from the recorder's numbering."""
    is_numbered = found.header is not None and found.header.library.startswith(LIBRARY_NAME)
    for channel in found.channels.values():
        spacing_ns = [after - before for before, after in pairwise(channel.log_ns)]
        back_ns = [-step for step in spacing_ns if step < 0]
        if back_ns:
            yield error(f"{channel.topic}: times run backwards {len(back_ns)} times, by {max(back_ns) / 1e9:.3f} s")
        missing = missing_messages(channel.sequences) if is_numbered else 0
        if missing:
            yield warning(f"{channel.topic}: {missing} messages are missing")
        if spacing_ns and channel.topic not in _EVENT_TOPICS:
            yield from _gap_findings(channel.topic, spacing_ns)


def _gap_findings(topic: str, spacing_ns: list[int]) -> Iterator[Finding]:
    median_ns = median(spacing_ns)
    gaps = [step for step in spacing_ns if median_ns > 0 and step > GAP_FACTOR * median_ns]
    if gaps:
        yield warning(
            f"{topic}: {len(gaps)} gaps, the longest {max(gaps) / 1e9:.3f} s where the median spacing is "
            f"{median_ns / 1e9:.3f} s"
        )


def missing_messages(sequences: list[int]) -> int:
    """How many numbers are left out, from 0 to the last one."""
    return sequences[-1] + 1 - len(sequences) if sequences else 0
