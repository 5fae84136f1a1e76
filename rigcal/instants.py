"""Which frames of different cameras belong to one instant.

Three rules, in order of preference: ``timestamps.csv`` in the capture, times in the file names, equal frame numbers.
Grouping by time is one to one and within half a frame period. Two frames are paired when each is the other's nearest:
the camera with the most frames goes first, what it leaves over is grouped by the next.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rigcal.captures import Capture, CaptureCamera, natural_key
from rigcal.detections import Instants
from rigcal.geometry import Floats, Ints
from rigcal.rig import ClockModel
from rigcal.stamps import frame_stamps, in_rig_time


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
    stamps = frame_stamps(capture)
    if stamps is not None and stamps.shared:
        known = [(clocks or {}).get(camera.id) for camera in capture.cameras]
        in_rig = [in_rig_time(t, clock) for clock, t in zip(known, stamps.times_s, strict=True)]
        return group_by_time(in_rig, rule=stamps.rule, fps=[camera.fps for camera in capture.cameras])
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
