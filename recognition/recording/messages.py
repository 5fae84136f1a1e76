"""Foxglove messages of frames, calibration, poses and log lines; Foxglove shows them without any set-up.

Every message's own timestamp is the capture time in rig time. The frame of an image, its annotations and its
calibration is the camera's identifier; `/tf` places the cameras in ``rig``, and ``rig`` in ``world`` where the rig
has one. Schemas: https://docs.foxglove.dev/docs/visualization/message-schemas/introduction.
"""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

from recognition.events import Marks
from recognition.observations import LIMBS, ViewFrame
from rigcal.geometry import Bools, Floats, Pose
from rigcal.rig import Rig, RigCamera

RIG_FRAME, WORLD_FRAME = "rig", "world"
JPEG_QUALITY = 90
"""0.28 bytes and 41 dB per pixel over eight images of the captures; 95 costs 1.4 times the bytes for 2.4 dB."""
GREY, VIOLATION_RGB = (0.6, 0.6, 0.6), (1.0, 0.0, 0.0)
LOG_LEVELS = {
    "debug": Log.DEBUG, "info": Log.INFO, "warning": Log.WARNING, "error": Log.ERROR, "fatal": Log.FATAL
}  # fmt: skip
_DISTORTION_MODELS = {
    "opencv4": "plumb_bob", "opencv5": "plumb_bob", "opencv8": "rational_polynomial", "fisheye4": "kannala_brandt"
}  # fmt: skip
_PLUMB_BOB_COEFFICIENTS = 5
_GOLDEN_RATIO = 0.6180339887498949


def stamp(t_ns: int) -> Timestamp:
    """A protobuf timestamp of integer nanoseconds."""
    seconds, nanos = divmod(t_ns, 1_000_000_000)
    return Timestamp(seconds=seconds, nanos=nanos)


@lru_cache(maxsize=1024)
def identity_rgb(track_id: int | None) -> tuple[float, float, float]:
    """The same strong colour for the same identity, in 2D and 3D; consecutive identities differ most in hue. Grey
    without one."""
    return GREY if track_id is None else colorsys.hsv_to_rgb(track_id * _GOLDEN_RATIO % 1.0, 0.8, 1.0)


def track_rgb(kind: str, track_id: int, marks: Marks) -> tuple[float, float, float]:
    """:func:`identity_rgb`; :data:`VIOLATION_RGB`, which is no identity's, of those who violate a rule."""
    return VIOLATION_RGB if (kind, track_id) in marks else identity_rgb(track_id)


def color_message(red: float, green: float, blue: float) -> Color:
    """An opaque colour of parts 0..1."""
    return Color(r=red, g=green, b=blue, a=1.0)


def identity_color(track_id: int | None) -> Color:
    """:func:`identity_rgb` as a message."""
    return color_message(*identity_rgb(track_id))


def known_points(points: Floats) -> Bools:
    """(...) which of points (..., D) have no NaN."""
    return np.asarray(np.isfinite(points).all(axis=-1))


def limb_ends(joints: Sequence[bytes], known: Sequence[bool]) -> bytes:
    """Both ends, one after the other, of the limbs whose joints are known, out of the serialized ends (17) of lines."""
    return b"".join([joints[one] + joints[other] for one, other in LIMBS if known[one] and known[other]])


def frame_message(camera_id: str, frame: ViewFrame) -> CompressedVideo | CompressedImage:
    """The frame in the form it came in; as a JPEG where it has none.

    Raises:
        ValueError: for an ``encoding`` that a view frame cannot have.
    """
    if frame.encoded is None:
        return _image(camera_id, frame.t_ns, jpeg(frame.image_bgr), "jpeg")
    return encoded_message(camera_id, frame.t_ns, frame.encoded, frame.encoding)


def encoded_message(camera_id: str, t_ns: int, data: bytes, encoding: str) -> CompressedVideo | CompressedImage:
    """A frame as its camera encoded it.

    Raises:
        ValueError: for an ``encoding`` that cannot be recorded.
    """
    if encoding == "h264":
        return CompressedVideo(timestamp=stamp(t_ns), frame_id=camera_id, data=data, format="h264")
    if encoding in ("jpeg", "png"):
        return _image(camera_id, t_ns, data, encoding)
    raise ValueError(f"encoding of a frame must be h264, jpeg or png, got {encoding!r}")


def _image(camera_id: str, t_ns: int, data: bytes, encoding: str) -> CompressedImage:
    return CompressedImage(timestamp=stamp(t_ns), frame_id=camera_id, data=data, format=encoding)


def jpeg(image_bgr: NDArray[np.uint8]) -> bytes:
    """An image (H, W, 3) as JPEG bytes of :data:`JPEG_QUALITY`."""
    _, data = cv2.imencode(".jpg", image_bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return data.tobytes()


def calibration(camera: RigCamera, t_ns: int) -> CameraCalibration:
    """The intrinsics; K and P are OpenCV's (pixel (0, 0) is a pixel's centre), R is the identity."""
    model = _DISTORTION_MODELS[camera.camera.model]
    distortion = camera.camera.distortion.tolist()
    if model == "plumb_bob":
        distortion += [0.0] * (_PLUMB_BOB_COEFFICIENTS - len(distortion))
    K = camera.camera.matrix
    return CameraCalibration(
        timestamp=stamp(t_ns),
        frame_id=camera.id,
        width=camera.camera.size_wh[0],
        height=camera.camera.size_wh[1],
        distortion_model=model,
        D=distortion,
        K=K.ravel().tolist(),
        R=np.eye(3).ravel().tolist(),
        P=np.hstack([K, np.zeros((3, 1))]).ravel().tolist(),
    )


def transforms(rig: Rig, t_ns: int) -> FrameTransforms:
    """Where every camera stands in ``rig``, and ``rig`` in ``world`` where the rig has a world."""
    placed = [_transform(RIG_FRAME, camera.id, camera.cam_from_rig.inverse(), t_ns) for camera in rig.cameras]
    if rig.world_from_rig is not None:
        placed.append(_transform(WORLD_FRAME, RIG_FRAME, rig.world_from_rig, t_ns))
    return FrameTransforms(transforms=placed)


def _transform(parent: str, child: str, parent_from_child: Pose, t_ns: int) -> FrameTransform:
    x, y, z = parent_from_child.translation_m.tolist()
    qw, qx, qy, qz = parent_from_child.quat_wxyz.tolist()
    return FrameTransform(
        timestamp=stamp(t_ns),
        parent_frame_id=parent,
        child_frame_id=child,
        translation=Vector3(x=x, y=y, z=z),
        rotation=Quaternion(x=qx, y=qy, z=qz, w=qw),
    )


def log_message(level: str, text: str, t_ns: int, *, speaker: str = "recognition") -> Log:
    """A line of the log, and who says it; ``level`` is one of :data:`LOG_LEVELS`, ValueError where it is not."""
    if level not in LOG_LEVELS:
        raise ValueError(f"level of a log line must be one of {', '.join(LOG_LEVELS)}, got {level!r}")
    return Log(timestamp=stamp(t_ns), level=LOG_LEVELS[level], message=text, name=speaker)
