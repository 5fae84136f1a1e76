"""What a camera saw, drawn over its image: Foxglove ImageAnnotations.

Foxglove counts pixels from the corner of the top-left pixel, we from its centre, so 0.5 px is added to every
coordinate here, and a reader takes it off again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.Point2_pb2 import Point2
from foxglove_schemas_protobuf.PointsAnnotation_pb2 import PointsAnnotation

from recognition.observations import ViewDetections
from recognition.recording.messages import GREY, identity_color, known_points, limb_ends, stamp
from rigcal.geometry import Floats

CORNER_FROM_CENTRE_PX = 0.5
"""Foxglove's pixel coordinate minus ours."""
LINE_PX, JOINT_PX, FONT_PX = 2.0, 5.0, 16.0
"""Line width, joint diameter and letter height, for images of about 1280x720."""
_TEXT_BACKGROUND = Color(r=0.0, g=0.0, b=0.0, a=0.5)


@dataclass(frozen=True, slots=True)
class ViewTracks:
    """Which track each detection of one camera belongs to."""

    people: tuple[int | None, ...]
    """(P,) worker track of each person; None: no track."""
    objects: tuple[int | None, ...]
    """(K,) object track of each object; None: no track."""


def image_annotations(view: ViewDetections, tracks: ViewTracks | None, t_ns: int) -> ImageAnnotations:
    """Skeletons and boxes: coloured and named by their track, grey without one. Joints that are NaN are left out.

    Raises:
        ValueError: where ``tracks`` does not name one track, or None, per detection.
    """
    people = (None,) * len(view.people_px) if tracks is None else tracks.people
    objects = (None,) * len(view.object_class) if tracks is None else tracks.objects
    drawn = ImageAnnotations(timestamp=stamp(t_ns))
    for joints_px, track_id in zip(view.people_px, people, strict=True):
        _add_skeleton(drawn, joints_px + CORNER_FROM_CENTRE_PX, track_id)
    boxes = zip(view.object_class, view.object_xyxy, view.object_score, objects, strict=True)
    for name, xyxy, score, track_id in boxes:
        _add_box(drawn, name, xyxy + CORNER_FROM_CENTRE_PX, float(score), track_id)
    return drawn


def _add_skeleton(drawn: ImageAnnotations, joints: Floats, track_id: int | None) -> None:
    known, limbs = joints[known_points(joints)], limb_ends(joints)
    if not len(known):
        return
    color = GREY if track_id is None else identity_color(track_id)
    if len(limbs):
        _add_points(drawn, PointsAnnotation.LINE_LIST, limbs.tolist(), color, LINE_PX)
    _add_points(drawn, PointsAnnotation.POINTS, known.tolist(), color, JOINT_PX)
    if track_id is not None:
        _add_text(drawn, f"worker {track_id}", known[np.argmin(known[:, 1])].tolist(), color)


def _add_box(drawn: ImageAnnotations, name: str, xyxy: Floats, score: float, track_id: int | None) -> None:
    color = GREY if track_id is None else identity_color(track_id)
    left, top, right, bottom = xyxy.tolist()
    corners = [[left, top], [right, top], [right, bottom], [left, bottom]]
    _add_points(drawn, PointsAnnotation.LINE_LOOP, corners, color, LINE_PX)
    label = name if track_id is None else f"{name} {track_id}"
    _add_text(drawn, f"{label} {score:.2f}", corners[0], color)


def _add_points(
    drawn: ImageAnnotations,
    kind: PointsAnnotation.Type.ValueType,
    points: list[list[float]],
    color: Color,
    thickness_px: float,
) -> None:
    drawn.points.add(
        timestamp=drawn.timestamp,
        type=kind,
        points=[Point2(x=x, y=y) for x, y in points],
        outline_color=color,
        fill_color=color,
        thickness=thickness_px,
    )


def _add_text(drawn: ImageAnnotations, text: str, position: list[float], color: Color) -> None:
    drawn.texts.add(
        timestamp=drawn.timestamp,
        position=Point2(x=position[0], y=position[1]),
        text=text,
        font_size=FONT_PX,
        text_color=color,
        background_color=_TEXT_BACKGROUND,
    )
