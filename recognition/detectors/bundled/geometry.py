"""Coordinates of the bundled networks' inputs; what trains the networks shares them.

Inside, coordinates count from the left and top **edge** of an image or of a network's input, because scaling is a
multiplication there. Pixels with whole numbers at their centres, as everywhere else in the project, are
``x = u - 0.5``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rigcal.geometry import Floats

SITE_WH = (512, 288)
"""Input of the site network in pixels."""
SITE_STRIDES = (8, 16, 32)
"""Cells of the site network: the finest first."""
WORKER_WH = (96, 128)
"""Input of the worker network in pixels."""
WORKER_STRIDE = 4
"""Cells of the worker network."""
PAD = 114
"""Grey beside an image that does not fill the input."""
MARGIN = 1.25
"""The crop's height over that of the worker's box."""
LIFT = 0.05
"""How much higher than the box the crop's middle lies, of the crop's height: a raised hand or a hat needs room."""


@dataclass(frozen=True, slots=True)
class Placing:
    """``u_input = u_image * scale + offset``, per axis the same scale."""

    scale: float
    """Input pixels per image pixel."""
    offset: tuple[float, float]
    """Input pixels from the image's top-left edge."""

    def to_input(self, points: ArrayLike) -> Floats:
        """(..., 2) edge coordinates of the image as those of the input."""
        return np.asarray(points, dtype=np.float64) * self.scale + self.offset

    def to_image(self, points: ArrayLike) -> Floats:
        """(..., 2) edge coordinates of the input as those of the image."""
        return (np.asarray(points, dtype=np.float64) - self.offset) / self.scale

    def matrix(self) -> Floats:
        """(2, 3) for ``cv2.warpAffine``, which has pixel centres at whole numbers."""
        shift = np.array(self.offset) + 0.5 * self.scale - 0.5
        return np.array([[self.scale, 0.0, shift[0]], [0.0, self.scale, shift[1]]])


def crop_xyxy(boxes_xyxy: ArrayLike) -> Floats:
    """(P, 4) the region of the image around each worker's box (P, 4) that the worker network sees.

    Its aspect is the input's; it holds the box with ``MARGIN`` and lies higher by ``LIFT``. It may leave the image.
    """
    boxes = np.asarray(boxes_xyxy, dtype=np.float64).reshape(-1, 4)
    aspect = WORKER_WH[0] / WORKER_WH[1]
    wh = boxes[:, 2:] - boxes[:, :2]
    height = MARGIN * np.maximum(wh[:, 1], wh[:, 0] / aspect)
    half = np.stack([height * aspect, height], axis=-1) / 2
    middle = (boxes[:, :2] + boxes[:, 2:]) / 2
    middle[:, 1] -= LIFT * height
    return np.concatenate([middle - half, middle + half], axis=-1)


def crop_placing(crop: Floats, input_wh: tuple[int, int] = WORKER_WH) -> Placing:
    """How the crop (4,) lies in an input of its aspect."""
    scale = input_wh[1] / float(crop[3] - crop[1])
    return Placing(scale, (-float(crop[0]) * scale, -float(crop[1]) * scale))
