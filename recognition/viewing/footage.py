"""The frames of a recording: when each camera has one, and their images in order of time.

Times are read first, without decoding anything, so that pictures can be planned; then each camera is decoded from the
last key frame before its first picture, and only frames that a picture needs are made images of.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recognition.errors import BrokenFrameError, RecordingError
from recognition.h264 import is_key_frame
from recognition.recording import RecordedMessage, iter_messages
from recognition.sources.decoding import DecodedFrame, Decoder
from recognition.sources.recording import RecordedRun
from recognition.sources.stream import Packet

KINDS = ("video", "image")
"""Last parts of the topics that hold frames."""
STALE_S = 0.5
"""A frame is not shown at times further from its own than this."""


@dataclass(frozen=True, slots=True)
class Footage:
    """What frames a recording holds."""

    run: RecordedRun
    topics: Mapping[str, str]
    """The topic of each camera that has frames, in rig order."""
    times_ns: Mapping[str, tuple[int, ...]]
    """Capture times of each camera's frames, in the order of recording; rig time in nanoseconds."""

    @property
    def span_ns(self) -> tuple[int, int]:
        """Times of the first and the last frame of any camera."""
        return min(min(t) for t in self.times_ns.values()), max(max(t) for t in self.times_ns.values())

    def ticks_ns(self, start_ns: int, end_ns: int, cameras: Set[str]) -> list[int]:
        """Times of the frames of the camera that has most of them, from ``start_ns`` to ``end_ns``; increasing."""
        of_cameras = [times for camera_id, times in self.times_ns.items() if camera_id in cameras]
        within = [sorted({t for t in times if start_ns <= t <= end_ns}) for times in of_cameras]
        return max(within, key=len, default=[])

    def nearest(self, camera_id: str, t_ns: int) -> int | None:
        """Number of the camera's frame that is nearest to a time; None where it is further than :data:`STALE_S`."""
        times = self.times_ns.get(camera_id, ())
        at = bisect_left(times, t_ns)
        around = [n for n in (at - 1, at) if 0 <= n < len(times)]
        best = min(around, key=lambda n: abs(times[n] - t_ns), default=None)
        return best if best is not None and abs(times[best] - t_ns) <= STALE_S * 1e9 else None


def read_footage(run: RecordedRun) -> Footage:
    """Look up when each camera has frames.

    Raises:
        RecordingError: where the recording holds no frames, or a file of it is damaged.
    """
    kinds = {f"/{camera_id}/{kind}": camera_id for camera_id in run.rig.camera_ids for kind in KINDS}
    times: dict[str, list[int]] = {topic: [] for topic in kinds}
    for file in run.files:
        for message in iter_messages(file, kinds):
            times[message.topic].append(message.publish_ns)
    topics = {kinds[topic]: topic for topic, found in times.items() if found}
    if not topics:
        raise RecordingError(
            "the recording holds no video",
            where=run.files[0],
            expected=f"frames in topics such as /{run.rig.reference}/{KINDS[0]}",
            got="none: it was made of detections alone",
            do_next="record with --source CAPTURE as well, or use recognition replay --poses for the tracks",
        )
    return Footage(
        run,
        MappingProxyType({camera_id: topics[camera_id] for camera_id in run.rig.camera_ids if camera_id in topics}),
        MappingProxyType({camera_id: tuple(times[topic]) for camera_id, topic in topics.items()}),
    )


class CameraFrames:
    """Decodes one camera's frames; numbers must be asked for in increasing order.

    Args:
        footage: Of the recording.
        camera_id: A camera that has frames in it.
        first: The first number that will be asked for.
    """

    def __init__(self, footage: Footage, camera_id: str, first: int) -> None:
        camera = footage.run.rig.camera(camera_id).camera
        self._decoder = Decoder(camera_id, camera.size_wh)
        self._packets = _from_key_frame(_packets(footage.run.files, footage.topics[camera_id]), first)
        self._frame: DecodedFrame | None = None
        self._read = -1
        self.broken = 0
        """Frames so far that could not be decoded."""

    def image_bgr(self, number: int) -> NDArray[np.uint8] | None:
        """(H, W, 3) frame ``number``; the one before it where it could not be decoded, None where there is none.

        Raises:
            RecordingError: where a file of the recording is damaged.
            SourceError: where the frame has another size than the camera was calibrated with.
        """
        while self._read < number and (packet := next(self._packets, None)) is not None:
            self._read = packet.number
            try:
                decoded = self._decoder.decode(packet)
            except BrokenFrameError:
                self.broken += 1
                continue
            self._frame = decoded[-1] if decoded else self._frame
        return None if self._frame is None else self._frame.image_bgr()


def _packets(files: Sequence[Path], topic: str) -> Iterator[Packet]:
    number = 0
    for file in files:
        for recorded in iter_messages(file, [topic]):
            yield _packet(recorded, number)
            number += 1


def _packet(recorded: RecordedMessage, number: int) -> Packet:
    message: Any = recorded.message
    is_key = message.format != "h264" or is_key_frame(message.data)
    return Packet(0, number, recorded.publish_ns, None, message.data, message.format, is_key)


def _from_key_frame(packets: Iterator[Packet], first: int) -> Iterator[Packet]:
    """The packets from the last key frame at or before number ``first``."""
    waiting: list[Packet] = []
    for packet in packets:
        if packet.is_key:
            waiting = []
        waiting.append(packet)
        if packet.number >= first:
            break
    yield from waiting
    yield from packets
