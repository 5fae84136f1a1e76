"""The rigs of the calibration benchmark: their truth, what a detector would find of the boards, and planted mistakes.

A ring of cameras on a circle that look inwards, or a line of cameras that look at a wall. Neighbours share boards that
no other camera sees, so that a chain of pairs is as long as the rig; every camera also sees boards alone, nearer.
Everything follows from the seed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from rigcal.board import Checkerboard
from rigcal.boardpose import board_poses
from rigcal.camera import Camera
from rigcal.detections import BoardView, SiteDetections
from rigcal.geometry import Bools, Floats, Pose
from rigcal.rig import Rig, RigCamera
from rigcal.synthetic import exact_detections, look_at, with_noise

BOARD = Checkerboard(9, 6, 0.06)
SIZE_WH = (1920, 1080)
RADIUS_M = 4.0
SPACING_M = 2 * RADIUS_M * np.sin(np.pi / 8)
"""Between neighbours of the ring of eight, which rings of fixed spacing keep."""
LINE_SPACING_M = 1.5
HEIGHT_M = 1.6
WALL_M = 4.0
JITTER_M = 0.05

PAIR_BOARDS, TRIPLE_BOARDS, SINGLE_BOARDS, HELD_OUT_BOARDS = 40, 27, 20, 10
"""Boards per pair of neighbours, or per three of them (as many views of each camera); alone; kept out, per group."""
SHARED_DISTANCE_M, SINGLE_DISTANCE_M = (1.5, 5.0), (0.7, 2.2)

_BATCH = 1024
_BATCHES = 1000
_OUTLINE = BOARD.corners_in_board[[0, BOARD.columns - 1, -BOARD.columns, -1]]
_MARGIN_PX = 0.03 * max(SIZE_WH) + 5  # that of the detections, and what a lens bends the board's sides
_FRONTAL = 0.35  # cosine: less than 70 degrees off the board's normal


@dataclass(frozen=True, slots=True, eq=False)
class BenchSite:
    """A rig, the boards held before it, and what a detector found of them."""

    name: str
    """``ring``, ``spaced``, ``line`` or ``triple``."""
    rig: Rig
    rig_from_board: tuple[Pose, ...]
    """The true pose of the board at each instant."""
    detections: SiteDetections
    """Noisy corners; frame ``i`` of every camera is instant ``i``."""
    held_out: SiteDetections
    """Noisy corners of boards that no method is given."""
    noise_px: float
    """Sigma per axis."""


@dataclass(frozen=True, slots=True)
class Planted:
    """One view that was spoilt."""

    camera_idx: int
    frame_idx: int
    kind: str
    """``shifted``: the whole board, as from bad synchronisation. ``thrown``: each corner by itself. ``turned``: the
    order of the corners by 180 degrees."""
    told_by: str
    """``itself``: no pose of the board explains the view, though the lens is known. ``third view``: at least two
    other cameras saw the board and were left alone. ``partner``: one other camera contradicts it, and nothing says
    which of the two is wrong. ``nobody``: a pose of the board explains it and no other camera saw it."""


def ring(
    cameras: int, seed: int, *, noise_px: float = 0.2, spacing: bool = False, seen_by_three: bool = False
) -> BenchSite:
    """A closed ring.

    Args:
        cameras: How many; at least six where ``seen_by_three``.
        seed: Of everything.
        noise_px: Sigma of the corners per axis.
        spacing: Keep the distance of neighbours, so that the radius grows with the cameras, instead of the radius.
        seen_by_three: Boards are shared by three neighbours instead of two.
    """
    radius_m = SPACING_M / (2 * np.sin(np.pi / cameras)) if spacing else RADIUS_M
    angles = 2 * np.pi * np.arange(cameras) / cameras
    positions = np.stack([radius_m * np.sin(angles), -radius_m * np.cos(angles), np.full(cameras, HEIGHT_M)], axis=1)
    width = 3 if seen_by_three else 2
    groups = [tuple((first + k) % cameras for k in range(width)) for first in range(cameras)]
    name = "triple" if seen_by_three else "spaced" if spacing else "ring"
    return _site(name, positions, np.tile([0, 0, HEIGHT_M], (cameras, 1)), groups, seed, noise_px)


def line(cameras: int, seed: int, *, noise_px: float = 0.2) -> BenchSite:
    """An open line of cameras side by side; its chain has one pair less than cameras. Arguments as of :func:`ring`."""
    x_m = LINE_SPACING_M * np.arange(cameras)
    positions = np.stack([x_m, np.zeros(cameras), np.full(cameras, HEIGHT_M)], axis=1)
    groups = [(first, first + 1) for first in range(cameras - 1)]
    return _site("line", positions, positions + [0, WALL_M, 0], groups, seed, noise_px)


RIGS: dict[str, Callable[[int, int, float], BenchSite]] = {
    "ring": lambda cameras, seed, noise_px: ring(cameras, seed, noise_px=noise_px),
    "spaced": lambda cameras, seed, noise_px: ring(cameras, seed, noise_px=noise_px, spacing=True),
    "line": lambda cameras, seed, noise_px: line(cameras, seed, noise_px=noise_px),
    "triple": lambda cameras, seed, noise_px: ring(cameras, seed, noise_px=noise_px, seen_by_three=True),
}
"""Each kind of rig by name, from (cameras, seed, noise in pixels)."""


def _site(
    name: str,
    positions_m: Floats,
    targets_m: Floats,
    groups: Sequence[tuple[int, ...]],
    seed: int,
    noise_px: float,
) -> BenchSite:
    rng = np.random.default_rng((seed, len(positions_m), sum(name.encode())))  # another rig, other boards
    rig = _rig(name, positions_m, targets_m, rng)
    shared = TRIPLE_BOARDS if len(groups[0]) == 3 else PAIR_BOARDS
    poses: list[Pose] = []
    seen_by: list[tuple[int, ...]] = []
    for group in groups:
        poses += _sample(rig, group, shared, SHARED_DISTANCE_M, rng)
        seen_by += [group] * shared
    for camera in range(len(positions_m)):
        poses += _sample(rig, (camera,), SINGLE_BOARDS, SINGLE_DISTANCE_M, rng)
        seen_by += [(camera,)] * SINGLE_BOARDS
    kept_out = [pose for group in groups for pose in _sample(rig, group, HELD_OUT_BOARDS, SHARED_DISTANCE_M, rng)]
    kept_by = [group for group in groups for _ in range(HELD_OUT_BOARDS)]
    noise_seed = int(rng.integers(2**32))
    return BenchSite(
        name,
        rig,
        tuple(poses),
        with_noise(_detections(rig, poses, seen_by), noise_px, seed=noise_seed),
        with_noise(_detections(rig, kept_out, kept_by), noise_px, seed=noise_seed + 1),
        noise_px,
    )


def _rig(name: str, positions_m: Floats, targets_m: Floats, rng: np.random.Generator) -> Rig:
    jitter = rng.normal(0, JITTER_M, (2, *positions_m.shape))
    cam_from_world = [look_at(p, t) for p, t in zip(positions_m + jitter[0], targets_m + jitter[1], strict=True)]
    members = tuple(
        RigCamera(f"cam{index}", _lens(rng), pose @ cam_from_world[0].inverse() if index else Pose.identity())
        for index, pose in enumerate(cam_from_world)
    )
    return Rig(name, members, "cam0", "PASS", world_from_rig=cam_from_world[0].inverse())


def _lens(rng: np.random.Generator) -> Camera:
    """About 69 degrees wide; focal length 1 % and distortion 20 % different from lens to lens."""
    focal = rng.normal(1400, 15)
    centre = (np.array(SIZE_WH) - 1) / 2 + rng.normal(0, 10, 2)
    distortion = np.array([-0.1, 0.05, 5e-4, -5e-4]) * rng.uniform(0.8, 1.2, 4)
    return Camera("opencv4", SIZE_WH, np.array([focal, focal * rng.uniform(0.998, 1.002), *centre, *distortion]))


def _detections(rig: Rig, poses: Sequence[Pose], seen_by: Sequence[tuple[int, ...]]) -> SiteDetections:
    return exact_detections(rig, BOARD, poses, seen_by=[[rig.camera_ids[c] for c in group] for group in seen_by])


def _sample(
    rig: Rig, group: tuple[int, ...], count: int, distance_m: tuple[float, float], rng: np.random.Generator
) -> list[Pose]:
    """``count`` poses ``rig_from_board`` that every camera of the group sees whole.

    Drawn evenly over the image of one of them and over ``distance_m`` from it; the board faces the middle of the
    cameras and is then tilted by up to 35 degrees each way and turned by up to 25.
    """
    cameras = [rig.cameras[c] for c in group]
    centres = np.stack([camera.cam_from_rig.inverse().translation_m for camera in cameras])
    middle = BOARD.corners_in_board.mean(axis=0)
    poses: list[Pose] = []
    for _ in range(_BATCHES):
        viewer = rng.integers(len(cameras), size=_BATCH)
        pixels = rng.uniform(0, SIZE_WH, (_BATCH, 2))
        reach_m = rng.uniform(*distance_m, _BATCH)
        tilts = rng.uniform([-35, -35, -25], [35, 35, 25], (_BATCH, 3))
        places = np.empty((_BATCH, 3))
        right = np.empty((_BATCH, 3))
        for index, camera in enumerate(cameras):
            mine = viewer == index
            rays = camera.camera.rays(pixels[mine]) * reach_m[mine, None]
            places[mine] = camera.cam_from_rig.inverse().apply(rays)
            right[mine] = camera.cam_from_rig.rotation[0]
        near = np.all([_inside(camera, places[:, None]) for camera in cameras], axis=0)
        rotations = _facing(centres.mean(axis=0) - places[near], right[near], tilts[near])
        origins = places[near] - rotations @ middle
        whole = np.all([_sees_whole(camera, rotations, origins) for camera in cameras], axis=0)
        found = np.flatnonzero(whole)[: count - len(poses)]
        poses += [Pose(rotations[i], origins[i]) for i in found]
        if len(poses) == count:
            return poses
    raise ValueError(f"found {len(poses)} of {count} boards seen by {', '.join(camera.id for camera in cameras)}")


def _facing(towards: Floats, right: Floats, tilts_deg: Floats) -> Floats:
    """(n, 3, 3) rotations of boards whose front faces ``towards`` (n, 3), upright beside ``right`` (n, 3), tilted."""
    z = -towards / np.linalg.norm(towards, axis=1, keepdims=True)
    x = right - (right * z).sum(axis=1, keepdims=True) * z
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    upright = np.stack([x, np.cross(z, x), z], axis=2)
    return np.asarray(upright @ Rotation.from_euler("xyz", tilts_deg, degrees=True).as_matrix())


def _inside(camera: RigCamera, points_in_rig: Floats) -> Bools:
    """(n,) whether all points (n, K, 3) of a row lie in the image, away from its edge."""
    points = camera.cam_from_rig.apply(points_in_rig)
    pixels = np.nan_to_num(camera.camera.project(points), nan=-1.0)
    inside = (pixels > _MARGIN_PX) & (pixels < np.array(SIZE_WH) - _MARGIN_PX) & (points[..., 2:] > 0.1)
    return np.asarray(inside.all(axis=(1, 2)))


def _sees_whole(camera: RigCamera, rotations: Floats, origins_m: Floats) -> Bools:
    """(n,) whether the camera sees the front of each board, and all of it."""
    to_origin = camera.cam_from_rig.apply(origins_m)
    normals = rotations[:, :, 2] @ camera.cam_from_rig.rotation.T
    seen = np.asarray((normals * to_origin).sum(axis=1) > _FRONTAL * np.linalg.norm(to_origin, axis=1))
    seen[seen] = _inside(camera, _OUTLINE @ rotations[seen].transpose(0, 2, 1) + origins_m[seen, None])
    return seen


def plant(site: BenchSite, seed: int) -> tuple[SiteDetections, tuple[Planted, ...]]:
    """Spoil 5 % of the views by 5 to 20 px, half shifted and half thrown, and turn 1 % of the shared ones (at least 3).

    Returns:
        The detections with the mistakes in them, and what was planted, by camera and frame.
    """
    rng = np.random.default_rng((seed, 1))
    views = [(c, v) for c, camera in enumerate(site.detections.cameras) for v in range(len(camera.views))]
    seen_by = _seen_by(site.detections)
    frame_of = [[view.frame_idx for view in camera.views] for camera in site.detections.cameras]
    shared = [(c, v) for c, v in views if len(seen_by[frame_of[c][v]]) > 1]
    turned = rng.permutation(len(shared))[: max(3, round(0.01 * len(shared)))]
    kinds = {shared[i]: "turned" for i in turned}
    others = [view for view in views if view not in kinds]
    chosen = rng.permutation(len(others))[: round(0.05 * len(views))]
    kinds |= {others[i]: ("shifted", "thrown")[rank % 2] for rank, i in enumerate(chosen)}
    spoilt = {(c, v): _spoilt(site.detections.cameras[c].views[v], kind, rng) for (c, v), kind in sorted(kinds.items())}
    detections = replace(
        site.detections,
        cameras=tuple(
            replace(camera, views=tuple(spoilt.get((c, v), view) for v, view in enumerate(camera.views)))
            for c, camera in enumerate(site.detections.cameras)
        ),
    )
    bad = {(c, frame_of[c][v]) for c, v in kinds}
    planted = []
    for (c, v), view in spoilt.items():
        partners = [other for other in seen_by[view.frame_idx] if other != c]
        clean = sum((other, view.frame_idx) not in bad for other in partners)
        by = "third view" if clean >= 2 else "partner" if partners else "nobody"
        if not _explained(site, c, view):
            by = "itself"
        planted.append(Planted(c, view.frame_idx, kinds[c, v], by))
    return detections, tuple(planted)


def _seen_by(detections: SiteDetections) -> dict[int, list[int]]:
    """Cameras that saw the board of each frame."""
    seen: dict[int, list[int]] = {}
    for c, camera in enumerate(detections.cameras):
        for view in camera.views:
            seen.setdefault(view.frame_idx, []).append(c)
    return seen


def _spoilt(view: BoardView, kind: str, rng: np.random.Generator) -> BoardView:
    if kind == "turned":
        return replace(view, corners_px=view.corners_px[::-1])
    count = 1 if kind == "shifted" else len(view.corner_ids)
    angle, length_px = rng.uniform(0, 2 * np.pi, count), rng.uniform(5, 20, count)
    return replace(
        view, corners_px=view.corners_px + np.stack([np.cos(angle), np.sin(angle)], axis=1) * length_px[:, None]
    )


def _explained(site: BenchSite, camera_idx: int, view: BoardView) -> bool:
    """Whether some pose of the board explains a view as well as noise lets it, the lens being known.

    The sum of squares has the mean ``n`` and the variance ``2 n`` of its degrees of freedom, in units of the noise;
    more than six sigma above is not explained.
    """
    camera, corners = site.rig.cameras[camera_idx].camera, BOARD.corners_in_board[view.corner_ids]
    lens = (camera.matrix, camera.distortion)
    squares = []
    for candidate in board_poses(camera, BOARD.corners_in_board, view):
        start = candidate.cam_from_board
        refined = cv2.solvePnPRefineLM(
            corners, view.corners_px, *lens, start.rvec_rad[:, None], start.translation_m[:, None].copy()
        )
        gap = cv2.projectPoints(corners, *refined, *lens)[0].reshape(-1, 2) - view.corners_px
        squares.append(float((gap**2).sum()) / site.noise_px**2)
    freedom = 2 * len(corners) - 6
    return bool(squares) and min(squares) <= freedom + 6 * np.sqrt(2 * freedom)
