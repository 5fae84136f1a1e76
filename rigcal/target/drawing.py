"""The PDF of a planned target: vectors, true to scale, with rulers and words.

All black of a sheet is one path, so that a renderer's anti-aliasing leaves no seam between rectangles that touch. The
file asks viewers not to scale it, names no time and no chance: the same plan gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from io import BytesIO

import numpy as np
from reportlab.pdfgen.canvas import Canvas

from rigcal.geometry import Floats
from rigcal.target.caption import (
    BOLD,
    FONT,
    FONT_PT,
    LINE_MM,
    POINTS_PER_MM,
    SKETCH_MM,
    assembly_steps,
    symmetry_warning,
    wrapped,
)
from rigcal.target.layout import OVERLAP_MM, Sheet, TargetPlan
from rigcal.target.paper import RULER_MM, TICKS_MM, Rect

HAIR_MM, THIN_MM = 0.1, 0.25
GREY = 0.8
TITLE_PT, STEP_PT, STEP_MM = 14.0, 9.0, 4.2
NON_ZERO_WINDING = 1


def draw_target(plan: TargetPlan) -> bytes:
    """The PDF: for several sheets first a page that says how they belong together; the back of a board last."""
    file = BytesIO()
    width, height = plan.frame.page_mm
    canvas = Canvas(file, pagesize=(width * POINTS_PER_MM, height * POINTS_PER_MM), pageCompression=1, invariant=1)
    canvas.setTitle(plan.board.spec)
    canvas.setCreator("rigcal target")
    canvas.setViewerPreference("PrintScaling", "None")
    pen = _Pen(canvas, height)
    if plan.tiled:
        _draw_overview(pen, plan)
        canvas.showPage()
    for sheet in plan.sheets:
        _draw_sheet(pen, plan, sheet, _front(sheet))
        canvas.showPage()
    if plan.two_sided:
        canvas.setViewerPreference("Duplex", "DuplexFlipLongEdge")
        _draw_back(pen, plan)
        canvas.showPage()
    canvas.save()
    return file.getvalue()


@dataclass(frozen=True, slots=True)
class _Pen:
    """Draws in millimetres, x to the right and y down from the page's top-left corner, or from a band's."""

    canvas: Canvas
    page_height_mm: float

    def line(self, x0: float, y0: float, x1: float, y1: float, *, width_mm: float = THIN_MM) -> None:
        self.canvas.setLineWidth(width_mm * POINTS_PER_MM)
        self.canvas.line(*self._points(x0, y0), *self._points(x1, y1))

    def text(self, x: float, y: float, words: str, *, size_pt: float = FONT_PT, bold: bool = False) -> None:
        """Words whose base line begins at (x, y)."""
        self.canvas.setFont(BOLD if bold else FONT, size_pt)
        self.canvas.drawString(*self._points(x, y), words)

    def centred(self, x: float, y: float, words: str, *, size_pt: float = FONT_PT, bold: bool = False) -> None:
        self.canvas.setFont(BOLD if bold else FONT, size_pt)
        self.canvas.drawCentredString(*self._points(x, y), words)

    def fill(self, rectangles: Floats, *, grey: float = 0.0) -> None:
        """(N, 4) left, top, right, bottom."""
        path = self.canvas.beginPath()
        for left, top, right, bottom in rectangles:
            x, y = self._points(left, bottom)
            path.rect(x, y, (right - left) * POINTS_PER_MM, (bottom - top) * POINTS_PER_MM)
        self.canvas.setFillGray(grey)
        self.canvas.drawPath(path, stroke=0, fill=1, fillMode=NON_ZERO_WINDING)
        self.canvas.setFillGray(0)

    def outline(self, box: Rect) -> None:
        self.line(box.left, box.top, box.right, box.top)
        self.line(box.right, box.top, box.right, box.bottom)
        self.line(box.right, box.bottom, box.left, box.bottom)
        self.line(box.left, box.bottom, box.left, box.top)

    def dot(self, x: float, y: float, radius_mm: float) -> None:
        self.canvas.circle(*self._points(x, y), radius_mm * POINTS_PER_MM, stroke=0, fill=1)

    @contextmanager
    def along(self, band: Rect, *, turned: bool) -> Iterator[_Pen]:
        """A pen whose origin is the band's corner; in a turned band x runs up the page and y to its right."""
        self.canvas.saveState()
        self.canvas.translate(*self._points(band.left, band.bottom if turned else band.top))
        if turned:
            self.canvas.rotate(90)
        yield _Pen(self.canvas, 0.0)
        self.canvas.restoreState()

    def _points(self, x: float, y: float) -> tuple[float, float]:
        return x * POINTS_PER_MM, (self.page_height_mm - y) * POINTS_PER_MM


@dataclass(frozen=True, slots=True)
class _View:
    """Where points of the pattern lie on the page: ``corner + sign * scale * point``."""

    corner: tuple[float, float]
    sign: tuple[int, int] = (1, 1)
    scale: float = 1.0

    def __call__(self, x: float, y: float) -> tuple[float, float]:
        (left, top), (sign_x, sign_y) = self.corner, self.sign
        return left + sign_x * self.scale * x, top + sign_y * self.scale * y

    def rectangles(self, rectangles: Floats) -> Floats:
        ends = np.tile(self.corner, 2) + np.tile(self.sign, 2) * self.scale * rectangles
        return np.concatenate([np.minimum(ends[:, :2], ends[:, 2:]), np.maximum(ends[:, :2], ends[:, 2:])], axis=1)


def _front(sheet: Sheet) -> _View:
    return _View(sheet.pattern_left_top_mm)


def _draw_sheet(pen: _Pen, plan: TargetPlan, sheet: Sheet, view: _View) -> None:
    frame = plan.frame
    pen.fill(_inside(view.rectangles(plan.pattern.black_mm), frame.window))
    for band, turned in ((frame.bottom_band, False), (frame.left_band, True)):
        length, depth = (band.height, band.width) if turned else (band.width, band.height)
        worded = frame.words_below != turned
        with pen.along(band, turned=turned) as along:
            for row, line in enumerate(frame.lines if worded else ()):
                along.text(0, (row + 0.8) * LINE_MM, line, bold=row == 0)
            _draw_ruler(along, LINE_MM * len(frame.lines) if worded else depth - depth)
        if worded:
            box = _end_of(band, turned=turned, length_mm=length)
            _draw_sketch(pen, plan, box, sign=view.sign, current=sheet)
    if plan.tiled:
        _draw_ticks(pen, plan, sheet)
        name = f"row {sheet.row + 1}, column {sheet.column + 1}"
        pen.centred(frame.window.left + frame.window.width / 2, frame.window.bottom + 3.5, name, size_pt=9, bold=True)


def _draw_back(pen: _Pen, plan: TargetPlan) -> None:
    """The only sheet as it is seen through the paper, turned over its long edge; its words read as ever."""
    (width, height), (sheet,) = plan.frame.page_mm, plan.sheets
    left, top = sheet.pattern_left_top_mm
    if width > height:

        def turned(box: Rect) -> Rect:
            return replace(box, top=height - box.bottom)

        view = _View((left, height - top), (1, -1))
    else:

        def turned(box: Rect) -> Rect:
            return replace(box, left=width - box.right)

        view = _View((width - left, top), (-1, 1))
    frame = replace(
        plan.frame,
        window=turned(plan.frame.window),
        bottom_band=turned(plan.frame.bottom_band),
        left_band=turned(plan.frame.left_band),
    )
    _draw_sheet(pen, replace(plan, frame=frame), sheet, view)


def _inside(rectangles: Floats, window: Rect) -> Floats:
    low, high = [window.left, window.top], [window.right, window.bottom]
    cut = np.concatenate([np.clip(rectangles[:, :2], low, high), np.clip(rectangles[:, 2:], low, high)], axis=1)
    return np.asarray(cut[(cut[:, 2:] > cut[:, :2]).all(axis=1)])


def _end_of(band: Rect, *, turned: bool, length_mm: float) -> Rect:
    """The part of a band that the words leave free."""
    if turned:
        return replace(band, height=SKETCH_MM)
    return replace(band, left=band.left + length_mm - SKETCH_MM, width=SKETCH_MM)


def _draw_ruler(pen: _Pen, top_mm: float) -> None:
    pen.line(0, top_mm + 0.5, RULER_MM, top_mm + 0.5, width_mm=HAIR_MM)
    for tick in range(round(RULER_MM) + 1):
        length = 3.0 if tick % 10 == 0 else 2.2 if tick % 5 == 0 else 1.4
        pen.line(tick, top_mm + 0.5, tick, top_mm + 0.5 + length, width_mm=HAIR_MM)
        if tick % 10 == 0:
            words = f"{tick} mm" if tick == RULER_MM else f"{tick}"
            pen.text(tick + 0.4, top_mm + 5.2, words, size_pt=5)


def _draw_sketch(
    pen: _Pen, plan: TargetPlan, box: Rect, *, sign: tuple[int, int] = (1, 1), current: Sheet | None = None
) -> _View:
    """The board's outline with its origin and axes; of several sheets their windows too, the current one grey."""
    (width, height), (x0, y0) = plan.pattern.size_mm, plan.pattern.origin_mm
    scale = min((box.width - 6) / width, (box.height - 6) / height)
    middle = (box.left + box.width / 2, box.top + box.height / 2)
    view = _View((middle[0] - sign[0] * scale * width / 2, middle[1] - sign[1] * scale * height / 2), sign, scale)
    for sheet in plan.sheets if plan.tiled else ():
        left, top = (a - b for a, b in zip((plan.frame.window.left, plan.frame.window.top), sheet.pattern_left_top_mm))
        window = np.array([[left, top, left + plan.frame.window.width, top + plan.frame.window.height]])
        shown = view.rectangles(np.clip(window, 0, [width, height, width, height]))
        if sheet == current:
            pen.fill(shown, grey=GREY)
        pen.outline(Rect(shown[0, 0], shown[0, 1], shown[0, 2] - shown[0, 0], shown[0, 3] - shown[0, 1]))
    (left, top), (right, bottom) = view(0, 0), view(width, height)
    pen.outline(Rect(min(left, right), min(top, bottom), abs(right - left), abs(bottom - top)))
    origin = view(x0, y0)
    pen.dot(*origin, 0.7)
    for axis, name in ((0, "x"), (1, "y")):
        reach = 0.5 * scale * min(width, height) * sign[axis]
        end = (origin[0] + reach, origin[1]) if axis == 0 else (origin[0], origin[1] + reach)
        pen.line(*origin, *end)
        pen.text(end[0] + 0.5, end[1] + (0.7 if axis == 0 else 0.0), name)
    return view


def _draw_ticks(pen: _Pen, plan: TargetPlan, sheet: Sheet) -> None:
    """Short lines outside the window: where to cut this sheet, and where its neighbours' cut edges come to lie."""
    window = plan.frame.window
    xs = [(window.left, "CUT")] if sheet.column else []
    xs += [(window.right - OVERLAP_MM, "JOIN")] if sheet.column + 1 < plan.columns else []
    for x, name in xs:
        pen.line(x, window.top - TICKS_MM, x, window.top)
        pen.line(x, window.bottom, x, window.bottom + TICKS_MM)
        pen.text(x + 0.6, window.top - 2, name)
        pen.text(x + 0.6, window.bottom + 3.5, name)
    ys = [(window.top, "CUT")] if sheet.row else []
    ys += [(window.bottom - OVERLAP_MM, "JOIN")] if sheet.row + 1 < plan.rows else []
    for y, name in ys:
        pen.line(window.left - TICKS_MM, y, window.left, y)
        pen.line(window.right, y, window.right + TICKS_MM, y)
        pen.text(window.left - TICKS_MM, y + 2.6, name, size_pt=5)
        pen.text(window.right + 0.4, y + 2.6, name, size_pt=5)


def _draw_overview(pen: _Pen, plan: TargetPlan) -> None:
    frame = plan.frame
    left, width = frame.left_band.left, frame.window.right - frame.left_band.left
    top = frame.window.top + 5
    pen.text(left, top, plan.board.spec, size_pt=TITLE_PT, bold=True)
    title = f"{len(plan.sheets)} sheets: {plan.rows} rows of {plan.columns}"
    pen.text(left, top + 7, title + (f"; on {plan.fits_on} it fits as one sheet" if plan.fits_on else ""), size_pt=STEP_PT)
    steps = [f"{number}. {step}" for number, step in enumerate(assembly_steps(plan.rows, plan.columns), start=1)]
    if warning := symmetry_warning(plan.board):
        steps.append(f"Warning: {warning}")
    lines = wrapped(tuple(steps), width, STEP_PT)
    for row, line in enumerate(lines):
        pen.text(left, top + 14 + row * STEP_MM, line, size_pt=STEP_PT)
    used = 14 + len(lines) * STEP_MM
    box = Rect(left, top + used, width, frame.bottom_band.bottom - top - used)
    view = _draw_sketch(pen, plan, box)
    for sheet in plan.sheets:
        centre = [
            start - corner + size / 2
            for start, corner, size in zip(
                (frame.window.left, frame.window.top),
                sheet.pattern_left_top_mm,
                (frame.window.width, frame.window.height),
                strict=True,
            )
        ]
        inside = np.clip(centre, 0, plan.pattern.size_mm)
        pen.centred(*view(*inside), f"row {sheet.row + 1}, column {sheet.column + 1}", size_pt=STEP_PT, bold=True)
