"""What is written of each event: video, pictures, plot and the event itself.

Decision: a violation that lasts longer than :data:`LONGEST_S` is shown up to then, and its evidence says so; what
follows is in the recording. Pictures are placed anew from shortly before, as ``recognition render`` does, with the
numbers that the run gave.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2

from recognition.events import Event, event_document, marks_at, utc
from recognition.evidence.plot import margin_plot
from recognition.evidence.zones import zones_of
from recognition.observations import Scene
from recognition.rules import RuleSet
from recognition.rules.zones import Zone
from recognition.sources.recording import RecordedRun
from recognition.viewing import (
    Codec,
    FloorPlan,
    Rendering,
    RenderOptions,
    VideoWriter,
    frame_span,
    read_footage,
    scenes_between,
)
from recognition.viewing.drawing import Image
from rigcal.errors import OutputError, writing

FORMAT, VERSION = "recognition.evidence", 1
BEFORE_S, AFTER_S = 5.0, 5.0
LONGEST_S = 120.0
"""Of a violation that is shown: a picture of four cameras of 1080p takes 0.11 s of processor time (134 of the demo)."""
PLAN_WH = 960, 720


@dataclass(frozen=True, slots=True)
class EvidenceOptions:
    """How evidence is made."""

    show_faces: bool = False
    codec: Codec = "h264"


@dataclass(frozen=True, slots=True)
class Exhibit:
    """The evidence of one event."""

    event: Event
    folder: Path
    lacking: tuple[str, ...]
    """What it could not be given, and why."""


def write_exhibits(
    recording: RecordedRun,
    events: Sequence[Event],
    folder: Path,
    options: EvidenceOptions | None = None,
    *,
    rules: RuleSet | None = None,
    progress: Callable[[int], None] | None = None,
) -> tuple[Exhibit, ...]:
    """Write the evidence of events; what was there of the same events is replaced.

    Args:
        recording: The run that they are of.
        events: With the run's own track numbers.
        folder: Where to, ``NAME.evidence``.
        options: How.
        rules: That found the events, whose zones are drawn on the floor plan; without them none are.
        progress: Called with the number of events done.

    Raises:
        OutputError: where the folder cannot be written.
        RecordingError: where a file of the recording is damaged.
        RecognitionError: where FFmpeg has no encoder for the codec.
    """
    span_ns = frame_span(recording)
    exhibits = []
    for number, event in enumerate(events, start=1):
        zones = zones_of(rules, event.rule, event.rules_digest)
        writing_one = _Writing(recording, event, folder / event.event_id, options or EvidenceOptions(), zones)
        exhibits.append(writing_one.run(span_ns))
        if progress:
            progress(number)
    return tuple(exhibits)


def decisive_ns(event: Event) -> int:
    """When the violation was clearest: of the instants with the greatest margin the middle one."""
    known = [margin for margin in event.margins if not math.isnan(margin.value)]
    if not known:
        return event.raised_ns
    most = max(margin.value for margin in known)
    clearest = [margin.t_ns for margin in known if margin.value == most]
    return clearest[len(clearest) // 2]


class _Writing:
    """Writes one exhibit."""

    def __init__(
        self, recording: RecordedRun, event: Event, folder: Path, options: EvidenceOptions, zones: Sequence[Zone]
    ) -> None:
        self._recording, self._event, self._folder, self._options = recording, event, folder, options
        self._zones = zones
        self._decisive_ns = decisive_ns(event)
        last_ns = max([event.raised_ns, *(margin.t_ns for margin in event.margins)])
        self._end_ns = last_ns if event.end_ns is None else event.end_ns
        self._shown_ns = (
            event.start_ns - round(BEFORE_S * 1e9),
            min(self._end_ns, event.start_ns + round(LONGEST_S * 1e9)) + round(AFTER_S * 1e9),
        )

    def run(self, span_ns: tuple[int, int] | None) -> Exhibit:
        """Write it; ``span_ns`` are the times of the recording's first and last frame, if it has frames."""
        lacking, video = list(self._cut()), None
        if span_ns is None:
            lacking.append("video: the recording holds no frames")
        elif self._shown_ns[0] > span_ns[1] or self._shown_ns[1] < span_ns[0]:
            lacking.append("video: the recording holds no frames of this time")
        else:
            video, scenes = self._show(span_ns[0])
        if video is None:
            scenes = scenes_between(self._recording, *self._shown_ns)
        self._write_plan(scenes)
        self._write("margins.svg", margin_plot(self._event))
        self._write("event.json", json.dumps(self._document(video, lacking), ensure_ascii=False, indent=1) + "\n")
        return Exhibit(self._event, self._folder, tuple(lacking))

    def _cut(self) -> Iterator[str]:
        """What is left out of a long violation."""
        lasted_s = (self._end_ns - self._event.start_ns) * 1e-9
        if lasted_s > LONGEST_S:
            yield f"video: what follows after {LONGEST_S:g} s of {lasted_s:.0f} s"

    def _show(self, first_ns: int) -> tuple[dict[str, Any], tuple[Scene, ...]]:
        """Write the video and the picture; what it shows, and the scenes of that time."""
        from_s, to_s = (max(0.0, (t_ns - first_ns) * 1e-9) for t_ns in self._shown_ns)
        footage = read_footage(self._recording, from_s=from_s, to_s=to_s)
        use = tuple(camera_id in footage.topics for camera_id in self._recording.rig.camera_ids)
        options = RenderOptions(use, from_s, to_s, show_faces=self._options.show_faces)
        rendering = Rendering(footage, options, events=(self._event,))
        path, nearest = self._folder / "views.mp4", self._nearest(rendering.ticks_ns)
        with (
            writing(path),
            VideoWriter(path, rendering.size_wh, rendering.rate, self._options.codec) as writer,
        ):
            for picture in rendering.pictures():
                writer.write(picture.image_bgr, picture.t_ns)
                if picture.t_ns == nearest:
                    self._write_picture("instant.png", picture.image_bgr)
        shown = {
            "file": path.name,
            "start_ns": rendering.ticks_ns[0],
            "end_ns": rendering.ticks_ns[-1],
            "cameras": list(footage.topics),
            "heads": "shown" if self._options.show_faces else "blurred",
            "frames_that_could_not_be_decoded": rendering.broken,
        }
        return shown, rendering.scenes

    def _nearest(self, ticks_ns: Sequence[int]) -> int:
        return min(ticks_ns, key=lambda t_ns: abs(t_ns - self._decisive_ns))

    def _write_plan(self, scenes: Sequence[Scene]) -> None:
        at_ns = self._decisive_ns
        scene = min(scenes, key=lambda scene: abs(scene.t_ns - at_ns), default=None)
        plan = FloorPlan(self._recording.rig, scenes, PLAN_WH, self._zones)
        self._write_picture("plan.png", plan.draw(scene, at_ns, marks_at((self._event,), at_ns)))

    def _document(self, video: dict[str, Any] | None, lacking: Sequence[str]) -> dict[str, Any]:
        return {
            "format": FORMAT,
            "version": VERSION,
            "recording": [file.name for file in self._recording.files],
            "decisive_ns": self._decisive_ns,
            "decisive_utc": utc(self._decisive_ns),
            "video": video,
            "lacking": list(lacking),
            "event": event_document(self._event),
        }

    def _write_picture(self, name: str, image: Image) -> None:
        path = self._folder / name
        is_made, data = cv2.imencode(".png", image)
        if not is_made:
            raise OutputError(path, got="the picture could not be encoded")
        with writing(path):
            path.write_bytes(data.tobytes())

    def _write(self, name: str, content: str) -> None:
        path = self._folder / name
        with writing(path):
            path.write_text(content, encoding="utf-8")
