"""A sequence's world at any time, and what of it each camera can see at its instants."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from recognition.evaluation.violations import SceneTruth, read_scene_truth
from rigcal.geometry import Bools, Floats, Ints, freeze
from rigcal.rig import Rig
from rigcal.rigfile import read_rigfile, rig_of
from tools.sicsg.catalog import item
from tools.sicsg.coco import MIN_VISIBLE, PERSON_MIN_HEIGHT, THING_MIN_SIDE
from tools.sicsg.moment import moment
from tools.sicsg.scene import Scene, read_scene

_STEP_S = 0.04
"""Between these times everything moves on straight lines; a wrist at 2 m/s^2 is then off by less than half a mm."""
MOST_S = 0.6
"""So long before the first and after the last instant the world is known: more than any clock error that is tried."""


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """F instants, V cameras, W workers and T objects of a sequence, and the world at G times."""

    truth: SceneTruth
    rig: Rig
    """As it is."""
    classes: tuple[str, ...]
    """(T,)"""
    t_s: Floats
    """(G,) seconds after the truth's epoch, ascending."""
    joints_m: Floats
    """(G, W, 17, 3) in the world, as all points here."""
    corners_m: Floats
    """(G, T, 8, 3) of the box around each object, along its own axes."""
    keypoints_m: Floats
    """(G, T, 4, 3) NaN where a class has fewer."""
    joint_seen: Ints
    """(F, V, W, 17) what hides the joint, of :class:`tools.sicsg.truth.Visibility`."""
    worker_share: Floats
    """(F, V, W) share of the worker that shows."""
    worker_given: Bools
    """(F, V, W) whether enough of the worker shows, as networks are asked for."""
    object_share: Floats
    """(F, V, T)"""
    object_given: Bools
    """(F, V, T)"""
    object_xyxy: Floats
    """(F, V, T, 4) boxes of what shows, at the instants; NaN where nothing does."""

    def __post_init__(self) -> None:
        count, things = len(self.t_s), len(self.classes)
        freeze(self, np.float64, t_s=(count,), joints_m=(count, None, 17, 3))
        freeze(self, np.float64, corners_m=(count, things, 8, 3), keypoints_m=(count, things, 4, 3))

    def at(self, t_s: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Joints (..., W, 17, 3), corners (..., T, 8, 3) and keypoints (..., T, 4, 3) at times (...)."""
        wanted = np.asarray(t_s, dtype=np.float64)
        after = np.clip(np.searchsorted(self.t_s, wanted), 1, len(self.t_s) - 1)
        part = ((wanted - self.t_s[after - 1]) / (self.t_s[after] - self.t_s[after - 1]))[..., None, None, None]
        joints, corners, keypoints = (
            (1 - part) * path[after - 1] + part * path[after]
            for path in (self.joints_m, self.corners_m, self.keypoints_m)
        )
        return joints, corners, keypoints

    def frame_at(self, t_s: ArrayLike) -> Ints:
        """(...) the instants nearest to times (...)."""
        return np.asarray(np.abs(self.truth.t_s - np.asarray(t_s)[..., None]).argmin(axis=-1))

    @property
    def middle_m(self) -> Floats:
        """(3,) mean of where workers are: the scene's centre."""
        return np.asarray(self.joints_m.mean(axis=(0, 1, 2)))


def read_world(folder: Path, *, at_instants: bool = False) -> World:
    """Read a sequence's folder: ``scene.json``, ``truth.json``, ``truth.npz`` and ``true.rig.json``.

    Args:
        folder: Of the sequence, rendered or not.
        at_instants: Whether the world is asked for at the instants only, and for no box that something hides: it is
            then read in no time.

    Raises:
        DatasetError: where the truth is missing or has another form.
    """
    truth, scene = read_scene_truth(folder), read_scene(folder / "scene.json")
    if at_instants:
        t_s = truth.t_s
        with np.load(folder / "truth.npz") as stored:
            joints, keypoints = stored["joints_m"], stored["object_keypoints_m"]
            corners = np.repeat(stored["object_m"][:, :, None], 8, axis=2)
    else:
        t_s = np.arange(float(truth.t_s[0]) - MOST_S, float(truth.t_s[-1]) + MOST_S + _STEP_S, _STEP_S)
        joints, corners, keypoints = _paths(scene, t_s)
    with np.load(folder / "truth.npz") as stored:
        seen = stored["joints_seen"]
        workers, things = stored["worker_xyxy"], stored["object_xyxy"]
        worker_share = stored["worker_pixels"] / np.maximum(stored["worker_full_pixels"], 1)
        object_share = stored["object_pixels"] / np.maximum(stored["object_full_pixels"], 1)
    heights = np.array([camera.size_wh[1] for camera in scene.cameras])[None, :, None]
    with np.errstate(invalid="ignore"):
        tall = workers[..., 3] - workers[..., 1] >= PERSON_MIN_HEIGHT * heights
        wide = (things[..., 2:] - things[..., :2]).min(axis=-1) >= THING_MIN_SIDE * heights
    return World(
        truth, rig_of(read_rigfile(folder / "true.rig.json")), tuple(thing.category for thing in scene.things), t_s,
        joints, corners, keypoints, seen, worker_share, tall & (worker_share >= MIN_VISIBLE),
        object_share, wide & (object_share >= MIN_VISIBLE), things,
    )  # fmt: skip


def _paths(scene: Scene, t_s: Floats) -> tuple[Floats, Floats, Floats]:
    items = [item(thing.category, thing.variant) for thing in scene.things]
    boxes = [_corners(own.mesh.vertices_m) for own in items]
    joints = np.zeros((len(t_s), len(scene.workers), 17, 3))
    corners = np.zeros((len(t_s), len(items), 8, 3))
    keypoints = np.full((len(t_s), len(items), 4, 3), np.nan)
    for number, at_s in enumerate(t_s.tolist()):
        now = moment(scene, at_s)
        joints[number] = [now.workers[worker.id].joints_m for worker in scene.workers]
        for index, (thing, own, box) in enumerate(zip(scene.things, items, boxes, strict=True)):
            pose = now.poses[thing.id]
            corners[number, index] = box @ pose[:3, :3].T + pose[:3, 3]
            points = own.keypoints_m
            keypoints[number, index, : len(points)] = points @ pose[:3, :3].T + pose[:3, 3]
    return joints, corners, keypoints


def _corners(vertices_m: NDArray[np.float32]) -> Floats:
    """(8, 3) of the box around points (N, 3)."""
    ends = np.stack([vertices_m.min(axis=0), vertices_m.max(axis=0)]).astype(np.float64)
    return np.array(list(product(*ends.T)))
