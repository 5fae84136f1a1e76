"""The loop: frame sets in, tracked scenes out, everything recorded on the way.

What happens to one instant is the same whether its frames come from files or its detections from a file: associate the
views, triangulate, track, record. The loop itself holds only the tracker's state.

Decision: an instant of a single camera is recorded, frame and detections, but is no scene. Nothing can be placed from
one view, and an empty scene would say that nobody is there.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from recognition.association import AssociationOptions, associate
from recognition.epipolar import RigGeometry
from recognition.observations import Instant, Scene, ViewDetections
from recognition.recording import Recorder, ViewTracks
from recognition.tracking import Tracker, TrackerState, TrackingOptions
from recognition.triangulation import triangulate_objects, triangulate_people
from rigcal.rig import Rig


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
    """What was known in 3D, at each instant that two cameras or more took part in."""
    instants: int
    """How many instants there were, those of a single camera included."""
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
        instants: As :func:`recognition.feeds.open_feed` makes them.
        recorder: Where frames, detections and scenes are recorded; open.
        options: Thresholds and pace.
        progress: Called with the number of instants done.
        stop: Asked before each instant whether to end the run.

    Returns:
        What was found.
    """
    placing = _Placing(RigGeometry.of(rig), Tracker(rig.world_from_rig, options.tracking), options.association)
    scenes: list[Scene] = []
    seen: Counter[str] = Counter(dict.fromkeys(rig.camera_ids, 0))
    pace = _Pace() if options.realtime else None
    stopped, done = False, 0
    for instant in instants:
        if stopped := stop is not None and stop():
            break
        frame_set = instant.frame_set
        if pace:
            pace.wait(frame_set.t_ns)
        scene = placing.scene(instant)
        recorder.write_frames(frame_set)
        recorder.write_detections(frame_set, *_to_record(instant, scene))
        if scene:
            recorder.write_scene(scene)
            scenes.append(scene)
        seen.update({c: len(v.people_px) for c, v in zip(rig.camera_ids, instant.views, strict=True)})
        done += 1
        if progress:
            progress(done)
    return RunResult(tuple(scenes), done, dict(seen), stopped)


class _Placing:
    """From views to scenes; remembers the tracks."""

    def __init__(self, geometry: RigGeometry, tracker: Tracker, options: AssociationOptions) -> None:
        self._geometry, self._tracker, self._options = geometry, tracker, options
        self._state = TrackerState()

    def scene(self, instant: Instant) -> Scene | None:
        """The scene of an instant; None where one camera saw it, or another scene was at its time."""
        frame_set, views = instant.frame_set, instant.common
        before_ns = self._state.t_ns
        if frame_set.cameras < 2 or (before_ns is not None and frame_set.t_ns <= before_ns):
            return None
        association = associate(self._geometry, views, self._options)
        people = triangulate_people(self._geometry, views, association)
        objects = triangulate_objects(self._geometry, views, association)
        self._state, scene = self._tracker.step(
            self._state, people, objects, t_ns=frame_set.t_ns, index=frame_set.index
        )
        return scene


def _to_record(
    instant: Instant, scene: Scene | None
) -> tuple[list[ViewDetections | None], tuple[ViewTracks, ...] | None]:
    """What the cameras that took part saw, at their own times, and the tracks of it where there is a scene."""
    own = zip(instant.views, instant.frame_set.times_ns, strict=True)
    views = [None if t_ns is None else view for view, t_ns in own]
    return views, None if scene is None else _tracks_of_views(scene, instant.views)


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
