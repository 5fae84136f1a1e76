"""Which frames of long videos are looked at: the same instants in every camera, and more of them where boards are few.

Context: a minute of video has 1,800 frames that differ little from one to the next, and calibration uses about a
hundred views of a camera. Decision: look five times a second, at instants at which as many cameras as possible have a
frame, since a view that two cameras share is worth more than two that they do not; then look at every frame around
the boards of cameras that saw few. Cost: a board held still for less than a fifth of a second may be missed by a
camera that has plenty of other views. Short videos and images are looked at frame by frame.
"""

from __future__ import annotations

from collections.abc import Sequence, Set

import numpy as np

from rigcal.captures import Capture
from rigcal.detections import Instants
from rigcal.geometry import Ints

LOOKS_PER_S = 5.0
"""A hand-held board rests for half a second and longer, or it is blurred."""
LEAST_LOOKS = 100
"""Frames of a video below which all of them are looked at."""


def first_looks(capture: Capture, instants: Instants) -> list[set[int]]:
    """Frames of each camera to look at first: all of them, or in long videos five a second and the last one."""
    stride = look_stride(capture)
    if stride == 1:
        return [set(range(len(camera.frames))) for camera in capture.cameras]
    rows = _spread(instants, stride, max(len(camera.frames) for camera in capture.cameras))
    looks = [set(column[column >= 0].tolist()) for column in instants.frame_idx[rows].T]
    return [look | {len(camera.frames) - 1} for look, camera in zip(looks, capture.cameras, strict=True)]


def closer_looks(capture: Capture, instants: Instants, boards: Sequence[Set[int]], *, enough: int) -> list[set[int]]:
    """Frames of each camera around the boards of those cameras that saw fewer than ``enough``.

    Args:
        capture: the capture.
        instants: which frames belong together.
        boards: frames of each camera in which a board was found.
        enough: views with which a camera has no need of more.
    """
    stride = look_stride(capture)
    near = [_near(instants.frame_idx[:, c], found, stride) for c, found in enumerate(boards)]
    short = [rows for rows, found in zip(near, boards, strict=True) if len(found) < enough]
    if stride == 1 or not short:
        return [set() for _ in boards]
    wanted = np.logical_or.reduce(short)
    return [
        set(frames[wanted & rows & (frames >= 0)].tolist())
        for frames, rows in zip(instants.frame_idx.T, near, strict=True)
    ]


def look_stride(capture: Capture) -> int:
    """Of how many frames one is looked at; 1 where every frame is."""
    if any(camera.kind == "images" for camera in capture.cameras):
        return 1
    frames = max(len(camera.frames) for camera in capture.cameras)
    fps = max(camera.fps or 0.0 for camera in capture.cameras)
    return max(1, min(round(fps / LOOKS_PER_S), frames // LEAST_LOOKS))


def _spread(instants: Instants, stride: int, frames: int) -> Ints:
    """Rows of instants, one per ``stride`` frames, each with the most cameras; more where a camera is in none."""
    seen = instants.frame_idx >= 0
    span = float(np.ptp(instants.t_s)) or 1.0
    cell = np.floor((instants.t_s - instants.t_s.min()) * (frames - 1) / span / stride + 1e-6).astype(np.int64)
    order = np.lexsort((np.arange(len(cell)), -seen.sum(axis=1), cell))
    chosen, current, covered = [], -1, np.zeros(seen.shape[1], dtype=bool)
    for row in order.tolist():
        if cell[row] != current:
            current, covered = cell[row], np.zeros_like(covered)
        if (seen[row] & ~covered).any():
            chosen.append(row)
            covered = covered | seen[row]
    return np.sort(np.array(chosen, dtype=np.int64))


def _near(frames: Ints, found: Set[int], stride: int) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """(I,) whether the camera's frame at an instant lies between a frame with a board and the looks beside it."""
    if not found:
        return np.zeros(len(frames), dtype=bool)
    boards = np.array(sorted(found))
    right = np.clip(np.searchsorted(boards, frames), 0, len(boards) - 1)
    distance = np.minimum(np.abs(boards[right] - frames), np.abs(frames - boards[np.maximum(right - 1, 0)]))
    return np.asarray((frames >= 0) & (distance < stride))
