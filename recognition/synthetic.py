"""A simulated site: workers and objects whose places in 3D are known at every instant.

For demonstrations, benchmarks and tests; what cameras report of it is in :mod:`recognition.synthetic_views`. The
world has z up and the floor at 0; the rig's ``world_from_rig`` joins the two. Same arguments, same site.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from recognition.errors import RigRefusedError
from rigcal.camera import Camera
from rigcal.geometry import Floats, Ints, Pose, freeze
from rigcal.rig import Rig, RigCamera
from rigcal.synthetic import look_at

HEIGHT_M = 1.75
"""A worker."""
STRIDE_M = 1.4
"""Two steps of a walking adult."""
HAT_SIZE_M = (0.28, 0.28, 0.16)
"""Extent of a hard hat, whose centre is 0.075 of the worker's height above the ears."""
FURNITURE: tuple[tuple[str, tuple[float, float, float]], ...] = (
    ("ladder", (0.5, 0.4, 2.0)),
    ("large_window", (1.4, 0.1, 1.2)),
    ("platform", (1.2, 0.8, 0.5)),
    ("small_window", (0.6, 0.1, 0.6)),
    ("step_ladder", (0.5, 0.6, 1.0)),
    ("large_window", (0.1, 1.4, 1.2)),
    ("toolbox", (0.5, 0.3, 0.3)),
    ("small_window", (0.1, 0.6, 0.6)),
    ("bucket", (0.3, 0.3, 0.35)),
    ("small_window", (0.6, 0.1, 0.6)),
)
"""Class and extent (x, y, z) in metres of the things that stand along the walls; with four hats, the 14 objects of
the Safe-Construct paper's experiment."""

CLASSES = ("hard_hat", *dict.fromkeys(name for name, _ in FURNITURE))
"""Classes of the simulated site's objects."""

_HEAD = ((0.07, 0, 0.385), (0.055, 0.018, 0.405), (0.055, -0.018, 0.405), (0, 0.042, 0.395), (0, -0.042, 0.395))
"""Nose, eyes and ears above the middle of the hips, for a body of height 1: forward, left, up."""
_PATHS_TRIED = 40
_WALL_M = 0.4
"""What a path keeps from the walls."""
_APART_M = 0.6
"""Those who cross a room are pushed aside by 2 m/s from another at this distance, and by a factor e more for every
0.2 m below it."""
_PUSH_M_PER_S, _PUSH_REACH_M = 2.0, 0.2
_TURN_RAD_PER_S, _HASTE_S = 4.0, 0.3
"""How fast they turn, and take up another speed."""


@dataclass(frozen=True, slots=True, eq=False)
class Site:
    """What is where at each of F instants, in the world frame."""

    rig: Rig
    cam_from_world: tuple[Pose, ...]
    """(V,) of each camera."""
    t_ns: Ints
    """(F,) nanoseconds, from 0."""
    joints_in_world_m: Floats
    """(F, W, 17, 3) COCO-17 joints of W workers."""
    object_class: tuple[str, ...]
    """(K,) classes: one ``hard_hat`` per worker, in the workers' order, then :data:`FURNITURE`."""
    object_centre_in_world_m: Floats
    """(F, K, 3) centres of the objects' boxes."""
    object_size_m: Floats
    """(K, 3) extents along the world's axes."""

    def __post_init__(self) -> None:
        frames, workers, objects = len(self.t_ns), self.joints_in_world_m.shape[1], len(self.object_class)
        freeze(self, np.int64, t_ns=(frames,))
        freeze(self, np.float64, joints_in_world_m=(frames, workers, 17, 3), object_size_m=(objects, 3))
        freeze(self, np.float64, object_centre_in_world_m=(frames, objects, 3))


def semicircle_rig(
    cameras: int = 4, *, radius_m: float = 5.0, height_m: float = 2.0, size_wh: tuple[int, int] = (1920, 1080)
) -> Rig:
    """Cameras on a semicircle that look at the world's origin at 1 m above the floor, as the paper's four do.

    Args:
        cameras: how many, evenly spread over 180 degrees.
        radius_m: horizontal distance of each from the origin.
        height_m: height of each above the floor.
        size_wh: image size; the focal length is 0.6 of the width (80 degrees across).
    """
    focal_px = 0.6 * size_wh[0]
    centre_px = ((size_wh[0] - 1) / 2, (size_wh[1] - 1) / 2)
    lens = Camera("opencv5", size_wh, np.array([focal_px, focal_px, *centre_px, -0.08, 0.03, 4e-4, -3e-4, 0.0]))
    angles = np.linspace(0.0, np.pi, cameras) if cameras > 1 else np.array([np.pi / 2])
    stands = [np.array([radius_m * np.cos(a), radius_m * np.sin(a), height_m]) for a in angles]
    cam_from_world = [look_at(stand, (0.0, 0.0, 1.0)) for stand in stands]
    world_from_rig = cam_from_world[0].inverse()
    mounted = tuple(
        RigCamera(f"cam{i}", lens, Pose.identity() if i == 0 else pose @ world_from_rig)
        for i, pose in enumerate(cam_from_world)
    )
    return Rig("simulated", mounted, "cam0", "PASS", world_from_rig=world_from_rig)


def simulate(
    rig: Rig,
    *,
    workers: int = 4,
    frames: int = 100,
    fps: float = 30.0,
    seed: int = 0,
    room_m: tuple[float, float] = (6.0, 6.0),
    crossing: bool = False,
) -> Site:
    """Workers who walk about a room, each with a hard hat, among ladders, windows and a platform.

    Args:
        rig: cameras; the room is centred on its world's origin.
        workers: how many; heights vary by 5 % around 1.75 m.
        frames: number of instants.
        fps: instants per second.
        seed: of the paths, heights and places.
        room_m: length of the room along world x and y.
        crossing: Whether they cross each other's paths all the time, instead of each keeping away from the others.

    Raises:
        RigRefusedError: where the rig has no world frame, for then nobody knows where the floor is.
    """
    if rig.world_from_rig is None:
        raise RigRefusedError(
            "cannot simulate a site without a floor",
            where=f"rig {rig.site}",
            expected="a rig with world_from_rig",
            got="null",
            do_next="measure it with rigcal world, or simulate on another rig",
        )
    rig_from_world = rig.world_from_rig.inverse()
    rng = np.random.default_rng(seed)
    t_s = np.arange(frames) / fps
    half = np.array(room_m) / 2 - _WALL_M
    paths = _crossing_paths(rng, workers, frames, 1 / fps, half) if crossing else _paths(rng, workers, t_s, half)
    heights = HEIGHT_M * (1 + 0.05 * rng.uniform(-1, 1, workers))
    joints = np.zeros((frames, workers, 17, 3))
    for worker, (path, height) in enumerate(zip(paths, heights, strict=True)):
        joints[:, worker] = walking(path, float(height), phase=float(rng.uniform(0, 2 * np.pi)))
    hats = joints[:, :, 3:5].mean(axis=2) + np.array([0.0, 0.0, 0.075 * HEIGHT_M])
    sizes = np.array([HAT_SIZE_M] * workers + [size for _, size in FURNITURE])
    angle = 2 * np.pi * (np.arange(len(FURNITURE)) + rng.uniform(-0.3, 0.3, len(FURNITURE))) / len(FURNITURE)
    stands = np.stack([half[0] * np.cos(angle), half[1] * np.sin(angle), sizes[workers:, 2] / 2], axis=-1)
    centres = np.concatenate([hats, np.broadcast_to(stands, (frames, *stands.shape))], axis=1)
    return Site(
        rig=rig,
        cam_from_world=tuple(mounted.cam_from_rig @ rig_from_world for mounted in rig.cameras),
        t_ns=np.rint(t_s * 1e9).astype(np.int64),
        joints_in_world_m=joints,
        object_class=("hard_hat",) * workers + tuple(name for name, _ in FURNITURE),
        object_centre_in_world_m=centres,
        object_size_m=sizes,
    )


def _paths(rng: np.random.Generator, workers: int, t_s: Floats, half: Floats) -> list[Floats]:
    """Smooth paths (F, 2) within +-half; each the one of several draws that keeps farthest from the others."""
    paths: list[Floats] = []
    for _ in range(workers):
        draws = []
        for _ in range(_PATHS_TRIED):
            rate = rng.uniform(0.5, 1.0, 2) / half  # rad/s: a peak speed of 0.5 to 1 m/s along each axis
            reach = half * rng.uniform(0.4, 1.0, 2)
            draws.append(reach * np.sin(t_s[:, None] * rate + rng.uniform(0, 2 * np.pi, 2)))
        apart = [min((float(np.linalg.norm(d - p, axis=1).min()) for p in paths), default=np.inf) for d in draws]
        paths.append(draws[int(np.argmax(apart))])
    return paths


def _crossing_paths(rng: np.random.Generator, workers: int, frames: int, step_s: float, half: Floats) -> list[Floats]:
    """Paths (F, 2) of people who walk from side to side of a room, again and again, and give way to each other.

    As in the social force model (Helbing and Molnar, "Social force model for pedestrian dynamics", 1995) everyone is
    drawn to a goal, on the other side of the room, and pushed away by those who are near. In 6 x 6 m four meet, within
    1 m, 50 times a minute, eight 187 times, and never nearer than 0.47 m.
    """
    angle = 2 * np.pi * (np.arange(workers) + rng.uniform(-0.3, 0.3, workers)) / workers
    reach, pace = 0.85 * half, rng.uniform(0.8, 1.3, workers)
    place, facing, speed = reach * _directions(angle), angle + np.pi, pace.copy()
    goal = -place
    paths = np.empty((frames, workers, 2))
    for frame in range(frames):
        paths[frame] = place
        across = np.arctan2(goal[:, 1], goal[:, 0]) + np.pi + rng.uniform(-0.8, 0.8, workers)
        arrived = np.linalg.norm(goal - place, axis=1, keepdims=True) < _APART_M
        goal = np.where(arrived, reach * _directions(across), goal)
        way = goal - place
        wanted = pace[:, None] * way / np.linalg.norm(way, axis=1, keepdims=True) + _pushed(place)
        turn = (np.arctan2(wanted[:, 1], wanted[:, 0]) - facing + np.pi) % (2 * np.pi) - np.pi
        facing = facing + np.clip(turn, -step_s * _TURN_RAD_PER_S, step_s * _TURN_RAD_PER_S)
        ahead = np.clip((wanted * _directions(facing)).sum(axis=1), 0.15, 1.2 * pace)
        speed = speed + (ahead - speed) * step_s / _HASTE_S
        place = np.clip(place + step_s * speed[:, None] * _directions(facing), -half, half)
    return list(np.swapaxes(paths, 0, 1))


def _directions(angle: Floats) -> Floats:
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _pushed(place_m: Floats) -> Floats:
    """(W, 2) velocities with which people (W, 2) are pushed away by the others."""
    others = 1 - np.eye(len(place_m))
    away_m = place_m[:, None] - place_m[None, :]
    apart_m = np.linalg.norm(away_m, axis=-1) + np.eye(len(place_m))
    push = _PUSH_M_PER_S * np.exp((_APART_M - apart_m) / _PUSH_REACH_M) * others / apart_m
    return np.asarray((push[..., None] * away_m).sum(axis=1))


def walking(path_m: Floats, height_m: float = HEIGHT_M, *, phase: float = 0.0) -> Floats:
    """COCO-17 joints (F, 17, 3) of a person who walks along a path (F, 2) on the floor, in the frame of the path.

    Segment lengths are fixed fractions of the body height (Drillis and Contini); arms and legs swing in the plane of
    motion, once per stride of 1.4 m, and the lower foot stays on the floor.

    Args:
        path_m: (F, 2) places below the middle of the hips. Its steps give the heading; one who stands still keeps
            the last, and looks along x before the first step.
        height_m: body height.
        phase: phase of the gait at the start, radians.
    """
    forward = _headings(path_m)
    walked_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path_m, axis=0), axis=1))])
    body = _body(phase + 2 * np.pi * walked_m / STRIDE_M) * height_m
    left = np.stack([-forward[:, 1], forward[:, 0]], axis=-1)
    joints = np.empty_like(body)
    joints[..., :2] = path_m[:, None] + body[..., :1] * forward[:, None] + body[..., 1:2] * left[:, None]
    joints[..., 2] = body[..., 2]
    return joints


def _headings(path_m: Floats) -> Floats:
    """Unit vectors (F, 2) along the steps of a path (F, 2)."""
    steps_m = np.gradient(path_m, axis=0) if len(path_m) > 1 else np.zeros((1, 2))
    length_m = np.linalg.norm(steps_m, axis=1)
    moved = np.maximum.accumulate(np.where(length_m > 1e-9, np.arange(len(path_m)), -1))
    headings = steps_m[moved] / np.where(moved < 0, 1.0, length_m[moved])[:, None]
    return np.where(moved[:, None] < 0, np.array([1.0, 0.0]), headings)


def _body(phase: Floats) -> Floats:
    """Joints (F, 17, 3) of a body of height 1: x forward, y left, z up from the floor."""
    joints = np.zeros((len(phase), 17, 3))
    swing = np.stack([np.sin(phase), -np.sin(phase)], axis=-1)  # left, right
    thigh = 0.45 * swing
    shank = thigh - 0.25 * (1 - np.stack([np.cos(phase), -np.cos(phase)], axis=-1))
    drop = 0.245 * np.cos(thigh) + 0.246 * np.cos(shank)
    hip_z = 0.039 + drop.max(axis=1)
    side = np.array([1.0, -1.0])
    joints[:, 11:13, 1], joints[:, 11:13, 2] = 0.07 * side, hip_z[:, None]
    joints[:, 13:15] = joints[:, 11:13] + 0.245 * _down(thigh)
    joints[:, 15:17] = joints[:, 13:15] + 0.246 * _down(shank)
    joints[:, 5:7, 1], joints[:, 5:7, 2] = 0.115 * side, hip_z[:, None] + 0.288
    arm = -0.5 * swing
    joints[:, 7:9] = joints[:, 5:7] + 0.186 * _down(arm)
    joints[:, 9:11] = joints[:, 7:9] + 0.146 * _down(arm + 0.35)
    joints[:, :5] = _HEAD
    joints[:, :5, 2] += hip_z[:, None]
    return joints


def _down(angle: Floats) -> Floats:
    """Unit vectors (..., 3) that hang down, swung forward by an angle (...)."""
    return np.stack([np.sin(angle), np.zeros_like(angle), -np.cos(angle)], axis=-1)
