"""A scene at one time: where everything is, as instances that renderers draw."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from tools.sicsg.catalog import item
from tools.sicsg.lighting import lamp_instances
from tools.sicsg.mesh import Instance, Mesh
from tools.sicsg.rooms import room_instances
from tools.sicsg.scene import Attachment, Light, Room, Scene, Thing, Worker
from tools.sicsg.skeleton import BONES, REST_ARM_RAD, Body, body, crown, rest_joints
from tools.sicsg.workers.motion import WorkerState, worker_state
from tools.sicsg.workers.skinning import posed, worker_mesh

Floats = NDArray[np.float64]

HANGING = ("toolbox", "bucket", "cone", "small_window")
"""What stays upright in a hand, gripped by its handle or its top."""
_HAT_TILT = Rotation.from_euler("y", 70, degrees=True).as_matrix()


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """A scene at one time."""

    t_s: float
    workers: dict[str, WorkerState]
    poses: dict[str, Floats]
    """``world_from_mesh`` (4, 4) of every thing, by id."""


def entities(scene: Scene) -> dict[str, int]:
    """Number in the id pass of every worker and thing, by id; 0 is the room."""
    names = [worker.id for worker in scene.workers] + [thing.id for thing in scene.things]
    return {name: index for index, name in enumerate(names, start=1)}


def moment(scene: Scene, t_s: float) -> Moment:
    """Where everybody and everything is at this time."""
    states = {worker.id: worker_state(scene, worker, t_s) for worker in scene.workers}
    bodies = {worker.id: worker.body for worker in scene.workers}
    poses = {}
    for thing in scene.things:
        carrier = thing.holder(t_s)
        if carrier is None:
            poses[thing.id] = thing.pose(t_s)
        else:
            poses[thing.id] = _carried(thing, carrier, states[carrier.worker], body(bodies[carrier.worker]))
    return Moment(t_s, states, poses)


def instances(scene: Scene, now: Moment) -> list[Instance]:
    """Everything that can be seen at this time."""
    number = entities(scene)
    drawn = [*room_instances(scene.room), *_lamps_of(scene.light, scene.room)]
    drawn += [Instance(_posed(w, now.workers[w.id]), np.eye(4), number[w.id]) for w in scene.workers]
    for thing in scene.things:
        mesh = item(thing.category, thing.variant).mesh
        drawn.append(Instance(mesh, now.poses[thing.id], number[thing.id]))
    return drawn


@lru_cache(maxsize=8)
def _lamps_of(light: Light, room: Room) -> tuple[Instance, ...]:
    return tuple(lamp_instances(light, room))


def _posed(worker: Worker, state: WorkerState) -> Mesh:
    return posed(worker_mesh(worker.body, worker.clothes), state.bones)


def _carried(thing: Thing, carrier: Attachment, state: WorkerState, build: Body) -> Floats:
    bone = state.bones[BONES.index(carrier.bone)]
    local = np.eye(4)
    if carrier.bone == "head":
        local[:3, 3] = crown(build)
        return bone @ local
    along = hand_direction(carrier.bone)
    grip = rest_joints(build)[BONES.index(carrier.bone)] + 0.05 * build.height_m * along
    what = item(thing.category, thing.variant)
    if thing.category in HANGING:
        handle = what.grips_m[0] if thing.category in ("toolbox", "bucket") else (0.0, 0.0, what.size_m[2])
        return _hanging(bone @ np.append(grip, 1.0), state, handle)
    local[:3, 3] = grip
    if thing.category == "hard_hat":
        local[:3, :3] = _HAT_TILT
        local[:3, 3] += local[:3, :3] @ [-0.02, 0.0, 0.075]  # held at the brim's front
    else:
        local[:3, :3] = _frame_along(along)
    return bone @ local


def hand_direction(bone: str) -> Floats:
    """(3,) unit vector from wrist to knuckles at rest."""
    side = 1.0 if bone == "left_hand" else -1.0
    return np.array([0.0, side * np.sin(REST_ARM_RAD), -np.cos(REST_ARM_RAD)])


def _frame_along(direction: Floats) -> Floats:
    """(3, 3) a rotation whose x axis is the direction and whose z axis is as near to forward as it can be."""
    z = np.array([1.0, 0.0, 0.0]) - direction[0] * direction
    z /= np.linalg.norm(z)
    return np.stack([direction, np.cross(z, direction), z], axis=1)


def _hanging(hand: Floats, state: WorkerState, grip: ArrayLike) -> Floats:
    forward = state.bones[BONES.index("pelvis")][:3, 0]
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("z", np.arctan2(forward[1], forward[0])).as_matrix()
    pose[:3, 3] = hand[:3] - pose[:3, :3] @ np.asarray(grip)
    return pose
