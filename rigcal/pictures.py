"""Pictures of the views that fit worst, for a reader who wants to see why.

Which views they are follows from the evidence alone; their images come from the capture, once, when the rig is
calibrated. Corners are not drawn into the pictures: the report draws them over, from the numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from rigcal.captures import Capture, read_frames_at
from rigcal.evidence import Evidence, ViewPicture
from rigcal.geometry import Floats

PER_CAMERA, IN_ALL = 3, 12
"""Pictures of one camera and of the rig: a page of twelve is looked at, a page of sixty is not."""
MARGIN = 0.3
"""Room around the board's corners over their extent, so that the outer squares are seen and some of what is behind."""
LONGEST_PX = 640
"""Longer side of a picture; the report shows it about half as wide."""
QUALITIES = (85, 75, 60, 45, 30)
"""JPEG qualities, tried until the file is small enough."""
GREATEST_BYTES = 50_000
"""Size of a file: twelve of them, in base64, are 0.8 MB of a report that should stay below 2 MB."""


def worst_views(
    evidence: Evidence, *, per_camera: int = PER_CAMERA, in_all: int = IN_ALL
) -> tuple[tuple[int, int], ...]:
    """The (camera index, frame index) of the views with the greatest RMSE over all their corners, worst first.

    Every camera gives its worst view before any gives a second one, as long as there is room.
    """
    views, rmse_px = view_rmse_px(evidence)
    ranked: list[tuple[int, float, int, int]] = []
    for camera in np.unique(views[:, 0]).tolist():
        mine = np.flatnonzero(views[:, 0] == camera)
        worst = mine[np.argsort(-rmse_px[mine], kind="stable")][:per_camera]
        ranked += [(rank, -float(rmse_px[row]), camera, int(views[row, 1])) for rank, row in enumerate(worst)]
    chosen = sorted(sorted(ranked)[:in_all], key=lambda view: view[1:])
    return tuple((camera, frame) for _, _, camera, frame in chosen)


def view_rmse_px(evidence: Evidence) -> tuple[NDArray[np.int64], Floats]:
    """(V, 2) camera and frame index of every view, and (V,) its RMSE in pixels over all its corners."""
    keys = np.stack([evidence.camera_idx, evidence.frame_idx], axis=1)
    views, view_of, counts = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    squared = np.bincount(view_of.ravel(), weights=(evidence.residuals_px**2).sum(axis=1), minlength=len(views))
    return views, np.sqrt(squared / counts)


def with_pictures(evidence: Evidence, capture: Capture, views: Sequence[tuple[int, int]]) -> Evidence:
    """The same evidence with pictures of these (camera index, frame index) views, in their order.

    Args:
        evidence: Of a calibration of this capture.
        capture: Where the images are; only these views' frames are decoded.
        views: From :func:`worst_views`.

    Raises:
        BrokenFileError: where an image or video cannot be decoded any more.
    """
    by_id = {camera.id: camera for camera in capture.cameras}
    found: dict[tuple[int, int], ViewPicture] = {}
    for camera_idx in sorted({camera for camera, _ in views}):
        camera, names = by_id[evidence.camera_ids[camera_idx]], evidence.frames[camera_idx]
        place = {name: index for index, name in enumerate(camera.frames)}
        frame_at = {place[names[frame]]: frame for c, frame in views if c == camera_idx}
        for index, image in read_frames_at(camera, sorted(frame_at), colour=True):
            frame = frame_at[index]
            corners_px = evidence.pixels[evidence.rows_of(camera_idx, frame)]
            found[camera_idx, frame] = cut_out(camera_idx, frame, image, corners_px)
    return replace(evidence, pictures=tuple(found[view] for view in views))


def cut_out(camera_idx: int, frame_idx: int, image: NDArray[np.uint8], corners_px: Floats) -> ViewPicture:
    """The part of an image (H, W, 3) around corners (n, 2), at most :data:`LONGEST_PX` long."""
    size_wh = np.array(image.shape[1::-1])
    low, high = corners_px.min(axis=0), corners_px.max(axis=0)
    room = MARGIN * float((high - low).max()) + 2
    left, top = (int(v) for v in np.clip(np.floor(low - room), 0, size_wh - 1))
    right, bottom = (int(v) for v in np.clip(np.ceil(high + room) + 1, (left + 1, top + 1), size_wh))
    part = image[top:bottom, left:right]
    shrink = min(1.0, LONGEST_PX / max(part.shape[:2]))
    if shrink < 1:
        wide, tall = (max(round(side * shrink), 1) for side in (right - left, bottom - top))
        part = np.asarray(cv2.resize(part, (wide, tall), interpolation=cv2.INTER_AREA), dtype=np.uint8)
    return ViewPicture(camera_idx, frame_idx, (left, top, right - left, bottom - top), _jpeg(part))


def _jpeg(image: NDArray[np.uint8]) -> bytes:
    content = b""
    for quality in QUALITIES:
        content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
        if len(content) <= GREATEST_BYTES:
            break
    return content
