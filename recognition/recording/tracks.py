"""What was known in 3D, to be judged again: one message per instant on ``/tracks``.

``/scene`` is made to be looked at: in the frame of the world, without views, keypoints and sizes. Here stands what was
judged, every number as the 64-bit float that it is, in the rig frame, and instants at which nothing was placed stand
here too. So other rules judge a recording without placing anybody anew, and the run's own find the run's own events to
the last bit. Covariances are not here: rules do not ask for them, and of four workers and 14 objects they would be
9.9 kB an instant.

Decision: tracks are recorded beside the detections, though they follow from them. Four workers and 14 objects take
3.9 kB an instant (2.2 kB compressed by themselves) of 63 kB that a recording without frames has (20 kB compressed). An
hour of 54,000 instants is read back in 11 s of processor time and judged by ``site.rules.toml`` in 16 s more, where
placing it again takes 160 s (half a minute's messages 120 times; ``tools/bench/runtime.py rejudge`` measures both).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import repeat
from typing import Any, TypeVar, get_args

import numpy as np
from google.protobuf.message import DecodeError, Message
from numpy.typing import NDArray

from recognition.observations import ObjectTrack, Scene, Status, WorkerTrack
from recognition.recording.messages import stamp
from recognition.recording.protobuf import message_class
from rigcal.geometry import Floats, Ints

TRACKS = "/tracks"
"""Topic."""
_Tracks = message_class(
    "tracks.proto",
    {
        "Workers": (
            ("track_id", "repeated int64"),  # W
            ("joints_m", "repeated double"),  # W x 17 x 3, rig frame, NaN: not known
            ("views", "repeated uint32"),  # W x 17: how many cameras gave each joint
            ("members", "repeated sint32"),  # W x V: index of the detection in each view, -1: none
        ),
        "Objects": (
            ("track_id", "repeated int64"),  # K
            ("object_class", "repeated string"),  # K
            ("centre_m", "repeated double"),  # K x 3, rig frame
            ("views", "repeated uint32"),  # K
            ("members", "repeated sint32"),  # K x V
            ("size_m", "repeated double"),  # K x 2: width and height, NaN: not known
            ("keypoints_m", "repeated double"),  # K x 4 x 3, rig frame, NaN: not known
        ),
        "Tracks": (
            ("timestamp", "Timestamp"),  # the instant's common time
            ("instant", "int64"),  # its number
            ("placed", "bool"),  # false: too few cameras took part, and nothing is known
            ("status", "string"),  # MONITORED, DEGRADED or NOT MONITORED
            ("reason", "string"),  # in words
            ("cameras", "optional uint32"),  # how many took part
            ("workers", "Workers"),
            ("objects", "Objects"),
        ),
    },
)
SCHEMA: str = _Tracks.DESCRIPTOR.full_name
"""Name of the schema in the file."""
_Number = TypeVar("_Number", np.float64, np.int64)
_STATUSES: tuple[Status, ...] = get_args(Status)


@dataclass(frozen=True, slots=True)
class TrackedInstant:
    """An instant as it was judged."""

    scene: Scene
    """Without covariances; ``NOT MONITORED`` where nothing was placed."""
    is_placed: bool
    """Whether workers and objects were placed at it; else nothing is known of it."""
    status: Status
    """How the instant was monitored."""


def tracks_message(instant: TrackedInstant) -> Message:
    """The message of an instant."""
    scene, workers, objects = instant.scene, instant.scene.workers, instant.scene.objects
    message: Message = _Tracks(
        timestamp=stamp(scene.t_ns),
        instant=scene.index,
        placed=instant.is_placed,
        status=instant.status,
        reason=scene.reason,
        cameras=scene.cameras,
        workers={
            "track_id": [one.track_id for one in workers],
            "joints_m": _row([one.joints_m for one in workers]),
            "views": _row([one.views for one in workers]),
            "members": _row([one.members for one in workers]),
        },
        objects={
            "track_id": [one.track_id for one in objects],
            "object_class": [one.object_class for one in objects],
            "centre_m": _row([one.centre_m for one in objects]),
            "views": [one.views for one in objects],
            "members": _row([one.members for one in objects]),
            "size_m": [length for one in objects for length in one.size_m],
            "keypoints_m": _row([one.keypoints_m for one in objects]),
        },
    )
    return message


def tracked_instant(data: bytes) -> TrackedInstant:
    """The instant that a message holds.

    Raises:
        ValueError: where the bytes are no such message, or its lists do not fit together.
    """
    try:
        message = _Tracks.FromString(data)
    except DecodeError as error:
        raise ValueError(f"no {SCHEMA}") from error
    if message.status not in _STATUSES:
        raise ValueError(f"status is {message.status!r}")
    scene = Scene(
        message.instant,
        message.timestamp.ToNanoseconds(),
        _workers(message.workers),
        _objects(message.objects),
        message.status if message.placed else "NOT MONITORED",
        message.reason,
        message.cameras if message.HasField("cameras") else None,
    )
    return TrackedInstant(scene, message.placed, message.status)


def _workers(of: Any) -> tuple[WorkerTrack, ...]:
    count = len(of.track_id)
    return tuple(
        map(
            WorkerTrack,
            of.track_id,
            _floats(of.joints_m, count, 17, 3),
            _ints(of.views, count, 17),
            _ints(of.members, count, -1),
            repeat(_UNKNOWN_JOINTS),
        )
    )


def _objects(of: Any) -> tuple[ObjectTrack, ...]:
    count = len(of.track_id)
    if not count == len(of.object_class) == len(of.views):
        raise ValueError(f"{count} objects have {len(of.object_class)} classes and {len(of.views)} numbers of views")
    return tuple(
        map(
            ObjectTrack,
            of.track_id,
            of.object_class,
            _floats(of.centre_m, count, 3),
            of.views,
            _ints(of.members, count, -1),
            repeat(_UNKNOWN_CENTRE),
            _floats(of.keypoints_m, count, 4, 3),
            map(tuple, _floats(of.size_m, count, 2).tolist()),
            repeat(_UNKNOWN_KEYPOINTS),
        )
    )


def _row(arrays: Sequence[Floats] | Sequence[Ints]) -> list[Any]:
    """The numbers of all, one array after the other."""
    return np.concatenate(arrays, axis=None).tolist() if arrays else []


def _floats(numbers: Any, count: int, *row: int) -> Floats:
    return _rows(np.array(numbers, dtype=np.float64), count, row)


def _ints(numbers: Any, count: int, *row: int) -> Ints:
    return _rows(np.array(numbers, dtype=np.int64), count, row)


def _rows(numbers: NDArray[_Number], count: int, row: tuple[int, ...]) -> NDArray[_Number]:
    """As so many rows, read-only; where one is of length -1, the length is what makes them fit."""
    rows = numbers.reshape(count, *row) if count else numbers.reshape(0, *np.abs(row))
    rows.setflags(write=False)
    return rows


def _unknown(*shape: int) -> Floats:
    return _rows(np.full(math.prod(shape), np.nan), shape[0], shape[1:])


_UNKNOWN_JOINTS, _UNKNOWN_CENTRE, _UNKNOWN_KEYPOINTS = _unknown(17, 3, 3), _unknown(3, 3), _unknown(4, 3, 3)
