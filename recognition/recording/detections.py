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
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from google.protobuf.message import DecodeError, Message

from recognition.observations import ViewDetections
from recognition.recording.messages import stamp
from rigcal.geometry import Floats

DETECTIONS = "detections"
"""Last part of the topics."""
_FILE, _PACKAGE = "recognition/detections.proto", "recognition"
_FIELD = descriptor_pb2.FieldDescriptorProto
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


def _schema() -> Any:
    """The class of the messages, made from a descriptor as ``protoc`` would from::

    message Detections {
      google.protobuf.Timestamp timestamp = 1;       // when the camera saw it; absent: it took no part
      string frame_id = 2;                           // the camera
      int64 instant = 3;                             // number of the instant
      google.protobuf.Timestamp instant_time = 4;    // its common time
      uint32 views = 5;                              // how many cameras have a message of it
      optional int64 frame_number = 6;               // in the camera's stream
      Seen seen = 7;                                 // at the camera's own time
      Seen common = 8;                               // at the common time; absent: the same
    }
    message Seen {                                   // distorted pixels at the rig's image size
      repeated double people_px = 1;                 // P x 17 x 2, NaN: not detected
      repeated double people_score = 2;              // P x 17
      repeated string object_class = 3;              // K
      repeated double object_xyxy = 4;               // K x 4: left, top, right, bottom
      repeated double object_score = 5;              // K
      repeated double object_keypoints_px = 6;       // K x 4 x 2, NaN: not detected
    }
    """
    stamp_name = timestamp_pb2.DESCRIPTOR.name
    file = descriptor_pb2.FileDescriptorProto(name=_FILE, package=_PACKAGE, syntax="proto3", dependency=[stamp_name])
    seen = file.message_type.add(name="Seen")
    for number, name in enumerate(("people_px", "people_score", "object_class", *tuple(_ROWS)[2:]), start=1):
        kind = _FIELD.TYPE_STRING if name == "object_class" else _FIELD.TYPE_DOUBLE
        seen.field.add(name=name, number=number, type=kind, label=_FIELD.LABEL_REPEATED)
    view = file.message_type.add(name="Detections", oneof_decl=[{"name": "_frame_number"}])
    time, part = ".google.protobuf.Timestamp", f".{_PACKAGE}.Seen"
    for number, (name, kind, of) in enumerate(
        (
            ("timestamp", _FIELD.TYPE_MESSAGE, time),
            ("frame_id", _FIELD.TYPE_STRING, None),
            ("instant", _FIELD.TYPE_INT64, None),
            ("instant_time", _FIELD.TYPE_MESSAGE, time),
            ("views", _FIELD.TYPE_UINT32, None),
            ("frame_number", _FIELD.TYPE_INT64, None),
            ("seen", _FIELD.TYPE_MESSAGE, part),
            ("common", _FIELD.TYPE_MESSAGE, part),
            ("interpolated", _FIELD.TYPE_BOOL, None),
        ),
        start=1,
    ):
        view.field.add(name=name, number=number, type=kind, type_name=of, label=_FIELD.LABEL_OPTIONAL)
    view.field[5].proto3_optional, view.field[5].oneof_index = True, 0
    pool = descriptor_pool.Default()
    pool.AddSerializedFile(file.SerializeToString())
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(f"{_PACKAGE}.Detections"))


_Detections = _schema()
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
    return {name: array.ravel().tolist() for name, array in arrays.items()} | {"object_class": view.object_class}


def _detections(seen: Any) -> ViewDetections:
    arrays = {name: np.array(getattr(seen, name), dtype=np.float64).reshape(-1, *row) for name, row in _ROWS.items()}
    return ViewDetections(object_class=tuple(seen.object_class), **arrays)
