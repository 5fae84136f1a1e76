"""Qualisys Track Manager's ``.qca.txt``: XML with one ``camera`` each, import only.

Only Qualisys' own software reads such a file, and it holds marker cameras and measures that a rig file does not, so
none is written. Focal lengths and centres are in 1/64 px of the sensor; the centre counts from the sensor's corner,
``fov_video`` says which part the video shows. The transform has the camera's position in mm and, by column in Qualisys'
reading, the rotation of a camera that looks along -z with y up. So ``x_cam = diag(1, -1, -1) [r_ij] (x_world - xyz)``,
which gives the calibration that stands beside the same capture to the last digit (the test has both). Distortions
have OpenCV's meaning and size as they stand.

Decision: a turned view (``viewrotation``) and a video resolution other than the sensor's 1080p change which pixel is
which in a way that no file at hand shows; they are refused by name rather than guessed.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from rigcal.camera import Camera
from rigcal.errors import FormatError
from rigcal.formats._entries import Entry
from rigcal.formats._foreign import ForeignCamera, ForeignRig
from rigcal.geometry import Pose

NAME = "qualisys"
_UNITS_PER_PIXEL = 64
_CV_FROM_QTM = np.diag([1.0, -1.0, -1.0])
_VIDEO_MODELS = ("Miqus Video", "Miqus Video UnderWater", "none")
"""Other models are marker cameras, whose images nobody has."""


def recognises(text: str) -> bool:
    """Whether the text is XML with a Qualisys calibration."""
    return text.lstrip().startswith("<") and "<calibration" in text and "focalLengthU" in text


def read(file: Path, text: str) -> ForeignRig:
    """Read the video cameras.

    Raises:
        FormatError: for text that is not XML, a file without video cameras, a turned view, or a missing or malformed
            entry, naming it.
    """
    try:
        root = ElementTree.fromstring(text.encode("utf-8"), ElementTree.XMLParser(encoding="utf-8"))
    except ElementTree.ParseError as error:
        do_next = "export it again from Qualisys Track Manager"
        raise FormatError("this is not XML", where=file, expected="XML", got=error, do_next=do_next) from error
    entries = [_entry(file, element) for element in root.iterfind("cameras/camera")]
    video = [entry for entry in entries if entry.get("model", "none").text() in _VIDEO_MODELS]
    if not video:
        models = ", ".join(sorted({str(entry.get("model", "none").value) for entry in entries})) or "no camera"
        raise Entry(file, "cameras", None).error("a video camera: " + ", ".join(_VIDEO_MODELS), models)
    return ForeignRig(tuple(_camera(entry) for entry in video), unit="mm")


def _entry(file: Path, element: ElementTree.Element) -> Entry:
    """A camera's attributes, and those of its children by their tags; numbers as numbers, all but the serial."""
    values = {key: text if key in ("serial", "model") else _number(text) for key, text in element.attrib.items()}
    children = {child.tag: {key: _number(text) for key, text in child.attrib.items()} for child in element}
    return Entry(file, f"camera {element.get('serial', '')}".strip(), values | children)


def _number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def _camera(entry: Entry) -> ForeignCamera:
    for key, known in (("viewrotation", 0.0), ("video_resolution", "1080p")):
        if entry.get(key, known).value != known:
            raise entry[key].error(f"{known:g}" if isinstance(known, float) else known)
    transform = entry["transform"]
    r = [[transform[f"r{row}{column}"].number() for column in (1, 2, 3)] for row in (1, 2, 3)]
    rotation = transform.nearest_rotation(_CV_FROM_QTM @ np.array(r))
    position_mm = np.array([transform[axis].number() for axis in "xyz"])
    return ForeignCamera(entry["serial"].text(), _lens(entry), Pose(rotation, -rotation @ position_mm))


def _lens(entry: Entry) -> Camera:
    view, intrinsic = entry["fov_video"], entry["intrinsic"]
    left, right, top, bottom = (view[side].number() for side in ("left", "right", "top", "bottom"))
    in_pixels = [
        intrinsic[key].number() / _UNITS_PER_PIXEL
        for key in ("focalLengthU", "focalLengthV", "centerPointU", "centerPointV")
    ]
    if intrinsic.get("skew", 0.0).number():
        raise intrinsic["skew"].error("0, as no lens model here has a skew")
    distortions = [
        intrinsic[key].number()
        for key in (
            "radialDistortion1",
            "radialDistortion2",
            "tangentalDistortion1",
            "tangentalDistortion2",
            "radialDistortion3",
        )
    ]
    params = np.array(in_pixels + distortions) - np.array([0, 0, left, top, 0, 0, 0, 0, 0])
    size_wh = Entry(view.file, view.name, [right - left + 1, bottom - top + 1]).size_wh()
    return intrinsic.camera("opencv5", size_wh, params)
