"""The frames of a recording: when each camera has one, and their images in order of time.

Times are read first, without decoding anything, so that pictures can be planned; then each camera is decoded from the
last key frame before its first picture, and only frames that a picture needs are made images of. A part of a recording
is found by the recording's index: two seconds out of ten minutes, 550 MB, took 2 s of processor time to show from
second 5, 100 and 590 on.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass
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
LATE_S = 10.0
"""The index knows when something was recorded, not when it was captured: up to this long before."""
KEY_S = (10.0, 60.0)
"""How long before a time its key frame is looked for, in turn, before everything is read; cameras send one every few
seconds."""


@dataclass(frozen=True, slots=True)
class Footage:
    """What frames a recording holds, or a part of it."""

    run: RecordedRun
    """The recording, or that part."""
    topics: Mapping[str, str]
    """The topic of each camera that has frames, in rig order."""
    times_ns: Mapping[str, tuple[int, ...]]
    """Capture times of each camera's frames, in the order of recording; rig time in nanoseconds."""
    span_ns: tuple[int, int]
    """Times of the first and the last frame of any camera in the whole recording."""

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


def read_footage(run: RecordedRun, *, from_s: float = 0.0, to_s: float | None = None) -> Footage:
    """Look up when each camera has frames.

    Args:
        run: The recording.
        from_s: Seconds after its first frame from which on frames are wanted; they can be decoded from there.
        to_s: Up to how many; None: to the end.

    Raises:
        RecordingError: where the recording holds no frames, or a file of it is damaged.
    """
    first, last = _ends(run)
    if not first:
        raise RecordingError(
            "the recording holds no video",
            where=run.files[0],
            expected=f"frames in topics such as /{run.rig.reference}/{KINDS[0]}",
            got="none: it was made of detections alone",
            do_next="record with --source CAPTURE as well, or use recognition replay --poses for the tracks",
        )
    start_ns, late_ns = min(first.values()) + round(from_s * 1e9), round(LATE_S * 1e9)
    end_ns = None if to_s is None else min(first.values()) + round(to_s * 1e9) + late_ns
    before_s = KEY_S if from_s > 0 else ()
    for since_ns in (*(start_ns - round(each * 1e9) for each in before_s), None):
        part = run.between(since_ns, end_ns)
        times, can_decode = _times(part, list(first), start_ns)
        if can_decode:
            break
    kept = {topic[1:].rpartition("/")[0]: topic for topic in times}
    return Footage(
        part,
        MappingProxyType({camera_id: kept[camera_id] for camera_id in run.rig.camera_ids if camera_id in kept}),
        MappingProxyType({camera_id: tuple(times[topic]) for camera_id, topic in kept.items()}),
        (min(first.values()), max(last.values())),
    )


def frame_span(run: RecordedRun) -> tuple[int, int] | None:
    """Capture times of the first and the last frame of any camera, rig time in nanoseconds; None: it has no frames.

    Raises:
        RecordingError: where a file of it is damaged.
    """
    first, last = _ends(run)
    return (min(first.values()), max(last.values())) if first else None


def _ends(run: RecordedRun) -> tuple[dict[str, int], dict[str, int]]:
    """Capture times of the first and the last frame of each topic that has frames."""
    topics = [f"/{camera_id}/{kind}" for camera_id in run.rig.camera_ids for kind in KINDS]
    first = {topic: message.publish_ns for topic in topics for message in _one(run, topic, newest=False)}
    return first, {topic: message.publish_ns for topic in first for message in _one(run, topic, newest=True)}


def _one(run: RecordedRun, topic: str, *, newest: bool) -> Iterator[RecordedMessage]:
    """The first or the newest message of a topic; nothing where it has none."""
    for file in reversed(run.files) if newest else run.files:
        for message in iter_messages(file, [topic], newest_first=newest):
            yield message
            return


def _times(run: RecordedRun, topics: list[str], start_ns: int) -> tuple[dict[str, list[int]], bool]:
    """Capture times of the frames of each topic, and whether those at a time can be decoded with the ones before it."""
    times: dict[str, list[int]] = {topic: [] for topic in topics}
    before: dict[str, bool] = {}
    for file in run.files:
        for message in iter_messages(file, topics, start_ns=run.start_ns, end_ns=run.end_ns):
            times[message.topic].append(message.publish_ns)
            if message.publish_ns <= start_ns and not before.get(message.topic, False):
                before[message.topic] = _packet(message, 0).is_key
    return times, all(before.values())


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
        self._packets = _from_key_frame(_packets(footage.run, footage.topics[camera_id]), first)
        self._read = -1
        self._shown: tuple[int, NDArray[np.uint8]] | None = None
        self.broken = 0
        """Frames so far that could not be decoded."""

    def frame(self, number: int) -> tuple[int, NDArray[np.uint8]] | None:
        """Number and image (H, W, 3) of the last frame up to ``number`` that can be decoded; None where none can.

        Whoever shows it must look at the number: it is of another time where a frame is broken.

        Raises:
            RecordingError: where a file of the recording is damaged.
            SourceError: where the frame has another size than the camera was calibrated with.
        """
        newest: DecodedFrame | None = None
        while self._read < number and (packet := next(self._packets, None)) is not None:
            self._read = packet.number
            try:
                decoded = self._decoder.decode(packet)
            except BrokenFrameError:
                self.broken += 1
                continue
            newest = decoded[-1] if decoded else newest
        if newest is not None:
            try:
                self._shown = newest.packet.number, newest.image_bgr()
            except BrokenFrameError:
                self.broken += 1
        return self._shown


def _packets(run: RecordedRun, topic: str) -> Iterator[Packet]:
    number = 0
    for file in run.files:
        for recorded in iter_messages(file, [topic], start_ns=run.start_ns, end_ns=run.end_ns):
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
