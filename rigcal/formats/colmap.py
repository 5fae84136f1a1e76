"""COLMAP's rig configuration ``rig_config.json`` (COLMAP 3.12 and later).

A list of rigs; per camera ``image_prefix``, ``ref_sensor`` (true for the reference, whose pose is the identity),
``cam_from_rig_rotation`` (quaternion w x y z), ``cam_from_rig_translation``, ``camera_model_name`` and
``camera_params``. COLMAP has the centre of the first pixel at (0.5, 0.5), so cx and cy are half a pixel larger than
here. FULL_OPENCV and OPENCV_FISHEYE hold every lens model, so nothing is ever lost. The file has no place for the
image size; COLMAP passes over keys that it does not know, so ``image_width`` and ``image_height`` are added, and asked
for on import.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from rigcal.camera import MODELS, Camera
from rigcal.formats._entries import ROTATION_TOLERANCE, Entry
from rigcal.formats._foreign import ForeignCamera, ForeignRig, Written
from rigcal.formats._json import parsed_json
from rigcal.geometry import Pose
from rigcal.rig import Rig, RigCamera
from rigcal.rigfile import readable_json

NAME = "colmap"
_HALF_PIXEL = 0.5
_COEFFICIENTS: Mapping[str, tuple[str, ...]] = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": MODELS["opencv4"],
    "FULL_OPENCV": MODELS["opencv8"],
    "OPENCV_FISHEYE": MODELS["fisheye4"],
}
"""COLMAP's parameters of each model, in its order; f is fx and fy."""
_COLMAP_MODEL = {
    "opencv4": "OPENCV",
    "opencv5": "FULL_OPENCV",
    "opencv8": "FULL_OPENCV",
    "fisheye4": "OPENCV_FISHEYE",
}


def recognises(text: str) -> bool:
    """Whether the text is a JSON list of objects whose cameras have an ``image_prefix``."""
    try:
        content = json.loads(text)
    except ValueError:
        return False
    rigs = content if isinstance(content, list) else []
    cameras = [rig["cameras"] for rig in rigs if isinstance(rig, dict) and isinstance(rig.get("cameras"), list)]
    return any(isinstance(camera, dict) and "image_prefix" in camera for cams in cameras for camera in cams)


def read(file: Path, text: str) -> ForeignRig:
    """Read the one rig of a rig configuration, with its lenses and image sizes.

    Raises:
        FormatError: for several rigs, or a missing or malformed entry, naming it.
    """
    rigs = parsed_json(file, text).elements()
    if len(rigs) != 1:
        raise rigs[1].error("one rig in the file", f"{len(rigs)} rigs")
    return ForeignRig(tuple(_camera(entry) for entry in rigs[0]["cameras"].elements()), unit=None)


def _camera(entry: Entry) -> ForeignCamera:
    camera_id = entry["image_prefix"].text().rstrip("/").rpartition("/")[2]
    if not camera_id:
        raise entry["image_prefix"].error("the name of a folder of images")
    if entry.get("ref_sensor", False).flag():
        return ForeignCamera(camera_id, _lens(entry), Pose.identity())
    rotation = entry["cam_from_rig_rotation"]
    quat_wxyz = rotation.numbers(4)
    if abs(np.linalg.norm(quat_wxyz) - 1) > ROTATION_TOLERANCE:
        raise rotation.error("a quaternion w x y z of length 1", f"length {np.linalg.norm(quat_wxyz):.6g}")
    pose = Pose.from_quat_wxyz(quat_wxyz, entry["cam_from_rig_translation"].numbers(3))
    return ForeignCamera(camera_id, _lens(entry), pose)


def _lens(entry: Entry) -> Camera:
    name = entry["camera_model_name"]
    if name.text() not in _COEFFICIENTS:
        raise name.error("one of " + ", ".join(_COEFFICIENTS))
    names, params = _COEFFICIENTS[name.text()], entry["camera_params"]
    values = dict(zip(names, params.numbers(len(names)).tolist(), strict=True))
    if "f" in values:
        values["fx"] = values["fy"] = values.pop("f")
    values["cx"], values["cy"] = values["cx"] - _HALF_PIXEL, values["cy"] - _HALF_PIXEL
    model = _smallest_model(name.text(), values)
    size_wh = Entry(entry.file, entry.name, _size(entry)).size_wh()
    return params.camera(model, size_wh, np.array([values.get(key, 0.0) for key in MODELS[model]]))


def _size(entry: Entry) -> list[float]:
    return [entry["image_width"].number(), entry["image_height"].number()]


def _smallest_model(colmap_model: str, values: Mapping[str, float]) -> str:
    """opencv5 is written as FULL_OPENCV with k4 k5 k6 of 0, and is read back as what it was."""
    if colmap_model == "OPENCV_FISHEYE":
        return "fisheye4"
    if colmap_model != "FULL_OPENCV":
        return "opencv4"
    return "opencv8" if any(values[name] for name in ("k4", "k5", "k6")) else "opencv5"


def write(rig: Rig) -> Written:
    """Write a rig configuration in metres; no lens model is refused."""
    cameras = [_entry(camera, is_reference=camera.id == rig.reference) for camera in rig.cameras]
    conventions = (
        f"poses: cam_from_rig, quaternion w x y z; the rig frame is camera {rig.reference}",
        "lengths: metres",
        "lens: OPENCV (fx fy cx cy k1 k2 p1 p2), FULL_OPENCV (with k3 k4 k5 k6), OPENCV_FISHEYE (k1 k2 k3 k4)",
        "pixels: (0.5, 0.5) is the centre of the top-left pixel, so cx and cy are 0.5 larger than in the rig file",
        "images: one folder per camera, named by its id; image_width and image_height are rigcal's own keys",
    )
    return Written(readable_json([{"cameras": cameras}]) + "\n", conventions)


def _entry(camera: RigCamera, *, is_reference: bool) -> dict[str, object]:
    lens = camera.camera
    model = _COLMAP_MODEL[lens.model]
    values = lens.coefficients
    values["cx"], values["cy"] = values["cx"] + _HALF_PIXEL, values["cy"] + _HALF_PIXEL
    pose = {
        "cam_from_rig_rotation": camera.cam_from_rig.quat_wxyz.tolist(),
        "cam_from_rig_translation": camera.cam_from_rig.translation_m.tolist(),
    }
    return {
        "image_prefix": f"{camera.id}/",
        **({"ref_sensor": True} if is_reference else pose),
        "camera_model_name": model,
        "camera_params": [values.get(name, 0.0) for name in _COEFFICIENTS[model]],
        "image_width": lens.size_wh[0],
        "image_height": lens.size_wh[1],
    }
