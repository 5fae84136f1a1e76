"""COLMAP's rig configuration ``rig_config.json`` (COLMAP 3.12 and later).

A list of rigs; per camera ``image_prefix``, ``ref_sensor`` (true for the reference, whose pose is the identity),
``cam_from_rig_rotation`` (quaternion w x y z), ``cam_from_rig_translation``, ``camera_model_name`` and
``camera_params``. The file has no place for the image size; COLMAP passes over keys that it does not know, so
``image_width`` and ``image_height`` are added, and asked for on import.
"""

from __future__ import annotations

import json
from pathlib import Path

from rigcal.camera import Camera
from rigcal.formats._colmap_lens import colmap_lens, lens_of_colmap
from rigcal.formats._entries import Entry
from rigcal.formats._foreign import ForeignCamera, ForeignRig, Written, refuse_names
from rigcal.formats._json import parsed_json
from rigcal.geometry import Pose
from rigcal.rig import Rig, RigCamera
from rigcal.rigfile import readable_json

NAME = "colmap"


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
    quat_wxyz = entry["cam_from_rig_rotation"].quaternion()
    pose = Pose.from_quat_wxyz(quat_wxyz, entry["cam_from_rig_translation"].numbers(3))
    return ForeignCamera(camera_id, _lens(entry), pose)


def _lens(entry: Entry) -> Camera:
    size = Entry(entry.file, entry.name, [entry["image_width"].number(), entry["image_height"].number()])
    return lens_of_colmap(entry["camera_model_name"], entry["camera_params"], size)


def write(rig: Rig) -> Written:
    """Write a rig configuration in metres; no lens model is refused.

    Raises:
        ForeignNameError: for a name that cannot be a folder's.
    """
    refuse_names(rig, r"[^/\0]+", to=NAME, expected="a name that a folder can have")
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
    model, params = colmap_lens(camera.camera)
    pose = {
        "cam_from_rig_rotation": camera.cam_from_rig.quat_wxyz.tolist(),
        "cam_from_rig_translation": camera.cam_from_rig.translation_m.tolist(),
    }
    return {
        "image_prefix": f"{camera.id}/",
        **({"ref_sensor": True} if is_reference else pose),
        "camera_model_name": model,
        "camera_params": params,
        "image_width": camera.camera.size_wh[0],
        "image_height": camera.camera.size_wh[1],
    }
