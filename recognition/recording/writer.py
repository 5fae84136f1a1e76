"""The recorder: frames, detections, scenes and tracks of a run into MCAP files that survive a crash.

Decision: a block that ends with an exception still finishes its files, but leaves the last one as ``.part``: nobody
takes it for a whole run, and recover can tell it (nothing lost) from a killed process (the last moments lost).

Log time is the receive or processing time where ``receive_ns`` is given (live), else the capture time; publish time
and the messages' own timestamps are capture times; all in rig time. Log times of a topic never run backwards: a message
that comes late, or after a clock was set back, is logged with the time of the one before it, and its publish time is
left as it is. Between topics nothing is ordered: frames are recorded as they come, what was seen in them and the scene
when they are known. A reader that sorts by log time sees what was known when; by publish time, what belongs together.
"""

from __future__ import annotations

import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Protocol, Self

from google.protobuf.message import Message

from recognition.errors import RecordingError
from recognition.events import NO_MARKS, Event, Marks
from recognition.h264 import is_key_frame
from recognition.observations import FrameSet, Scene, ViewDetections
from recognition.recording.annotations import ViewTracks, image_annotations
from recognition.recording.budget import DiskBudget, require_room
from recognition.recording.container import RIG_METADATA, SEGMENT_METADATA
from recognition.recording.detections import DETECTIONS, RecordedView, detections_message
from recognition.recording.events import EVENTS, Phase, event_line, event_message
from recognition.recording.messages import encoded_message, frame_message, log_message
from recognition.recording.naming import SUFFIX, require_free_names, segment_path, unfinished_notices
from recognition.recording.origin import describe
from recognition.recording.rotation import LOG, Rotation
from recognition.recording.scene import SceneDrawer
from recognition.recording.segment import Outgoing, Segment, SegmentContent, topic_of
from recognition.recording.tracks import TRACKS, TrackedInstant, tracks_message
from rigcal.errors import OptionError
from rigcal.rig import Rig

_LATEST_NS = 2**63 - 1


@dataclass(frozen=True, slots=True)
class Recorded:
    """What a recorder wrote."""

    path: Path
    """The recording: a file, or the common name of its segments."""
    files: tuple[Path, ...]
    """Its finished files, in order."""
    messages: Mapping[str, int]
    """Messages per topic, those of deleted segments among them; where the disk refused, the last ones may be lost."""
    undecodable: Mapping[str, int]
    """Per video topic: frames before a key frame, which no player could show and which were left out."""
    bytes: int
    """Size of the files together."""
    dropped: tuple[Path, ...]
    """Segments that were deleted to make room, as the newest were to be kept."""
    stopped: str | None
    """Why recording ended before the run did: the disk, or the budget; None where it did not."""
    unrecorded: Mapping[str, int]
    """Messages per topic that came after recording had ended."""


class EncodedFrame(Protocol):
    """A frame as its camera encoded it, such as :class:`recognition.sources.stream.Packet`."""

    @property
    def camera(self) -> int:
        """Index of the camera in the rig."""

    @property
    def t_ns(self) -> int:
        """Capture time: rig time in nanoseconds."""

    @property
    def receive_ns(self) -> int | None:
        """When it arrived, in rig time; None for files."""

    @property
    def encoded(self) -> bytes:
        """The camera's own bytes."""

    @property
    def encoding(self) -> str:
        """``h264`` (an access unit in Annex B form), ``jpeg`` or ``png``."""


class Recorder:
    """Writes ``path`` by way of ``path.part``; use it in a ``with`` block, from as many threads as you like.

    A finished file at ``path`` is replaced when the block ends without an exception, not before; segments of an
    earlier run are never replaced. Times handed to one recorder either all have a ``receive_ns`` or none has.

    Args:
        path: The recording to be, ``NAME.mcap``.
        rig: The rig that the frames come from.
        rig_json: The bytes of its rig file; attached as they are.
        metadata: Options and whatever else describes the run, for the metadata record ``rigcal``.
        rules_toml: The bytes of the rule file that the run is judged by; attached as they are.
        fsync_interval_s: Nothing handed over is off the disk for longer, if the disk syncs in half that time.
        segment_s: Length of the segments ``NAME.000.mcap``, ``NAME.001.mcap``, ...; None for one file.
        budget: What the files may take of the disk.
        expected_bytes: What the whole run is likely to take, where somebody knows.

    Raises:
        RecordingError: where the file cannot be created, has no room, a ``.part`` or segments of an earlier run are
            there, the rig file is not the rig's, or a camera bears the name of a frame. Every method raises it when
            the disk refuses for another reason than that it is full, or after ``close``; the ``.part`` stays.
        OptionError: where ``segment_s`` is not positive, or the newest segments are to be kept and there are none.
    """

    def __init__(
        self,
        path: Path,
        *,
        rig: Rig,
        rig_json: bytes,
        metadata: Mapping[str, str],
        rules_toml: bytes | None = None,
        fsync_interval_s: float = 1.0,
        segment_s: float | None = None,
        budget: DiskBudget | None = None,
        expected_bytes: int | None = None,
    ) -> None:
        description = describe(rig, rig_json, metadata, rules_toml)
        budget = budget or DiskBudget()
        _require_segments(path, segment_s, budget)
        self.path, self._rig, self._scenes = path, rig, SceneDrawer(rig)
        self._numbers: dict[str, int] = {}
        run = uuid.uuid4().hex

        def opened(index: int) -> Segment:
            records = {RIG_METADATA: description}
            if segment_s is not None:
                records[SEGMENT_METADATA] = {"run": run, "index": str(index)}
            file = path if segment_s is None else segment_path(path, index)
            return Segment(file, SegmentContent(rig, rig_json, records, fsync_interval_s, rules_toml), self._numbers)

        self._notices = (*unfinished_notices(path.parent), *_room_notice(path, budget, expected_bytes))
        self._rotation = Rotation(opened, None if segment_s is None else round(segment_s * 1e9), budget)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        else:
            self._rotation.abandon()

    @property
    def notices(self) -> tuple[str, ...]:
        """What whoever starts the run should know: unfinished recordings beside it, and room that will not do."""
        return self._notices

    @property
    def stopped(self) -> str | None:
        """Why nothing is recorded any more, in words; None while it is."""
        return self._rotation.stopped

    def write_packet(self, packet: EncodedFrame) -> None:
        """A frame as its camera encoded it to ``/CAMERA/video`` (H.264) or ``/CAMERA/image``.

        H.264 frames that nobody could decode, because their key frame is not there, are counted and left out.
        """
        camera_id = self._rig.cameras[packet.camera].id
        message = encoded_message(camera_id, packet.t_ns, packet.encoded, packet.encoding)
        self._write([_frame(camera_id, message, packet.t_ns, packet.encoded, packet.encoding)], packet.receive_ns)

    def write_frames(self, frame_set: FrameSet, *, receive_ns: int | None = None) -> None:
        """The frames of an instant, as :meth:`write_packet` does, or as JPEG where they have no form of their own.

        Args:
            frame_set: Frames in rig order.
            receive_ns: When they arrived, rig time in nanoseconds; for live sources.
        """
        self._write(
            [
                _frame(camera.id, frame_message(camera.id, frame), frame.t_ns, frame.encoded, frame.encoding)
                for camera, frame in zip(self._rig.cameras, frame_set.views, strict=True)
                if frame is not None
            ],
            receive_ns,
        )

    def write_detections(
        self,
        frame_set: FrameSet,
        views: Sequence[ViewDetections | None],
        tracks: Sequence[ViewTracks | None] | None = None,
        *,
        common: Sequence[ViewDetections | None] | None = None,
        marks: Marks = NO_MARKS,
        receive_ns: int | None = None,
    ) -> None:
        """What the cameras saw: ``/CAMERA/detections`` to compute with again, ``/CAMERA/annotations`` to look at.

        A replay takes the instants in the order of these calls.

        Args:
            frame_set: The instant; a camera that took no part in it has messages at its common time.
            views: (V,) detections in rig order; None writes nothing for that camera.
            tracks: (V,) tracks of the detections, where they are known.
            common: (V,) the detections at the common time; None where the run does not interpolate.
            marks: Tracks that violate rules.
            receive_ns: When they became known, rig time in nanoseconds; for live sources.
        """
        of_views = (None,) * len(views) if tracks is None else tracks
        moved = views if common is None else common
        outgoing = []
        for v, (camera, view, track) in enumerate(zip(self._rig.cameras, views, of_views, strict=True)):
            if view is None:
                continue
            own_ns, frame = frame_set.times_ns[v], frame_set.views[v]
            t_ns = frame_set.t_ns if own_ns is None else own_ns
            seen = RecordedView(
                camera_id=camera.id,
                index=frame_set.index,
                instant_ns=frame_set.t_ns,
                views=sum(other is not None for other in views),
                t_ns=own_ns,
                frame_idx=None if frame is None else frame.frame_idx,
                seen=view,
                common=moved[v] or view,
                interpolated=common is not None,
            )
            outgoing.append(_Message(topic_of(camera.id, DETECTIONS), detections_message(seen), t_ns))
            drawn = image_annotations(view, track, t_ns, marks)
            outgoing.append(_Message(topic_of(camera.id, "annotations"), drawn, t_ns))
        self._write(outgoing, receive_ns)

    def write_scene(self, scene: Scene, *, marks: Marks = NO_MARKS, receive_ns: int | None = None) -> None:
        """Workers and objects in 3D to ``/scene``; ``marks`` are those that violate rules."""
        self._write([_Message("/scene", self._scenes.update(scene, marks), scene.t_ns)], receive_ns)

    def write_tracks(self, instant: TrackedInstant, *, receive_ns: int | None = None) -> None:
        """What is judged at an instant, placed or not, to ``/tracks``: every instant of a run, in order."""
        self._write([_Message(TRACKS, tracks_message(instant), instant.scene.t_ns)], receive_ns)

    def write_event(self, event: Event, phase: Phase, t_ns: int, *, receive_ns: int | None = None) -> None:
        """A violation to ``/events`` when it is raised, changes, ends or is cut off by the end of the run, at a time;
        where it is raised or over, also to ``/log``."""
        line = event_line(event, phase, t_ns)
        messages = [_Message(EVENTS, event_message(event, phase), t_ns)]
        self._write(messages if line is None else [*messages, _Message(LOG, line, t_ns)], receive_ns)

    def log(self, level: str, text: str, t_ns: int, *, receive_ns: int | None = None) -> None:
        """A line to ``/log``; ``level`` is ``debug``, ``info``, ``warning``, ``error`` or ``fatal``."""
        self._write([_Message(LOG, log_message(level, text, t_ns), t_ns)], receive_ns)

    def close(self) -> Recorded:
        """Finish the files and give them their names; a second call returns the same."""
        written = self._rotation.close()
        return Recorded(
            path=self.path,
            files=tuple(written.files),
            messages=MappingProxyType(dict(self._numbers)),
            undecodable=MappingProxyType(dict(written.undecodable)),
            bytes=sum(written.files.values()),
            dropped=written.dropped,
            stopped=written.stopped,
            unrecorded=MappingProxyType(dict(written.unrecorded)),
        )

    def _write(self, messages: Sequence[_Message], receive_ns: int | None) -> None:
        for message in messages:
            _require_time(message.t_ns)
        self._rotation.write(
            [
                Outgoing(m.topic, m.message, m.t_ns, m.t_ns if receive_ns is None else receive_ns, m.is_key)
                for m in messages
            ]
        )


@dataclass(frozen=True, slots=True)
class _Message:
    topic: str
    message: Message
    t_ns: int
    is_key: bool | None = None


def _frame(camera_id: str, message: Message, t_ns: int, encoded: bytes | None, encoding: str) -> _Message:
    if encoded is None or encoding != "h264":
        return _Message(topic_of(camera_id, "image"), message, t_ns)
    return _Message(topic_of(camera_id, "video"), message, t_ns, is_key_frame(encoded))


def _require_time(t_ns: int) -> None:
    if not 0 <= t_ns <= _LATEST_NS:
        raise RecordingError(
            "a time cannot be recorded",
            expected="nanoseconds since 1970 or since the start of a file, 0 or more",
            got=f"{t_ns} ns",
            do_next="check the clock of the source and the rig's clock offsets",
        )


def _require_segments(path: Path, segment_s: float | None, budget: DiskBudget) -> None:
    if segment_s is None:
        if budget.keep == "newest":
            raise OptionError("segment_s", expected="a length, where the newest segments are to be kept", got=None)
        return
    if not segment_s > 0:
        raise OptionError("segment_s", expected="a time above 0", got=segment_s)
    if path.suffix != SUFFIX:
        raise RecordingError(
            "segments need a name that they can be told by",
            where=path,
            expected=f"a name that ends in {SUFFIX}",
            got=path.name,
            do_next=f"give -o {path.name}{SUFFIX}",
        )
    require_free_names(path)


def _room_notice(path: Path, budget: DiskBudget, expected_bytes: int | None) -> tuple[str, ...]:
    notice = require_room(path, budget, expected_bytes) if path.parent.is_dir() else None
    return () if notice is None else (notice,)
