"""The loop: frame sets in, tracked scenes out, everything recorded on the way.

What happens to one instant is the same whether its frames come from files or its detections from a file: associate the
views, triangulate, track, record. The loop itself holds only the tracker's state.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from recognition.association import AssociationOptions, associate
from recognition.detectors import Detector
from recognition.epipolar import RigGeometry
from recognition.observations import FrameSet, Scene, ViewDetections
from recognition.recording import Recorder, ViewTracks
from recognition.sources.capture import CaptureSource
from recognition.sources.detections_file import DetectionsFile
from recognition.tracking import Tracker, TrackerState, TrackingOptions
from recognition.triangulation import triangulate_objects, triangulate_people
from rigcal.rig import Rig


@dataclass(frozen=True, slots=True)
class Instant:
    """One instant, ready for 3D."""

    frame_set: FrameSet
    views: tuple[ViewDetections, ...]
    """(V,) what each camera saw."""


@dataclass(frozen=True, slots=True)
class RunOptions:
    """How instants become scenes."""

    association: AssociationOptions = field(default_factory=AssociationOptions)
    tracking: TrackingOptions = field(default_factory=TrackingOptions)
    realtime: bool = False
    """Pace the instants at their own times instead of running as fast as possible."""


@dataclass(frozen=True, slots=True)
class RunResult:
    """What a run found."""

    scenes: tuple[Scene, ...]
    detections: Mapping[str, int]
    """People detected per camera, over all instants."""
    stopped: bool = False
    """Whether the run was stopped before its last instant."""

    @property
    def worker_instants(self) -> dict[int, int]:
        """At how many instants each worker was seen, by track."""
        return dict(sorted(Counter(w.track_id for scene in self.scenes for w in scene.workers).items()))

    @property
    def object_instants(self) -> dict[str, int]:
        """At how many instants each object was seen, by ``class/track``."""
        return dict(
            sorted(Counter(f"{o.object_class}/{o.track_id}" for scene in self.scenes for o in scene.objects).items())
        )


def instants_of_capture(source: CaptureSource, detector: Detector) -> Iterator[Instant]:
    """Frames of a capture, and what a detector finds in them."""
    for frame_set in source.frame_sets():
        views = tuple(
            detector.detect(view.image_bgr) if view is not None else ViewDetections.empty() for view in frame_set.views
        )
        yield Instant(frame_set, views)


def instants_of_detections(detections: DetectionsFile, *, fps: float, use: Sequence[bool]) -> Iterator[Instant]:
    """Detections of a file without frames; its frame numbers become times at ``fps`` where it holds none."""
    nothing = (None,) * detections.cameras
    for index, frame in enumerate(detections.frames):
        t_s = frame / fps if detections.time_s is None else float(detections.time_s[index])
        yield Instant(FrameSet(frame, round(t_s * 1e9), nothing), _wanted(detections.views(frame), use))


def instants_of_both(source: CaptureSource, detections: DetectionsFile, *, use: Sequence[bool]) -> Iterator[Instant]:
    """Frames of a capture, and detections of a file whose frame numbers count the capture's instants."""
    for frame_set in source.frame_sets():
        known = frame_set.index in detections.frames
        views = detections.views(frame_set.index) if known else (ViewDetections.empty(),) * detections.cameras
        yield Instant(frame_set, _wanted(views, use))


def _wanted(views: Sequence[ViewDetections], use: Sequence[bool]) -> tuple[ViewDetections, ...]:
    return tuple(view if wanted else ViewDetections.empty() for view, wanted in zip(views, use, strict=True))


def run(
    rig: Rig,
    instants: Iterable[Instant],
    recorder: Recorder,
    options: RunOptions,
    *,
    progress: Callable[[int], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> RunResult:
    """Run over instants in order of time.

    Args:
        rig: The rig.
        instants: From one of the functions above.
        recorder: Where frames, detections and scenes are recorded; open.
        options: Thresholds and pace.
        progress: Called with the number of instants done.
        stop: Asked before each instant whether to end the run.

    Returns:
        What was found.
    """
    geometry, tracker, state = RigGeometry.of(rig), Tracker(rig.world_from_rig, options.tracking), TrackerState()
    scenes: list[Scene] = []
    seen: Counter[str] = Counter(dict.fromkeys(rig.camera_ids, 0))
    pace = _Pace() if options.realtime else None
    stopped = False
    for instant in instants:
        if stopped := stop is not None and stop():
            break
        frame_set = instant.frame_set
        if pace:
            pace.wait(frame_set.t_ns)
        association = associate(geometry, instant.views, options.association)
        people = triangulate_people(geometry, instant.views, association)
        objects = triangulate_objects(geometry, instant.views, association)
        state, scene = tracker.step(state, people, objects, t_ns=frame_set.t_ns, index=frame_set.index)
        recorder.write_frames(frame_set)
        recorder.write_detections(frame_set, instant.views, _tracks_of_views(scene, instant.views))
        recorder.write_scene(scene)
        scenes.append(scene)
        seen.update({c: len(v.people_px) for c, v in zip(rig.camera_ids, instant.views, strict=True)})
        if progress:
            progress(len(scenes))
    return RunResult(tuple(scenes), dict(seen), stopped)


def _tracks_of_views(scene: Scene, views: Sequence[ViewDetections]) -> tuple[ViewTracks, ...]:
    """Per view, the track of each detection."""
    tracks = []
    for index, view in enumerate(views):
        people: list[int | None] = [None] * len(view.people_px)
        objects: list[int | None] = [None] * len(view.object_class)
        for worker in scene.workers:
            if worker.members[index] >= 0:
                people[int(worker.members[index])] = worker.track_id
        for thing in scene.objects:
            if thing.members[index] >= 0:
                objects[int(thing.members[index])] = thing.track_id
        tracks.append(ViewTracks(tuple(people), tuple(objects)))
    return tuple(tracks)


class _Pace:
    """Waits until an instant is as far from the first as its time says."""

    def __init__(self) -> None:
        self._first: tuple[int, int] | None = None

    def wait(self, t_ns: int) -> None:
        now = time.monotonic_ns()
        if self._first is None:
            self._first = (now, t_ns)
        due = self._first[0] + t_ns - self._first[1]
        if due > now:
            time.sleep((due - now) * 1e-9)
