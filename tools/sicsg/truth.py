"""What is true of a picture: joints, boxes, keypoints, and what of them can be seen.

Positions come from the scene, projected through the camera's own lens; visibility from the id and depth passes of the
same camera (glass opaque there), warped by the same lens.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tools.sicsg.catalog import item
from tools.sicsg.moment import Moment, entities
from tools.sicsg.rendering.lens import camera_of
from tools.sicsg.scene import Scene, SceneCamera

Floats = NDArray[np.float64]


class Visibility(IntEnum):
    """What hides a joint."""

    OUTSIDE = 0
    OCCLUDED = 1
    """By a worker or a thing, or by the room."""
    SELF_OCCLUDED = 2
    """By the worker's own body or the hat on it."""
    VISIBLE = 3


FLESH_M = np.array(
    [0.05, 0.06, 0.06, 0.07, 0.07, 0.14, 0.14, 0.10, 0.10, 0.08, 0.08, 0.20, 0.20, 0.12, 0.12, 0.12, 0.12]
)
"""(17,) how deep each joint lies under the surface at the most, seen from a side on which it counts as visible."""
_POINT_M, _HAT_M = 0.06, 0.14
"""The same for an object's keypoints, which lie on its surface, and for a hard hat's, the middle of its shell."""


@dataclass(frozen=True, slots=True, eq=False)
class Passes:
    """Id and depth of one camera, distorted as its picture is."""

    ids: NDArray[np.int32]
    """(H, W) entity, 0 for the room."""
    depth_m: NDArray[np.float32]
    """(H, W) z in the camera's frame, inf where nothing is."""


@dataclass(frozen=True, slots=True, eq=False)
class PersonTruth:
    """A worker in a picture."""

    id: str
    joints_px: Floats
    """(17, 2)."""
    visibility: NDArray[np.int64]
    """(17,) of :class:`Visibility`."""
    box: Floats | None
    """(4,) left, top, right, bottom edges of what the id pass shows of body and worn hat; None: nothing."""
    pixels: int


@dataclass(frozen=True, slots=True, eq=False)
class ThingTruth:
    """An object in a picture."""

    id: str
    category: str
    keypoints_px: Floats
    """(K, 2) in the catalogue's physical order."""
    visibility: NDArray[np.int64]
    """(K,) of :class:`Visibility`."""
    box: Floats | None
    """As of :class:`PersonTruth`."""
    pixels: int
    worn_by: str | None
    """The worker on whose head or in whose hand it is."""
    on_head: bool


def cam_from_world(camera: SceneCamera) -> Floats:
    """(4, 4) of a scene's camera."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(np.array(camera.quat_wxyz)[[1, 2, 3, 0]]).as_matrix()
    matrix[:3, 3] = camera.translation_m
    return matrix


def project(camera: SceneCamera, points_m: Floats) -> tuple[Floats, Floats]:
    """Pixels (..., 2), NaN behind the camera, and depths (...,) of points (..., 3) in the world."""
    matrix = cam_from_world(camera)
    local = points_m @ matrix[:3, :3].T + matrix[:3, 3]
    return camera_of(camera).project(local), local[..., 2]


def boxes_of_ids(ids: NDArray[np.int32], count: int) -> tuple[Floats, NDArray[np.int64]]:
    """Boxes (count + 1, 4) as edges (left - .5 of the first pixel, ...; NaN where absent) and pixels (count + 1,)."""
    pixels = np.bincount(ids.ravel(), minlength=count + 1)[: count + 1]
    boxes = np.full((count + 1, 4), np.nan)
    columns = np.zeros((count + 1, ids.shape[1]), dtype=bool)
    rows = np.zeros((count + 1, ids.shape[0]), dtype=bool)
    y, x = np.nonzero(ids)
    number = ids[y, x]
    columns[number, x] = True
    rows[number, y] = True
    for entity in np.flatnonzero(pixels):
        if entity:
            across, down = np.flatnonzero(columns[entity]), np.flatnonzero(rows[entity])
            boxes[entity] = across[0] - 0.5, down[0] - 0.5, across[-1] + 0.5, down[-1] + 0.5
    return boxes, pixels


def visibility(
    passes: Passes, pixels: Floats, depth_m: Floats, own: tuple[int, ...], slack_m: Floats
) -> NDArray[np.int64]:
    """(N,) what hides points at ``pixels`` (N, 2) and ``depth_m`` (N,), ``slack_m`` (N,) under their owner's surface.

    Args:
        own: entities that count as the points' owner: a worker and the hat on the head.
    """
    height, width = passes.ids.shape
    result = np.full(len(pixels), int(Visibility.OUTSIDE))
    with np.errstate(invalid="ignore"):
        inside = (pixels > -0.5).all(axis=1) & (pixels[:, 0] < width - 0.5) & (pixels[:, 1] < height - 0.5)
    for index in np.flatnonzero(inside):
        x, y = np.rint(pixels[index]).astype(int)
        gap = depth_m[index] - passes.depth_m[y, x]
        mine = passes.ids[y, x] in own
        if gap <= slack_m[index]:  # what is seen there is no nearer than the owner's own surface
            result[index] = Visibility.VISIBLE
        else:
            result[index] = Visibility.SELF_OCCLUDED if mine else Visibility.OCCLUDED
    return result


def truth_of_view(scene: Scene, now: Moment, camera: SceneCamera, passes: Passes) -> tuple[list, list]:
    """Every worker (list of :class:`PersonTruth`) and every object (list of :class:`ThingTruth`) in a picture."""
    number = entities(scene)
    boxes, counts = boxes_of_ids(passes.ids, len(number))
    worn = {}
    for thing in scene.things:
        holder = thing.holder(now.t_s)
        if holder is not None:
            worn[thing.id] = holder
    people = []
    for worker in scene.workers:
        hats = [name for name, holder in worn.items() if holder.worker == worker.id and holder.bone == "head"]
        own = (number[worker.id], *(number[name] for name in hats))
        pixels, depth = project(camera, now.workers[worker.id].joints_m)
        seen = visibility(passes, pixels, depth, own, FLESH_M)
        people.append(PersonTruth(worker.id, pixels, seen, _union(boxes[list(own)]), int(counts[list(own)].sum())))
    things = []
    for thing in scene.things:
        points = item(thing.category, thing.variant).keypoints_m
        pose = now.poses[thing.id]
        pixels, depth = project(camera, points @ pose[:3, :3].T + pose[:3, 3])
        seen = visibility(
            passes,
            pixels,
            depth,
            (number[thing.id],),
            np.full(len(points), _HAT_M if thing.category == "hard_hat" else _POINT_M),
        )
        holder = worn.get(thing.id)
        box, area = _union(boxes[[number[thing.id]]]), int(counts[number[thing.id]])
        on_head = holder is not None and holder.bone == "head"
        who = holder.worker if holder else None
        things.append(ThingTruth(thing.id, thing.category, pixels, seen, box, area, who, on_head))
    return people, things


def _union(boxes: Floats) -> Floats | None:
    known = boxes[np.isfinite(boxes[:, 0])]
    return np.concatenate([known[:, :2].min(axis=0), known[:, 2:].max(axis=0)]) if len(known) else None
