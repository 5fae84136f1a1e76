"""A recording placed again: what its networks saw, through the same code as live.

Same rig, options and detections give the same tracks to the last bit, since a recording holds all three as the run had
them. Other options answer what another method would have made of the same detections.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from recognition.errors import RecordingError
from recognition.monitoring import LEAST_CAMERAS, Verdict, judged
from recognition.observations import Instant, Scene
from recognition.options import options_of
from recognition.placing import Placer, PlacingOptions, place_smoothed
from recognition.recording import DETECTIONS
from recognition.sources.recording import RecordedRun
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
    """Instants that lost the detections of a camera and were left out; 0 unless the recording was recovered."""
    placed: int
    """How many instants are scenes."""
    worker_instants: Mapping[int, int]
    """At how many instants each worker was seen, by track."""
    object_instants: Mapping[str, int]
    """At how many instants each object was seen, by ``class/track``."""


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
    options: PlacingOptions,
    *,
    smooth: bool = False,
    keep_scenes: bool = True,
    progress: Callable[[int], None] | None = None,
) -> ReplayResult:
    """Place every instant of a recording.

    Args:
        recording: As :func:`recognition.sources.recording.open_recording` opens it.
        options: Those of the run (:func:`recorded_options`) for the same tracks, or others.
        smooth: Whether every track is smoothed by what came after (:mod:`recognition.smoothing`).
        keep_scenes: Whether the result holds every scene, which a recording of days has no room for.
        progress: Called with the number of instants done.

    Raises:
        RecordingError: where a file of the recording is damaged, or it holds no detections.
        OptionError: where tracks of the method ``paper`` are to be smoothed.
    """
    instants, rig = recording.instants(), recording.rig
    use = recorded_cameras(recording)
    verdicts: dict[int, Verdict] = {}
    done = 0

    def judged_instants() -> Iterator[Instant]:
        nonlocal done
        for instant in instants:
            if instant.frame_set.cameras >= LEAST_CAMERAS:
                verdicts[instant.frame_set.index] = judged(rig.camera_ids, use, instant.frame_set)
            yield instant
            done += 1
            if progress:
                progress(done)

    place = place_smoothed if smooth else _placed
    scenes, placed = [], 0
    workers, objects = Counter[int](), Counter[str]()
    for scene in place(rig, judged_instants(), options):
        verdict = verdicts.pop(scene.index)
        placed += 1
        workers.update(worker.track_id for worker in scene.workers)
        objects.update(f"{thing.object_class}/{thing.track_id}" for thing in scene.objects)
        if keep_scenes:
            scenes.append(replace(scene, status=verdict.status, reason=verdict.reason, cameras=verdict.cameras))
    if not done:
        raise RecordingError(
            "the recording holds no detections to replay",
            where=recording.files[0],
            expected=f"topics such as /{recording.rig.reference}/{DETECTIONS}",
            got=f"no whole instant in {len(recording.files)} files",
            do_next="run the networks again: recognition run RIG --source CAPTURE",
        )
    return ReplayResult(
        tuple(scenes), done, instants.incomplete, placed, dict(sorted(workers.items())), dict(sorted(objects.items()))
    )


def _placed(rig: Rig, instants: Iterable[Instant], options: PlacingOptions) -> Iterator[Scene]:
    """The scenes as the run had them."""
    placer = Placer(rig, options)
    for instant in instants:
        if (scene := placer.place(instant)) is not None:
            yield scene
