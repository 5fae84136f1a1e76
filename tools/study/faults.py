"""The errors that are injected, one kind at a time, and the levels that are tried.

Positions and rotations are of every camera but the reference, whose frame is the rig's. A level is a root mean square:
of a displacement in space, as the gates ``position_sigma_m`` and ``scene_sigma_m`` have it (root of a covariance's
trace). The rig states how unsure it is, as a rig file of rigcal does; that changes how sure a scene says that it is,
and no decision: of turned cameras that did not state it every decision was the same.

Decision: ``position`` moves a camera and leaves its direction, which no calibration does: what board views leave open
is mostly where a camera is on a circle about the scene, looking at the same place. That is ``orbit``. Both bound what a
stated position error can mean.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from recognition.observations import JOINTS
from rigcal.geometry import Floats, Pose
from rigcal.rig import Rig, RigCamera
from tools.study.world import World
from tools.train.geometry import RULE_JOINTS


@dataclass(frozen=True, slots=True)
class Axis:
    """A kind of error."""

    title: str
    unit: str
    levels: tuple[float, ...]
    """In the unit; the first is no error."""
    detectors: tuple[str, ...]
    """Of :mod:`tools.study.detector`."""
    gate: tuple[str, float] | None = None
    """A gate of rigcal that limits it, and its default in the unit."""


_MM = (0.0, 5.0, 10.0, 20.0, 40.0, 80.0, 160.0, 320.0)
_DEG = (0.0, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
_BOTH = ("open", "measured")
AXES: Mapping[str, Axis] = MappingProxyType(
    {
        "joint_jitter": Axis("3D joints, anew at each instant", "mm", (0.0, 10, 20, 30, 50, 75, 100, 150), ("open",)),
        "joint_held": Axis("3D joints, the same all the time", "mm", (0.0, 10, 20, 30, 50, 75, 100, 150), ("open",)),
        "pixel": Axis("pixels of joints, boxes and keypoints", "px", (0.0, 1, 2, 4, 8, 16, 32), ("open",)),
        "position": Axis("cameras displaced", "mm", _MM, _BOTH, ("position_sigma_m", 20.0)),
        "orbit": Axis("cameras displaced about the scene", "mm", _MM, _BOTH, ("position_sigma_m", 20.0)),
        "rotation": Axis("cameras turned", "deg", _DEG, _BOTH),
        "clock": Axis("clocks", "ms", (0.0, 5, 10, 20, 40, 80, 160, 320), _BOTH, ("clock_error_m", 10.0)),
        "joints": Axis("joints that are known", "", (17.0, 13, 11, 10, 7), ("open", "seen", "measured")),
    }
)


def _both(*parts: str) -> tuple[str, ...]:
    return tuple(f"{side}_{part}" for part in parts for side in ("left", "right"))


_NAMED: Mapping[int, tuple[str, ...]] = MappingProxyType(
    {
        17: JOINTS,
        13: ("nose", *_both("shoulder", "elbow", "wrist", "hip", "knee", "ankle")),
        11: RULE_JOINTS,
        10: _both("ear", "shoulder", "wrist", "hip", "ankle"),
        7: ("nose", *_both("shoulder", "wrist", "ankle")),
    }
)
"""Sets of joints: 13 lack eyes and ears; 11 are those of ``python -m tools.train saving``, without eyes, elbows and
knees; 10 lack the nose besides; 7 have neither ears nor hips."""


@dataclass(frozen=True, slots=True, eq=False)
class Injected:
    """What is wrong in a trial."""

    rig: Rig
    """As it is believed to be."""
    late_s: Floats
    """(V,) how much later than its stamp each camera's picture was taken."""
    joints: tuple[int, ...]
    """Those that are known."""
    pixel: float = 0.0
    """Added standard deviation of every pixel."""
    joint_m: float = 0.0
    """Mean distance by which joints in 3D are moved after they were placed."""
    joint_held: bool = False
    """Whether each joint of a worker keeps its displacement."""


def injected(axis: str, level: float, world: World, rng: np.random.Generator) -> Injected:
    """An error of a kind and a level.

    Args:
        axis: Of :data:`AXES`.
        level: In its unit.
        world: What it is injected into.
        rng: Directions; of another level, from the same state, the same ones.
    """
    views = len(world.rig.cameras)
    whole = Injected(world.rig, np.zeros(views), tuple(range(17)))
    if axis in ("joint_jitter", "joint_held"):
        return replace(whole, joint_m=level * 1e-3, joint_held=axis == "joint_held")
    if axis == "pixel":
        return replace(whole, pixel=level)
    if axis == "joints":
        return replace(whole, joints=tuple(JOINTS.index(name) for name in _NAMED[int(level)]))
    if axis == "clock":
        late_s = np.where(_moves(world.rig), rng.standard_normal(views), 0.0) * level * 1e-3
        return replace(whole, rig=_with_clock_bounds(world.rig, 2e-3 * level), late_s=late_s)
    return replace(whole, rig=misplaced(axis, level, world, rng))


def misplaced(axis: str, level: float, world: World, rng: np.random.Generator) -> Rig:
    """The rig with its cameras displaced or turned; it states the covariance."""
    cameras = []
    for entry, moves in zip(world.rig.cameras, _moves(world.rig), strict=True):
        draw = rng.standard_normal(3) / np.sqrt(3)
        if not moves or level == 0:
            cameras.append(entry)
            continue
        if axis in ("position", "orbit"):
            own = _displaced(entry, draw * level * 1e-3, level * 1e-3, world if axis == "orbit" else None)
        else:
            own = _turned(entry, draw * np.deg2rad(level), np.deg2rad(level))
        cameras.append(own)
    return replace(world.rig, cameras=tuple(cameras))


def scene_error_m(rig: Rig, world: World) -> float:
    """How far the scene's centre is triangulated from where it is: the gate ``scene_sigma_m``, of one draw.

    The nearest point to the rays of all cameras, which see it exactly.
    """
    if world.rig.world_from_rig is None:
        raise ValueError(f"{world.truth.name}: its rig has no world frame; render it again")
    point = world.rig.world_from_rig.inverse().apply(world.middle_m)
    normal, right = np.zeros((3, 3)), np.zeros(3)
    for true, believed in zip(world.rig.cameras, rig.cameras, strict=True):
        seen = true.cam_from_rig.apply(point)
        ray = believed.cam_from_rig.rotation.T @ (seen / np.linalg.norm(seen))
        across = np.eye(3) - np.outer(ray, ray)
        normal += across
        right += across @ _centre(believed.cam_from_rig)
    return float(np.linalg.norm(np.linalg.solve(normal, right) - point))


def _moves(rig: Rig) -> list[bool]:
    return [entry.id != rig.reference for entry in rig.cameras]


def _centre(cam_from_rig: Pose) -> Floats:
    return np.asarray(-cam_from_rig.rotation.T @ cam_from_rig.translation_m)


def _displaced(entry: RigCamera, by_m: Floats, rms_m: float, about: World | None) -> RigCamera:
    """A camera moved in the rig's frame; about the scene's centre: turned, so that it still looks at it."""
    pose = entry.cam_from_rig
    R, centre = pose.rotation, _centre(pose)
    turn, per_m = np.zeros(3), np.zeros((3, 3))
    if about is not None and about.rig.world_from_rig is not None:
        to_scene = about.rig.world_from_rig.inverse().apply(about.middle_m) - centre
        per_m = R @ _cross(to_scene) / float(to_scene @ to_scene)
        turn = R @ _between(to_scene - by_m, to_scene)
    turned = Pose(R, np.zeros(3)).perturbed(turn, np.zeros(3)).rotation
    jacobian = np.concatenate([per_m, -R - _cross(pose.translation_m) @ per_m])
    moved = Pose(turned, -turned @ (centre + by_m))
    return replace(entry, cam_from_rig=moved, pose_covariance=jacobian @ jacobian.T * rms_m**2 / 3)


def _turned(entry: RigCamera, by_rad: Floats, rms_rad: float) -> RigCamera:
    """A camera turned about its own centre."""
    pose = entry.cam_from_rig
    moved = Pose(pose.perturbed(by_rad, np.zeros(3)).rotation, np.zeros(3))
    jacobian = np.concatenate([np.eye(3), -_cross(pose.translation_m)])
    moved = Pose(moved.rotation, -moved.rotation @ _centre(pose))
    return replace(entry, cam_from_rig=moved, pose_covariance=jacobian @ jacobian.T * rms_rad**2 / 3)


def _between(first: Floats, second: Floats) -> Floats:
    """(3,) rotation vector of the smallest turn from one direction to another."""
    across = np.cross(first, second)
    sine, cosine = float(np.linalg.norm(across)), float(first @ second)
    return np.asarray(across * np.arctan2(sine, cosine) / sine if sine else np.zeros(3))


def _cross(vector: Floats) -> Floats:
    """(3, 3) the matrix of the cross product with a vector."""
    x, y, z = vector.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _with_clock_bounds(rig: Rig, bound_s: float) -> Rig:
    """The rig with clocks that state how wrong they may be."""
    cameras = tuple(
        replace(entry, clock=replace(entry.clock, bound_s=bound_s)) if moves and entry.clock else entry
        for entry, moves in zip(rig.cameras, _moves(rig), strict=True)
    )
    return replace(rig, cameras=cameras)
