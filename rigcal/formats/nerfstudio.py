"""nerfstudio's ``transforms.json``: one frame per camera, with its own intrinsics.

``transform_matrix`` (4, 4) maps points of the camera into the scene, the camera with OpenGL's axes: x right, y up, z
back. The scene has z up; where the rig has no world, it is the rig frame turned upright (z up is -y of the reference
camera). ``fl_x fl_y cx cy w h``, and ``camera_model`` for the whole file: OPENCV with k1 k2 k3 p1 p2, or
OPENCV_FISHEYE with k1..k4. nerfstudio has the centre of the first pixel at (0.5, 0.5): its rays leave through index +
0.5, and it takes 0.5 from cx and cy before it calls OpenCV (its full_images_datamanager.py), so cx and cy
are half a pixel larger than here. Its k4 of an OPENCV lens is not OpenCV's, so a rational lens cannot be written.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from rigcal.camera import FOCAL_AND_CENTRE, MODELS, Camera
from rigcal.errors import FormatError
from rigcal.formats._colmap_lens import HALF_PIXEL
from rigcal.formats._entries import Entry
from rigcal.formats._foreign import (
    GL_FROM_CV,
    ForeignCamera,
    ForeignRig,
    Written,
    cams_from_upright,
    coefficients_of,
    refuse_loss,
    refuse_names,
)
from rigcal.formats._json import parsed_json
from rigcal.geometry import Floats, Pose
from rigcal.rig import Rig, RigCamera
from rigcal.rigfile import readable_json

NAME = "nerfstudio"
_LENS_KEYS = ("fl_x", "fl_y", "cx", "cy")
_FISHEYE = "OPENCV_FISHEYE"
_MODELS = {"OPENCV": "opencv5", "PINHOLE": "opencv4", _FISHEYE: "fisheye4"}
_IMAGE_SUFFIX = ".png"


def recognises(text: str) -> bool:
    """Whether the text is a JSON object whose frames have a ``transform_matrix``."""
    try:
        content = json.loads(text)
    except ValueError:
        return False
    frames = content.get("frames") if isinstance(content, dict) else None
    return isinstance(frames, list) and any(isinstance(f, dict) and "transform_matrix" in f for f in frames)


def read(file: Path, text: str) -> ForeignRig:
    """Read every frame as a camera; intrinsics that stand above the frames are shared by them.

    Raises:
        FormatError: for another camera model, or a missing or malformed entry, naming it.
    """
    content = parsed_json(file, text)
    model = content.get("camera_model", "OPENCV")
    if model.text() not in _MODELS:
        raise model.error("one of " + ", ".join(_MODELS))
    frames = content["frames"].elements()
    return ForeignRig(tuple(_camera(content, frame, _MODELS[model.value]) for frame in frames), unit=None)


def _camera(content: Entry, frame: Entry, model: str) -> ForeignCamera:
    def number(key: str, default: float | None = None) -> float:
        """Of the file as a whole where it stands there, as nerfstudio itself looks it up; else of the frame."""
        if key in content:
            return content[key].number()
        return (frame[key] if default is None else frame.get(key, default)).number()

    params = np.array([number(key) for key in _LENS_KEYS] + [number(key, 0.0) for key in MODELS[model][4:]])
    params[2:4] -= HALF_PIXEL
    if model != "fisheye4" and number("k4", 0.0):
        raise frame.error("k4 of 0: no lens model here has a fourth radial term", f"k4 = {number('k4', 0.0)}")
    size_wh = Entry(frame.file, f"{frame.name}.w, h", [number("w"), number("h")]).size_wh()
    camera_id = Path(frame["file_path"].text()).stem
    scene_from_gl = frame["transform_matrix"].pose_matrix()
    return ForeignCamera(camera_id, frame.camera(model, size_wh, params), (scene_from_gl @ GL_FROM_CV).inverse())


def write(rig: Rig) -> Written:
    """Write one frame per camera in metres, in the world frame where the rig has one.

    Raises:
        LossyExportError: for a rational lens with k4, k5 or k6.
        FormatError: for a rig that mixes fisheye with other lenses.
        ForeignNameError: for a name that cannot be an image's.
    """
    refuse_names(rig, r"[^/\\\0]+", to=NAME, expected="a name that a file can have")
    _refuse_mixed(rig)
    poses, frame = cams_from_upright(rig)
    fisheye = rig.cameras[0].camera.is_fisheye
    frames = [_frame(camera, pose.inverse()) for camera, pose in zip(rig.cameras, poses, strict=True)]
    conventions = (
        f"poses: transform_matrix maps points of the camera into the scene, {frame}",
        "axes: the camera is OpenGL's, x right, y up, z back; the scene has z up",
        "lengths: metres (nerfstudio scales the scene unless auto_scale_poses is off)",
        "lens: OPENCV k1 k2 k3 p1 p2, or OPENCV_FISHEYE k1 k2 k3 k4, for all cameras",
        "pixels: (0.5, 0.5) is the centre of the top-left pixel, so cx and cy are 0.5 larger than in the rig file",
        f"images: file_path is images/<camera>{_IMAGE_SUFFIX}; put the images of one instant there",
    )
    content = {"camera_model": _FISHEYE if fisheye else "OPENCV", "frames": frames}
    return Written(readable_json(content) + "\n", conventions)


def _refuse_mixed(rig: Rig) -> None:
    fisheye = [camera.id for camera in rig.cameras if camera.camera.is_fisheye]
    if fisheye and len(fisheye) < len(rig.cameras):
        raise FormatError(
            "nerfstudio has one camera model for the whole file",
            where=f"rig {rig.site}",
            expected="all cameras with a fisheye lens, or none",
            got="fisheye: " + ", ".join(fisheye),
            do_next="export to colmap, which holds mixed lenses",
        )


def _frame(camera: RigCamera, scene_from_cam: Pose) -> dict[str, Any]:
    lens = camera.camera
    names = MODELS["fisheye4" if lens.is_fisheye else "opencv5"]
    do_next = "calibrate again with --model opencv5, or export to colmap, which holds every model"
    refuse_loss(camera, held=names, to=NAME, do_next=do_next)
    return {
        "file_path": f"images/{camera.id}{_IMAGE_SUFFIX}",
        **dict(zip(_LENS_KEYS, _focal_and_shifted_centre(lens).tolist(), strict=True)),
        "w": lens.size_wh[0],
        "h": lens.size_wh[1],
        **dict(zip(names[4:], coefficients_of(lens, names[4:]), strict=True)),
        "transform_matrix": (scene_from_cam @ GL_FROM_CV).matrix.tolist(),
    }


def _focal_and_shifted_centre(lens: Camera) -> Floats:
    return np.asarray(lens.params[: len(FOCAL_AND_CENTRE)] + np.array([0.0, 0.0, HALF_PIXEL, HALF_PIXEL]))
