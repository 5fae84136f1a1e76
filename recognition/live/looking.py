"""What the networks see in the newest frame set, while the caller places what they saw in the one before.

One thread takes sets and has their views looked at, in as many threads as there are processors, which give way to all
others. What was seen waits for the caller in a place for one set; where that is taken the networks wait too, so that a
caller who is slower than they are has sets skipped, counted as such, and never falls behind.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from queue import Empty, Full, Queue
from threading import Event
from typing import NamedTuple

from recognition.detectors import Detector
from recognition.errors import SourceError
from recognition.live.gathering import Gathering, Numbered
from recognition.observations import ViewDetections
from recognition.sources.decoding import DecodedFrame
from rigcal.cores import core_count

_POLL_S = 0.2
"""How soon a stop is noticed."""
_NICENESS = 10
"""Of the threads that look. In half-minute runs of four 1080p30 cameras over RTSP on two processors, the p95 from
capture to track was 170 to 191 ms with it and 203 without, and no fewer sets were looked at: what was decoded first is
newer when it is looked at."""


class Seen(NamedTuple):
    """A frame set that was looked at."""

    taken: Numbered[DecodedFrame]
    views: tuple[ViewDetections | None, ...]
    """(V,) by camera; None where there is no frame, or no image can be made of it."""


class Looking:
    """Has the sets of a gathering looked at; :meth:`run` is the thread's work, :meth:`next` the caller's side."""

    def __init__(
        self,
        gathering: Gathering[DecodedFrame],
        detector: Detector,
        stopping: Event,
        broken: Callable[[int, SourceError], None],
    ) -> None:
        """Look.

        Args:
            gathering: Where sets come from.
            detector: Several threads call it at once.
            stopping: Ends :meth:`run`.
            broken: Told of the camera (index) of which a frame cannot be made an image.
        """
        self._gathering, self._detector, self._stopping, self._broken = gathering, detector, stopping, broken
        self._seen: Queue[Seen] = Queue(1)
        self._has_ended = False
        self.is_busy = False
        """Whether there is a set that was taken and that the caller does not have yet."""

    def run(self) -> None:
        """Look until there is nothing more to look at, or until stopped."""
        try:
            with ThreadPoolExecutor(core_count(), "look", _give_way) as views:
                while not (self._stopping.is_set() or self._gathering.is_over):
                    taken = self._gathering.take(_POLL_S)
                    if taken is not None:
                        self.is_busy = True
                        self._hand_on(Seen(taken, tuple(views.map(self._detections, taken.group.frames))))
        finally:
            self._has_ended = True

    def next(self, timeout_s: float) -> Seen | None:
        """What was seen last; None where there is nothing new within the time, or ever again."""
        try:
            seen = self._seen.get(timeout=timeout_s)
        except Empty:
            return None
        self.is_busy = False
        return seen

    @property
    def is_over(self) -> bool:
        """Whether the caller has everything and nothing will follow."""
        return self._has_ended and self._seen.empty()

    def _hand_on(self, seen: Seen) -> None:
        while not self._stopping.is_set():
            try:
                self._seen.put(seen, timeout=_POLL_S)
            except Full:
                continue
            return

    def _detections(self, frame: DecodedFrame | None) -> ViewDetections | None:
        if frame is None:
            return None
        try:
            image_bgr = frame.image_bgr()
        except SourceError as error:
            self._broken(frame.packet.camera, error)
            return None
        return self._detector.detect(image_bgr)


def _give_way() -> None:
    """Have this thread give way to those that receive, decode, place and record, where threads have priorities."""
    if sys.platform == "linux":
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICENESS)
