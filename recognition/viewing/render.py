"""A recording as a sequence of pictures: frames as they were, and what the same placing makes of what was seen.

Each picture shows, of every camera, the frame nearest to its time, and the scene nearest to it; scenes come from the
recorded detections through :mod:`recognition.replay`, so that they are the run's to the last bit.

Decision: pictures from a later time on are placed from :data:`WARM_S` before it, and not from the recording's first
instant, which would take the longer the later they begin. Tracks are what they were by then, but for the last digits,
and get the numbers that the run gave them (:mod:`recognition.viewing.identities`).
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import cv2
import numpy as np

from recognition.errors import RecordingError
from recognition.events import Event, Marks, marks_at, rules_of
from recognition.monitoring import LEAST_CAMERAS, judged
from recognition.observations import Instant, Scene, ViewDetections
from recognition.placing import PlacingOptions
from recognition.recording import DETECTIONS, iter_messages
from recognition.replay import recorded_cameras, recorded_options, replay
from recognition.sources.recording import RecordedRun
from recognition.viewing import captions, drawing
from recognition.viewing.drawing import BLACK, Image, Shown
from recognition.viewing.floor import FloorPlan
from recognition.viewing.footage import LATE_S, STALE_S, CameraFrames, Footage
from recognition.viewing.heads import Heads, blur, blur_all, person_discs
from recognition.viewing.identities import recorded_identities
from recognition.viewing.mosaic import HEADER, Mosaic
from rigcal.errors import OptionError
from rigcal.geometry import Floats

WARM_S = 10.0
"""How long before the first picture placing begins: more than a track lives without being seen, and than a trail."""


@dataclass(frozen=True, slots=True)
class RenderOptions:
    """What is shown of a recording."""

    use: tuple[bool, ...]
    """(V,) which cameras."""
    from_s: float = 0.0
    """From how many seconds after the first frame on."""
    to_s: float | None = None
    """Up to how many; None: to the end."""
    every_s: float | None = None
    """One picture each so many seconds; None: one for each frame."""
    show_faces: bool = False
    smooth: bool = False
    """Whether tracks are smoothed by what came after, as ``recognition replay --smooth`` does."""

    def __post_init__(self) -> None:
        if self.from_s < 0:
            raise OptionError("--from", expected="0 s or more", got=self.from_s)
        if self.to_s is not None and self.to_s <= self.from_s:
            raise OptionError("--to", expected=f"a time after --from, {self.from_s:g} s", got=self.to_s)


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """One picture."""

    t_ns: int
    """Rig time in nanoseconds."""
    after_s: float
    """Seconds after the recording's first frame."""
    image_bgr: Image
    """(H, W, 3)"""
    scene: Scene | None
    """The result that is shown; None where there is none near."""
    headline: str
    """What the band on top says: how the site was monitored, and when."""


class Rendering:
    """Makes the pictures of a recording.

    Args:
        footage: Of the recording.
        options: What is shown.
        events: Violations whose actors are coloured while they last; with the run's own track numbers.
        progress: Called with the number of instants placed so far, before there is a picture.

    Raises:
        RecordingError: where no camera of these has frames, or there are none in the range of time.
        OptionError: where tracks of the method ``paper`` are to be smoothed.
    """

    def __init__(
        self,
        footage: Footage,
        options: RenderOptions,
        *,
        events: Sequence[Event] = (),
        progress: Callable[[int], None] | None = None,
    ) -> None:
        rig = footage.run.rig
        self._events = tuple(events)
        self._footage, self._options = footage, options
        self._views = tuple(v for v, is_used in enumerate(options.use) if is_used)
        self._start_ns = footage.span_ns[0]
        self.ticks_ns = _ticks(footage, options)
        """Times of the pictures, rig time in nanoseconds."""
        self.has_detections = _has_detections(footage.run)
        """Whether the recording says anything about who is there; without, faces are hidden by blurring everything."""
        part = _placed_part(footage.run, options, self._start_ns, self.ticks_ns)
        self._instants = {instant.frame_set.index: instant for instant in part.instants()}
        self.scenes = _scenes(part, self._instants.values(), options, progress)
        """All results that are shown, in order of time."""
        self._scene_times = [scene.t_ns for scene in self.scenes]
        self._mosaic = Mosaic.of(tuple(rig.cameras[v] for v in self._views))
        self._plan = FloorPlan(rig, self.scenes, self._mosaic.plan_wh)
        shown = zip(self._views, self._mosaic.scales, strict=True)
        self._shown = {v: Shown(rig.cameras[v], scale) for v, scale in shown}
        self._heads = {v: Heads(self._looks(v), rig.cameras[v].camera.size_wh) for v in self._views}
        self.broken = 0
        """Frames so far that could not be decoded."""

    @property
    def size_wh(self) -> tuple[int, int]:
        """Of the pictures."""
        return self._mosaic.size_wh

    @property
    def rate(self) -> float:
        """How many pictures there are in a second, about."""
        spacings = np.diff(self.ticks_ns)
        return 1e9 / float(np.median(spacings)) if len(spacings) else 1.0

    def pictures(self) -> Iterator[Picture]:
        """All pictures in order of time; to be run through once.

        Raises:
            RecordingError: where a file of the recording is damaged.
            SourceError: where a frame has another size than its camera was calibrated with.
        """
        frames: dict[int, CameraFrames] = {}
        for t_ns in self.ticks_ns:
            scene = self._scene_at(t_ns)
            marks = marks_at(self._events, t_ns if scene is None else scene.t_ns)
            picture = np.zeros((*self.size_wh[::-1], 3), dtype=np.uint8)
            for place, v in enumerate(self._views):
                self._show_view(picture, place, self._frame(frames, v, t_ns), t_ns, scene, marks)
            self._mosaic.place_plan(picture, self._plan.draw(scene, t_ns, marks))
            words, color = self._headline(t_ns, scene, marks)
            drawing.band(picture[:HEADER], words, color)
            self.broken = sum(each.broken for each in frames.values())
            yield Picture(t_ns, (t_ns - self._start_ns) * 1e-9, picture, scene, words)

    def _looks(self, v: int) -> Iterator[tuple[int, ViewDetections]]:
        for instant in self._instants.values():
            t_ns = instant.frame_set.times_ns[v]
            if t_ns is not None:
                yield t_ns, instant.views[v]

    def _frame(self, frames: dict[int, CameraFrames], v: int, t_ns: int) -> tuple[int, Image] | None:
        """A camera's frame nearest to a time, or the one before that where it is broken: its own time, its image."""
        camera_id = self._footage.run.rig.camera_ids[v]
        number = self._footage.nearest(camera_id, t_ns)
        if number is None:
            return None
        if v not in frames:
            frames[v] = CameraFrames(self._footage, camera_id, number)
        found = frames[v].frame(number)
        if found is None:
            return None
        at_ns = self._footage.times_ns[camera_id][found[0]]
        return (at_ns, found[1]) if abs(at_ns - t_ns) <= STALE_S * 1e9 else None

    def _show_view(
        self,
        picture: Image,
        place: int,
        frame: tuple[int, Image] | None,
        t_ns: int,
        scene: Scene | None,
        marks: Marks,
    ) -> None:
        """A camera's frame as it is shown: heads blurred first of all, everything else over that."""
        v = self._views[place]
        camera_id, title = self._footage.run.rig.camera_ids[v], self._mosaic.title(picture, place)
        if frame is None:
            drawing.band(title, f"{camera_id}  no frame", BLACK)
            return
        at_ns, full = frame
        heads = np.zeros((0, 3)) if self._options.show_faces else self._heads[v].at(at_ns)
        drawing.band(title, captions.view_title(camera_id, at_ns, t_ns, is_hidden=heads is None), BLACK)
        shown = self._shown[v]
        width, height = (max(1, int(side * shown.scale)) for side in shown.camera.camera.size_wh)
        way = cv2.INTER_AREA if shown.scale < 1 else cv2.INTER_LINEAR
        image = np.asarray(cv2.resize(full, (width, height), interpolation=way), dtype=np.uint8)
        if heads is None:
            blur_all(image)
        elif not self._options.show_faces:
            seen = np.column_stack([shown.pixels(heads[:, :2]), heads[:, 2] * shown.scale])
            blur(image, np.concatenate([seen, _tracked_heads(shown, scene, (width, height))]))
        if scene is not None:
            self._draw(image, v, scene, marks)
        self._mosaic.place(picture, place, image)

    def _draw(self, image: Image, v: int, scene: Scene, marks: Marks) -> None:
        shown, instant = self._shown[v], self._instants[scene.index]
        tracked = {int(worker.members[v]) for worker in scene.workers}
        for person in instant.views[v].counted.tolist():
            if person not in tracked:
                joints = instant.views[v].people_px[person]
                drawing.skeleton(image, shown.pixels(joints), drawing.GREY, thickness=1)
        by_member = {int(thing.members[v]): thing.track_id for thing in scene.objects}
        tracks = [by_member.get(k) for k in range(len(instant.views[v].object_class))]
        things = list(drawing.boxes(image, shown, instant.views[v], tracks, marks))
        for thing in scene.objects:
            if thing.members[v] < 0:
                point = shown.points(thing.centre_m)
                things.extend(drawing.carried(image, point, thing.object_class, thing.track_id, marks))
        seen = ((worker.track_id, shown.points(worker.joints_m)) for worker in scene.workers)
        workers = [label for track_id, joints in seen for label in drawing.worker(image, joints, track_id, marks)]
        drawing.write(image, (*workers, *sorted(things, key=lambda label: label.color == drawing.GREY)))

    def _scene_at(self, t_ns: int) -> Scene | None:
        at = bisect_left(self._scene_times, t_ns)
        around = self.scenes[max(0, at - 1) : at + 1]
        best = min(around, key=lambda scene: abs(scene.t_ns - t_ns), default=None)
        return best if best is not None and abs(best.t_ns - t_ns) <= STALE_S * 1e9 else None

    def _headline(self, t_ns: int, scene: Scene | None, marks: Marks) -> tuple[str, drawing.Color]:
        if self.has_detections:
            words, color = captions.of_scene(scene, t_ns, rules_of(marks))
        else:
            words, color = captions.without_detections(show_faces=self._options.show_faces)
        return captions.headline(words, color, self._footage.run.rig, t_ns, self._start_ns)


def _tracked_heads(shown: Shown, scene: Scene | None, size_wh: tuple[int, int]) -> Floats:
    """(D, 3) discs of the heads that the other cameras place in this view, where its own networks missed somebody."""
    discs = [
        disc[:3]
        for worker in (scene.workers if scene else ())
        for disc in person_discs(shown.points(worker.joints_m), np.ones(len(worker.joints_m)), size_wh)
    ]
    return np.array(discs, dtype=np.float64).reshape(-1, 3)


def scenes_between(run: RecordedRun, start_ns: int, end_ns: int) -> tuple[Scene, ...]:
    """What was known from one time to another, with the numbers that the run gave; no frames are needed for it.

    Raises:
        RecordingError: where a file of the recording is damaged.
    """
    part = run.between(start_ns - round(WARM_S * 1e9), end_ns + round(LATE_S * 1e9))
    options = RenderOptions((True,) * len(run.rig.cameras))
    return tuple(
        scene for scene in _scenes(part, tuple(part.instants()), options, None) if start_ns <= scene.t_ns <= end_ns
    )


def _ticks(footage: Footage, options: RenderOptions) -> list[int]:
    """Times of the pictures."""
    ids = footage.run.rig.camera_ids
    used = {ids[v] for v, is_used in enumerate(options.use) if is_used}
    first_ns, last_ns = footage.span_ns
    length_s = (last_ns - first_ns) * 1e-9
    end_s = length_s if options.to_s is None else options.to_s
    ticks = footage.ticks_ns(first_ns + round(options.from_s * 1e9), first_ns + round(end_s * 1e9), used)
    if not ticks:
        until = "on" if options.to_s is None else f"to {options.to_s:g} s"
        raise RecordingError(
            "there are no frames to show",
            where=footage.run.files[0],
            expected=f"cameras {', '.join(footage.topics)}, and times within 0 to {length_s:.3f} s",
            got=f"{', '.join(sorted(used))} from {options.from_s:g} s {until}",
            do_next="choose others with --views, or other times with --from and --to",
        )
    return ticks if options.every_s is None else _thinned(ticks, round(options.every_s * 1e9))


def _has_detections(run: RecordedRun) -> bool:
    topics = [f"/{camera_id}/{DETECTIONS}" for camera_id in run.rig.camera_ids]
    return any(True for file in run.files for _ in islice(iter_messages(file, topics), 1))


def _placed_part(run: RecordedRun, options: RenderOptions, first_ns: int, ticks_ns: Sequence[int]) -> RecordedRun:
    """The part of a recording that is placed for pictures of these times."""
    start_ns = ticks_ns[0] - round(WARM_S * 1e9)
    return run.between(
        start_ns if start_ns > first_ns else None,
        None if options.to_s is None else ticks_ns[-1] + round(LATE_S * 1e9),
    )


def _scenes(
    run: RecordedRun, instants: Collection[Instant], options: RenderOptions, progress: Callable[[int], None] | None
) -> tuple[Scene, ...]:
    """What was known at each instant; NOT MONITORED at those that too few cameras took part in."""
    if not instants:
        return ()
    placing = recorded_options(run) or PlacingOptions()
    placed = replay(run, placing, smooth=options.smooth, progress=progress).scenes
    if run.start_ns is not None:
        placed = recorded_identities(placed, run)
    ids, use = run.rig.camera_ids, recorded_cameras(run)
    judgements = ((each.frame_set, judged(ids, use, each.frame_set)) for each in instants)
    alone = (
        Scene(frame_set.index, frame_set.t_ns, (), (), verdict.status, verdict.reason, verdict.cameras)
        for frame_set, verdict in judgements
        if verdict.cameras < LEAST_CAMERAS
    )
    return tuple(sorted((*placed, *alone), key=lambda scene: scene.t_ns))


def _thinned(ticks: Sequence[int], every_ns: int) -> list[int]:
    """The first of the times in each stretch of a length."""
    kept: dict[int, int] = {}
    for t_ns in ticks:
        kept.setdefault((t_ns - ticks[0]) // every_ns, t_ns)
    return list(kept.values())
