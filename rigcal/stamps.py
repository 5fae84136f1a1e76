"""When each frame of a capture was taken, by its camera's own clock.

A stamp means mid-exposure of the centre row. Three places hold stamps, in order of preference: ``timestamps.csv`` in
the capture, the names of images, and the presentation times of a video, which count from its own first frame and so
say nothing of when that was.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Literal

import numpy as np

from rigcal.captures import Capture
from rigcal.errors import TimestampsError
from rigcal.geometry import Floats, Ints
from rigcal.rig import ClockModel

TIMESTAMPS = "timestamps.csv"
_UTC_NAME = re.compile(r"(\d{8})T(\d{6})(?:\.(\d{1,9}))?Z")
_S_NS = 10**9
_YEAR_2000_S, _YEAR_2100_S = 946_684_800, 4_102_444_800
OTHER_EPOCH_S = 10 * 365.25 * 86400.0
"""A clock measured further than this from a stamp counts from another epoch: stamps since the start of a recording,
which lie in 1970, and a clock in UTC."""


@dataclass(frozen=True, slots=True)
class FrameStamps:
    """The stamps of a capture's frames."""

    rule: Literal["timestamps.csv", "file times", "presentation times"]
    """Where they come from."""
    times_s: tuple[Floats, ...]
    """Per camera (F,) seconds of its frames, in capture order."""
    times_ns: tuple[Ints, ...] = ()
    """The same in nanoseconds, with every digit that was written down: a float of the epoch's seconds holds 240 ns."""

    @classmethod
    def of_ns(cls, rule: Literal["timestamps.csv", "file times"], times_ns: Sequence[Ints]) -> FrameStamps:
        """From nanoseconds."""
        return cls(rule, tuple(t // _S_NS + t % _S_NS / _S_NS for t in times_ns), tuple(times_ns))

    def counts_for(self, capture: Capture) -> list[int]:
        """Frames of each camera of the capture that these stamps are of.

        Raises:
            ValueError: where the stamps are another capture's.
        """
        counts, stamped = [len(camera.frames) for camera in capture.cameras], [len(t_s) for t_s in self.times_s]
        if stamped != counts:
            raise ValueError(f"stamps of {stamped} frames for a capture of {counts}")
        return counts

    @property
    def shared(self) -> bool:
        """Whether the cameras' stamps count from the same epoch; presentation times do not."""
        return self.rule != "presentation times"

    @property
    def utc(self) -> bool:
        """Whether the stamps are seconds since the Unix epoch, as far as their size tells."""
        known = [t for t in self.times_s if len(t)]
        return self.shared and all(t.min() >= _YEAR_2000_S and t.max() < _YEAR_2100_S for t in known)


def frame_stamps(capture: Capture) -> FrameStamps | None:
    """The stamps of a capture's frames; None where neither the capture nor its files hold any.

    Raises:
        TimestampsError: where ``timestamps.csv`` contradicts the capture.
    """
    times = _times_from_csv(capture)
    if times is not None:
        return FrameStamps.of_ns("timestamps.csv", times)
    times = _times_from_names(capture)
    if times is not None:
        return FrameStamps.of_ns("file times", times)
    if all(camera.times_s for camera in capture.cameras):
        return FrameStamps("presentation times", tuple(np.array(camera.times_s) for camera in capture.cameras))
    return None


def same_epoch(t_cam_s: Floats, clock: ClockModel) -> bool:
    """Whether stamps (n,) in seconds count from the epoch that a camera's clock was measured in."""
    return not len(t_cam_s) or abs(clock.at_s - float(t_cam_s[0])) <= OTHER_EPOCH_S


def in_rig_time(t_cam_s: Floats, clock: ClockModel | None) -> Floats:
    """Rig times of a camera's stamps (n,) in seconds; the stamps themselves where no clock model is of their epoch."""
    if clock is None or not same_epoch(t_cam_s, clock):
        return t_cam_s
    return np.asarray(t_cam_s + clock.offset_s + clock.drift_ppm * 1e-6 * (t_cam_s - clock.at_s))


def _times_from_csv(capture: Capture) -> list[Ints] | None:
    """Nanoseconds per camera from ``timestamps.csv``; None where there is no such file."""
    path = capture.path / TIMESTAMPS
    if not path.exists():
        return None
    with path.open(newline="", encoding="utf-8-sig") as file:
        reader = csv.DictReader(file)
        missing = {"cam_id", "frame_time"} - set(reader.fieldnames or ())
        if missing:
            got = ", ".join(reader.fieldnames or ()) or "an empty file"
            raise TimestampsError(
                path, problem=f"no column {', '.join(sorted(missing))}", expected="columns cam_id, frame_time", got=got
            )
        rows = [(row["cam_id"], row["frame_time"], reader.line_num) for row in reader]
    times: dict[str, list[int]] = {camera.id: [] for camera in capture.cameras}
    for cam_id, text, line in rows:
        camera = match_camera_id((cam_id or "").strip(), list(times))
        if camera is None:
            raise TimestampsError(
                path,
                problem=f"line {line} names camera {cam_id!r}, which the capture does not have",
                expected=f"one of {', '.join(times)}, or the number at its end",
                got=repr(cam_id),
            )
        times[camera].append(_nanoseconds(path, text, line))
    for entry in capture.cameras:
        if len(times[entry.id]) != len(entry.frames):
            raise TimestampsError(
                path,
                problem=f"camera {entry.id} has another number of rows than of frames",
                expected=f"{len(entry.frames)} rows for the {len(entry.frames)} frames of {entry.id}",
                got=f"{len(times[entry.id])} rows",
            )
    return [np.sort(np.array(times[camera.id], dtype=np.int64)) for camera in capture.cameras]


def _nanoseconds(path: Path, text: str | None, line: int) -> int:
    try:
        value = Decimal((text or "").strip())
    except InvalidOperation:
        value = Decimal("NaN")
    if not value.is_finite() or abs(value) > _YEAR_2100_S:
        raise TimestampsError(
            path,
            problem=f"line {line} has no time",
            expected="frame_time as a number of seconds",
            got=repr(text),
        )
    return round(value * _S_NS)


def match_camera_id(name: str, camera_ids: Sequence[str]) -> str | None:
    """The camera of that name: an exact match, else the only one that ends in the same integer; None otherwise."""
    if name in camera_ids:
        return name
    number = re.search(r"(\d+)$", name)
    if number is None:
        return None
    matches = [c for c in camera_ids if (end := re.search(r"(\d+)$", c)) and int(end[1]) == int(number[1])]
    return matches[0] if len(matches) == 1 else None


def _times_from_names(capture: Capture) -> list[Ints] | None:
    """Nanoseconds per camera from the names of images; None where any name holds none."""
    if any(camera.kind == "video" for camera in capture.cameras):
        return None
    times = [[_time_in_name(name) for name in camera.frames] for camera in capture.cameras]
    if any(t is None for camera in times for t in camera):
        return None
    return [np.array(camera, dtype=np.int64) for camera in times]


def _time_in_name(name: str) -> int | None:
    """Nanoseconds of the epoch in a stem: ``20260412T093001.250000Z``, or an integer of nano- or microseconds."""
    if match := _UTC_NAME.search(name):
        whole = datetime.strptime(match[1] + match[2], "%Y%m%d%H%M%S").replace(tzinfo=UTC)
        return int(whole.timestamp()) * _S_NS + int((match[3] or "").ljust(9, "0"))
    if match := re.search(r"(\d{15,19})$", name):
        for unit_ns in (1, 1000):
            t_ns = int(match[1]) * unit_ns
            if _YEAR_2000_S * _S_NS <= t_ns < _YEAR_2100_S * _S_NS:
                return t_ns
    return None
