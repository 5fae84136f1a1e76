"""Workers and objects in 3D: Foxglove SceneUpdate.

Entities stand in ``world`` where the rig has one (z is up there, as in ``--poses``), else in ``rig``. An entity stays
on the screen until it is deleted, so each update deletes what the last one drew and this one does not.
"""

from __future__ import annotations

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
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

from recognition.observations import ObjectTrack, Scene, WorkerTrack
from recognition.recording.messages import RIG_FRAME, WORLD_FRAME, identity_color, known_points, limb_ends, stamp
from rigcal.geometry import Floats, Pose
from rigcal.rig import Rig

JOINT_M, LIMB_M, OBJECT_M = 0.05, 0.03, 0.2
"""Diameter of joints and limbs, edge of an object's cube: only how it looks, an object's size is not measured."""
LABEL_M = 0.3
"""How far above its worker or object a label stands."""
FONT_M = 0.15


class SceneDrawer:
    """Turns scenes into updates, and remembers what it drew last."""

    def __init__(self, rig: Rig) -> None:
        has_world = rig.world_from_rig is not None
        self._frame_id = WORLD_FRAME if has_world else RIG_FRAME
        self._frame_from_rig = rig.world_from_rig or Pose.identity()
        self._up = np.array([0.0, 0.0, 1.0]) if has_world else np.array([0.0, -1.0, 0.0])
        self._drawn: frozenset[str] = frozenset()

    def update(self, scene: Scene) -> SceneUpdate:
        """The scene as one update; tracks of which no joint or centre is known are not drawn."""
        entities = [self._worker(worker, scene.t_ns) for worker in scene.workers if _is_known(worker.joints_m)]
        entities += [self._object(thing, scene.t_ns) for thing in scene.objects if _is_known(thing.centre_m)]
        drawn = frozenset(entity.id for entity in entities)
        vanished = sorted(self._drawn - drawn)
        self._drawn = drawn
        return SceneUpdate(deletions=[_deletion(entity_id, scene.t_ns) for entity_id in vanished], entities=entities)

    def _worker(self, worker: WorkerTrack, t_ns: int) -> SceneEntity:
        color = identity_color(worker.track_id)
        joints = self._frame_from_rig.apply(worker.joints_m)
        known, limbs = joints[known_points(joints)], limb_ends(joints)
        top = known[np.argmax(known @ self._up)]
        return SceneEntity(
            timestamp=stamp(t_ns),
            frame_id=self._frame_id,
            id=f"worker/{worker.track_id}",
            lines=[_lines(limbs, color)] if len(limbs) else [],
            spheres=[_sphere(joint, color) for joint in known.tolist()],
            texts=[self._label(f"worker {worker.track_id}", top, color)],
        )

    def _object(self, thing: ObjectTrack, t_ns: int) -> SceneEntity:
        color = identity_color(thing.track_id)
        centre = self._frame_from_rig.apply(thing.centre_m)
        edge = Vector3(x=OBJECT_M, y=OBJECT_M, z=OBJECT_M)
        return SceneEntity(
            timestamp=stamp(t_ns),
            frame_id=self._frame_id,
            id=f"object/{thing.object_class}/{thing.track_id}",
            cubes=[CubePrimitive(pose=_at(centre.tolist()), size=edge, color=color)],
            texts=[self._label(f"{thing.object_class} {thing.track_id}", centre, color)],
        )

    def _label(self, text: str, below: Floats, color: Color) -> TextPrimitive:
        pose = _at((below + LABEL_M * self._up).tolist())
        return TextPrimitive(pose=pose, billboard=True, font_size=FONT_M, color=color, text=text)


def _is_known(points_m: Floats) -> bool:
    return bool(known_points(points_m).any())


def _deletion(entity_id: str, t_ns: int) -> SceneEntityDeletion:
    return SceneEntityDeletion(timestamp=stamp(t_ns), type=SceneEntityDeletion.MATCHING_ID, id=entity_id)


def _at(point: list[float]) -> PoseMessage:
    x, y, z = point
    return PoseMessage(position=Vector3(x=x, y=y, z=z), orientation=Quaternion(w=1.0))


def _sphere(centre: list[float], color: Color) -> SpherePrimitive:
    return SpherePrimitive(pose=_at(centre), size=Vector3(x=JOINT_M, y=JOINT_M, z=JOINT_M), color=color)


def _lines(points: Floats, color: Color) -> LinePrimitive:
    return LinePrimitive(
        type=LinePrimitive.LINE_LIST,
        pose=_at([0.0, 0.0, 0.0]),
        thickness=LIMB_M,
        points=[Point3(x=x, y=y, z=z) for x, y, z in points.tolist()],
        color=color,
    )
