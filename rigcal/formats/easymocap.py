"""EasyMocap's ``intri.yml`` and ``extri.yml``, a folder of two OpenCV storages.

Both have the list ``names``; per camera ``K_<name>`` (3, 3), ``dist_<name>`` (1, 5) k1 k2 p1 p2 k3, ``H_<name>`` and
``W_<name>``, and in the other file ``R_<name>`` (3, 1) Rodrigues, ``Rot_<name>`` (3, 3) and ``T_<name>`` (3, 1):
``x_cam = R x_world + t``, metres, OpenCV's axes and pixel centres
(https://github.com/zju3dv/EasyMocap, easymocap/mytools/camera_utils.py). Names stand in quotes, as EasyMocap itself
reads an unquoted 01 as 1. EasyMocap has no fisheye and no rational lens.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rigcal.camera import FOCAL_AND_CENTRE
from rigcal.errors import FormatError
from rigcal.formats._entries import Entry
from rigcal.formats._filestorage import HEADER, matrix_text, names_text, parsed_storage, storage_values
from rigcal.formats._foreign import (
    ForeignCamera,
    ForeignRig,
    Written,
    cams_from_common,
    coefficients_of,
    refuse_fisheye,
    refuse_loss,
    refuse_names,
)
from rigcal.formats._source import Source
from rigcal.geometry import Pose
from rigcal.rig import Rig, RigCamera

NAME = "easymocap"
_INTRI, _EXTRI = "intri.yml", "extri.yml"
_DISTORTIONS = ("k1", "k2", "p1", "p2", "k3")
_MODEL_OF_COUNT = {4: "opencv4", 5: "opencv5"}


def recognises(source: Source) -> bool:
    """Whether a storage has ``names`` and a ``K_<name>`` or ``R_<name>`` of them."""
    storages = [storage_values(text) or {} for text in source.texts.values()]
    return any("names" in values and any(key.startswith(("K_", "R_")) for key in values) for values in storages)


def read(source: Source) -> ForeignRig:
    """Read the two files.

    Raises:
        FormatError: where one is absent, or an entry is missing or malformed, naming it.
    """
    for name in (_INTRI, _EXTRI):
        if name not in source.texts:
            raise FormatError(
                f"there is no {name}",
                where=source.path,
                expected=f"a folder with {_INTRI} and {_EXTRI}",
                got=source.shown_names,
                do_next="give the folder that holds both files",
            )
    intri, extri = (parsed_storage(source.file(name), source.texts[name]) for name in (_INTRI, _EXTRI))
    return ForeignRig(tuple(_camera(_name(entry), intri, extri) for entry in intri["names"].elements()), unit="m")


def _name(entry: Entry) -> str:
    """A name; EasyMocap reads a number as the text of its digits."""
    return str(entry.value) if isinstance(entry.value, int) else entry.text()


def _camera(name: str, intri: Entry, extri: Entry) -> ForeignCamera:
    K = intri[f"K_{name}"]
    size = [intri[f"{axis}_{name}"].number() for axis in "WH"]
    distortions = (intri[f"dist_{name}"] if f"dist_{name}" in intri else intri[f"D_{name}"]).numbers(*_MODEL_OF_COUNT)
    model = _MODEL_OF_COUNT[len(distortions)]
    size_wh = Entry(intri.file, f"W_{name}, H_{name}", size).size_wh()
    camera = K.camera(model, size_wh, np.concatenate([K.focal_and_centre(), distortions]))
    rotation = extri[f"R_{name}"] if f"R_{name}" in extri else extri[f"Rot_{name}"]
    return ForeignCamera(name, camera, Pose(rotation.rotation(), extri[f"T_{name}"].numbers(3)))


def write(rig: Rig) -> Written:
    """Write both files in metres, in the world frame where the rig has one.

    Raises:
        LossyExportError: for a fisheye lens, or a rational one with k4, k5 or k6.
        ForeignNameError: for a name that cannot be part of an OpenCV key.
    """
    expected = "letters, digits, _ and -, as OpenCV allows in a key"
    refuse_names(rig, r"[A-Za-z0-9_\-]+", to=NAME, expected=expected)
    poses, frame = cams_from_common(rig)
    names = names_text("names", rig.camera_ids)
    cameras = list(zip(rig.cameras, poses, strict=True))
    files: Mapping[str, str] = {
        _INTRI: HEADER + names + "".join(_intri(camera) for camera in rig.cameras),
        _EXTRI: HEADER + names + "".join(_extri(camera.id, pose) for camera, pose in cameras),
    }
    conventions = (
        f"poses: x_cam = R x + T from {frame}; R_<name> is a Rodrigues vector in radians, Rot_<name> its matrix",
        "lengths: metres",
        "lens: dist_<name> is k1 k2 p1 p2 k3",
        "pixels: (0, 0) is the centre of the top-left pixel; camera axes x right, y down, z forward",
    )
    return Written(files, conventions)


def _intri(camera: RigCamera) -> str:
    lens = camera.camera
    refuse_fisheye(camera, to=NAME)
    do_next = "calibrate again with --model opencv5, or export to colmap, which holds every model"
    refuse_loss(camera, held=(*FOCAL_AND_CENTRE, *_DISTORTIONS), to=NAME, do_next=do_next)
    width, height = lens.size_wh
    distortions = matrix_text(f"dist_{camera.id}", coefficients_of(lens, _DISTORTIONS))
    return (
        matrix_text(f"K_{camera.id}", lens.matrix) + distortions + f"H_{camera.id}: {height}\nW_{camera.id}: {width}\n"
    )


def _extri(name: str, cam_from_common: Pose) -> str:
    columns = {"R": cam_from_common.rvec_rad[:, None], "T": cam_from_common.translation_m[:, None]}
    return (
        matrix_text(f"R_{name}", columns["R"])
        + matrix_text(f"Rot_{name}", cam_from_common.rotation)
        + matrix_text(f"T_{name}", columns["T"])
    )
