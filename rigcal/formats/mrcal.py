"""mrcal's ``.cameramodel``: one file per camera, each a Python dictionary of literals with comments.

``lensmodel`` (older files: ``lens_model``), ``intrinsics`` [fx, fy, cx, cy, k...] in OpenCV's order, ``extrinsics``
[r, t]: ``x_cam = R x_ref + t`` with r a Rodrigues vector, metres, ``imagersize`` [width, height]; OpenCV's axes and
pixel centres (https://mrcal.secretsauce.net/cameramodels.html). The file's name is the camera's. LENSMODEL_OPENCV4,
OPENCV5, OPENCV8 and PINHOLE are read; OPENCV12 where its thin prism terms are zero. mrcal has no lens of OpenCV's
fisheye. What mrcal measured of the lens (``optimization_inputs``) is not carried over.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from rigcal.camera import MODELS
from rigcal.errors import FormatError
from rigcal.formats._entries import Entry
from rigcal.formats._foreign import ForeignCamera, ForeignRig, Written, cams_from_common, refuse_fisheye, refuse_names
from rigcal.formats._source import Source
from rigcal.geometry import Pose
from rigcal.rig import Rig, RigCamera

NAME = "mrcal"
_SUFFIX = ".cameramodel"
_MODEL_OF_LENS: Mapping[str, str] = {
    "LENSMODEL_PINHOLE": "opencv4",
    "LENSMODEL_OPENCV4": "opencv4",
    "LENSMODEL_OPENCV5": "opencv5",
    "LENSMODEL_OPENCV8": "opencv8",
    "LENSMODEL_OPENCV12": "opencv8",
}
_COUNT_OF_LENS = {"LENSMODEL_PINHOLE": 4, "LENSMODEL_OPENCV12": 16}


def recognises(source: Source) -> bool:
    """Whether a file has the keys of a camera model in quotes."""
    return any("'lensmodel'" in text or "'lens_model'" in text for text in source.texts.values())


def read(source: Source) -> ForeignRig:
    """Read one camera model, or all of a folder.

    Raises:
        FormatError: for another lens model, or a missing or malformed entry, naming it.
    """
    texts = {name: text for name, text in source.texts.items() if name.endswith(_SUFFIX)} or source.texts
    return ForeignRig(tuple(_camera(source.file(name), text) for name, text in texts.items()), unit="m")


def _camera(file: Path, text: str) -> ForeignCamera:
    content = _parsed(file, text)
    lens = content["lensmodel"] if "lensmodel" in content else content["lens_model"]
    if lens.text() not in _MODEL_OF_LENS:
        raise lens.error("one of " + ", ".join(_MODEL_OF_LENS))
    model, intrinsics = _MODEL_OF_LENS[lens.text()], content["intrinsics"]
    params = intrinsics.numbers(_COUNT_OF_LENS.get(lens.text(), len(MODELS[model])))
    if params[12:].any():
        raise intrinsics.error("zeros after k6: no lens model here has thin prism terms", params[12:].tolist())
    camera = intrinsics.camera(model, content["imagersize"].size_wh(), params[:12])
    rt_cam_ref = content["extrinsics"].numbers(6).tolist()
    rotation = Entry(file, "extrinsics, r", rt_cam_ref[:3]).rotation()
    return ForeignCamera(file.name.removesuffix(_SUFFIX), camera, Pose(rotation, np.array(rt_cam_ref[3:])))


def _parsed(file: Path, text: str) -> Entry:
    try:
        return Entry(file, "", ast.literal_eval(text.strip()))
    except (ValueError, SyntaxError) as error:
        do_next = "write the file again with mrcal"
        expected = "a dictionary of literals: { 'lensmodel': ..., }"
        raise FormatError(
            "this is not a camera model", where=file, expected=expected, got=error, do_next=do_next
        ) from error


def write(rig: Rig) -> Written:
    """Write one file per camera in metres, in the world frame where the rig has one.

    Raises:
        LossyExportError: for a fisheye lens.
        ForeignNameError: for a name that cannot be a file's.
    """
    refuse_names(rig, r"[^/\\\0.][^/\\\0]*", to=NAME, expected="a name that a file can have")
    poses, frame = cams_from_common(rig)
    files = {camera.id + _SUFFIX: _text(camera, pose, frame) for camera, pose in zip(rig.cameras, poses, strict=True)}
    conventions = (
        f"poses: extrinsics are rt_cam_ref, x_cam = R x + t from {frame}; r is a Rodrigues vector in radians",
        "lengths: metres",
        "lens: fx fy cx cy, then LENSMODEL_OPENCV4 k1 k2 p1 p2, OPENCV5 with k3, OPENCV8 with k4 k5 k6",
        "pixels: (0, 0) is the centre of the top-left pixel; camera axes x right, y down, z forward",
    )
    return Written(files, conventions)


def _text(camera: RigCamera, cam_from_common: Pose, frame: str) -> str:
    refuse_fisheye(camera, to=NAME)
    lens = camera.camera
    rt_cam_ref = np.concatenate([cam_from_common.rvec_rad, cam_from_common.translation_m]).tolist()
    return (
        f"# reference frame: {' '.join(frame.split())}\n"
        "{\n"
        f"    'lensmodel':  'LENSMODEL_{lens.model.upper()}',\n\n"
        "    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....\n"
        f"    'intrinsics': {lens.params.tolist()},\n\n"
        "    # extrinsics are rt_fromref\n"
        f"    'extrinsics': {rt_cam_ref},\n\n"
        f"    'imagersize': {list(lens.size_wh)},\n"
        "}\n"
    )
