"""The floor plan: cameras, workers with their trails, objects, and zones of rules, seen from above in metres.

In ``world`` where the rig has one, x to the right and y up. Without a world nobody knows where the floor is: the plan
is then the reference camera's own x to the right and z, away from it, up, and says so.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence

import cv2
import numpy as np

from recognition.events import NO_MARKS, Marks, name_of
from recognition.observations import ObjectTrack, Scene, WorkerTrack
from recognition.rules.zones import Zone
from recognition.viewing.drawing import BLACK, GREY, WHITE, Image, Label, text, track_color, write
from rigcal.geometry import Floats, Pose
from rigcal.rig import Rig

TRAIL_S = 5.0
"""How long a trail is."""
MARGIN_M = 0.7
"""Around everything that is shown."""
FARTHEST_M = 15.0
"""Workers, objects and corners of zones further than this from every camera do not widen the plan: one false
triangulation would shrink all the rest."""
_GROUND, _GRID = (32, 32, 32), (60, 60, 60)
ZONE_BGR = 60, 170, 230
_STEPS_M = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
_LINES = 16
"""Most lines of the grid in one direction."""


class FloorPlan:
    """Draws plans of one size and extent, so that consecutive ones can be compared.

    Args:
        rig: The rig.
        scenes: All that will be shown, in order of time.
        size_wh: Of the plan in pixels.
        zones: Of the floor, which a rig without a world does not know.
    """

    def __init__(self, rig: Rig, scenes: Sequence[Scene], size_wh: tuple[int, int], zones: Sequence[Zone] = ()) -> None:
        self._rig, self._scenes, self._size_wh = rig, scenes, size_wh
        self._zones = zones if rig.world_from_rig is not None else ()
        self._times = [scene.t_ns for scene in scenes]
        self._axes = [0, 1] if rig.world_from_rig is not None else [0, 2]
        self._from_rig = rig.world_from_rig or Pose.identity()
        self._cameras = [self._flat(c.cam_from_rig.inverse().apply(np.zeros(3))) for c in rig.cameras]
        low, high = self._extent()
        self._pixels_per_m = float(np.min((np.array(size_wh) - [8, 60]) / (high - low)))
        self._middle = (low + high) / 2

    def draw(self, scene: Scene | None, t_ns: int, marks: Marks = NO_MARKS) -> Image:
        """The plan (H, W, 3) of a scene, with trails up to a time, and rings around those who are marked; cameras
        alone where there is no scene."""
        width, height = self._size_wh
        image = np.full((height, width, 3), _GROUND, dtype=np.uint8)
        step = self._draw_grid(image)
        zones = list(self._draw_zones(image))
        cameras = list(self._draw_cameras(image))
        self._draw_trails(image, t_ns)
        objects = [
            label for thing in (scene.objects if scene else ()) for label in self._draw_object(image, thing, marks)
        ]
        workers = [label for one in (scene.workers if scene else ()) for label in self._draw_worker(image, one, marks)]
        write(image, (*workers, *cameras, *objects, *zones))
        text(image, f"floor plan, grid {step:g} m" if self._rig.world_from_rig is not None
             else f"top view of {self._rig.reference}'s frame, grid {step:g} m", (6, 16), size=0.42)  # fmt: skip
        if self._rig.world_from_rig is None:
            text(image, "no floor was measured for this rig", (6, 34), GREY, size=0.38)
        return image

    def pixel_of(self, point_in_rig: Floats) -> tuple[int, int]:
        """Where a point (3,) is on the plan."""
        return self._at(self._flat(point_in_rig))

    def _flat(self, points_in_rig: Floats) -> Floats:
        return np.asarray(self._from_rig.apply(points_in_rig)[..., self._axes])

    def _extent(self) -> tuple[Floats, Floats]:
        cameras = np.array(self._cameras)
        seen = [place for scene in self._scenes for place in self._places(scene)]
        seen += [np.array(corner) for zone in self._zones for corner in zone.corners_m]
        near = [p for p in seen if np.linalg.norm(cameras - p, axis=1).min() <= FARTHEST_M]
        points = np.concatenate([cameras, np.array(near).reshape(-1, 2)])
        return points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M

    def _places(self, scene: Scene) -> list[Floats]:
        places = [self._place(one) for one in scene.workers] + [self._flat(thing.centre_m) for thing in scene.objects]
        return [place for place in places if np.isfinite(place).all()]

    def _place(self, one: WorkerTrack) -> Floats:
        """(2,) of a worker: between the hips where they are known, else the middle of the joints."""
        joints = self._flat(one.joints_m)
        hips = joints[11:13][np.isfinite(joints[11:13]).all(axis=1)]
        known = hips if len(hips) else joints[np.isfinite(joints).all(axis=1)]
        return known.mean(axis=0) if len(known) else np.full(2, np.nan)

    def _at(self, place: Floats) -> tuple[int, int]:
        width, height = self._size_wh
        x, y = (place - self._middle) * self._pixels_per_m
        return round(float(np.clip(width / 2 + x, -9999, 9999))), round(
            float(np.clip(height / 2 + 16 - y, -9999, 9999))
        )

    def _beside(self, place: Floats) -> tuple[float, float]:
        x, y = self._at(place)
        return x + 7, y - 5

    def _draw_grid(self, image: Image) -> float:
        half = np.array(self._size_wh) / self._pixels_per_m / 2
        low, high = self._middle - half - 1.0, self._middle + half + 1.0
        wanted = float((high - low).max()) / _LINES
        step = next((each for each in _STEPS_M if each >= wanted), _STEPS_M[-1])
        for axis in (0, 1):
            for line in np.arange(np.ceil(low[axis] / step), np.floor(high[axis] / step) + 1) * step:
                ends = low.copy(), high.copy()
                ends[0][axis] = ends[1][axis] = line
                cv2.line(image, self._at(ends[0]), self._at(ends[1]), _GRID, 1)
        return step

    def _draw_zones(self, image: Image) -> Iterator[Label]:
        for zone in self._zones:
            corners = [self._at(np.array(corner)) for corner in zone.corners_m]
            cv2.polylines(image, [np.array(corners, dtype=np.int32)], True, ZONE_BGR, 2, cv2.LINE_AA)
            yield Label(zone.name, corners[0], ZONE_BGR, 0.42)

    def _draw_trails(self, image: Image, t_ns: int) -> None:
        first = bisect_left(self._times, t_ns - round(TRAIL_S * 1e9))
        trails: dict[int, list[tuple[int, int]]] = {}
        for scene in self._scenes[first : bisect_right(self._times, t_ns)]:
            for one in scene.workers:
                place = self._place(one)
                if np.isfinite(place).all():
                    trails.setdefault(one.track_id, []).append(self._at(place))
        for track_id, points in trails.items():
            cv2.polylines(
                image, [np.array(points, dtype=np.int32)], False, track_color("worker", track_id), 1, cv2.LINE_AA
            )

    def _draw_cameras(self, image: Image) -> Iterator[Label]:
        for camera, place in zip(self._rig.cameras, self._cameras, strict=True):
            ahead = self._flat(camera.cam_from_rig.inverse().apply(np.array([0.0, 0.0, 1.0])))
            cv2.line(image, self._at(place), self._at(place + 0.5 * _unit(ahead - place)), WHITE, 1, cv2.LINE_AA)
            cv2.circle(image, self._at(place), 4, WHITE, -1, cv2.LINE_AA)
            yield Label(camera.id, self._beside(place), WHITE, 0.4)

    def _draw_worker(self, image: Image, one: WorkerTrack, marks: Marks) -> Iterator[Label]:
        place, color = self._place(one), track_color("worker", one.track_id, marks)
        if np.isfinite(place).all():
            cv2.circle(image, self._at(place), 6, color, -1, cv2.LINE_AA)
            cv2.circle(image, self._at(place), 6, BLACK, 1, cv2.LINE_AA)
            if ("worker", one.track_id) in marks:
                cv2.circle(image, self._at(place), 11, color, 2, cv2.LINE_AA)
            yield Label(name_of("worker", one.track_id, marks), self._beside(place), color, 0.42)

    def _draw_object(self, image: Image, thing: ObjectTrack, marks: Marks) -> Iterator[Label]:
        place = self._flat(thing.centre_m)
        if np.isfinite(place).all():
            x, y = self._at(place)
            color = track_color(thing.object_class, thing.track_id, marks)
            cv2.rectangle(image, (x - 4, y - 4), (x + 4, y + 4), color, 1, cv2.LINE_AA)
            if (thing.object_class, thing.track_id) in marks:
                cv2.circle(image, (x, y), 11, color, 2, cv2.LINE_AA)
            yield Label(name_of(thing.object_class, thing.track_id, marks), self._beside(place), color, 0.38)


def _unit(vector: Floats) -> Floats:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-9))
