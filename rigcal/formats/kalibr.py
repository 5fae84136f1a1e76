"""Kalibr's ``camchain.yaml``.

Cameras ``cam0, cam1, ...``; ``T_cn_cnm1`` maps points of the camera before into this camera's frame, so the poses form
a chain (https://github.com/ethz-asl/kalibr/wiki/yaml-formats). Pinhole cameras with ``radtan`` (k1 k2 p1 p2, no k3) or
``equidistant`` (k1..k4, as OpenCV's fisheye). Metres; OpenCV's camera axes and pixel centres. The IMU entries
and topics of an imported file are kept under ``extensions.kalibr``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rigcal.camera import FOCAL_AND_CENTRE, MODELS, Camera
from rigcal.formats._entries import Entry
from rigcal.formats._foreign import ForeignCamera, ForeignRig, Written, refuse_loss
from rigcal.formats._yaml import list_text, parse_yaml, quoted
from rigcal.geometry import Pose
from rigcal.rig import Rig, RigCamera

NAME = "kalibr"
_MODEL_OF_DISTORTION: Mapping[str, str] = {"radtan": "opencv4", "equidistant": "fisheye4", "none": "opencv4"}
_READ_KEYS = frozenset(
    {"camera_model", "intrinsics", "distortion_model", "distortion_coeffs", "resolution", "T_cn_cnm1"}
)


def recognises(text: str) -> bool:
    """Whether a line ``cam0:`` and an entry ``camera_model:`` stand in the text."""
    return bool(
        re.search(r"^cam0:\s*(#.*)?$", text, re.MULTILINE) and re.search(r"^\s+camera_model:", text, re.MULTILINE)
    )


def read(file: Path, text: str) -> ForeignRig:
    """Read a camera chain.

    Raises:
        FormatError: for other projections than pinhole, or a missing or malformed entry, naming it.
    """
    content = Entry(file, "", parse_yaml(file, text))
    cameras: list[ForeignCamera] = []
    for index in range(max(1, len(content.value))):
        entry = content[f"cam{index}"]
        cam_from_cam0 = entry["T_cn_cnm1"].pose_matrix() @ cameras[-1].cam_from_common if cameras else Pose.identity()
        cameras.append(ForeignCamera(f"cam{index}", _lens(entry), cam_from_cam0))
    kept = {camera.id: _rest(content[camera.id]) for camera in cameras}
    extensions = {"kalibr": kept} if any(kept.values()) else {}
    return ForeignRig(tuple(cameras), unit="m", extensions=extensions)


def _lens(entry: Entry) -> Camera:
    projection, distortion = entry["camera_model"], entry["distortion_model"]
    if projection.text() != "pinhole":
        raise projection.error("'pinhole', the one projection that rigcal has")
    if distortion.text() not in _MODEL_OF_DISTORTION:
        raise distortion.error("one of " + ", ".join(_MODEL_OF_DISTORTION))
    model = _MODEL_OF_DISTORTION[distortion.text()]
    coefficients = np.zeros(4) if distortion.value == "none" else entry["distortion_coeffs"].numbers(4)
    intrinsics = entry["intrinsics"]
    params = np.concatenate([intrinsics.numbers(4), coefficients])
    return intrinsics.camera(model, entry["resolution"].size_wh(), params)


def _rest(entry: Entry) -> dict[str, Any]:
    return {key: value for key, value in entry.value.items() if key not in _READ_KEYS}


def write(rig: Rig) -> Written:
    """Write a camera chain in rig order.

    Raises:
        LossyExportError: for a lens with k3 or more, which radtan has no place for.
    """
    lines: list[str] = []
    for index, camera in enumerate(rig.cameras):
        lines += [f"cam{index}:", *_entries(camera)]
        if index:
            cam_from_previous = camera.cam_from_rig @ rig.cameras[index - 1].cam_from_rig.inverse()
            lines += ["  T_cn_cnm1:", *(f"  - {list_text(row)}" for row in cam_from_previous.matrix.tolist())]
    named = ", ".join(f"cam{index} is {camera.id}" for index, camera in enumerate(rig.cameras))
    conventions = (
        f"cameras: {named}",
        "poses: T_cn_cnm1 maps points of the camera before into this camera, x_cn = T x_cnm1",
        "lengths: metres",
        "lens: pinhole [fu fv pu pv]; radtan k1 k2 p1 p2, equidistant k1 k2 k3 k4",
        "pixels: (0, 0) is the centre of the top-left pixel; camera axes x right, y down, z forward",
    )
    return Written("\n".join(lines) + "\n", conventions)


def _entries(camera: RigCamera) -> list[str]:
    lens = camera.camera
    distortion = "equidistant" if lens.is_fisheye else "radtan"
    names = MODELS["fisheye4" if lens.is_fisheye else "opencv4"]
    refuse_loss(
        camera,
        held=names,
        to=f"{NAME} {distortion}",
        do_next="calibrate again with --model opencv4, or export to colmap, which holds every model",
    )
    coefficients = lens.coefficients
    return [
        "  camera_model: pinhole",
        f"  intrinsics: {list_text([coefficients[name] for name in FOCAL_AND_CENTRE])}",
        f"  distortion_model: {distortion}",
        f"  distortion_coeffs: {list_text([coefficients[name] for name in names[4:]])}",
        f"  resolution: {list_text(lens.size_wh)}",
        f"  rostopic: {quoted(f'/{camera.id}/image_raw')}",
    ]
