"""Which frames of different cameras belong to one instant.

Three rules, in order of preference: ``timestamps.csv`` in the capture, times in the file names, equal frame numbers.
Grouping by time is one to one and within half a frame period. Two frames are paired when each is the other's nearest:
the camera with the most frames goes first, what it leaves over is grouped by the next.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from rigcal.captures import Capture, CaptureCamera, natural_key
from rigcal.detections import Instants
from rigcal.errors import TimestampsError
from rigcal.geometry import Floats, Ints
from rigcal.rig import ClockModel

TIMESTAMPS = "timestamps.csv"
_UTC_NAME = re.compile(r"(\d{8})T(\d{6})(?:\.(\d{1,9}))?Z")
_YEAR_2000_S, _YEAR_2100_S = 946_684_800, 4_102_444_800


def find_instants(capture: Capture, clocks: Mapping[str, ClockModel | None] | None = None) -> Instants:
    """Group the frames of a capture.

    Args:
        capture: The capture.
        clocks: Clock model per camera; times are mapped to rig time by it. Frame numbers need none.

    Returns:
        Every frame of every camera exactly once, by time; an instant may hold one camera only.

    Raises:
        TimestampsError: where ``timestamps.csv`` contradicts the capture.
    """
    times = _times_from_csv(capture)
    rule = TIMESTAMPS
    if times is None:
        times, rule = _times_from_names(capture), "file times"
    if times is not None:
        in_rig = [_in_rig_time(t, (clocks or {}).get(c.id)) for c, t in zip(capture.cameras, times, strict=True)]
        return group_by_time(in_rig, rule=rule, fps=[camera.fps for camera in capture.cameras])
    return _group_by_number(capture)


def group_by_time(times_s: Sequence[Floats], *, rule: str, fps: Sequence[float | None] = ()) -> Instants:
    """Group frames whose times (n,) in seconds are known, one array per camera in any order."""
    count = len(times_s)
    period = _period_s(times_s, fps)
    left = [np.argsort(t, kind="stable") for t in times_s]  # frames not yet grouped, by time
    rows: list[Ints] = []
    for anchor in sorted(range(count), key=lambda c: (-len(times_s[c]), c)):
        row = np.full((len(left[anchor]), count), -1, dtype=np.int64)
        row[:, anchor] = left[anchor]
        for other in range(count):
            if other == anchor or not len(left[other]) or not len(left[anchor]):
                continue
            mine, theirs = _mutual_nearest(times_s[anchor][left[anchor]], times_s[other][left[other]], period / 2)
            row[mine, other] = left[other][theirs]
            left[other] = np.delete(left[other], theirs)
        left[anchor] = left[anchor][:0]
        rows.append(row)
    frame_idx = np.concatenate(rows)
    t = np.stack([np.append(times, np.nan)[frame_idx[:, c]] for c, times in enumerate(times_s)], axis=1)
    t_s = np.nanmean(t, axis=1) if len(t) else np.zeros(0)
    order = np.argsort(t_s, kind="stable")
    offset_s = np.nan_to_num(t - t_s[:, None])
    return Instants(rule, frame_idx[order], t_s[order], offset_s[order])


def _mutual_nearest(first: Floats, second: Floats, within: float) -> tuple[Ints, Ints]:
    """Indices into two sorted arrays of times that are each other's nearest, no further apart than ``within``."""
    nearest_second, nearest_first = _nearest(first, second), _nearest(second, first)
    mine = np.arange(len(first))
    paired = (nearest_first[nearest_second] == mine) & (np.abs(first - second[nearest_second]) <= within)
    return mine[paired], nearest_second[paired]


def _nearest(times: Floats, among: Floats) -> Ints:
    right = np.clip(np.searchsorted(among, times), 0, len(among) - 1)
    left = np.maximum(right - 1, 0)
    return np.asarray(np.where(np.abs(among[left] - times) <= np.abs(among[right] - times), left, right))


def _period_s(times_s: Sequence[Floats], fps: Sequence[float | None]) -> float:
    """Frame period: the median spacing of the camera with the most frames, else what the videos declare."""
    most = np.sort(max(times_s, key=len, default=np.zeros(0)))
    if len(most) > 1:
        return float(np.median(np.diff(most)))
    declared = [1 / rate for rate in fps if rate]
    return max(declared, default=1 / 30)


def _in_rig_time(t_cam_s: Floats, clock: ClockModel | None) -> Floats:
    return t_cam_s if clock is None else np.array([clock.rig_time_s(float(t)) for t in t_cam_s])


def _times_from_csv(capture: Capture) -> list[Floats] | None:
    """Times per camera from ``timestamps.csv``; None where there is no such file."""
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
    times: dict[str, list[float]] = {camera.id: [] for camera in capture.cameras}
    for cam_id, text, line in rows:
        camera = match_camera_id((cam_id or "").strip(), list(times))
        if camera is None:
            raise TimestampsError(
                path,
                problem=f"line {line} names camera {cam_id!r}, which the capture does not have",
                expected=f"one of {', '.join(times)}, or the number at its end",
                got=repr(cam_id),
            )
        times[camera].append(_seconds(path, text, line))
    for entry in capture.cameras:
        if len(times[entry.id]) != len(entry.frames):
            raise TimestampsError(
                path,
                problem=f"camera {entry.id} has another number of rows than of frames",
                expected=f"{len(entry.frames)} rows for the {len(entry.frames)} frames of {entry.id}",
                got=f"{len(times[entry.id])} rows",
            )
    return [np.sort(np.array(times[camera.id], dtype=np.float64)) for camera in capture.cameras]


def _seconds(path: Path, text: str | None, line: int) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise TimestampsError(
            path,
            problem=f"line {line} has no time",
            expected="frame_time as a number of seconds",
            got=repr(text),
        )
    return value


def match_camera_id(name: str, camera_ids: Sequence[str]) -> str | None:
    """The camera of that name: an exact match, else the only one that ends in the same integer; None otherwise."""
    if name in camera_ids:
        return name
    number = re.search(r"(\d+)$", name)
    if number is None:
        return None
    matches = [c for c in camera_ids if (end := re.search(r"(\d+)$", c)) and int(end[1]) == int(number[1])]
    return matches[0] if len(matches) == 1 else None


def _times_from_names(capture: Capture) -> list[Floats] | None:
    """Times per camera from the names of images; None where any name holds none."""
    if any(camera.kind == "video" for camera in capture.cameras):
        return None
    times = [[_time_in_name(name) for name in camera.frames] for camera in capture.cameras]
    if any(t is None for camera in times for t in camera):
        return None
    return [np.array(camera, dtype=np.float64) for camera in times]


def _time_in_name(name: str) -> float | None:
    """Seconds since the epoch in a file's stem: ``20260412T093001.250000Z``, or nano- or microseconds at its end."""
    if match := _UTC_NAME.search(name):
        whole = datetime.strptime(match[1] + match[2], "%Y%m%d%H%M%S").replace(tzinfo=UTC)
        return whole.timestamp() + float(f"0.{match[3] or 0}")
    if match := re.search(r"(\d{15,19})$", name):
        for unit in (1e-9, 1e-6):
            seconds = int(match[1]) * unit
            if _YEAR_2000_S <= seconds < _YEAR_2100_S:
                return seconds
    return None


def _group_by_number(capture: Capture) -> Instants:
    """Frames of equal number; where numbers are missing or repeat in a camera, every frame stands alone."""
    numbers = [_numbers(camera) for camera in capture.cameras]
    count = len(numbers)
    if any(n is None or len(set(n)) != len(n) for n in numbers):
        frames = [(c, i) for c, camera in enumerate(capture.cameras) for i in range(len(camera.frames))]
        frame_idx = np.full((len(frames), count), -1, dtype=np.int64)
        for row, (c, i) in enumerate(frames):
            frame_idx[row, c] = i
        return Instants("none", frame_idx, np.arange(len(frames), dtype=np.float64), np.zeros(frame_idx.shape))
    at = [{number: index for index, number in enumerate(n or [])} for n in numbers]
    every = sorted({number for camera in at for number in camera})
    frame_idx = np.array([[camera.get(number, -1) for camera in at] for number in every], dtype=np.int64)
    frame_idx = frame_idx.reshape(-1, count)
    return Instants("frame numbers", frame_idx, np.array(every, dtype=np.float64), np.zeros(frame_idx.shape))


def _numbers(camera: CaptureCamera) -> list[int] | None:
    """The last integer in each frame's name, or the index in a video; None where a name has none."""
    if camera.kind == "video":
        return list(range(len(camera.frames)))
    found = [[part[1] for part in natural_key(name) if part[0] == 1] for name in camera.frames]
    return [numbers[-1] for numbers in found] if all(found) else None
