"""A recording as a sequence of pictures: frames as they were, and what the same placing makes of what was seen.

Each picture shows, of every camera, the frame nearest to its time, and the scene nearest to it; scenes come from the
recorded detections through :mod:`recognition.replay`, so that they are the run's to the last bit.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import cv2
import numpy as np

from recognition.errors import RecordingError
from recognition.observations import Instant, Scene, ViewDetections
from recognition.optics import EPOCH_S
from recognition.placing import PlacingOptions
from recognition.replay import recorded_options, replay
from recognition.viewing import drawing
from recognition.viewing.drawing import AMBER, BLACK, RED, Image, Shown
from recognition.viewing.floor import FloorPlan
from recognition.viewing.footage import STALE_S, CameraFrames, Footage
from recognition.viewing.heads import Heads, blur, blur_all, person_discs
from recognition.viewing.mosaic import HEADER, Mosaic
from rigcal.errors import OptionError
from rigcal.geometry import Floats

AROUND_S = 3.0
"""What was seen up to this long before and after a picture's time can matter to it; more than any limit used here."""
_CALM = (70, 70, 70)


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


class Rendering:
    """Makes the pictures of a recording.

    Args:
        footage: Of the recording.
        options: What is shown.

    Raises:
        RecordingError: where the recording holds no detections, no camera of these has frames, or there are none in
            the range of time.
        OptionError: where tracks of the method ``paper`` are to be smoothed.
    """

    def __init__(self, footage: Footage, options: RenderOptions) -> None:
        rig = footage.run.rig
        self._footage, self._options = footage, options
        self._views = tuple(v for v, is_used in enumerate(options.use) if is_used)
        self._start_ns = footage.span_ns[0]
        self.ticks_ns = _ticks(footage, options)
        """Times of the pictures, rig time in nanoseconds."""
        placing = recorded_options(footage.run) or PlacingOptions()
        self._scenes = replay(footage.run, placing, smooth=options.smooth).scenes
        self._scene_times = [scene.t_ns for scene in self._scenes]
        self._instants = _instants(footage.run.instants(), self.ticks_ns)
        self._mosaic = Mosaic.of(tuple(rig.cameras[v] for v in self._views))
        self._plan = FloorPlan(rig, self._scenes, self._mosaic.plan_wh)
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
        ids = self._footage.run.rig.camera_ids
        for t_ns in self.ticks_ns:
            scene = self._scene_at(t_ns)
            picture = np.zeros((*self.size_wh[::-1], 3), dtype=np.uint8)
            for place, v in enumerate(self._views):
                number = self._footage.nearest(ids[v], t_ns)
                if number is not None and v not in frames:
                    frames[v] = CameraFrames(self._footage, ids[v], number)
                image = None if number is None else self._view(frames[v], v, number, scene)
                title = f"{ids[v]}  no frame" if number is None else self._title(v, number)
                drawing.band(self._mosaic.title(picture, place), title, BLACK)
                if image is not None:
                    self._mosaic.place(picture, place, image)
            self._mosaic.place_plan(picture, self._plan.draw(scene, t_ns))
            drawing.band(picture[:HEADER], *self._headline(t_ns, scene))
            self.broken = sum(each.broken for each in frames.values())
            yield Picture(t_ns, (t_ns - self._start_ns) * 1e-9, picture)

    def _looks(self, v: int) -> Iterator[tuple[int, ViewDetections]]:
        for instant in self._instants.values():
            t_ns = instant.frame_set.times_ns[v]
            if t_ns is not None:
                yield t_ns, instant.views[v]

    def _view(self, frames: CameraFrames, v: int, number: int, scene: Scene | None) -> Image | None:
        """A camera's frame as it is shown: heads blurred first of all, everything else over that."""
        full = frames.image_bgr(number)
        if full is None:
            return None
        shown = self._shown[v]
        width, height = (max(1, int(side * shown.scale)) for side in shown.camera.camera.size_wh)
        size_wh = width, height
        way = cv2.INTER_AREA if shown.scale < 1 else cv2.INTER_LINEAR
        image = np.asarray(cv2.resize(full, size_wh, interpolation=way), dtype=np.uint8)
        if not self._options.show_faces:
            discs = self._heads[v].at(self._time_of(v, number))
            if discs is None:
                blur_all(image)
            else:
                blur(image, np.column_stack([shown.pixels(discs[:, :2]), discs[:, 2] * shown.scale]))
                blur(image, _tracked_heads(shown, scene, size_wh))
        if scene is not None:
            self._draw(image, v, scene)
        return image

    def _draw(self, image: Image, v: int, scene: Scene) -> None:
        shown, instant = self._shown[v], self._instants.get(scene.index)
        if instant is not None:
            seen = instant.views[v]
            tracked = {int(worker.members[v]) for worker in scene.workers}
            for person, joints in enumerate(seen.people_px):
                if person not in tracked:
                    drawing.skeleton(image, shown.pixels(joints), drawing.GREY, thickness=1)
            by_member = {int(thing.members[v]): thing.track_id for thing in scene.objects}
            drawing.boxes(image, shown, seen, [by_member.get(k) for k in range(len(seen.object_class))])
        for thing in scene.objects:
            if thing.members[v] < 0:
                drawing.carried(image, shown.points(thing.centre_m), thing.object_class, thing.track_id)
        for worker in scene.workers:
            drawing.worker(image, shown.points(worker.joints_m), worker.track_id)

    def _scene_at(self, t_ns: int) -> Scene | None:
        at = bisect_left(self._scene_times, t_ns)
        around = self._scenes[max(0, at - 1) : at + 1]
        best = min(around, key=lambda scene: abs(scene.t_ns - t_ns), default=None)
        return best if best is not None and abs(best.t_ns - t_ns) <= STALE_S * 1e9 else None

    def _time_of(self, v: int, number: int) -> int:
        return self._footage.times_ns[self._footage.run.rig.camera_ids[v]][number]

    def _title(self, v: int, number: int) -> str:
        return f"{self._footage.run.rig.camera_ids[v]}  frame {number}  {_clock(self._time_of(v, number))}"

    def _headline(self, t_ns: int, scene: Scene | None) -> tuple[str, drawing.Color]:
        after = f"{_clock(t_ns)}  +{(t_ns - self._start_ns) * 1e-9:.3f} s  {self._footage.run.rig.site}"
        if scene is None:
            return f"NOT MONITORED: no result within {STALE_S:g} s of this time  |  {after}", RED
        count = f"{len(scene.workers)} workers, {len(scene.objects)} objects  |  {after}"
        if scene.status == "MONITORED":
            return f"MONITORED  |  {count}", _CALM
        return f"{scene.status}: {scene.reason}  |  {count}", AMBER if scene.status == "DEGRADED" else RED


def _tracked_heads(shown: Shown, scene: Scene | None, size_wh: tuple[int, int]) -> Floats:
    """(D, 3) discs of the heads that the other cameras place in this view, where its own networks missed somebody."""
    discs = [
        disc[:3]
        for worker in (scene.workers if scene else ())
        for disc in person_discs(shown.points(worker.joints_m), np.ones(len(worker.joints_m)), size_wh)
    ]
    return np.array(discs, dtype=np.float64).reshape(-1, 3)


def _ticks(footage: Footage, options: RenderOptions) -> list[int]:
    """Times of the pictures."""
    ids = footage.run.rig.camera_ids
    used = {ids[v] for v, is_used in enumerate(options.use) if is_used}
    first_ns, last_ns = footage.span_ns
    length_s = (last_ns - first_ns) * 1e-9
    end_s = length_s if options.to_s is None else options.to_s
    ticks = footage.ticks_ns(first_ns + round(options.from_s * 1e9), first_ns + round(end_s * 1e9), used)
    if not ticks:
        raise RecordingError(
            "there are no frames to show",
            where=footage.run.files[0],
            expected=f"cameras {', '.join(footage.topics)}, and times within 0 to {length_s:.3f} s",
            got=f"{', '.join(sorted(used))} from {options.from_s:g} to {end_s:g} s",
            do_next="choose others with --views, or other times with --from and --to",
        )
    return ticks if options.every_s is None else _thinned(ticks, round(options.every_s * 1e9))


def _instants(instants: Iterable[Instant], ticks_ns: Sequence[int]) -> dict[int, Instant]:
    """What was seen around the times of the pictures, by number of the instant."""
    margin_ns = round(AROUND_S * 1e9)
    first_ns, last_ns = ticks_ns[0] - margin_ns, ticks_ns[-1] + margin_ns
    return {each.frame_set.index: each for each in instants if first_ns <= each.frame_set.t_ns <= last_ns}


def _thinned(ticks: Sequence[int], every_ns: int) -> list[int]:
    """The first of the times in each stretch of a length."""
    kept: dict[int, int] = {}
    for t_ns in ticks:
        kept.setdefault((t_ns - ticks[0]) // every_ns, t_ns)
    return list(kept.values())


def _clock(t_ns: int) -> str:
    """A rig time in words: UTC, or seconds from the start of a capture that knows no date."""
    if t_ns < EPOCH_S * 1e9:
        return f"{t_ns * 1e-9:.3f} s"
    second, rest = divmod(t_ns, 1_000_000_000)
    return f"{datetime.fromtimestamp(second, UTC):%Y-%m-%d %H:%M:%S}.{rest // 1_000_000:03d} UTC"
