"""A few images that speak for many: those in which something like a board is seen."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice

import cv2
import numpy as np

from rigcal.captures import Capture, CaptureCamera, read_frames, read_image
from rigcal.detect.found import Grey

LOOKED_AT, SAMPLED = 40, 10
"""Images that are looked at, evenly over the cameras' frames, and those of them that are searched."""
COUNTED = 60
"""Stills up to which another board is counted in all of them."""
CROSSINGS = 12
"""A board of 4x3 corners shows as many; rooms seldom show a dozen that are as clear."""


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """An image of the sample."""

    camera: int
    """Index of its camera."""
    frame: int
    """Index of its frame."""
    grey: Grey
    """(height, width) 8-bit image."""


def every_frame(capture: Capture, cameras: Sequence[int]) -> list[tuple[int, int]]:
    """(camera, frame) of every frame of some cameras."""
    return [(c, k) for c in cameras for k in range(len(capture.cameras[c].frames))]


def sample_shots(capture: Capture, cameras: Sequence[int], pool: ThreadPoolExecutor) -> list[Shot]:
    """At most :data:`SAMPLED` images, those first in which a board is most likely seen."""
    every = every_frame(capture, cameras)
    spread = [every[k] for k in np.unique(np.linspace(0, len(every) - 1, LOOKED_AT).round().astype(int))]
    best: list[tuple[float, Shot]] = []
    for c in cameras:
        shots = list(_shots(capture.cameras[c], c, [frame for camera, frame in spread if camera == c]))
        best += zip(pool.map(_clearest_crossings, shots), shots, strict=True)
        best = sorted(best, key=lambda entry: -entry[0])[:SAMPLED]
    return [shot for _, shot in best]


def _shots(camera: CaptureCamera, index: int, frames: Sequence[int]) -> Iterator[Shot]:
    if camera.kind == "images":
        yield from (Shot(index, frame, read_image(camera, camera.paths[frame])) for frame in frames)
    elif frames:
        wanted = set(frames)
        read = islice(read_frames(camera), max(wanted) + 1)
        yield from (Shot(index, frame, image) for frame, image in read if frame in wanted)


def _clearest_crossings(shot: Shot) -> float:
    """How clear the twelfth clearest crossing of an image is, in a small or a very small copy, whichever is clearer.

    At the crossing of two edges the grey values form a saddle, whose Hessian has a negative determinant; along a single
    edge it is zero.
    """
    clearest = 0.0
    for longest_px in (960, 240):
        scale = min(1.0, longest_px / max(shot.grey.shape))
        small = cv2.resize(shot.grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA).astype(np.float32)
        smooth = cv2.GaussianBlur(small, (0, 0), 1.5)
        xx, yy, xy = (cv2.Sobel(smooth, cv2.CV_32F, *order) for order in ((2, 0), (0, 2), (1, 1)))
        saddle = xy**2 - xx * yy
        peaks = np.sort(saddle[saddle == cv2.dilate(saddle, np.ones((7, 7), np.uint8))])
        clearest = max(clearest, float(peaks[-CROSSINGS]) if len(peaks) >= CROSSINGS else 0.0)
    return clearest
