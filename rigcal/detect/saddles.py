"""Places where a picture looks like a checker crossing: saddles of the brightness, with the directions of their edges.

At a crossing the brightness is nearly ``step * d1 * d2``, with d the distances from its two edges: light along one
bisector and dark along the other. So the determinant of the second derivatives is negative there and lowest at the
crossing (P. Beaudet, "Rotationally invariant image operators", ICPR 1978), and the gradient tells where between the
pixels the crossing lies. Blurred by a round spot, the curvatures along the two bisectors are equal and opposite
whatever the angle of the edges; so that angle is read from a small circle, on which the brightness must cross its
middle four times.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from rigcal.detect.found import Grey
from rigcal.geometry import Bools, Floats, Ints

LEAST_STEP = 5.0
"""Half the step between dark and light, in grey levels, below which a crossing drowns in the noise of a dim image."""
SHARPEST_PX = 1.6
"""Blur of the filters below and of a sharp lens together, in pixels, at which that step is meant."""
MOST_SADDLES = 3000
"""The strongest of an image; foliage and gravel have many thousands, and a board is stronger than most of them."""
LEAST_BALANCE = 0.3
"""Lesser curvature over greater, along the bisectors: 1 at a crossing, less at ends of lines and in textures."""
RING_PX, RING_STEPS = 3.2, 16
"""Radius of the circle on which dark and light must alternate twice, and places on it."""
MOST_ODD = 0.6
"""What differs between opposite places of the circle, over what they have in common (sums of squares)."""
SOBEL_GAIN = 4.0
"""Of OpenCV's second derivatives with three pixels."""
_ANGLES = 2 * np.pi * np.arange(RING_STEPS) / RING_STEPS


@dataclass(frozen=True, slots=True, eq=False)
class Saddles:
    """The saddles of one image."""

    points_px: Floats
    """(n, 2) pixels, to about a quarter of one."""
    light: Floats
    """(n,) direction of the bisector of the light quadrants, radians, without sign."""
    edges: Floats
    """(n, 2, 2) unit vectors along the two edges, the second clockwise from the first as the image shows them."""

    def only(self, kept: Bools) -> Saddles:
        """Those that ``kept`` (n,) marks."""
        return Saddles(self.points_px[kept], self.light[kept], self.edges[kept])


def find_saddles(grey: Grey) -> Saddles:
    """Saddles of a (height, width) 8-bit image where dark and light alternate twice on a small circle."""
    smooth = np.asarray(cv2.GaussianBlur(grey, (5, 5), 0), dtype=np.uint8)
    second = [cv2.Sobel(smooth, cv2.CV_16S, dx, dy, ksize=3) for dx, dy in ((2, 0), (1, 1), (0, 2))]
    xx, xy, yy = second
    strength = cv2.subtract(cv2.multiply(xy, xy, dtype=cv2.CV_32F), cv2.multiply(xx, yy, dtype=cv2.CV_32F))
    column, row = _peaks(np.asarray(strength, dtype=np.float32))
    curvature = np.stack([d[row, column] for d in second], axis=1).astype(np.float64) / SOBEL_GAIN
    level = _balance(curvature) > LEAST_BALANCE
    points, light = _fitted(smooth, column[level], row[level], curvature[level])
    return _with_edges(smooth, points, light)


def _peaks(strength: NDArray[np.float32]) -> tuple[Ints, Ints]:
    """Columns and rows of the strongest local maxima, in the order of the image."""
    least = (SOBEL_GAIN * 2 * LEAST_STEP / (np.pi * SHARPEST_PX**2)) ** 2
    highest = cv2.dilate(strength, np.ones((3, 3), np.uint8))
    row, column = np.divmod(np.flatnonzero((strength >= highest) & (strength > least)), strength.shape[1])
    height, width = strength.shape
    inside = (column > 3) & (column < width - 4) & (row > 3) & (row < height - 4)
    row, column = row[inside], column[inside]
    if len(column) > MOST_SADDLES:
        strongest = np.sort(np.argsort(-strength[row, column], kind="stable")[:MOST_SADDLES])
        row, column = row[strongest], column[strongest]
    return column, row


def _balance(curvature: Floats) -> Floats:
    """(n,) lesser over greater curvature along the principal directions; 0 where both have one sign."""
    xx, xy, yy = curvature.T
    mean, root = (xx + yy) / 2, np.sqrt(((xx - yy) / 2) ** 2 + xy**2)
    return np.asarray(np.maximum(root - np.abs(mean), 0) / np.maximum(root + np.abs(mean), 1e-9))


def _fitted(smooth: Grey, column: Ints, row: Ints, curvature: Floats) -> tuple[Floats, Floats]:
    """Points (n, 2) where the gradient vanishes, at most a pixel away, and light bisectors (n,)."""
    xx, xy, yy = curvature.T
    dx = (smooth[row, column + 1].astype(np.float64) - smooth[row, column - 1]) / 2
    dy = (smooth[row + 1, column].astype(np.float64) - smooth[row - 1, column]) / 2
    shift = np.stack([xy * dy - yy * dx, xy * dx - xx * dy], axis=1) / (xx * yy - xy**2)[:, None]
    return np.stack([column, row], axis=1) + np.clip(shift, -1.0, 1.0), 0.5 * np.arctan2(2 * xy, xx - yy)


def _with_edges(smooth: Grey, points: Floats, light: Floats) -> Saddles:
    """Those of the points around which the brightness crosses its middle four times, the same way on both sides."""
    x = (points[:, :1] + RING_PX * np.cos(_ANGLES)).astype(np.float32)
    y = (points[:, 1:] + RING_PX * np.sin(_ANGLES)).astype(np.float32)
    ring = np.zeros(x.shape)
    if len(points):
        ring = np.asarray(cv2.remap(smooth, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float64)
    ring -= (ring.max(axis=1, keepdims=True) + ring.min(axis=1, keepdims=True)) / 2
    following = np.roll(ring, -1, axis=1)
    crossed = (ring > 0) != (following > 0)
    half = RING_STEPS // 2
    odd, even = ring[:, :half] - ring[:, half:], ring[:, :half] + ring[:, half:]
    kept = (crossed.sum(axis=1) == 4) & ((odd**2).sum(axis=1) < MOST_ODD * (even**2).sum(axis=1))
    ring, following, crossed = ring[kept], following[kept], crossed[kept]
    which, k = np.nonzero(crossed)
    crossing = (k + ring[which, k] / (ring[which, k] - following[which, k])).reshape(-1, 4) * 2 * np.pi / RING_STEPS
    turns = (crossing[:, :2] + crossing[:, 2:] - np.pi) / 2
    return Saddles(points[kept], light[kept], np.stack([np.cos(turns), np.sin(turns)], axis=-1))
