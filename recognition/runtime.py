"""The loop: instants in, tracked scenes out, everything recorded on the way.

Two paths, one placing. :func:`run` takes instants that wait (files, detections): each is placed, as fast as that goes
or at their own pace, and its frames are recorded with it. :func:`run_live` takes instants of cameras that do not wait:
:class:`recognition.live.LiveFeed` records every packet by itself, and hands on the newest frame set. What happens to
one instant is the same in both.

Decision: an instant of a single camera is recorded, frame and detections, and places nothing, since an empty scene
would say that nobody is there. Of files it is no scene; of live cameras it is one that says NOT MONITORED, because
somebody may be watching. Rules are told of it as NOT MONITORED in both cases, since a violation may go on meanwhile.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from recognition.events import Event, Marks, Watch
from recognition.interpolation import in_common_time
from recognition.judging import Judging, OnEvent, blind_scene
from recognition.live import LiveFeed
from recognition.monitoring import Verdict, judged
from recognition.observations import Instant, Scene, Status, ViewDetections
from recognition.placing import Placer, PlacingOptions
from recognition.recording import Recorder, TrackedInstant, ViewTracks
from rigcal.rig import Rig


@dataclass(frozen=True, slots=True)
class RunOptions:
    """How instants become scenes."""

    placing: PlacingOptions = field(default_factory=PlacingOptions)
    use: Sequence[bool] | None = None
    """(V,) which of the rig's cameras are wanted; None: all."""
    realtime: bool = False
    """Pace the instants at their own times instead of running as fast as possible; live ones have their own pace."""
    interpolate: bool = False
    """Move what live cameras saw to the common times; instants of files come so from their feed."""
    keep_scenes: bool = True
    """Whether the result holds every scene, which a run of days has no room for."""


@dataclass(frozen=True, slots=True)
class RunResult:
    """What a run found."""

    scenes: tuple[Scene, ...]
    """What was known in 3D, at each instant that two cameras or more took part in, where scenes are kept."""
    instants: int
    """How many instants there were, those of a single camera included."""
    detections: Mapping[str, int]
    """People detected per camera, over all instants."""
    placed: int
    """How many instants are scenes."""
    statuses: Mapping[Status, int]
    """How many instants were monitored, and how well."""
    worker_instants: Mapping[int, int]
    """At how many instants each worker was seen, by track."""
    object_instants: Mapping[str, int]
    """At how many instants each object was seen, by ``class/track``."""
    events: tuple[Event, ...] = ()
    """What the rules found, in order of their start; those that last when the run ends have no end."""
    start_ns: int | None = None
    """Time of the first instant; None where there was none."""
    stopped: bool = False
    """Whether the run was stopped before its last instant."""


def run(
    rig: Rig,
    instants: Iterable[Instant],
    recorder: Recorder,
    options: RunOptions,
    *,
    watch: Watch | None = None,
    on_scene: Callable[[Scene], None] | None = None,
    on_event: OnEvent | None = None,
    progress: Callable[[int], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> RunResult:
    """Run over instants in order of time.

    Args:
        rig: The rig.
        instants: As :func:`recognition.feeds.open_feed` makes them.
        recorder: Where frames, detections and scenes are recorded; open.
        options: Thresholds and pace.
        watch: Rules that judge every scene; None: none do.
        on_scene: Told of every scene, and of a NOT MONITORED one for each instant that is none.
        on_event: Told of every word on an event, after the scene that it follows from.
        progress: Called with the number of instants done.
        stop: Asked before each instant whether to end the run.

    Returns:
        What was found.
    """
    placer, tally = Placer(rig, options.placing), _Tally(rig, options)
    judging = Judging(watch, recorder, on_event)
    pace = _Pace() if options.realtime else None
    use = options.use or (True,) * len(rig.cameras)
    stopped = False
    for instant in instants:
        if stopped := stop is not None and stop():
            break
        frame_set = instant.frame_set
        if pace:
            pace.wait(frame_set.t_ns)
        verdict = judged(rig.camera_ids, use, frame_set)
        scene = _said(placer.place(instant), verdict)
        recorder.write_frames(frame_set)
        shown = scene or blind_scene(frame_set, verdict)
        _record(recorder, instant, scene, judging.judge(shown))
        recorder.write_tracks(TrackedInstant(shown, scene is not None, verdict.status))
        tally.add(instant, verdict, scene)
        if on_scene:
            on_scene(shown)
        judging.tell(frame_set.t_ns, None)
        if progress:
            progress(tally.instants)
    judging.close()
    return tally.result(stopped, judging.events)


def run_live(
    rig: Rig,
    feed: LiveFeed,
    recorder: Recorder,
    options: RunOptions,
    *,
    watch: Watch | None = None,
    on_scene: Callable[[Scene], None] | None = None,
    on_event: OnEvent | None = None,
    stop: Callable[[], bool] | None = None,
) -> RunResult:
    """Run until the streams end or ``stop`` says so; the feed records what the cameras send.

    Args:
        rig: The rig.
        feed: The live cameras; entered.
        recorder: The feed's.
        options: Thresholds.
        watch: Rules that judge every scene; None: none do.
        on_scene: Told of every scene.
        on_event: Told of every word on an event, after the scene that it follows from.
        stop: Asked often whether to end the run.

    Returns:
        What was found; an instant that cannot be placed is a scene that says NOT MONITORED.
    """
    placer, tally = Placer(rig, options.placing), _Tally(rig, options)
    judging = Judging(watch, recorder, on_event)
    stopped = False

    def ended() -> bool:
        nonlocal stopped
        stopped = stop is not None and stop()
        return stopped

    instants = feed.instants(ended)
    for instant in in_common_time(instants) if options.interpolate else instants:
        frame_set = instant.frame_set
        verdict = feed.judged(frame_set)
        placed = _said(placer.place(instant), verdict)
        if placed:
            feed.placed(frame_set)
        scene = placed or blind_scene(frame_set, verdict)
        receive_ns = feed.log_ns()
        _record(recorder, instant, scene, judging.judge(scene), receive_ns)
        recorder.write_tracks(TrackedInstant(scene, placed is not None, verdict.status), receive_ns=receive_ns)
        tally.add(instant, verdict, scene)
        if on_scene:
            on_scene(scene)
        judging.tell(frame_set.t_ns, receive_ns)
    judging.close()
    return tally.result(stopped, judging.events)


def _said(scene: Scene | None, verdict: Verdict) -> Scene | None:
    """The scene with what is to be said beside it."""
    if scene is None:
        return None
    return replace(scene, status=verdict.status, reason=verdict.reason, cameras=verdict.cameras)


class _Tally:
    """Counts, in memory that does not grow unless scenes are kept."""

    def __init__(self, rig: Rig, options: RunOptions) -> None:
        self._camera_ids, self._keeps = rig.camera_ids, options.keep_scenes
        self._scenes: list[Scene] = []
        self._seen: Counter[str] = Counter(dict.fromkeys(rig.camera_ids, 0))
        self._statuses: Counter[Status] = Counter()
        self._workers: Counter[int] = Counter()
        self._objects: Counter[str] = Counter()
        self._placed = 0
        self._start_ns: int | None = None
        self.instants = 0

    def add(self, instant: Instant, verdict: Verdict, scene: Scene | None) -> None:
        """Count an instant."""
        self.instants += 1
        self._start_ns = instant.frame_set.t_ns if self._start_ns is None else self._start_ns
        self._statuses[verdict.status] += 1
        self._seen.update({c: len(v.counted) for c, v in zip(self._camera_ids, instant.views, strict=True)})
        if scene is None:
            return
        self._placed += 1
        self._workers.update(worker.track_id for worker in scene.workers)
        self._objects.update(f"{thing.object_class}/{thing.track_id}" for thing in scene.objects)
        if self._keeps:
            self._scenes.append(scene)

    def result(self, stopped: bool, events: tuple[Event, ...]) -> RunResult:
        """What was counted."""
        return RunResult(
            scenes=tuple(self._scenes),
            instants=self.instants,
            detections=dict(self._seen),
            placed=self._placed,
            statuses=dict(self._statuses),
            worker_instants=dict(sorted(self._workers.items())),
            object_instants=dict(sorted(self._objects.items())),
            events=events,
            start_ns=self._start_ns,
            stopped=stopped,
        )


def _record(
    recorder: Recorder, instant: Instant, scene: Scene | None, marks: Marks, receive_ns: int | None = None
) -> None:
    """What the cameras that took part saw, at their own times, with the tracks of it where there is a scene.

    Of an instant without any camera the reference camera says that it saw nothing and took no part, so that a replay
    judges it too.
    """
    frame_set = instant.frame_set
    took_part = [t_ns is not None for t_ns in frame_set.times_ns]
    took_part[0] = took_part[0] or not any(took_part)
    recorder.write_detections(
        frame_set,
        [view if is_there else None for view, is_there in zip(instant.views, took_part, strict=True)],
        None if scene is None else _tracks_of_views(scene, instant.views),
        common=None if instant.common is instant.views else instant.common,
        marks=marks,
        receive_ns=receive_ns,
    )
    if scene is not None:
        recorder.write_scene(scene, marks=marks, receive_ns=receive_ns)


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
