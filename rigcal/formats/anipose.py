"""aniposelib's TOML and its relatives: of Pose2Sim (``Calib.toml``), Caliscope (``camera_array.toml``) and FreeMoCap.

One table per camera: ``name, size = [w, h], matrix, distortions, rotation, translation`` and an optional
``fisheye``. ``x_cam = R x_common + t``, ``rotation`` a Rodrigues vector or (Caliscope) a matrix, OpenCV's camera axes
and pixel centres, distortions k1 k2 p1 p2 [k3] or fisheye k1 k2 k3 k4. The unit of length is the board's and is not
written; rigcal writes metres and says so in ``[metadata]``. FreeMoCap is known by its ``world_position``, the
camera's centre once more, and works in millimetres. aniposelib takes exactly five distortions, so five are written,
and a rational lens (k4 k5 k6) cannot be.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import tomli_w

from rigcal.camera import FOCAL_AND_CENTRE
from rigcal.errors import FormatError
from rigcal.formats._entries import Entry
from rigcal.formats._foreign import (
    METRES_PER_UNIT,
    ForeignCamera,
    ForeignRig,
    Written,
    cams_from_common,
    coefficients_of,
    refuse_loss,
)
from rigcal.geometry import Pose
from rigcal.rig import Rig, RigCamera

NAME = "anipose"
_CAMERA_KEYS = frozenset({"matrix", "distortions", "rotation", "translation"})
_DISTORTIONS = ("k1", "k2", "p1", "p2", "k3")
_FISHEYE_DISTORTIONS = ("k1", "k2", "k3", "k4")
_MODEL_OF_COUNT = {4: "opencv4", 5: "opencv5", 8: "opencv8"}


def recognises(text: str) -> bool:
    """Whether the text is TOML with a table that has a camera's keys."""
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return False
    nested = content.get("cameras")
    tables = [*content.values(), *(nested.values() if isinstance(nested, dict) else ())]
    return any(isinstance(table, dict) and _CAMERA_KEYS & set(table) for table in tables)


def read(file: Path, text: str) -> ForeignRig:
    """Read a TOML calibration.

    Raises:
        FormatError: for anything but TOML with camera tables, naming the entry.
    """
    try:
        content = Entry(file, "", tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        do_next = "mend that line, or write the file again with the tool that made it"
        raise FormatError("this is not TOML", where=file, expected="TOML text", got=error, do_next=do_next) from error
    tables = _camera_tables(content)
    if not tables:
        raise content.error("a table per camera with " + ", ".join(sorted(_CAMERA_KEYS)), "none")
    cameras = [_camera(table_id, table) for table_id, table in tables]
    unit = content.get("metadata", {}).get("units", None)
    if unit.value is not None and unit.text() not in METRES_PER_UNIT:
        raise unit.error("one of " + ", ".join(METRES_PER_UNIT))
    is_freemocap = all("world_position" in table for _, table in tables)
    return ForeignRig(tuple(cameras), unit=unit.value or ("mm" if is_freemocap else None))


def _camera_tables(content: Entry) -> list[tuple[str, Entry]]:
    """Cameras with their identifiers; those that Caliscope was told to ignore are left out."""
    if "cameras" in content:
        content = content["cameras"]
    tables = [(key, table) for key, table in content.tables() if _CAMERA_KEYS & set(table.value)]
    kept = [(key, table) for key, table in tables if not table.get("ignore", False).flag()]
    return [(f"cam_{key}" if key.isdigit() else key, table) for key, table in kept]


def _camera(table_id: str, table: Entry) -> ForeignCamera:
    fisheye = table.get("fisheye", False).flag()
    distortions = table["distortions"].numbers(*((4,) if fisheye else _MODEL_OF_COUNT))
    model = "fisheye4" if fisheye else _MODEL_OF_COUNT[len(distortions)]
    params = np.concatenate([table["matrix"].focal_and_centre(), distortions])
    camera = table["matrix"].camera(model, table["size"].size_wh(), params)
    pose = Pose(table["rotation"].rotation(), table["translation"].numbers(3))
    return ForeignCamera(table.get("name", table_id).text(), camera, pose)


def write(rig: Rig) -> Written:
    """Write aniposelib's TOML in metres, in the world frame where the rig has one.

    Raises:
        LossyExportError: for a rational lens with k4, k5 or k6.
    """
    poses, frame = cams_from_common(rig)
    tables: dict[str, object] = {
        f"cam_{index}": _table(camera, pose)
        for index, (camera, pose) in enumerate(zip(rig.cameras, poses, strict=True))
    }
    tables["metadata"] = {"adjusted": False, "error": 0.0, "units": "m", "frame": frame, "rig_digest": rig.digest}
    conventions = (
        f"poses: x_cam = R x + t from {frame}; rotation is a Rodrigues vector in radians",
        "lengths: metres (aniposelib's own files are in the board's unit, often mm)",
        "lens: distortions are k1 k2 p1 p2 k3; k1 k2 k3 k4 where fisheye = true",
        "pixels: (0, 0) is the centre of the top-left pixel; camera axes x right, y down, z forward",
    )
    return Written(tomli_w.dumps(tables), conventions)


def _table(camera: RigCamera, pose: Pose) -> dict[str, object]:
    lens = camera.camera
    held = _FISHEYE_DISTORTIONS if lens.is_fisheye else _DISTORTIONS
    refuse_loss(
        camera,
        held=(*FOCAL_AND_CENTRE, *held),
        to=NAME,
        do_next="calibrate again with --model opencv5, or export to colmap, which holds every model",
    )
    return {
        "name": camera.id,
        "size": list(lens.size_wh),
        "matrix": lens.matrix.tolist(),
        "distortions": coefficients_of(lens, held),
        "rotation": pose.rvec_rad.tolist(),
        "translation": pose.translation_m.tolist(),
        "fisheye": lens.is_fisheye,
    }
