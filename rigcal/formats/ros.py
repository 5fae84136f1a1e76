"""ROS: a folder with ``<camera>_camera_info.yaml`` per camera, and where the cameras are, in three equal forms.

The camera_info files are ``camera_calibration_parsers``' YAML, for ``camera_info_manager``. ``tf_static.yaml`` is a
``tf2_msgs/TFMessage`` as ``ros2 topic echo /tf_static`` prints it, ``static_transforms.launch.py`` publishes the same
with ``tf2_ros``, and ``rig.urdf`` describes it for ``robot_state_publisher``; use one of them. A transform holds the
pose of ``<camera>_optical_frame`` (x right, y down, z forward, REP 103) in ``world`` or ``rig``: it maps points of the
camera into that frame; metres, quaternions x y z w. On import the camera_info files are read, and for more than one
camera the transforms, whose frames may hang on one another.
"""

from __future__ import annotations

import re

from rigcal.camera import Camera
from rigcal.errors import FormatError
from rigcal.formats._camera_info import distortion_of, lens_of, projection_of
from rigcal.formats._entries import Entry
from rigcal.formats._foreign import ForeignCamera, ForeignRig, Written, cams_from_common, refuse_names
from rigcal.formats._frames import FrameTree, common_frame_id, transform_entry
from rigcal.formats._ros_text import OPTICAL, launch_text, tf_static_text, urdf_text
from rigcal.formats._source import Source
from rigcal.formats._yaml import list_text, parse_yaml, quoted
from rigcal.geometry import Pose
from rigcal.rig import Rig, RigCamera

NAME = "ros"
_FISHEYE = "equidistant"
_FRAME_SUFFIXES = (OPTICAL, "_optical")
"""A body's frame (``_link``) has other axes, so it is never taken for the camera's."""
_CAMERA_INFO = re.compile(r"^camera_matrix:", re.MULTILINE)
_TRANSFORMS = re.compile(r"^transforms:", re.MULTILINE)


def recognises(source: Source) -> bool:
    """Whether a file is YAML with a ``camera_matrix``, and not OpenCV's."""
    return any(_is_camera_info(text) for text in source.texts.values())


def _is_camera_info(text: str) -> bool:
    return _CAMERA_INFO.search(text) is not None and "!!opencv-matrix" not in text


def read(source: Source) -> ForeignRig:
    """Read the camera_info files, and the transforms where there is more than one camera.

    Raises:
        FormatError: for a missing or malformed entry, or a camera without a transform, naming it.
    """
    infos = {name: text for name, text in source.texts.items() if _is_camera_info(text)}
    if not infos:
        raise FormatError(
            "there is no camera_info file",
            where=source.path,
            expected="YAML with image_width, camera_matrix and distortion_model",
            got=source.shown_names,
            do_next="give the camera_info file, or the folder that holds those of all cameras",
        )
    entries = [Entry(source.file(name), "", parse_yaml(source.file(name), text)) for name, text in infos.items()]
    tree = _tree(source)
    lenses = [(_camera_name(entry), _lens(entry)) for entry in entries]
    if len(lenses) > 1 and not tree.parent_from_child:
        raise FormatError(
            "nothing says where these cameras are",
            where=source.path,
            expected="a file with the transforms of " + ", ".join(name + OPTICAL for name, _ in lenses),
            got=source.shown_names,
            do_next="save them beside the camera_info files: ros2 topic echo --once /tf_static > tf_static.yaml",
        )
    poses = tree.cams_from_root([(name, _frame_of(name, tree)) for name, _ in lenses])
    cameras = (ForeignCamera(name, lens, pose) for (name, lens), pose in zip(lenses, poses, strict=True))
    return ForeignRig(tuple(cameras), unit="m")


def _tree(source: Source) -> FrameTree:
    """The transforms of every file that has some."""
    hung: dict[str, tuple[str, Pose]] = {}
    where = Entry(source.path, "transforms", [])
    for name, text in source.texts.items():
        if _TRANSFORMS.search(text):
            where = Entry(source.file(name), "", parse_yaml(source.file(name), text))["transforms"]
            hung |= dict(
                transform_entry(entry["header"]["frame_id"], entry["child_frame_id"], entry["transform"])
                for entry in where.elements()
            )
    return FrameTree(where, hung)


def _camera_name(entry: Entry) -> str:
    """The name, which YAML takes for a number where it is digits without quotes."""
    name = entry["camera_name"]
    return str(name.value) if isinstance(name.value, int) else name.text()


def _frame_of(camera_name: str, tree: FrameTree) -> str:
    named = (camera_name + suffix for suffix in _FRAME_SUFFIXES)
    return next((frame_id for frame_id in named if frame_id in tree), camera_name + OPTICAL)


def _lens(entry: Entry) -> Camera:
    size = [entry[key].number() for key in ("image_width", "image_height")]
    size_wh = Entry(entry.file, "image_width, image_height", size).size_wh()
    D, K = entry["distortion_coefficients"]["data"], entry["camera_matrix"]["data"]
    return lens_of(entry["distortion_model"], D, K, size_wh, _FISHEYE)


def write(rig: Rig) -> Written:
    """Write the folder in metres, in the world frame where the rig has one; no lens model is refused.

    Raises:
        ForeignNameError: for a name that cannot be part of a frame's and a file's name.
    """
    refuse_names(rig, r"[A-Za-z0-9_][A-Za-z0-9_.\-]*", to=NAME, expected="letters, digits, _ - and .")
    poses, frame = cams_from_common(rig)
    parent_id = common_frame_id(rig)
    placed = {camera.id: pose.inverse() for camera, pose in zip(rig.cameras, poses, strict=True)}
    files = {f"{camera.id}_camera_info.yaml": _camera_info(camera) for camera in rig.cameras} | {
        "tf_static.yaml": tf_static_text(parent_id, placed),
        "static_transforms.launch.py": launch_text(parent_id, placed),
        "rig.urdf": urdf_text(parent_id, placed),
    }
    conventions = (
        f"poses: a transform maps points of <camera>{OPTICAL} into frame {parent_id!r}, {frame}; quaternion x y z w",
        "lengths: metres",
        "lens: plumb_bob k1 k2 p1 p2 k3; rational_polynomial with k4 k5 k6; equidistant k1 k2 k3 k4 (fisheye)",
        "pixels: (0, 0) is the centre of the top-left pixel; optical frames x right, y down, z forward",
        "use: static_transforms.launch.py, tf_static.yaml and rig.urdf say the same; publish one of them",
    )
    return Written(files, conventions)


def _camera_info(camera: RigCamera) -> str:
    lens = camera.camera
    model, D = distortion_of(lens, _FISHEYE)
    projection = projection_of(lens)
    identity = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    return (
        f"image_width: {lens.size_wh[0]}\n"
        f"image_height: {lens.size_wh[1]}\n"
        f"camera_name: {quoted(camera.id)}\n"
        + _matrix("camera_matrix", lens.matrix.tolist())
        + f"distortion_model: {model}\n"
        + _matrix("distortion_coefficients", [D])
        + _matrix("rectification_matrix", identity)
        + _matrix("projection_matrix", projection)
    )


def _matrix(name: str, rows: list[list[float]]) -> str:
    data = list_text([value for row in rows for value in row])
    return f"{name}:\n  rows: {len(rows)}\n  cols: {len(rows[0])}\n  data: {data}\n"
