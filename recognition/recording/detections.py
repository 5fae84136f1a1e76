"""What the networks saw, without loss: one message per camera and instant on ``/CAMERA/detections``.

Every number of :class:`recognition.observations.ViewDetections` is stored as the 64-bit float that it is, NaN
included, together with the times and the number of its instant, so that a replay computes from the very same values
as the run. ``/CAMERA/annotations`` are made to be looked at; these are made to be computed with.

Decision: protobuf with a schema of our own, whose descriptor stands in the file as those of Foxglove's schemas do, so
that any reader of MCAP decodes it without this package. JSON was the alternative: it has no NaN, and the detections of
four views with 4 workers and 14 objects each take 0.06 ms and 12.9 kB as protobuf, 0.56 ms and 24.9 kB as JSON (thread
time, mean of 500; 0.07 ms to read them back).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError, Message

from recognition.observations import ViewDetections
from recognition.recording.messages import stamp
from recognition.recording.protobuf import message_class
from rigcal.geometry import Floats

DETECTIONS = "detections"
"""Last part of the topics."""
_ROWS = {
    "people_px": (17, 2), "people_score": (17,), "object_xyxy": (4,), "object_score": (),
    "object_keypoints_px": (4, 2),
}  # fmt: skip
"""Shape of one person's or object's row in each field of numbers, which are stored row after row."""


@dataclass(frozen=True, slots=True)
class RecordedView:
    """What one camera saw at one instant, as it was recorded."""

    camera_id: str
    index: int
    """Number of the instant."""
    instant_ns: int
    """The instant's common time: rig time in nanoseconds."""
    views: int
    """How many cameras have such a message of this instant."""
    t_ns: int | None
    """When the camera saw it; None where it took no part in the instant."""
    frame_idx: int | None
    """Number of the frame in its camera's stream; None where there were detections alone."""
    seen: ViewDetections
    """The undecided detections, where they were at the camera's own time."""
    common: ViewDetections
    """The same, where they were at the common time."""
    interpolated: bool
    """Whether the run moved detections to common times; False: what was seen counts at the time of its frame."""


_Detections = message_class(
    "detections.proto",
    {
        "Seen": (  # distorted pixels at the rig's image size
            ("people_px", "repeated double"),  # P x 17 x 2, NaN: not detected
            ("people_score", "repeated double"),  # P x 17
            ("object_class", "repeated string"),  # K
            ("object_xyxy", "repeated double"),  # K x 4: left, top, right, bottom
            ("object_score", "repeated double"),  # K
            ("object_keypoints_px", "repeated double"),  # K x 4 x 2, NaN: not detected
            ("hints", "repeated int64"),  # which of the P people count only with another camera's
        ),
        "Detections": (
            ("timestamp", "Timestamp"),  # when the camera saw it; absent: it took no part
            ("frame_id", "string"),  # the camera
            ("instant", "int64"),  # number of the instant
            ("instant_time", "Timestamp"),  # its common time
            ("views", "uint32"),  # how many cameras have a message of it
            ("frame_number", "optional int64"),  # in the camera's stream
            ("seen", "Seen"),  # at the camera's own time
            ("common", "Seen"),  # at the common time; absent: the same
            ("interpolated", "bool"),  # whether the run moved detections to common times
        ),
    },
)
SCHEMA: str = _Detections.DESCRIPTOR.full_name
"""Name of the schema in the file."""


def detections_message(view: RecordedView) -> Message:
    """One camera's detections of one instant; ``common`` only where it is another object than ``seen``."""
    message: Message = _Detections(
        timestamp=None if view.t_ns is None else stamp(view.t_ns),
        frame_id=view.camera_id,
        instant=view.index,
        instant_time=stamp(view.instant_ns),
        views=view.views,
        frame_number=view.frame_idx,
        seen=_numbers(view.seen),
        common=None if view.common is view.seen else _numbers(view.common),
        interpolated=view.interpolated,
    )
    return message


def recorded_view(data: bytes) -> RecordedView:
    """The view that a message holds.

    Raises:
        ValueError: where the bytes are no such message, or its lists do not fit together.
    """
    try:
        message = _Detections.FromString(data)
    except DecodeError as error:
        raise ValueError(f"no {SCHEMA}") from error
    seen = _detections(message.seen)
    return RecordedView(
        camera_id=message.frame_id,
        index=message.instant,
        instant_ns=message.instant_time.ToNanoseconds(),
        views=message.views,
        t_ns=message.timestamp.ToNanoseconds() if message.HasField("timestamp") else None,
        frame_idx=message.frame_number if message.HasField("frame_number") else None,
        seen=seen,
        common=_detections(message.common) if message.HasField("common") else seen,
        interpolated=message.interpolated,
    )


def _numbers(view: ViewDetections) -> dict[str, Any]:
    arrays: dict[str, Floats] = {name: getattr(view, name) for name in _ROWS}
    lists: dict[str, Any] = {name: array.ravel().tolist() for name, array in arrays.items()}
    return lists | {"object_class": view.object_class, "hints": view.hints.tolist()}


def _detections(seen: Any) -> ViewDetections:
    arrays = {name: np.array(getattr(seen, name), dtype=np.float64).reshape(-1, *row) for name, row in _ROWS.items()}
    hints = np.array(seen.hints, dtype=np.int64)
    return ViewDetections(object_class=tuple(seen.object_class), hints=hints, **arrays)
