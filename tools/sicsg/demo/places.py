"""Where the technician holds the board, and when: shown to each pair of neighbours and to each camera near by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from rigcal.geometry import Floats, Pose
from rigcal.rig import Rig, RigCamera
from rigcal.synthetic import board_poses_for_camera, board_poses_for_pair
from tools.sicsg.demo.painting import outline_m
from tools.sicsg.demo.scene import BOARD, SEED
from tools.sicsg.scene import Scene
from tools.sicsg.sequences import true_rig

SHARED, SINGLE = 10, 6
"""Places shown to each pair of neighbours, and to each camera alone."""
SHARED_M, SINGLE_M = (1.8, 6.0), (1.0, 2.8)
"""How far from the camera."""
STILL, MOVING = 4, 1
"""Frames of each place, and between two places."""
_DRAWN = 12
"""Places drawn for each that is wanted: many of them are in a wall or behind a pillar."""
_REACH_M = (0.05, 2.3)
"""Heights that a person can hold the board's corners at."""
_WALL_M = 0.1
_TREMOR_M, _TREMOR_RAD = 0.0008, 0.0008
_EXPOSED = 5
"""Poses into which the exposure of a moving board is divided."""


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """A camera of the empty room, with what stands before it."""

    camera: RigCamera
    depth_m: NDArray[np.float32]
    """(H, W) to the room, as the camera sees it."""

    def shows_whole(self, outline_in_rig: Floats) -> bool | None:
        """Whether nothing of the room is before the board; None where the board is not in the picture."""
        local = self.camera.cam_from_rig.apply(outline_in_rig)
        pixels = self.camera.camera.project(local)
        width, height = self.camera.camera.size_wh
        inside = (local[:, 2] > 0.1) & (pixels > 0).all(axis=1) & (pixels < (width - 1, height - 1)).all(axis=1)
        if not inside.any():
            return None
        x, y = np.rint(pixels[inside]).astype(int).T
        return bool((self.depth_m[y, x] > local[inside, 2]).all())


def places(scene: Scene, seen: Sequence[Seen]) -> list[Pose]:
    """``world_from_board`` of every place, ordered so that the way is short.

    Raises:
        ValueError: where a pair of neighbours or a camera has too few free places.
    """
    rig = true_rig(scene, scene.story)
    assert rig.world_from_rig is not None
    found: list[Pose] = []
    for number, group in enumerate(_groups(rig)):
        wanted = SHARED if len(group) == 2 else SINGLE
        seed = 100 * SEED + number
        if len(group) == 2:
            drawn = board_poses_for_pair(rig, *group, BOARD, _DRAWN * wanted, distance_m=SHARED_M, seed=seed)
        else:
            drawn = board_poses_for_camera(rig, *group, BOARD, _DRAWN * wanted, distance_m=SINGLE_M, seed=seed)
        free = [rig.world_from_rig @ pose for pose in drawn if _is_free(rig, scene, seen, pose)]
        if len(free) < wanted:
            raise ValueError(f"{' and '.join(group)}: {len(free)} of {wanted} places for the board are free")
        found += free[:wanted]
    return _short_way(found)


def _groups(rig: Rig) -> list[tuple[str, ...]]:
    """Pairs of neighbours from one end of the arc to the other, then each camera."""
    assert rig.world_from_rig is not None
    at = [rig.world_from_rig.apply(c.cam_from_rig.inverse().translation_m)[:2] for c in rig.cameras]
    middle = np.arctan2(*np.mean(at, axis=0)[::-1])
    angle = [(np.arctan2(y, x) - middle + np.pi) % (2 * np.pi) for x, y in at]
    ids = [rig.camera_ids[index] for index in np.argsort(angle)]
    return [*pairwise(ids), *((name,) for name in ids)]


def _is_free(rig: Rig, scene: Scene, seen: Sequence[Seen], rig_from_board: Pose) -> bool:
    """Whether a person could hold it there, and no camera sees it behind something."""
    assert rig.world_from_rig is not None
    rows, columns = np.meshgrid(np.linspace(0, 1, 7), np.linspace(0, 1, 9), indexing="ij")
    a, b, _, d = outline_m(BOARD)
    grid = (a + columns[..., None] * (b - a) + rows[..., None] * (d - a)).reshape(-1, 3)
    in_rig = rig_from_board.apply(grid)
    in_world = rig.world_from_rig.apply(in_rig)
    half = np.array(scene.room.size_m[:2]) / 2 - _WALL_M
    held = (
        (in_world[:, 2] > _REACH_M[0]) & (in_world[:, 2] < _REACH_M[1]) & (np.abs(in_world[:, :2]) < half).all(axis=1)
    )
    return bool(held.all()) and all(one.shows_whole(in_rig) is not False for one in seen)


def _short_way(poses: list[Pose]) -> list[Pose]:
    """The same poses, each followed by the nearest that is left."""
    left, way = list(poses[1:]), [poses[0]]
    while left:
        gaps = [float(np.linalg.norm(pose.translation_m - way[-1].translation_m)) for pose in left]
        way.append(left.pop(int(np.argmin(gaps))))
    return way


def frames(way: Sequence[Pose], fps: float, exposure_s: float) -> list[list[Pose]]:
    """For every frame of the film ``world_from_board`` in equal parts of its exposure.

    The board is held still, but for the hand's tremor, for ``STILL`` frames at each place, then moved on.
    """
    rng = np.random.default_rng((SEED, 9))
    film: list[list[Pose]] = []
    for number, place in enumerate(way):
        film += [[_trembling(place, rng)] for _ in range(STILL)]
        if number + 1 < len(way):
            times = (np.arange(1, MOVING + 1)) / (MOVING + 1)
            parts = ((np.arange(_EXPOSED) + 0.5) / _EXPOSED - 0.5) * exposure_s * fps / (MOVING + 1)
            film += [[between(place, way[number + 1], t + part) for part in parts] for t in times]
    return film


def between(one: Pose, other: Pose, share: float) -> Pose:
    """On the way from one pose to another, gently started and ended."""
    s = float(np.clip(share, 0.0, 1.0))
    s = s * s * (3 - 2 * s)
    turn = Slerp([0, 1], Rotation.from_matrix([one.rotation, other.rotation]))(s).as_matrix()
    return Pose(turn, one.translation_m + s * (other.translation_m - one.translation_m))


def _trembling(pose: Pose, rng: np.random.Generator) -> Pose:
    turn = Rotation.from_rotvec(rng.normal(0, _TREMOR_RAD, 3)).as_matrix()
    return Pose(pose.rotation @ turn, pose.translation_m + rng.normal(0, _TREMOR_M, 3))
