"""What is drawn is what was seen: the same messages as if every field had been set by hand, and a scene that says
whether anybody watches."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Point2_pb2 import Point2
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.PointsAnnotation_pb2 import PointsAnnotation
from foxglove_schemas_protobuf.Pose_pb2 import Pose as PoseMessage
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.TextAnnotation_pb2 import TextAnnotation
from foxglove_schemas_protobuf.TextPrimitive_pb2 import TextPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3

sys.path.insert(0, str(Path(__file__).parent))
from test_recording_write import T0, rig_and_json

from recognition.observations import LIMBS, ObjectTrack, Scene, ViewDetections, WorkerTrack
from recognition.recording import ViewTracks
from recognition.recording.annotations import image_annotations
from recognition.recording.messages import identity_color, stamp
from recognition.recording.scene import SceneDrawer
from recognition.recording.stencil import Stencil
from rigcal.geometry import Pose

UPRIGHT = Pose(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]), np.array([0.5, -1.0, 2.0]))
"""The rig's world, of numbers that are moved to it without rounding."""
UNSEEN = np.full((17, 2), np.nan)
WHEN = stamp(T0)
GREY = Color(r=0.6, g=0.6, b=0.6, a=1.0)


def point_stencil() -> Stencil:
    return Stencil(2, lambda x, y: PointsAnnotation(points=[Point2(x=x, y=y)]))


def test_a_copy_is_the_message_that_has_these_numbers():
    numbers = np.array([[[1.5, -2.0], [0.0, 1e300], [-0.0, 5e-324]], [[np.inf, np.pi], [np.pi + 1, 0.0], [0.1, 0.2]]])
    copies = point_stencil().copies(numbers)
    for row, messages in zip(numbers.tolist(), copies, strict=True):
        for (x, y), copy in zip(row, messages, strict=True):
            drawn = PointsAnnotation.FromString(copy)
            assert drawn == PointsAnnotation(points=[Point2(x=x, y=y)])
            assert drawn.SerializeToString() == PointsAnnotation(points=[Point2(x=x, y=y)]).SerializeToString()


def test_copies_are_appended_in_order_and_nothing_of_nothing():
    drawn = PointsAnnotation(thickness=2.0)
    drawn.MergeFromString(b"".join(point_stencil().copies(np.arange(8.0).reshape(4, 2))))
    assert [(p.x, p.y) for p in drawn.points] == [(0, 1), (2, 3), (4, 5), (6, 7)]
    assert drawn.thickness == 2.0
    assert point_stencil().copies(np.zeros((0, 2))) == []
    assert point_stencil().copies(np.zeros((0, 17, 2))) == []


def test_a_number_that_the_message_does_not_hold_or_holds_twice_is_refused():
    with pytest.raises(ValueError, match="number 1 must be one double of the message, is 0"):
        Stencil(2, lambda x, _y: Point2(x=x))
    with pytest.raises(ValueError, match="number 0 must be one double of the message, is 2"):
        Stencil(1, lambda x: Point2(x=x, y=x))


def drawn_by_hand(view: ViewDetections, people: list[int | None], objects: list[int | None]) -> ImageAnnotations:
    """Every field set one by one, joint by joint."""
    drawn = ImageAnnotations(timestamp=WHEN)

    def add(kind: int, points: list[tuple[float, float]], color: Color, thickness: float) -> None:
        made = [Point2(x=x, y=y) for x, y in points]
        style = {"outline_color": color, "fill_color": color, "thickness": thickness}
        drawn.points.append(PointsAnnotation(timestamp=WHEN, type=kind, points=made, **style))

    def label(text: str, at: tuple[float, float], color: Color) -> None:
        position, background = Point2(x=at[0], y=at[1]), Color(a=0.5)
        style = {"font_size": 16.0, "text_color": color, "background_color": background}
        drawn.texts.append(TextAnnotation(timestamp=WHEN, position=position, text=text, **style))

    for joints, track in zip(view.people_px, people, strict=True):
        color = GREY if track is None else identity_color(track)
        known = {j: (float(x) + 0.5, float(y) + 0.5) for j, (x, y) in enumerate(joints) if np.isfinite([x, y]).all()}
        limbs = [known[j] for limb in LIMBS if set(limb) <= set(known) for j in limb]
        if limbs:
            add(PointsAnnotation.LINE_LIST, limbs, color, 2.0)
        if known:
            add(PointsAnnotation.POINTS, list(known.values()), color, 5.0)
            if track is not None:
                label(f"worker {track}", min(known.values(), key=lambda point: point[1]), color)
    boxes = zip(view.object_class, view.object_xyxy + 0.5, view.object_score, objects, strict=True)
    for name, (left, top, right, bottom), score, track in boxes:
        color = GREY if track is None else identity_color(track)
        add(PointsAnnotation.LINE_LOOP, [(left, top), (right, top), (right, bottom), (left, bottom)], color, 2.0)
        label(f"{name}{'' if track is None else f' {track}'} {score:.2f}", (left, top), color)
    return drawn


def test_annotations_are_byte_for_byte_those_that_are_drawn_by_hand():
    rng = np.random.default_rng(0)
    joints = rng.uniform(0, 1000, (40, 17, 2))
    joints[rng.random((40, 17)) < rng.random((40, 1))] = np.nan
    joints[0], joints[1, 3], joints[2, :, 0] = UNSEEN, (np.nan, 7.0), -0.5
    joints[3, 1:] = np.nan  # joints, but no limb
    boxes = rng.uniform(0, 1000, (20, 4))
    boxes[0, :2] = -0.5  # a corner at 0, which protobuf leaves out
    names = tuple(f"thing_{k}" for k in range(20))
    view = ViewDetections(joints, np.ones((40, 17)), names, boxes, rng.random(20))
    people, objects = ([None if k % 3 == 0 else k % 9 for k in range(n)] for n in (40, 20))
    drawn = image_annotations(view, ViewTracks(tuple(people), tuple(objects)), T0)
    assert drawn.SerializeToString() == drawn_by_hand(view, people, objects).SerializeToString()
    untracked = image_annotations(view, None, T0)
    assert untracked.SerializeToString() == drawn_by_hand(view, [None] * 40, [None] * 20).SerializeToString()
    nothing = image_annotations(ViewDetections.empty(), None, T0)
    assert nothing.SerializeToString() == ImageAnnotations(timestamp=WHEN).SerializeToString()


def scene_by_hand(scene: Scene, frame: str, world_from_rig: Pose, up: np.ndarray) -> SceneUpdate:
    """Every field of workers and objects set one by one."""

    def at(point: np.ndarray) -> PoseMessage:
        x, y, z = point.tolist()
        return PoseMessage(position=Vector3(x=x, y=y, z=z), orientation=Quaternion(w=1.0))

    def label(text: str, below: np.ndarray, color: Color) -> TextPrimitive:
        return TextPrimitive(pose=at(below + 0.3 * up), billboard=True, font_size=0.15, color=color, text=text)

    update = SceneUpdate()
    for worker in scene.workers:
        color, joints = identity_color(worker.track_id), world_from_rig.apply(worker.joints_m)
        known = {j: joint for j, joint in enumerate(joints) if np.isfinite(joint).all()}
        if not known:
            continue
        size = Vector3(x=0.05, y=0.05, z=0.05)
        entity = SceneEntity(timestamp=WHEN, frame_id=frame, id=f"worker/{worker.track_id}")
        entity.spheres.extend(SpherePrimitive(pose=at(joint), size=size, color=color) for joint in known.values())
        limbs = [known[j].tolist() for limb in LIMBS if set(limb) <= set(known) for j in limb]
        if limbs:
            points = [Point3(x=x, y=y, z=z) for x, y, z in limbs]
            style = {"type": LinePrimitive.LINE_LIST, "pose": at(np.zeros(3)), "thickness": 0.03, "color": color}
            entity.lines.append(LinePrimitive(points=points, **style))
        entity.texts.append(label(f"worker {worker.track_id}", max(known.values(), key=lambda p: p @ up), color))
        update.entities.append(entity)
    for thing in scene.objects:
        color, centre = identity_color(thing.track_id), world_from_rig.apply(thing.centre_m)
        name = f"{thing.object_class}/{thing.track_id}"
        entity = SceneEntity(timestamp=WHEN, frame_id=frame, id=f"object/{name}")
        entity.cubes.append(CubePrimitive(pose=at(centre), size=Vector3(x=0.2, y=0.2, z=0.2), color=color))
        entity.texts.append(label(name.replace("/", " "), centre, color))
        update.entities.append(entity)
    return update


@pytest.mark.parametrize("world", [UPRIGHT, None])
def test_scenes_are_byte_for_byte_those_that_are_drawn_by_hand(world):
    rng = np.random.default_rng(1)
    joints = rng.uniform(-3, 3, (12, 17, 3))
    joints[rng.random((12, 17)) < rng.random((12, 1))] = np.nan
    joints[0], joints[1, 1:], joints[2, 4] = np.nan, np.nan, 0.0
    nobody = np.zeros(2, int)
    workers = tuple(WorkerTrack(k, one, np.full(17, 2), nobody) for k, one in enumerate(joints))
    things = tuple(ObjectTrack(k, "hard_hat", rng.uniform(-3, 3, 3), 2, nobody) for k in range(14))
    unknown = ObjectTrack(99, "ladder", np.full(3, np.nan), 0, nobody)
    scene = Scene(0, T0, workers, (*things, unknown))
    drawn = SceneDrawer(rig_and_json(world)[0]).update(scene)
    assert drawn.entities[0].id == "status"
    del drawn.entities[0]
    up = np.array([0, -1.0, 0]) if world is None else np.array([0, 0, 1.0])
    by_hand = scene_by_hand(
        Scene(0, T0, workers, things), "rig" if world is None else "world", world or Pose.identity(), up
    )
    assert len(drawn.entities) == 11 + 14
    assert drawn.SerializeToString() == by_hand.SerializeToString()


def status_text(scene: Scene, world: Pose | None = UPRIGHT) -> TextPrimitive:
    (entity,) = SceneDrawer(rig_and_json(world)[0]).update(scene).entities
    assert (entity.id, entity.frame_id) == ("status", "rig" if world is None else "world")
    (text,) = entity.texts
    return text


def test_the_scene_says_whether_the_site_is_monitored_and_why_not():
    watched = status_text(Scene(0, T0, (), ()))
    degraded = status_text(Scene(0, T0, (), (), "DEGRADED", "3 of 4 cameras (cam1: no frame)", 3))
    blind = status_text(Scene(0, T0, (), (), "NOT MONITORED", "1 of 4 cameras (cam1: no frame; cam2: no frame)", 1))
    assert watched.text == "MONITORED"
    assert degraded.text == "DEGRADED\n3 of 4 cameras (cam1: no\nframe)"
    assert blind.text == "NOT MONITORED\n1 of 4 cameras (cam1: no\nframe; cam2: no frame)"
    colors = [(text.color.r, text.color.g, text.color.b, text.color.a) for text in (watched, degraded, blind)]
    assert colors == [(0.2, 0.8, 0.3, 1.0), (1.0, 0.55, 0.0, 1.0), (1.0, 0.1, 0.1, 1.0)]
    assert watched.font_size < degraded.font_size < blind.font_size
    assert all(text.billboard and text.scale_invariant for text in (watched, degraded, blind))


def test_the_status_stands_above_the_floor_or_above_camera_0():
    scene = Scene(0, T0, (), ())
    places = [status_text(scene, world).pose.position for world in (UPRIGHT, None)]
    assert [(at.x, at.y, at.z) for at in places] == [(0.0, 0.0, 2.5), (0.0, -2.5, 0.0)]


def test_when_nobody_watches_any_more_the_workers_go_and_the_red_text_replaces_the_green():
    drawer = SceneDrawer(rig_and_json()[0])
    there = (WorkerTrack(3, np.ones((17, 3)), np.full(17, 2), np.zeros(2, int)),)
    before = drawer.update(Scene(0, T0, there, ()))
    blind = drawer.update(Scene(1, T0 + 1, (), (), "NOT MONITORED", "1 of 4 cameras", 1))
    after = drawer.update(Scene(2, T0 + 2, there, ()))
    assert [entity.id for entity in before.entities] == ["status", "worker/3"]
    assert [entity.id for entity in blind.entities] == ["status"]
    assert [deletion.id for deletion in blind.deletions] == ["worker/3"]
    assert after.entities[0].texts[0].text == "MONITORED"
    assert len(after.deletions) == 0  # an entity of the same name replaces the one before
