"""OpenCV's own calibration files: one camera, or a stereo pair, in a FileStorage (YAML, XML or JSON).

OpenCV fixes no form, only its samples do. Read are the names of ``calibration.cpp`` (``camera_matrix``,
``distortion_coefficients``, ``image_width``, ``image_height``) for one camera, and of ``stereo_calib.cpp`` (``M1 D1 M2
D2`` in one file, ``R T`` in another beside it) or of the documentation (``K1 D1 K2 D2 R T``) for a pair:
``x_2 = R x_1 + T`` in the board's unit. Distortions are k1 k2 p1 p2 [k3 [k4 k5 k6]]; longer ones only where the rest
is zero. Four of them are ``cv2.fisheye``'s as well as a plain lens's, so rigcal writes ``fisheye1: 1`` or 0 and asks
for it then. The samples leave the image size of a pair out; rigcal writes and asks for ``image_width`` and
``image_height``, with a camera's number where the two differ.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rigcal.camera import MODELS, Camera
from rigcal.errors import FormatError
from rigcal.formats._entries import Entry
from rigcal.formats._filestorage import HEADER, matrix_text, names_text, parsed_storage, storage_values
from rigcal.formats._foreign import ForeignCamera, ForeignRig, Written
from rigcal.formats._source import Source
from rigcal.geometry import Floats, Pose
from rigcal.rig import Rig

NAME = "opencv"
_MODEL_OF_COUNT = {4: "opencv4", 5: "opencv5", 8: "opencv8"}
_COUNTS = (4, 5, 8, 12, 14)
_MATRIX_KEYS = frozenset({"camera_matrix", "cameraMatrix", "K1", "M1"})


def recognises(source: Source) -> bool:
    """Whether a storage has a camera matrix by one of OpenCV's names."""
    return any(_MATRIX_KEYS & set(storage_values(text) or {}) for text in source.texts.values())


def read(source: Source) -> ForeignRig:
    """Read one camera or a pair; the storages of a folder are read as one.

    Raises:
        FormatError: for a storage that OpenCV cannot read, or a missing or malformed entry, naming it.
    """
    content = _merged(source)
    if "K1" not in content and "M1" not in content:
        (name,) = _names(content, 1)
        return ForeignRig((ForeignCamera(name, _lens(content, ""), Pose.identity()),), unit=None)
    first, second = _names(content, 2)
    for key in "RT":
        _require(content, key, "R and T of the pair, in this file or in one beside it (then give the folder)")
    pose = Pose(content["R"].rotation(), content["T"].numbers(3))
    cameras = (
        ForeignCamera(first, _lens(content, "1"), Pose.identity()),
        ForeignCamera(second, _lens(content, "2"), pose),
    )
    return ForeignRig(cameras, unit=None)


def _merged(source: Source) -> Entry:
    """The entries of every storage; the same entry twice, with two values, is refused."""
    if not source.is_folder:
        return parsed_storage(source.path, *source.texts.values())
    values: dict[str, Any] = {}
    for name, text in source.texts.items():
        storage = storage_values(text) or {}
        contradicted = sorted(key for key in values.keys() & storage.keys() if values[key] != storage[key])
        if contradicted:
            expected = "one value in all files of the folder; give one file where each is a camera of its own"
            raise Entry(source.file(name), contradicted[0], storage[contradicted[0]]).error(expected)
        values |= storage
    return Entry(source.path, "", values)


def _names(content: Entry, count: int) -> list[str]:
    if "names" not in content:
        return ["cam1", "cam2"][:count]
    names = [entry.text() for entry in content["names"].elements()]
    if len(names) != count:
        raise content["names"].error(f"{count} names, one for each camera matrix")
    return names


def _either(content: Entry, *keys: str) -> Entry:
    """The first of the keys that is there; the first of all where none is, for the error to name."""
    return content[next((key for key in keys if key in content), keys[0])]


def _require(content: Entry, key: str, expected: str) -> None:
    if key not in content:
        raise Entry(content.file, key, None).error(expected, "nothing")


def _lens(content: Entry, number: str) -> Camera:
    if number:
        K, distortions = _either(content, f"K{number}", f"M{number}"), content[f"D{number}"]
    else:
        K = _either(content, "camera_matrix", "cameraMatrix")
        distortions = _either(content, "distortion_coefficients", "distCoeffs")
    size = [_size(content, key, number) for key in ("image_width", "image_height")]
    model, values = _model(content, distortions, f"fisheye{number}")
    params = np.concatenate([K.focal_and_centre(), values])
    return K.camera(model, Entry(content.file, "image_width, image_height", size).size_wh(), params)


def _size(content: Entry, key: str, number: str) -> float:
    if f"{key}{number}" in content:
        return content[f"{key}{number}"].number()
    _require(content, key, f"the images' size in pixels: add a line such as '{key}: 1920'")
    return content[key].number()


def _model(content: Entry, distortions: Entry, fisheye_key: str) -> tuple[str, Floats]:
    values = distortions.numbers(*_COUNTS)
    if fisheye_key in content and content[fisheye_key].number():
        return "fisheye4", distortions.numbers(4)
    if len(values) == 4 and fisheye_key not in content:
        hint = f"5 or 8 numbers; or a line '{fisheye_key}: 1' (cv2.fisheye) or '{fisheye_key}: 0', as 4 may be either"
        raise distortions.error(hint)
    if values[8:].any():
        raise distortions.error("k1 k2 p1 p2 k3 k4 k5 k6 and zeros: no lens model here has thin prism or tilt terms")
    return _MODEL_OF_COUNT[min(len(values), 8)], values[:8]


def write(rig: Rig) -> Written:
    """Write one camera or a stereo pair, in metres; no lens model is refused.

    Raises:
        FormatError: for more than two cameras.
    """
    if len(rig.cameras) > 2:
        raise FormatError(
            "an opencv file holds one camera or a stereo pair",
            where=f"rig {rig.site}",
            expected="one or two cameras",
            got=f"{len(rig.cameras)}: " + ", ".join(rig.camera_ids),
            do_next="export to easymocap, which is OpenCV's form for any number of cameras",
        )
    text = HEADER + names_text("names", rig.camera_ids)
    if len(rig.cameras) == 1:
        text += _lens_text(rig.cameras[0].camera, "", "camera_matrix", "distortion_coefficients")
    else:
        first, second = rig.cameras
        second_from_first = second.cam_from_rig @ first.cam_from_rig.inverse()
        text += _lens_text(first.camera, "1", "K1", "D1") + _lens_text(second.camera, "2", "K2", "D2")
        text += matrix_text("R", second_from_first.rotation)
        text += matrix_text("T", second_from_first.translation_m[:, None])
    conventions = (
        f"poses: x_2 = R x_1 + T, where 1 is camera {rig.camera_ids[0]} and 2 is {rig.camera_ids[-1]}",
        "lengths: metres",
        "lens: k1 k2 p1 p2 [k3 [k4 k5 k6]]; k1 k2 k3 k4 of cv2.fisheye where fisheye = 1",
        "pixels: (0, 0) is the centre of the top-left pixel; camera axes x right, y down, z forward",
    )
    return Written(text, conventions)


def _lens_text(lens: Camera, number: str, matrix_key: str, distortion_key: str) -> str:
    width, height = lens.size_wh
    return (
        f"image_width{number}: {width}\nimage_height{number}: {height}\nfisheye{number}: {int(lens.is_fisheye)}\n"
        + matrix_text(matrix_key, lens.matrix)
        + matrix_text(distortion_key, lens.params[4 : len(MODELS[lens.model])])
    )
