"""A recording judged again: by the tracks that it holds, or by what its networks saw, through the same code as live.

The run's own tracks are in the recording, so that other rules need nobody placed anew. Placed again, with the same rig,
options and detections, they are the same to the last bit, since a recording holds all three as the run had them. Other
options answer what another method would have made of the same detections.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from recognition.errors import RecordingError
from recognition.events import Event, Watch
from recognition.judging import EventBook, blind_scene
from recognition.monitoring import Verdict, judged
from recognition.observations import FrameSet, Instant, Scene, Status
from recognition.options import options_of
from recognition.placing import Placer, PlacingOptions, place_smoothed
from recognition.recording import DETECTIONS, TrackedInstant
from recognition.sources.recording import RecordedRun, RecordedTracks
from rigcal.rig import Rig

PLACING_KEY, VIEWS_KEY = "placing", "views"
"""Metadata of a run: its placing options as :func:`recognition.options.options_text`, and the cameras in use."""


@dataclass(frozen=True, slots=True)
class ReplayResult:
    """What a replay found."""

    scenes: tuple[Scene, ...]
    """What was known in 3D, at each instant that two cameras or more took part in, where scenes are kept."""
    instants: int
    """How many instants there were, those of a single camera included."""
    incomplete: int
    """Instants that are lost, or lost the detections of a camera, and were left out; 0 unless the recording was
    recovered."""
    placed: int
    """How many instants are scenes."""
    is_placed_again: bool
    """Whether workers and objects were placed anew; else the tracks are those that the run recorded, without their
    covariances."""
    worker_instants: Mapping[int, int]
    """At how many instants each worker was seen, by track."""
    object_instants: Mapping[str, int]
    """At how many instants each object was seen, by ``class/track``."""
    statuses: Mapping[Status, int]
    """How many instants were monitored, and how well."""
    events: tuple[Event, ...] = ()
    """What the rules found, in order of their start; those that last at the end have no end."""
    start_ns: int | None = None
    """Time of the first instant."""
    end_ns: int | None = None
    """Time of the last."""


def recorded_options(recording: RecordedRun) -> PlacingOptions | None:
    """The options that the run placed with; None where the recording does not say.

    Raises:
        RecordingError: where this version does not have them.
    """
    text = recording.metadata.get(PLACING_KEY)
    return None if text is None else options_of(PlacingOptions, text)


def recorded_cameras(recording: RecordedRun) -> tuple[bool, ...]:
    """(V,) which cameras the run used; all where the recording does not say."""
    ids, views = recording.rig.camera_ids, recording.metadata.get(VIEWS_KEY)
    names = ids if views is None else views.split(",")
    return tuple(camera_id in names for camera_id in ids)


def replay(
    recording: RecordedRun,
    options: PlacingOptions | None = None,
    *,
    smooth: bool = False,
    keep_scenes: bool = True,
    watch: Watch | None = None,
    progress: Callable[[int], None] | None = None,
) -> ReplayResult:
    """Go through every instant of a recording again.

    Args:
        recording: As :func:`recognition.sources.recording.open_recording` opens it.
        options: To place with: those of the run (:func:`recorded_options`) for the same tracks, or others. None: the
            run's own tracks count, and are placed again, with its options, only where the recording does not hold them.
        smooth: Whether every track is smoothed by what came after (:mod:`recognition.smoothing`).
        keep_scenes: Whether the result holds every scene, which a recording of days has no room for.
        watch: Rules that judge every instant, also those that are no scenes, which are NOT MONITORED; of the run's own
            rules come the run's own events.
        progress: Called with the number of instants done.

    Raises:
        RecordingError: where a file of the recording is damaged, or it holds no detections.
        OptionError: where tracks of the method ``paper`` are to be smoothed.
    """
    source = tracked_again(recording, options, smooth=smooth)
    counts, book, scenes = _Counts(), EventBook(), []
    for instant in source:
        counts.add(instant)
        for event in watch.step(instant.scene)[1] if watch is not None else ():
            book.add(event)
        if keep_scenes and instant.is_placed:
            scenes.append(instant.scene)
        if progress:
            progress(counts.instants)
    for event in watch.lasting() if watch is not None else ():
        book.add(event)
    if not counts.instants:
        raise _nothing(recording)
    return ReplayResult(
        scenes=tuple(scenes),
        instants=counts.instants,
        incomplete=source.incomplete,
        placed=counts.placed,
        is_placed_again=isinstance(source, PlacedAgain),
        worker_instants=dict(sorted(counts.workers.items())),
        object_instants=dict(sorted(counts.objects.items())),
        statuses=dict(counts.statuses),
        events=book.events,
        start_ns=counts.start_ns,
        end_ns=counts.end_ns,
    )


class _Counts:
    """What there was, in memory that does not grow with time."""

    def __init__(self) -> None:
        self.instants = self.placed = 0
        self.statuses: Counter[Status] = Counter()
        self.workers: Counter[int] = Counter()
        self.objects: Counter[str] = Counter()
        self.start_ns: int | None = None
        self.end_ns: int | None = None

    def add(self, instant: TrackedInstant) -> None:
        """Count an instant."""
        scene = instant.scene
        self.instants += 1
        self.statuses[instant.status] += 1
        self.start_ns = scene.t_ns if self.start_ns is None else self.start_ns
        self.end_ns = scene.t_ns
        if instant.is_placed:
            self.placed += 1
            self.workers.update(worker.track_id for worker in scene.workers)
            self.objects.update(f"{thing.object_class}/{thing.track_id}" for thing in scene.objects)


def tracked_again(
    recording: RecordedRun, options: PlacingOptions | None = None, *, smooth: bool = False
) -> RecordedTracks | PlacedAgain:
    """The instants of a recording, one by one, as :func:`replay` goes through them; to be run through once."""
    if options is None and not smooth and recording.holds_tracks:
        return recording.tracks()
    return PlacedAgain(recording, options or recorded_options(recording) or PlacingOptions(), smooth=smooth)


class PlacedAgain:
    """Places the instants of a recording; to be run through once."""

    def __init__(self, recording: RecordedRun, options: PlacingOptions, *, smooth: bool) -> None:
        self._rig, self._use = recording.rig, recorded_cameras(recording)
        self._instants, self._options, self._smooth = recording.instants(), options, smooth
        self._waiting: dict[int, tuple[FrameSet, Verdict]] = {}
        """Instants that were handed on, and of which no scene came back yet; in order."""

    @property
    def incomplete(self) -> int:
        """Instants so far that lost the detections of a camera, and were left out."""
        return self._instants.incomplete

    def __iter__(self) -> Iterator[TrackedInstant]:
        """Each instant, in order; those of which no scene can be made are NOT MONITORED."""
        place = place_smoothed if self._smooth else _placed
        for scene in place(self._rig, self._handed_on(), self._options):
            _, verdict = self._waiting[scene.index]
            yield from self._blind(before=scene.index)
            del self._waiting[scene.index]
            said = replace(scene, status=verdict.status, reason=verdict.reason, cameras=verdict.cameras)
            yield TrackedInstant(said, is_placed=True, status=verdict.status)
        yield from self._blind(before=None)

    def _handed_on(self) -> Iterator[Instant]:
        for instant in self._instants:
            frame_set = instant.frame_set
            self._waiting[frame_set.index] = frame_set, judged(self._rig.camera_ids, self._use, frame_set)
            yield instant

    def _blind(self, before: int | None) -> Iterator[TrackedInstant]:
        for index in list(self._waiting):
            if index == before:
                return
            frame_set, verdict = self._waiting.pop(index)
            yield TrackedInstant(blind_scene(frame_set, verdict), is_placed=False, status=verdict.status)


def _placed(rig: Rig, instants: Iterable[Instant], options: PlacingOptions) -> Iterator[Scene]:
    """The scenes as the run had them."""
    placer = Placer(rig, options)
    for instant in instants:
        if (scene := placer.place(instant)) is not None:
            yield scene


def _nothing(recording: RecordedRun) -> RecordingError:
    return RecordingError(
        "the recording holds no detections to replay",
        where=recording.files[0],
        expected=f"topics such as /{recording.rig.reference}/{DETECTIONS}",
        got=f"no whole instant in {len(recording.files)} files",
        do_next="run the networks again: recognition run RIG --source CAPTURE",
    )
