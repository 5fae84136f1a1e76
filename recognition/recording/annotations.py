"""What a camera saw, drawn over its image: Foxglove ImageAnnotations.

Foxglove counts pixels from the corner of the top-left pixel, we from its centre, so 0.5 px is added to every
coordinate here, and a reader takes it off again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import compress

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.Point2_pb2 import Point2
from foxglove_schemas_protobuf.PointsAnnotation_pb2 import PointsAnnotation
from foxglove_schemas_protobuf.TextAnnotation_pb2 import TextAnnotation

from recognition.events import NO_MARKS, Marks, name_of
from recognition.observations import ViewDetections
from recognition.recording.messages import GREY, color_message, known_points, limb_ends, stamp, track_rgb
from recognition.recording.stencil import Stencil
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


def image_annotations(
    view: ViewDetections, tracks: ViewTracks | None, t_ns: int, marks: Marks = NO_MARKS
) -> ImageAnnotations:
    """Skeletons and boxes: coloured and named by their track, grey without one; who is marked is in the colour of
    violations. Joints that are NaN are left out, and so are hints that belong to no track.

    Raises:
        ValueError: where ``tracks`` does not name one track, or None, per detection.
    """
    people = (None,) * len(view.people_px) if tracks is None else tracks.people
    objects = (None,) * len(view.object_class) if tracks is None else tracks.objects
    sheet = _Sheet(t_ns)
    people_px = view.people_px.copy()
    people_px[[n for n in view.hints.tolist() if people[n] is None]] = np.nan
    _draw_skeletons(sheet, people_px, people, marks)
    _draw_boxes(sheet, view, objects, marks)
    return sheet.drawn


class _Sheet:
    """What is drawn over one image; all of it bears the image's time."""

    def __init__(self, t_ns: int) -> None:
        when = stamp(t_ns)
        self.drawn = ImageAnnotations(timestamp=when)
        self._points_then = PointsAnnotation(timestamp=when).SerializeToString()
        self._text_then = TextAnnotation(timestamp=when).SerializeToString()

    def add_points(self, style: bytes, points: bytes) -> None:
        self.drawn.points.add().MergeFromString(self._points_then + style + points)

    def add_text(self, text: str, style: bytes, position: bytes) -> None:
        self.drawn.texts.add(text=text).MergeFromString(self._text_then + style + position)


@dataclass(frozen=True, slots=True)
class _Style:
    """How what is of one colour is drawn: serialized annotations that lack their points, text and time."""

    limbs: bytes
    joints: bytes
    box: bytes
    text: bytes


@lru_cache(maxsize=1024)
def _style(rgb: tuple[float, float, float]) -> _Style:
    color = color_message(*rgb)

    def points(kind: PointsAnnotation.Type.ValueType, thickness_px: float) -> bytes:
        drawn = PointsAnnotation(type=kind, outline_color=color, fill_color=color, thickness=thickness_px)
        return drawn.SerializeToString()

    text = TextAnnotation(font_size=FONT_PX, text_color=color, background_color=_TEXT_BACKGROUND)
    return _Style(
        limbs=points(PointsAnnotation.LINE_LIST, LINE_PX),
        joints=points(PointsAnnotation.POINTS, JOINT_PX),
        box=points(PointsAnnotation.LINE_LOOP, LINE_PX),
        text=text.SerializeToString(),
    )


def _style_of(kind: str, track_id: int | None, marks: Marks) -> _Style:
    return _style(GREY if track_id is None else track_rgb(kind, track_id, marks))


def _draw_skeletons(sheet: _Sheet, people_px: Floats, tracks: Sequence[int | None], marks: Marks) -> None:
    joints = people_px + CORNER_FROM_CENTRE_PX
    known = known_points(joints)
    highest = np.where(known, joints[..., 1], np.inf).argmin(axis=1)
    labels = _POSITION.copies(joints[np.arange(len(joints)), highest])
    for track_id, points, is_known, label in zip(tracks, _POINT.copies(joints), known.tolist(), labels, strict=True):
        style, limbs = _style_of("worker", track_id, marks), limb_ends(points, is_known)
        if limbs:
            sheet.add_points(style.limbs, limbs)
        if any(is_known):
            sheet.add_points(style.joints, b"".join(compress(points, is_known)))
            if track_id is not None:
                sheet.add_text(name_of("worker", track_id, marks), style.text, label)


def _draw_boxes(sheet: _Sheet, view: ViewDetections, tracks: Sequence[int | None], marks: Marks) -> None:
    corners = (view.object_xyxy + CORNER_FROM_CENTRE_PX)[:, _CORNERS]
    boxes, labels = _POINT.copies(corners), _POSITION.copies(corners[:, 0])
    named = zip(view.object_class, view.object_score.tolist(), tracks, boxes, labels, strict=True)
    for name, score, track_id, box, label in named:
        style = _style_of(name, track_id, marks)
        words = name if track_id is None else name_of(name, track_id, marks)
        sheet.add_points(style.box, b"".join(box))
        sheet.add_text(f"{words} {score:.2f}", style.text, label)


_CORNERS = np.array([[0, 1], [2, 1], [2, 3], [0, 3]])
"""(4, 2) a box's corners in its left, top, right and bottom."""
_POINT = Stencil(2, lambda x, y: PointsAnnotation(points=[Point2(x=x, y=y)]))
_POSITION = Stencil(2, lambda x, y: TextAnnotation(position=Point2(x=x, y=y)))
