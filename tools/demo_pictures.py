"""Pictures for the demo's page: what each camera saw at some instants, with what was recognised drawn over it."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.PointsAnnotation_pb2 import PointsAnnotation
from numpy.typing import NDArray

from recognition.recording import iter_messages
from rigcal.captures import open_capture, read_frames_at
from tools.demo_truth import Truth

Image = NDArray[np.uint8]
WIDTH_PX = 880
_QUALITY = 80
_CORNER_FROM_CENTRE_PX = 0.5
"""Annotations count pixels from the corner of the first, OpenCV from its centre."""
_LETTERS = 0.45
_SHIFT = 3
"""OpenCV draws with this many bits below the pixel."""


@dataclass(frozen=True, slots=True)
class ViewPicture:
    """A camera's picture, ready for the page."""

    camera_id: str
    source: str
    """As a data URL."""


def pictures_at(truth: Truth, capture: Path, recording: Path, instants: Sequence[int]) -> list[list[ViewPicture]]:
    """For each instant the picture of every camera, skeletons and boxes drawn as they were recorded."""
    pictures: list[list[ViewPicture]] = [[] for _ in instants]
    for camera in open_capture(capture).cameras:
        drawn = _annotations(truth, recording, camera.id)
        images = dict(read_frames_at(camera, instants, colour=True))
        for row, instant in zip(pictures, instants, strict=True):
            scale = WIDTH_PX / images[instant].shape[1]
            image = cv2.resize(images[instant], None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
            if instant in drawn:
                draw(np.asarray(image, np.uint8), drawn[instant], scale)
            row.append(ViewPicture(camera.id, _data_url(image)))
    return pictures


def _annotations(truth: Truth, recording: Path, camera_id: str) -> dict[int, ImageAnnotations]:
    """What was drawn over each instant's picture."""
    found = list(iter_messages(recording, [f"/{camera_id}/annotations"]))
    if not found:
        return {}
    frames = truth.frames_at(np.array([one.publish_ns for one in found]))
    return {int(frame): one.message for frame, one in zip(frames, found, strict=True)}


def draw(image: Image, drawn: ImageAnnotations, scale: float) -> None:
    """Draw annotations over an image that was scaled, and is changed."""
    for shape in drawn.points:
        points = np.array([(point.x, point.y) for point in shape.points]) * scale - _CORNER_FROM_CENTRE_PX
        fixed = np.rint(points * 2**_SHIFT).astype(np.int32)
        colour, wide = _bgr(shape.outline_color), round(shape.thickness)
        if shape.type == PointsAnnotation.LINE_LOOP:
            cv2.polylines(image, [fixed], True, colour, wide, cv2.LINE_AA, _SHIFT)
        elif shape.type == PointsAnnotation.LINE_LIST:
            cv2.polylines(image, list(fixed.reshape(-1, 2, 2)), False, colour, wide, cv2.LINE_AA, _SHIFT)
        else:
            for point in fixed:
                cv2.circle(image, point.tolist(), wide << (_SHIFT - 1), colour, -1, cv2.LINE_AA, _SHIFT)
    for text in drawn.texts:
        left, bottom = round(text.position.x * scale), round(text.position.y * scale) - 3
        (wide, high), below = cv2.getTextSize(text.text, cv2.FONT_HERSHEY_SIMPLEX, _LETTERS, 1)
        cv2.rectangle(image, (left - 1, bottom - high - 2), (left + wide + 1, bottom + below - 2), (0, 0, 0), -1)
        white = (255, 255, 255)
        cv2.putText(image, text.text, (left, bottom), cv2.FONT_HERSHEY_SIMPLEX, _LETTERS, white, 1, cv2.LINE_AA)


def _bgr(colour: Color) -> tuple[float, float, float]:
    return 255 * colour.b, 255 * colour.g, 255 * colour.r


def _data_url(image: Image) -> str:
    content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()
    return f"data:image/jpeg;base64,{base64.b64encode(content).decode()}"
