"""The recorder: frames, detections and scenes of a run into one MCAP file that survives a crash.

Decision: a block that ends with an exception still finishes its file, but leaves it as ``.part``: nobody takes it for
a whole run, and recover can tell it (nothing lost) from a killed process (the last moments lost).

Log time is the receive time where ``receive_ns`` is given (live), else the capture time; publish time and the
messages' own timestamps are capture times; all in rig time.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import NamedTuple, Self

from google.protobuf.message import Message
from mcap.writer import Writer
from mcap_protobuf.schema import build_file_descriptor_set

from recognition.errors import RecordingError
from recognition.observations import FrameSet, Scene, ViewDetections
from recognition.recording.annotations import ViewTracks, image_annotations
from recognition.recording.container import RIG_ATTACHMENT, RIG_METADATA
from recognition.recording.definitions import define_channel, define_schema
from recognition.recording.durable import DurableFile
from recognition.recording.h264 import is_key_frame
from recognition.recording.messages import RIG_FRAME, WORLD_FRAME, calibration, frame_message, log_message, transforms
from recognition.recording.scene import SceneDrawer
from rigcal import __version__
from rigcal.rig import Rig

_RIG_PERIOD_NS = 1_000_000_000
"""Calibration and transforms are repeated at this pace, so that a viewer finds them after a jump."""
_LATEST_NS = 2**63 - 1


@dataclass(frozen=True, slots=True)
class Recorded:
    """What a recorder wrote."""

    path: Path
    messages: Mapping[str, int]
    """Messages per topic."""
    undecodable: Mapping[str, int]
    """Per video topic: frames before its first key frame, which no player could show and which were left out."""
    bytes: int
    """Size of the file."""


class _Outgoing(NamedTuple):
    topic: str
    message: Message
    t_ns: int


class Recorder:
    """Writes ``path`` by way of ``path.part``; use it in a ``with`` block.

    A finished file at ``path`` is replaced when the block ends without an exception, not before. Times handed to one
    recorder either all have a ``receive_ns`` or none has.

    Args:
        path: The recording to be, ``NAME.mcap``.
        rig: The rig that the frames come from.
        rig_json: The bytes of its rig file; attached as they are.
        metadata: Options and whatever else describes the run, for the metadata record ``rigcal``.
        fsync_interval_s: Nothing handed over is off the disk for longer, if the disk syncs in half that time.

    Raises:
        RecordingError: where the file cannot be created, a ``.part`` of an earlier run is there, the rig file is not
            the rig's, or a camera bears the name of a frame. Every method raises it when the disk refuses, or after
            ``close``; the ``.part`` stays.
    """

    def __init__(
        self,
        path: Path,
        *,
        rig: Rig,
        rig_json: bytes,
        metadata: Mapping[str, str],
        fsync_interval_s: float = 1.0,
    ) -> None:
        description = _description(rig, rig_json, metadata)
        self._rig, self._scenes = rig, SceneDrawer(rig)
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._counts: dict[str, int] = {}
        self._undecodable: dict[str, int] = {}
        self._rig_due_ns = 0
        self._recorded: Recorded | None = None
        self._file = DurableFile(path, fsync_interval_s=fsync_interval_s)
        try:
            with self._file.writing() as writer:
                writer.add_attachment(0, 0, RIG_ATTACHMENT, "application/json", rig_json)
                writer.add_metadata(RIG_METADATA, description)
            self._file.sync()
        except RecordingError:
            self._abandon()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        else:
            self._abandon()

    def write_frames(self, frame_set: FrameSet, *, receive_ns: int | None = None) -> None:
        """The frames of an instant to ``/CAMERA/video`` (H.264) or ``/CAMERA/image``.

        H.264 frames before a camera's first key frame are counted and left out.

        Args:
            frame_set: Frames in rig order.
            receive_ns: When they arrived, rig time in nanoseconds; for live sources.
        """
        outgoing = []
        for camera, frame in zip(self._rig.cameras, frame_set.views, strict=True):
            if frame is None:
                continue
            is_video = frame.encoded is not None and frame.encoding == "h264"
            topic = _topic(camera.id, "video" if is_video else "image")
            if is_video and topic not in self._counts and not is_key_frame(frame.encoded or b""):
                self._undecodable[topic] = self._undecodable.get(topic, 0) + 1
            else:
                outgoing.append(_Outgoing(topic, frame_message(camera.id, frame), frame.t_ns))
        self._write(outgoing, receive_ns)

    def write_detections(
        self,
        frame_set: FrameSet,
        views: Sequence[ViewDetections | None],
        tracks: Sequence[ViewTracks | None] | None = None,
        *,
        receive_ns: int | None = None,
    ) -> None:
        """What the cameras saw to ``/CAMERA/annotations``, at the times of the frames.

        Args:
            frame_set: The instant; a camera that took no part in it has annotations at its common time.
            views: (V,) detections in rig order; None writes nothing for that camera.
            tracks: (V,) tracks of the detections, where they are known.
            receive_ns: As for :meth:`write_frames`.
        """
        outgoing = []
        of_views = (None,) * len(views) if tracks is None else tracks
        for camera, own_ns, view, track in zip(self._rig.cameras, frame_set.times_ns, views, of_views, strict=True):
            if view is not None:
                t_ns = frame_set.t_ns if own_ns is None else own_ns
                outgoing.append(_Outgoing(_topic(camera.id, "annotations"), image_annotations(view, track, t_ns), t_ns))
        self._write(outgoing, receive_ns)

    def write_scene(self, scene: Scene, *, receive_ns: int | None = None) -> None:
        """Workers and objects in 3D to ``/scene``."""
        self._write([_Outgoing("/scene", self._scenes.update(scene), scene.t_ns)], receive_ns)

    def log(self, level: str, text: str, t_ns: int, *, receive_ns: int | None = None) -> None:
        """A line to ``/log``; ``level`` is ``debug``, ``info``, ``warning``, ``error`` or ``fatal``."""
        self._write([_Outgoing("/log", log_message(level, text, t_ns), t_ns)], receive_ns)

    def close(self) -> Recorded:
        """Finish the file and give it its name; a second call returns the same."""
        if self._recorded is None:
            if not self._counts:
                with self._file.writing() as writer:
                    self._add_rig(writer, 0, 0)
            self._file.finish()
            self._file.publish()
            self._recorded = Recorded(
                self._file.path,
                MappingProxyType(dict(self._counts)),
                MappingProxyType(dict(self._undecodable)),
                self._file.path.stat().st_size,
            )
        return self._recorded

    def _abandon(self) -> None:
        """Finish the ``.part`` as far as the disk allows: the exception on its way says more than another."""
        with contextlib.suppress(RecordingError):
            self._file.finish()

    def _write(self, outgoing: Sequence[_Outgoing], receive_ns: int | None) -> None:
        for item in outgoing:
            _require_time(item.t_ns)
        with self._file.writing() as writer:
            for item in outgoing:
                log_ns = item.t_ns if receive_ns is None else receive_ns
                if log_ns >= self._rig_due_ns:
                    self._add_rig(writer, item.t_ns, log_ns)
                self._add(writer, item, log_ns)

    def _add_rig(self, writer: Writer, t_ns: int, log_ns: int) -> None:
        for camera in self._rig.cameras:
            message = calibration(camera, t_ns)
            self._add(writer, _Outgoing(_topic(camera.id, "calibration"), message, t_ns), log_ns)
        self._add(writer, _Outgoing("/tf", transforms(self._rig, t_ns), t_ns), log_ns)
        self._rig_due_ns = log_ns + _RIG_PERIOD_NS

    def _add(self, writer: Writer, item: _Outgoing, log_ns: int) -> None:
        channel_id = self._channels.get(item.topic) or self._register(writer, item.topic, item.message)
        sequence = self._counts.get(item.topic, 0)
        writer.add_message(channel_id, log_ns, item.message.SerializeToString(), item.t_ns, sequence)
        self._counts[item.topic] = sequence + 1

    def _register(self, writer: Writer, topic: str, message: Message) -> int:
        schema = message.DESCRIPTOR.full_name
        if schema not in self._schemas:
            descriptors = build_file_descriptor_set(type(message)).SerializeToString(deterministic=True)
            self._schemas[schema] = define_schema(writer, schema, "protobuf", descriptors)
        self._channels[topic] = define_channel(writer, topic, "protobuf", self._schemas[schema])
        return self._channels[topic]


def _topic(camera_id: str, kind: str) -> str:
    return f"/{camera_id}/{kind}"


def _require_time(t_ns: int) -> None:
    if not 0 <= t_ns <= _LATEST_NS:
        raise RecordingError(
            "a time cannot be recorded",
            expected="nanoseconds since 1970 or since the start of a file, 0 or more",
            got=f"{t_ns} ns",
            do_next="check the clock of the source and the rig's clock offsets",
        )


def _description(rig: Rig, rig_json: bytes, metadata: Mapping[str, str]) -> dict[str, str]:
    """The metadata record of the run: which rig, which version, which options."""
    document = json.loads(rig_json)
    if document.get("digest") != rig.digest:
        raise RecordingError(
            "the rig and its file are not the same",
            expected=f"digest {rig.digest}",
            got=f"digest {document.get('digest')}",
            do_next="load the rig from the very bytes that are recorded",
        )
    taken = {RIG_FRAME, WORLD_FRAME} & set(rig.camera_ids)
    if taken:
        raise RecordingError(
            f"a camera is called {min(taken)}",
            expected=f"other names than {RIG_FRAME} and {WORLD_FRAME}, which are frames of the recording",
            got=", ".join(rig.camera_ids),
            do_next="rename the camera in the site file and calibrate again",
        )
    own = {
        "digest": rig.digest,
        "geometry_digest": str(document.get("geometry_digest", "")),
        "verdict": rig.verdict,
        "site": rig.site,
        "rigcal": __version__,
    }
    repeated = sorted(set(own) & set(metadata))
    if repeated:
        raise ValueError(f"metadata must not set {', '.join(repeated)}")
    return {**own, **metadata}
