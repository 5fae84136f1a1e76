"""Foxglove's messages as JSON: one ``foxglove.CameraCalibration`` per camera and their ``foxglove.FrameTransforms``.

Foxglove shows these messages from a live connection or a recording and has no file of its own for a rig, so rigcal
writes one JSON object of the two schema names (https://docs.foxglove.dev/docs/sdk/schemas), ready to be published:
``frame_id`` is the camera's name, its transform maps points of the camera into ``world`` or ``rig`` (x y z and a
quaternion x y z w, metres), the camera frame is x right, y down, z forward. Lenses are ``plumb_bob``,
``rational_polynomial`` and ``kannala_brandt``; K, R and P are row by row.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from rigcal.camera import Camera
from rigcal.errors import ForeignNameError
from rigcal.formats._camera_info import distortion_of, lens_of, projection_of
from rigcal.formats._entries import Entry
from rigcal.formats._foreign import ForeignCamera, ForeignRig, Written, cams_from_common
from rigcal.formats._frames import FrameTree, common_frame_id, transform_entry
from rigcal.formats._json import parsed_json
from rigcal.geometry import Pose
from rigcal.rig import Rig, RigCamera
from rigcal.rigfile import readable_json

NAME = "foxglove"
_CALIBRATION, _TRANSFORMS = "foxglove.CameraCalibration", "foxglove.FrameTransforms"
_FISHEYE = "kannala_brandt"


def recognises(text: str) -> bool:
    """Whether the text is a JSON object with Foxglove's schema name of calibrations."""
    try:
        content = json.loads(text)
    except ValueError:
        return False
    return isinstance(content, dict) and _CALIBRATION in content


def read(file: Path, text: str) -> ForeignRig:
    """Read the calibrations, and where their frames hang.

    Raises:
        FormatError: for a missing or malformed entry, or a camera without a transform, naming it.
    """
    content = parsed_json(file, text)
    lenses = [(entry["frame_id"].text(), _lens(entry)) for entry in content[_CALIBRATION].elements()]
    transforms = content[_TRANSFORMS]["transforms"]
    hung = dict(
        transform_entry(entry["parent_frame_id"], entry["child_frame_id"], entry) for entry in transforms.elements()
    )
    poses = FrameTree(transforms, hung).cams_from_root([(name, name) for name, _ in lenses])
    cameras = (ForeignCamera(name, lens, pose) for (name, lens), pose in zip(lenses, poses, strict=True))
    return ForeignRig(tuple(cameras), unit="m")


def _lens(entry: Entry) -> Camera:
    size = Entry(entry.file, f"{entry.name}.width, height", [entry[key].number() for key in ("width", "height")])
    return lens_of(entry["distortion_model"], entry["D"], entry["K"], size.size_wh(), _FISHEYE)


def write(rig: Rig) -> Written:
    """Write the messages in metres, in the world frame where the rig has one; no lens model is refused.

    Raises:
        ForeignNameError: for a camera that has the name of the frame that the cameras hang on.
    """
    poses, frame = cams_from_common(rig)
    parent_id = common_frame_id(rig)
    if parent_id in rig.camera_ids:
        expected = f"another name than {parent_id!r}, which is the frame that the cameras hang on"
        raise ForeignNameError(parent_id, to=NAME, expected=expected)
    pairs = zip(rig.cameras, poses, strict=True)
    transforms = [_transform(parent_id, camera.id, pose.inverse()) for camera, pose in pairs]
    content = {
        _CALIBRATION: [_calibration(camera) for camera in rig.cameras],
        _TRANSFORMS: {"transforms": transforms},
    }
    conventions = (
        f"poses: a transform maps points of the camera into frame {parent_id!r}, {frame}; quaternion x y z w",
        "lengths: metres",
        "lens: plumb_bob k1 k2 p1 p2 k3; rational_polynomial with k4 k5 k6; kannala_brandt k1 k2 k3 k4 (fisheye)",
        "pixels: (0, 0) is the centre of the top-left pixel; camera axes x right, y down, z forward",
        "time: timestamps are 0; set them to the time of publishing",
    )
    return Written(readable_json(content) + "\n", conventions)


def _calibration(camera: RigCamera) -> dict[str, Any]:
    lens = camera.camera
    model, D = distortion_of(lens, _FISHEYE)
    return {
        "timestamp": {"sec": 0, "nsec": 0},
        "frame_id": camera.id,
        "width": lens.size_wh[0],
        "height": lens.size_wh[1],
        "distortion_model": model,
        "D": D,
        "K": lens.matrix.ravel().tolist(),
        "R": np.eye(3).ravel().tolist(),
        "P": np.ravel(projection_of(lens)).tolist(),
    }


def _transform(parent_id: str, child_id: str, parent_from_child: Pose) -> dict[str, Any]:
    w, *xyz = parent_from_child.quat_wxyz.tolist()
    return {
        "timestamp": {"sec": 0, "nsec": 0},
        "parent_frame_id": parent_id,
        "child_frame_id": child_id,
        "translation": dict(zip("xyz", parent_from_child.translation_m.tolist(), strict=True)),
        "rotation": dict(zip("xyzw", (*xyz, w), strict=True)),
    }
