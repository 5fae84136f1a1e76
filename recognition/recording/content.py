"""Whether a recording is fit for use: its video, detections and times."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from statistics import median

from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from google.protobuf.message import DecodeError
from mcap import records as r

from recognition.h264 import IDR, has_b_slice, is_key_frame, nal_types, starts_with_start_code
from recognition.recording import detections, tracks
from recognition.recording.container import LIBRARY_NAME
from recognition.recording.findings import Finding, error, warning
from recognition.recording.origin import segment_place
from recognition.recording.survey import ChannelSurvey, Survey

GAP_FACTOR = 5.0
"""A pause longer than this many median spacings is a gap: at 30 Hz, five frames lost in a row."""
_EVENT_TOPICS = ("/log", "/events")
"""Topics without a pace, where a pause is no gap."""
LONG_GOP_S = 10.0
"""Cameras are usually set to a key frame every 1 to 2 s; with more than this between two, a viewer that jumps shows
nothing for so long, and a segment begins so late."""


class ContentVisitor:
    """Looks into the messages of video, detections, tracks and poses while the file is surveyed."""

    def __init__(self) -> None:
        self.frames: set[str] = set()
        """Frames that a transform places."""
        self._keys_ns: dict[str, list[int]] = {}
        """Log times of the key frames of each video."""
        self._lacking: dict[tuple[int, int], int] = {}
        """How many messages of detections each instant still lacks."""
        self._faults: dict[tuple[str, str], int] = {}

    def __call__(self, channel: ChannelSurvey, message: r.Message) -> None:
        """Look into one message."""
        try:
            if channel.schema == "foxglove.FrameTransforms":
                placed = FrameTransforms.FromString(message.data).transforms
                self.frames |= {transform.child_frame_id for transform in placed}
            elif channel.schema == "foxglove.CompressedVideo":
                self._look_at_video(channel.topic, message.log_time, CompressedVideo.FromString(message.data))
            elif channel.schema == detections.SCHEMA:
                self._look_at_detections(message.data)
            elif channel.schema == tracks.SCHEMA:
                tracks.tracked_instant(message.data)
        except (DecodeError, ValueError):
            self._count(channel.topic, f"messages are no {channel.schema}")

    def findings(self) -> Iterator[Finding]:
        """Faults of the messages."""
        for (topic, fault), count in self._faults.items():
            yield error(f"{topic}: {count} {fault}")
        if self._lacking:
            yield warning(f"{len(self._lacking)} instants lost the detections of a camera: a replay leaves them out")
        for topic, keys_ns in self._keys_ns.items():
            longest_s = max((after - before for before, after in pairwise(keys_ns)), default=0) / 1e9
            if longest_s > LONG_GOP_S:
                yield warning(
                    f"{topic}: up to {longest_s:.1f} s between key frames: set the camera to one every 1 to 2 s"
                )

    def _look_at_video(self, topic: str, log_ns: int, video: CompressedVideo) -> None:
        is_key = is_key_frame(video.data)
        if not starts_with_start_code(video.data):
            self._count(topic, "frames do not begin with an H.264 start code (Annex B)")
        elif topic not in self._keys_ns and not is_key:
            self._count(topic, "frame at the start is no key frame with SPS and PPS: the video cannot be decoded")
        elif not is_key and IDR in nal_types(video.data):
            self._count(topic, "key frames are without SPS and PPS: nobody can begin to decode there")
        elif has_b_slice(video.data):
            self._count(topic, "frames are B frames, which viewers cannot show")
        self._keys_ns.setdefault(topic, []).extend([log_ns] if is_key else [])

    def _look_at_detections(self, data: bytes) -> None:
        view = detections.recorded_view(data)
        instant = (view.index, view.instant_ns)
        lacking = self._lacking.pop(instant, view.views) - 1
        if lacking:
            self._lacking[instant] = lacking

    def _count(self, topic: str, fault: str) -> None:
        self._faults[topic, fault] = self._faults.get((topic, fault), 0) + 1


def time_findings(found: Survey) -> Iterator[Finding]:
    """Times that run backwards, pauses, and messages that are missing from the recorder's numbering."""
    for channel in found.channels.values():
        spacing_ns = [after - before for before, after in pairwise(channel.log_ns)]
        back_ns = [-step for step in spacing_ns if step < 0]
        if back_ns:
            yield error(f"{channel.topic}: times run backwards {len(back_ns)} times, by {max(back_ns) / 1e9:.3f} s")
        set_back_ns = [before - after for before, after in pairwise(channel.publish_ns) if after < before]
        if set_back_ns:
            yield warning(
                f"{channel.topic}: capture times run backwards {len(set_back_ns)} times, by "
                f"{max(set_back_ns) / 1e9:.3f} s: a clock was set"
            )
        missing = missing_messages(found, channel)
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


def missing_messages(found: Survey, channel: ChannelSurvey) -> int:
    """How many numbers are left out up to the last one, from 0, or in later segments from the first that is there.

    0 for recordings of another program, whose numbers mean something else.
    """
    is_numbered = found.header is not None and found.header.library.startswith(LIBRARY_NAME)
    if not channel.sequences or not is_numbered:
        return 0
    place = segment_place(found)
    first = channel.sequences[0] if place is not None and place[1] > 0 else 0
    return channel.sequences[-1] + 1 - first - len(channel.sequences)
