"""Workers and objects in 3D, and whether the site is monitored: Foxglove SceneUpdate.

Entities stand in ``world`` where the rig has one (z is up there, as in ``--poses``), else in ``rig``. An entity stays
on the screen until it is deleted, so each update deletes what the last one drew and this one does not.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from itertools import compress

import numpy as np
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose as PoseMessage
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.TextPrimitive_pb2 import TextPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3

from recognition.events import NO_MARKS, Marks, name_of, rules_of
from recognition.observations import ObjectTrack, Scene, Status, WorkerTrack
from recognition.recording.messages import (
    RIG_FRAME,
    VIOLATION_RGB,
    WORLD_FRAME,
    color_message,
    known_points,
    limb_ends,
    stamp,
    track_rgb,
)
from recognition.recording.stencil import Stencil
from rigcal.geometry import Floats, Pose
from rigcal.rig import Rig

JOINT_M, LIMB_M, OBJECT_M = 0.05, 0.03, 0.2
"""Diameter of joints and limbs, edge of an object's cube: only how it looks, an object's size is not measured."""
LABEL_M = 0.3
"""How far above its worker or object a label stands."""
FONT_M = 0.15
STATUS_M = 2.5
"""How far above the origin of the world (the floor), or of camera 0, it is said whether the site is monitored: above
the labels of people who stand."""
STATUS_RGB: dict[Status, tuple[float, float, float]] = {
    "MONITORED": (0.2, 0.8, 0.3), "DEGRADED": (1.0, 0.55, 0.0), "NOT MONITORED": (1.0, 0.1, 0.1)
}  # fmt: skip
STATUS_FONT_PX: dict[Status, float] = {"MONITORED": 16.0, "DEGRADED": 20.0, "NOT MONITORED": 36.0}
"""Height of its letters on the screen, from wherever the scene is looked at."""
VIOLATION_FONT_PX = 28.0
"""Of the status while a rule is violated, unless it is larger."""
STATUS_COLUMNS = 28
"""Letters in a line of the reason: about 600 px at the largest, which a third of a screen of 1920 px has room for."""


class SceneDrawer:
    """Turns scenes into updates, and remembers what it drew last."""

    def __init__(self, rig: Rig) -> None:
        has_world = rig.world_from_rig is not None
        self._frame_id = WORLD_FRAME if has_world else RIG_FRAME
        self._frame_from_rig = rig.world_from_rig or Pose.identity()
        self._up = np.array([0.0, 0.0, 1.0]) if has_world else np.array([0.0, -1.0, 0.0])
        self._drawn: frozenset[str] = frozenset()

    def update(self, scene: Scene, marks: Marks = NO_MARKS) -> SceneUpdate:
        """The scene as one update; tracks of which no joint or centre is known are not drawn, those that are marked
        have the colour of violations.

        What the scene says of itself is always drawn, so that a site without anybody never looks like one that nobody
        watches.
        """
        update = SceneUpdate()
        head = SceneEntity(timestamp=stamp(scene.t_ns), frame_id=self._frame_id).SerializeToString()
        self._add_status(update, head, scene, rules_of(marks))
        self._add_workers(update, head, scene.workers, marks)
        self._add_objects(update, head, scene.objects, marks)
        drawn = frozenset(entity.id for entity in update.entities)
        update.deletions.extend(_deletion(entity_id, scene.t_ns) for entity_id in sorted(self._drawn - drawn))
        self._drawn = drawn
        return update

    def _add_status(self, update: SceneUpdate, head: bytes, scene: Scene, violated: Sequence[str]) -> None:
        violations = [f"VIOLATED: {', '.join(violated)}"] if violated else []
        font_px, rgb = STATUS_FONT_PX[scene.status], STATUS_RGB[scene.status]
        entity = _entity(update, "status", head)
        entity.texts.add(
            pose=_at(*(STATUS_M * self._up).tolist()),
            billboard=True,
            font_size=max(font_px, VIOLATION_FONT_PX) if violated else font_px,
            scale_invariant=True,
            color=color_message(*(VIOLATION_RGB if violated else rgb)),
            text="\n".join([*violations, scene.status, *textwrap.wrap(scene.reason, STATUS_COLUMNS)]),
        )

    def _add_workers(self, update: SceneUpdate, head: bytes, workers: Sequence[WorkerTrack], marks: Marks) -> None:
        if not workers:
            return
        colors = np.array([track_rgb("worker", worker.track_id, marks) for worker in workers])
        joints = self._frame_from_rig.apply(np.stack([worker.joints_m for worker in workers]))
        known = known_points(joints)
        highest = np.where(known, joints @ self._up, -np.inf).argmax(axis=1)
        drawn = zip(
            workers,
            known.tolist(),
            _SPHERE.copies(np.dstack([joints, np.broadcast_to(colors[:, None], joints.shape)])),
            _LIMBS.copies(colors),
            _END.copies(joints),
            self._labels(joints[np.arange(len(joints)), highest], colors),
            strict=True,
        )
        for worker, is_known, spheres, limbs, ends, label in drawn:
            if any(is_known):
                entity = _entity(update, f"worker/{worker.track_id}", head + b"".join(compress(spheres, is_known)))
                if used := limb_ends(ends, is_known):
                    entity.lines.add().MergeFromString(limbs + used)
                entity.texts.add(text=name_of("worker", worker.track_id, marks)).MergeFromString(label)

    def _add_objects(self, update: SceneUpdate, head: bytes, objects: Sequence[ObjectTrack], marks: Marks) -> None:
        if not objects:
            return
        colors = np.array([track_rgb(thing.object_class, thing.track_id, marks) for thing in objects])
        centres = self._frame_from_rig.apply(np.stack([[thing.centre_m] for thing in objects]))[:, 0]
        cubes, labels = _CUBE.copies(np.hstack([centres, colors])), self._labels(centres, colors)
        drawn = zip(objects, known_points(centres).tolist(), cubes, labels, strict=True)
        for thing, is_known, cube, label in drawn:
            if is_known:
                entity = _entity(update, f"object/{thing.object_class}/{thing.track_id}", head + cube)
                entity.texts.add(text=name_of(thing.object_class, thing.track_id, marks)).MergeFromString(label)

    def _labels(self, below: Floats, colors: Floats) -> list[bytes]:
        return _LABEL.copies(np.hstack([below + LABEL_M * self._up, colors]))


def _entity(update: SceneUpdate, entity_id: str, content: bytes) -> SceneEntity:
    entity = update.entities.add(id=entity_id)
    entity.MergeFromString(content)
    return entity


def _deletion(entity_id: str, t_ns: int) -> SceneEntityDeletion:
    return SceneEntityDeletion(timestamp=stamp(t_ns), type=SceneEntityDeletion.MATCHING_ID, id=entity_id)


def _at(x: float, y: float, z: float) -> PoseMessage:
    return PoseMessage(position=Vector3(x=x, y=y, z=z), orientation=Quaternion(w=1.0))


def _cube(x: float, y: float, z: float, *rgb: float) -> SceneEntity:
    edge = Vector3(x=OBJECT_M, y=OBJECT_M, z=OBJECT_M)
    return SceneEntity(cubes=[CubePrimitive(pose=_at(x, y, z), size=edge, color=color_message(*rgb))])


def _sphere(x: float, y: float, z: float, *rgb: float) -> SceneEntity:
    size = Vector3(x=JOINT_M, y=JOINT_M, z=JOINT_M)
    return SceneEntity(spheres=[SpherePrimitive(pose=_at(x, y, z), size=size, color=color_message(*rgb))])


def _limbs(*rgb: float) -> LinePrimitive:
    pose = _at(0.0, 0.0, 0.0)
    return LinePrimitive(type=LinePrimitive.LINE_LIST, pose=pose, thickness=LIMB_M, color=color_message(*rgb))


def _label(x: float, y: float, z: float, *rgb: float) -> TextPrimitive:
    return TextPrimitive(pose=_at(x, y, z), billboard=True, font_size=FONT_M, color=color_message(*rgb))


_CUBE, _SPHERE, _LABEL = Stencil(6, _cube), Stencil(6, _sphere), Stencil(6, _label)
_LIMBS = Stencil(3, _limbs)
_END = Stencil(3, lambda x, y, z: LinePrimitive(points=[Point3(x=x, y=y, z=z)]))
