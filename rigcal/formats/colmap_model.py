"""A COLMAP model: a folder with ``cameras``, ``images`` and (3.12 and later) ``rigs`` and ``frames``.

Written as text, one instant with one image per camera, so that COLMAP and what reads its models (hloc, gsplat,
OpenMVS) start from known cameras; read from text or binary. ``cam_from_world`` is a quaternion w x y z and a
translation, ``x_cam = R x_world + t``; cx and cy are half a pixel larger than here. Where every camera has one image,
the images place the cameras; else the one rig that joins them does.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import PurePosixPath

from rigcal.camera import Camera
from rigcal.errors import FormatError
from rigcal.formats._colmap_lens import colmap_lens, lens_of_colmap
from rigcal.formats._colmap_tables import CameraRow, ImageRow, RigRow, camera_rows, image_rows, rig_rows
from rigcal.formats._entries import Entry
from rigcal.formats._foreign import ForeignCamera, ForeignRig, Written, cams_from_common, refuse_names
from rigcal.formats._source import Source
from rigcal.geometry import Pose
from rigcal.rig import Rig

NAME = "colmap-model"
_IMAGE = "000000.png"


def recognises(source: Source) -> bool:
    """Whether a folder has a model's cameras and images."""
    return any({f"cameras{suffix}", f"images{suffix}"} <= set(source.files) for suffix in (".txt", ".bin"))


def read(source: Source) -> ForeignRig:
    """Read the cameras of a model and their poses.

    Raises:
        FormatError: where a file is absent or damaged, a lens model is not known, or nothing says how the cameras
            stand to one another.
    """
    if not recognises(source):
        raise FormatError(
            "this is no COLMAP model",
            where=source.path,
            expected="a folder with cameras and images, .txt or .bin",
            got=source.shown_names,
            do_next="give the folder that holds those files, such as sparse/0",
        )
    images = image_rows(source)
    used = {image.camera_id for image in images}
    rows = [row for row in camera_rows(source) if row.id in used]
    poses = _poses(source, images, rig_rows(source))
    names = {image.camera_id: _camera_name(image.name) for image in reversed(images)}
    cameras = tuple(ForeignCamera(names[row.id], _lens(source, row), poses[row.id]) for row in rows if row.id in poses)
    return ForeignRig(cameras, unit=None)


def _poses(source: Source, images: Sequence[ImageRow], rigs: Sequence[RigRow]) -> dict[int, Pose]:
    """By camera id, from the world or the rig frame."""
    counts = Counter(image.camera_id for image in images)
    if images and max(counts.values()) == 1:
        return {i.camera_id: _pose(source, f"images, image {i.id}", i.cam_from_world) for i in images}
    joined = [rig for rig in rigs if len(set(rig.cam_from_rig) & set(counts)) > 1 or len(counts) == 1]
    if len(joined) == 1:
        placed = {camera_id: values for camera_id, values in joined[0].cam_from_rig.items() if camera_id in counts}
        where = f"rigs, rig {joined[0].id}"
        return {cam: _pose(source, where, values) if values else Pose.identity() for cam, values in placed.items()}
    raise FormatError(
        "nothing says how the cameras of this model stand to one another",
        where=source.path,
        expected="one image per camera, or one rig that joins the cameras",
        got=f"{len(images)} images of {len(counts)} cameras, {len(joined)} rigs that join them",
        do_next="configure the rig in COLMAP (rig_configurator) and solve again, or export one instant",
    )


def _pose(source: Source, where: str, values: Sequence[float]) -> Pose:
    quat_wxyz = Entry(source.path, f"{where}, QW QX QY QZ", list(values[:4])).quaternion()
    return Pose.from_quat_wxyz(quat_wxyz, Entry(source.path, f"{where}, TX TY TZ", list(values[4:])).numbers(3))


def _camera_name(image_name: str) -> str:
    """The folder that an image stands in; where there is none, the image's own name."""
    path = PurePosixPath(image_name)
    return path.parent.name or path.stem


def _lens(source: Source, row: CameraRow) -> Camera:
    def entry(name: str, value: object) -> Entry:
        return Entry(source.path, f"cameras, camera {row.id}, {name}", value)

    return lens_of_colmap(
        entry("MODEL", row.model), entry("PARAMS", list(row.params)), entry("WIDTH, HEIGHT", list(row.size_wh))
    )


def write(rig: Rig) -> Written:
    """Write a model as text in metres, in the world frame where the rig has one; no lens model is refused.

    Raises:
        ForeignNameError: for a name that cannot be a folder's, or with a blank, which COLMAP's text form splits at.
    """
    refuse_names(rig, r"[^/\s\0]+", to=NAME, expected="a folder's name without blanks")
    poses, frame = cams_from_common(rig)
    reference = rig.camera_ids.index(rig.reference)
    conventions = (
        f"poses: cam_from_world, quaternion w x y z, from {frame}; sensor_from_rig from camera {rig.reference}",
        "lengths: metres",
        "lens: OPENCV (fx fy cx cy k1 k2 p1 p2), FULL_OPENCV (with k3 k4 k5 k6), OPENCV_FISHEYE (k1 k2 k3 k4)",
        "pixels: (0.5, 0.5) is the centre of the top-left pixel, so cx and cy are 0.5 larger than in the rig file",
        f"images: one instant, <camera>/{_IMAGE}; cameras and images are numbered from 1 in the rig's order",
    )
    numbered = list(enumerate(zip(rig.cameras, poses, strict=True), start=1))
    data_ids = " ".join(f"CAMERA {n} {n}" for n, _ in numbered)
    files = {
        "cameras.txt": "".join(_camera_line(n, camera.camera) for n, (camera, _) in numbered),
        "images.txt": "".join(f"{n} {_numbers(pose)} {n} {camera.id}/{_IMAGE}\n\n" for n, (camera, pose) in numbered),
        "rigs.txt": _rig_line(rig, reference),
        "frames.txt": f"1 1 {_numbers(poses[reference])} {len(numbered)} {data_ids}\n",
        "points3D.txt": "",
    }
    return Written(files, conventions)


def _numbers(pose: Pose) -> str:
    """qw qx qy qz tx ty tz."""
    return " ".join(map(repr, (*pose.quat_wxyz.tolist(), *pose.translation_m.tolist())))


def _camera_line(number: int, lens: Camera) -> str:
    model, params = colmap_lens(lens)
    return f"{number} {model} {lens.size_wh[0]} {lens.size_wh[1]} {' '.join(map(repr, params))}\n"


def _rig_line(rig: Rig, reference: int) -> str:
    """The reference first, then each other camera with its pose."""
    others = [(n, camera.cam_from_rig) for n, camera in enumerate(rig.cameras, start=1) if n != reference + 1]
    placed = "".join(f" CAMERA {n} 1 {_numbers(pose)}" for n, pose in others)
    return f"1 {len(rig.cameras)} CAMERA {reference + 1}{placed}\n"
