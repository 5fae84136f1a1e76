"""Places where a picture looks like a checker crossing: saddles of the brightness, with the directions of their edges.

At a crossing the brightness is nearly ``step * d1 * d2``, with d the distances from its two edges: light along one
bisector and dark along the other. So the determinant of the second derivatives is negative there and lowest at the
crossing (P. Beaudet, "Rotationally invariant image operators", ICPR 1978), the directions in which the second
derivative vanishes are those of the edges, and the gradient tells where between the pixels the crossing lies.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rigcal.detect.found import Grey
from rigcal.geometry import Bools, Floats

LEAST_STEP = 5.0
"""Half the step between dark and light, in grey levels, below which a crossing drowns in the noise of a dim image."""
SHARPEST_PX = 1.6
"""Blur of the filters below and of a sharp lens together, in pixels, at which that step is meant."""
MOST_SADDLES = 3000
"""The strongest of an image; foliage and gravel have many thousands, and a board is stronger than most of them."""
LEAST_BALANCE = 0.06
"""Lesser curvature over greater: 1 at a right angle, 0.06 where edges meet at 28 degrees. Ends of lines have less."""
RING_PX, RING_STEPS = 3.2, 16
"""Radius of the circle on which dark and light must alternate twice, and places on it."""
_ANGLES = 2 * np.pi * np.arange(RING_STEPS) / RING_STEPS


@dataclass(frozen=True, slots=True, eq=False)
class Saddles:
    """The saddles of one image."""

    points_px: Floats
    """(n, 2) pixels, to about a quarter of one."""
    light: Floats
    """(n,) direction of the bisector of the light quadrants, radians, without sign."""
    edges: Floats
    """(n, 2, 2) unit vectors along the two edges, the second to the right-hand side of the first as the image shows it."""

    def only(self, kept: Bools) -> Saddles:
        """Those that ``kept`` (n,) marks."""
        return Saddles(self.points_px[kept], self.light[kept], self.edges[kept])


def find_saddles(grey: Grey) -> Saddles:
    """Saddles of a (height, width) 8-bit image where dark and light alternate twice on a small circle."""
    smooth = cv2.GaussianBlur(grey, (3, 3), 0)
    xx, xy, yy = (
        cv2.Sobel(smooth, cv2.CV_16S, dx, dy, ksize=5, scale=scale)
        for dx, dy, scale in ((2, 0, 1.0), (1, 1, 1.0), (0, 2, 1.0))
    )
    strength = cv2.multiply(xy, xy, dtype=cv2.CV_32F)
    strength -= cv2.multiply(xx, yy, dtype=cv2.CV_32F)
    column, row = _peaks(strength)
    at = (row, column)
    a, b, c = (d[at].astype(np.float64) / 64 for d in (xx, xy, yy))
    points, light, edges, balance = _geometry(smooth, column, row, a, b, c)
    saddles = Saddles(points, light, edges)
    saddles = saddles.only(balance > LEAST_BALANCE)
    return saddles.only(_alternate(smooth, saddles))


def _peaks(strength: NDArray[np.float32]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Columns and rows of the strongest local maxima, in the order of the image."""
    least = (64 * 2 * LEAST_STEP / (np.pi * SHARPEST_PX**2)) ** 2
    highest = cv2.dilate(strength, np.ones((3, 3), np.uint8))
    peaks = cv2.findNonZero(((strength >= highest) & (strength > least)).view(np.uint8))
    if peaks is None:
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    column, row = peaks.reshape(-1, 2).T.astype(np.intp)
    height, width = strength.shape
    kept = (column > 3) & (column < width - 4) & (row > 3) & (row < height - 4)
    column, row = column[kept], row[kept]
    if len(column) > MOST_SADDLES:
        strongest = np.sort(np.argsort(-strength[row, column], kind="stable")[:MOST_SADDLES])
        column, row = column[strongest], row[strongest]
    return column, row


def _geometry(smooth: NDArray[Any], column: NDArray[np.intp], row: NDArray[np.intp], a: Floats, b: Floats, c: Floats):
    """Points, light bisectors, edges and balance, from the second derivatives ``a b c`` (xx, xy, yy) at the peaks."""
    near = smooth.astype(np.float32) if len(column) == 0 else smooth
    dx = (near[row, column + 1].astype(np.float64) - near[row, column - 1]) / 2
    dy = (near[row + 1, column].astype(np.float64) - near[row - 1, column]) / 2
    determinant = a * c - b * b
    determinant = np.where(determinant < 0, determinant, -1.0)
    shift = np.stack([-(c * dx - b * dy), -(a * dy - b * dx)], axis=1) / determinant[:, None]
    points = np.stack([column, row], axis=1) + np.clip(shift, -1.0, 1.0)
    root = np.sqrt(((a - c) / 2) ** 2 + b * b)
    light = 0.5 * np.arctan2(2 * b, a - c)
    high, low = (a + c) / 2 + root, root - (a + c) / 2
    opening = np.arctan(np.sqrt(np.maximum(high, 0) / np.maximum(low, 1e-9)))
    edges = np.stack([np.stack([np.cos(t), np.sin(t)], axis=-1) for t in (light - opening, light + opening)], axis=1)
    balance = np.minimum(high, low) / np.maximum(np.maximum(high, low), 1e-9)
    return points, light, edges, balance


def _alternate(smooth: NDArray[Any], saddles: Saddles) -> Bools:
    """(n,) whether the grey values on a circle around the saddle cross their middle four times, the same on both
    sides."""
    if not len(saddles.points_px):
        return np.zeros(0, dtype=bool)
    x = (saddles.points_px[:, :1] + RING_PX * np.cos(_ANGLES)).astype(np.float32)
    y = (saddles.points_px[:, 1:] + RING_PX * np.sin(_ANGLES)).astype(np.float32)
    ring = cv2.remap(smooth, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float64)
    middle = (ring.max(axis=1, keepdims=True) + ring.min(axis=1, keepdims=True)) / 2
    side = ring > middle
    changes = (side != np.roll(side, 1, axis=1)).sum(axis=1)
    half = RING_STEPS // 2
    odd, even = ring[:, :half] - ring[:, half:], ring[:, :half] + ring[:, half:] - 2 * middle
    return np.asarray((changes == 4) & ((odd**2).sum(axis=1) < 0.6 * (even**2).sum(axis=1)))
