"""The ``dataset.json`` of a recorded multi-view data set: cameras in a metric world with z up and the floor at 0.

``x_cam = R X_world + t`` in metres, ``dist`` k1 k2 p1 p2 k3 in OpenCV's meaning. The world becomes
``world_from_rig``; the frame rate is kept under ``extensions.rigcal.fps``.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from rigcal.formats._entries import Entry
from rigcal.formats._foreign import ForeignCamera, ForeignRig
from rigcal.formats._json import parsed_json
from rigcal.geometry import Pose

NAME = "multiview-dataset"
_FORMAT = "multiview-dataset/1"


def recognises(text: str) -> bool:
    """Whether the text is JSON that names this format."""
    try:
        content = json.loads(text)
    except ValueError:
        return False
    return isinstance(content, dict) and str(content.get("format", "")).startswith("multiview-dataset/")


def read(file: Path, text: str) -> ForeignRig:
    """Read the calibration of a data set.

    Raises:
        FormatError: for another version or unit, or a missing or malformed entry, naming it.
    """
    content = parsed_json(file, text)
    for key, known in (("format", _FORMAT), ("units", "metre")):
        if content[key].text() != known:
            raise content[key].error(repr(known))
    cameras = tuple(_camera(entry) for entry in content["cameras"].elements())
    extensions: dict[str, Any] = {"rigcal": {"fps": content["fps"].number()}} if "fps" in content else {}
    return ForeignRig(cameras, unit="m", site=content["name"].text(), common_is_world=True, extensions=extensions)


def _camera(entry: Entry) -> ForeignCamera:
    params = np.concatenate([entry["K"].focal_and_centre(), entry["dist"].numbers(5)])
    camera = entry["K"].camera("opencv5", entry["image_size"].size_wh(), params)
    return ForeignCamera(entry["name"].text(), camera, Pose(entry["R"].rotation(), entry["t"].numbers(3)))
