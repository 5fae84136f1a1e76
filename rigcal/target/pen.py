"""A pen that draws on a PDF page in millimetres, and the view that lays a pattern on it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from reportlab.pdfgen.canvas import Canvas

from rigcal.geometry import Floats
from rigcal.target.caption import BOLD, FONT, FONT_PT, POINTS_PER_MM
from rigcal.target.paper import Rect

HAIR_MM, THIN_MM = 0.1, 0.25
"""Widths of lines: a ruler's, and all others'."""
_NON_ZERO_WINDING = 1


@dataclass(frozen=True, slots=True)
class Pen:
    """Draws in millimetres, x to the right and y down from the page's top-left corner, or from a band's."""

    canvas: Canvas
    page_height_mm: float
    """Height of the page, 0 within a band: the canvas counts y upwards."""

    def line(self, x0: float, y0: float, x1: float, y1: float, *, width_mm: float = THIN_MM) -> None:
        """A black line."""
        self.canvas.setLineWidth(width_mm * POINTS_PER_MM)
        self.canvas.line(*self._points(x0, y0), *self._points(x1, y1))

    def text(self, x: float, y: float, words: str, *, size_pt: float = FONT_PT, bold: bool = False) -> None:
        """Words whose base line begins at (x, y)."""
        self.canvas.setFont(BOLD if bold else FONT, size_pt)
        self.canvas.drawString(*self._points(x, y), words)

    def centred(self, x: float, y: float, words: str, *, size_pt: float) -> None:
        """Bold words whose base line has its middle at (x, y)."""
        self.canvas.setFont(BOLD, size_pt)
        self.canvas.drawCentredString(*self._points(x, y), words)

    def fill(self, rectangles: Floats, *, grey: float = 0.0) -> None:
        """Rectangles (N, 4) of left, top, right and bottom, as one path."""
        path = self.canvas.beginPath()
        for left, top, right, bottom in rectangles:
            x, y = self._points(left, bottom)
            path.rect(x, y, (right - left) * POINTS_PER_MM, (bottom - top) * POINTS_PER_MM)
        self.canvas.setFillGray(grey)
        self.canvas.drawPath(path, stroke=0, fill=1, fillMode=_NON_ZERO_WINDING)
        self.canvas.setFillGray(0)

    def outline(self, box: Rect) -> None:
        """The four sides of a rectangle."""
        self.line(box.left, box.top, box.right, box.top)
        self.line(box.right, box.top, box.right, box.bottom)
        self.line(box.right, box.bottom, box.left, box.bottom)
        self.line(box.left, box.bottom, box.left, box.top)

    def dot(self, x: float, y: float, radius_mm: float) -> None:
        """A black disc."""
        self.canvas.circle(*self._points(x, y), radius_mm * POINTS_PER_MM, stroke=0, fill=1)

    @contextmanager
    def along(self, band: Rect, *, turned: bool) -> Iterator[Pen]:
        """A pen whose origin is the band's corner; in a turned band x runs up the page and y to its right."""
        self.canvas.saveState()
        self.canvas.translate(*self._points(band.left, band.bottom if turned else band.top))
        if turned:
            self.canvas.rotate(90)
        yield Pen(self.canvas, 0.0)
        self.canvas.restoreState()

    def _points(self, x: float, y: float) -> tuple[float, float]:
        return x * POINTS_PER_MM, (self.page_height_mm - y) * POINTS_PER_MM


@dataclass(frozen=True, slots=True)
class View:
    """Where points of the pattern lie on the page: ``corner + sign * scale * point``."""

    corner: tuple[float, float]
    """Where the pattern's top-left corner lies."""
    sign: tuple[int, int] = (1, 1)
    """-1 for an axis that is mirrored."""
    scale: float = 1.0

    def __call__(self, x: float, y: float) -> tuple[float, float]:
        """A point of the pattern, on the page."""
        (left, top), (sign_x, sign_y) = self.corner, self.sign
        return left + sign_x * self.scale * x, top + sign_y * self.scale * y

    def rectangles(self, rectangles: Floats) -> Floats:
        """Rectangles (N, 4) of the pattern, on the page."""
        ends = np.tile(self.corner, 2) + np.tile(self.sign, 2) * self.scale * rectangles
        return np.concatenate([np.minimum(ends[:, :2], ends[:, 2:]), np.maximum(ends[:, :2], ends[:, 2:])], axis=1)
