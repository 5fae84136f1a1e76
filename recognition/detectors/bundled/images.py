"""From a camera's image to the bundled networks' inputs.

Shrinking needs averages, or limbs alias: means of 2 x 2, 4 x 4, ... pixels, which OpenCV computes fast, down to less
than twice the size, then bilinear. From 1920 x 1080 to 512 x 288 that takes 0.8 ms where means over the exact areas
take 7.1; on a video the two differ by 0.4 grey levels on average.

Both networks shrink the same image: ``halves`` does once what they share. Without it their inputs are the same.
"""

from __future__ import annotations

from math import ceil, floor, log2

import cv2
import numpy as np
from numpy.typing import NDArray

from recognition.detectors.bundled.geometry import PAD, SITE_WH, WORKER_WH, Placing
from recognition.detectors.fit import Fit

Image = NDArray[np.uint8]


def halves(image_bgr: Image) -> tuple[Image, ...]:
    """The image (H, W, 3) and the means of its 2 x 2, 4 x 4, ... pixels, as far as the site network's input needs them.

    Ends before that where a side is odd, so that every pixel is a mean of whole ones.

    Raises:
        ValueError: where the image is not (H, W, 3) uint8.
    """
    _require_bgr(image_bgr)
    levels = [image_bgr]
    for _ in range(_halvings(_site_scale(image_bgr))):
        if levels[-1].shape[0] % 2 or levels[-1].shape[1] % 2:
            break
        levels.append(_shrunk(levels[-1], 1))
    return tuple(levels)


def site_input(image_bgr: Image, *smaller: Image) -> Fit:
    """The whole image (H, W, 3) in the middle of the site network's input, as large as it fits.

    Args:
        image_bgr: The image.
        smaller: The others of its ``halves``, where somebody has them; they only save time.

    Raises:
        ValueError: where the image is not (H, W, 3) uint8.
    """
    _require_bgr(image_bgr)
    image_h, image_w = image_bgr.shape[:2]
    scale = _site_scale(image_bgr)
    width, height = max(round(image_w * scale), 1), max(round(image_h * scale), 1)
    left, top = (SITE_WH[0] - width) // 2, (SITE_WH[1] - height) // 2
    scale_xy, offset_xy = np.array([width / image_w, height / image_h]), np.array([left, top], dtype=np.float64)
    shrunk = _shrunk(*_nearest((image_bgr, *smaller), _halvings(float(scale_xy.min()))))
    resized = np.asarray(cv2.resize(shrunk, (width, height)), np.uint8)
    if (width, height) == SITE_WH:
        return Fit(resized[None], scale_xy, offset_xy)
    canvas = np.full((1, SITE_WH[1], SITE_WH[0], 3), PAD, np.uint8)
    canvas[0, top : top + height, left : left + width] = resized
    return Fit(canvas, scale_xy, offset_xy)


def worker_input(image_bgr: Image, placing: Placing, *smaller: Image) -> Image:
    """(128, 96, 3) a crop of the image (H, W, 3) as it is placed in the input, grey where it leaves the image.

    Only what the crop shows is read. ``smaller`` are the others of the image's ``halves``, where somebody has them;
    they only save time.
    """
    halvings = _halvings(placing.scale)
    fold = 1 << halvings
    left, right = _seen(placing, 0, fold, image_bgr.shape[1])
    top, bottom = _seen(placing, 1, fold, image_bgr.shape[0])
    if right <= left or bottom <= top:
        return np.full((WORKER_WH[1], WORKER_WH[0], 3), PAD, np.uint8)
    nearest, left_over = _nearest((image_bgr, *smaller), halvings)
    part = nearest[top << left_over : bottom << left_over, left << left_over : right << left_over]
    x, y = placing.to_input((left * fold, top * fold)).tolist()
    matrix = Placing(placing.scale * fold, (x, y)).matrix()
    return np.asarray(
        cv2.warpAffine(_shrunk(part, left_over), matrix, WORKER_WH, borderValue=(PAD, PAD, PAD)), np.uint8
    )


def _require_bgr(image: Image) -> None:
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        raise ValueError(f"image_bgr: expected (H, W, 3) uint8, got {image.shape} {image.dtype}")


def _site_scale(image: Image) -> float:
    """Input pixels per image pixel at which the image just fits the site network's input."""
    return float(min(SITE_WH[0] / image.shape[1], SITE_WH[1] / image.shape[0]))


def _seen(placing: Placing, axis: int, fold: int, length: int) -> tuple[int, int]:
    """First column (axis 0) or row that the crop needs of the image shrunk ``fold`` times, and the one after the last.

    ``length`` is that of the image's side.
    """
    low, high = ((edge - placing.offset[axis]) / placing.scale / fold for edge in (0.0, WORKER_WH[axis]))
    return max(floor(low) - 1, 0), min(ceil(high) + 1, length // fold)


def _halvings(scale: float) -> int:
    """How often the image can be halved before it is smaller than at ``scale``."""
    return max(floor(-log2(scale)), 0)


def _nearest(levels: tuple[Image, ...], halvings: int) -> tuple[Image, int]:
    """The one of an image's halves that is nearest to so many halvings, and how many are left to do."""
    level = min(halvings, len(levels) - 1)
    return levels[level], halvings - level


def _shrunk(image: Image, halvings: int) -> Image:
    """Means of 2 x 2, 4 x 4, ... pixels, by halves: OpenCV takes 0.07 ms for 528 x 396 pixels to a quarter so, and
    0.22 ms at once."""
    for _ in range(halvings):
        size_wh = (-(-image.shape[1] // 2), -(-image.shape[0] // 2))
        image = np.asarray(cv2.resize(image, size_wh, interpolation=cv2.INTER_AREA), np.uint8)
    return image
