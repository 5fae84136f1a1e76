"""The PDF of a planned target: vectors, true to scale, with rulers and words.

All black of a sheet is one path, so that a renderer's anti-aliasing leaves no seam between rectangles that touch. The
file asks viewers not to scale it, names no time and no chance: the same plan gives the same bytes.
"""

from __future__ import annotations

from dataclasses import replace
from io import BytesIO

import numpy as np
from reportlab.pdfgen.canvas import Canvas

from rigcal.geometry import Floats
from rigcal.target.caption import LINE_MM, POINTS_PER_MM, SKETCH_MM, assembly_steps, symmetry_warning, wrapped
from rigcal.target.layout import OVERLAP_MM, Sheet, TargetPlan
from rigcal.target.paper import RULER_MM, TICKS_MM, Rect
from rigcal.target.pen import HAIR_MM, Pen, View

GREY = 0.8
"""Shade of the current sheet in the sketch."""
TITLE_PT, STEP_PT, STEP_MM = 14.0, 9.0, 4.2
"""Sizes of the overview's title and steps, and the distance of their lines."""


def draw_target(plan: TargetPlan) -> bytes:
    """The PDF: for several sheets first a page that says how they belong together; the back of a board last."""
    file = BytesIO()
    width, height = plan.frame.page_mm
    canvas = Canvas(file, pagesize=(width * POINTS_PER_MM, height * POINTS_PER_MM), pageCompression=1, invariant=1)
    canvas.setTitle(plan.board.spec)
    canvas.setCreator("rigcal target")
    canvas.setViewerPreference("PrintScaling", "None")
    pen = Pen(canvas, height)
    if plan.tiled:
        _draw_overview(pen, plan)
        canvas.showPage()
    for sheet in plan.sheets:
        _draw_sheet(pen, plan, sheet, View(sheet.pattern_left_top_mm))
        canvas.showPage()
    if plan.two_sided:
        canvas.setViewerPreference("Duplex", "DuplexFlipLongEdge")
        _draw_back(pen, plan)
        canvas.showPage()
    canvas.save()
    return file.getvalue()


def _draw_sheet(pen: Pen, plan: TargetPlan, sheet: Sheet, view: View) -> None:
    frame = plan.frame
    pen.fill(_inside(view.rectangles(plan.pattern.black_mm), frame.window))
    for band, turned in ((frame.bottom_band, False), (frame.left_band, True)):
        worded = frame.words_below != turned
        with pen.along(band, turned=turned) as along:
            for row, line in enumerate(frame.lines if worded else ()):
                along.text(0, (row + 0.8) * LINE_MM, line, bold=row == 0)
            _draw_ruler(along, LINE_MM * len(frame.lines) if worded else 0.0)
        if worded:
            _draw_sketch(pen, plan, _end_of(band, turned=turned), sign=view.sign, current=sheet)
    if plan.tiled:
        _draw_ticks(pen, plan, sheet)
        name = f"row {sheet.row + 1}, column {sheet.column + 1}"
        pen.centred(frame.window.left + frame.window.width / 2, frame.window.bottom + 3.5, name, size_pt=9)


def _draw_back(pen: Pen, plan: TargetPlan) -> None:
    """The only sheet as it is seen through the paper, turned over its long edge; its words read as ever."""
    (width, height), (sheet,), frame = plan.frame.page_mm, plan.sheets, plan.frame
    left, top = sheet.pattern_left_top_mm
    lying = width > height
    view = View((left, height - top), (1, -1)) if lying else View((width - left, top), (-1, 1))
    window, below, beside = (
        replace(box, top=height - box.bottom) if lying else replace(box, left=width - box.right)
        for box in (frame.window, frame.bottom_band, frame.left_band)
    )
    turned = replace(frame, window=window, bottom_band=below, left_band=beside)
    _draw_sheet(pen, replace(plan, frame=turned), sheet, view)


def _inside(rectangles: Floats, window: Rect) -> Floats:
    low, high = [window.left, window.top], [window.right, window.bottom]
    cut = np.concatenate([np.clip(rectangles[:, :2], low, high), np.clip(rectangles[:, 2:], low, high)], axis=1)
    return np.asarray(cut[(cut[:, 2:] > cut[:, :2]).all(axis=1)])


def _end_of(band: Rect, *, turned: bool) -> Rect:
    """The part of a band that the words leave free."""
    return replace(band, height=SKETCH_MM) if turned else replace(band, left=band.right - SKETCH_MM, width=SKETCH_MM)


def _draw_ruler(pen: Pen, top_mm: float) -> None:
    pen.line(0, top_mm + 0.5, RULER_MM, top_mm + 0.5, width_mm=HAIR_MM)
    for tick in range(round(RULER_MM) + 1):
        length = 3.0 if tick % 10 == 0 else 2.2 if tick % 5 == 0 else 1.4
        pen.line(tick, top_mm + 0.5, tick, top_mm + 0.5 + length, width_mm=HAIR_MM)
        if tick % 10 == 0:
            words = f"{tick} mm" if tick == RULER_MM else f"{tick}"
            pen.text(tick + 0.4, top_mm + 5.2, words, size_pt=5)


def _draw_sketch(
    pen: Pen, plan: TargetPlan, box: Rect, *, sign: tuple[int, int] = (1, 1), current: Sheet | None = None
) -> View:
    """The board's outline with its origin and axes; of several sheets their windows too, the current one grey."""
    (width, height), (x0, y0) = plan.pattern.size_mm, plan.pattern.origin_mm
    scale = min((box.width - 6) / width, (box.height - 6) / height)
    middle = (box.left + box.width / 2, box.top + box.height / 2)
    view = View((middle[0] - sign[0] * scale * width / 2, middle[1] - sign[1] * scale * height / 2), sign, scale)
    for sheet in plan.sheets if plan.tiled else ():
        (shown,) = view.rectangles(plan.shown_mm(sheet)[None])
        if sheet == current:
            pen.fill(shown[None], grey=GREY)
        pen.outline(Rect(shown[0], shown[1], shown[2] - shown[0], shown[3] - shown[1]))
    (left, top), (right, bottom) = view(0, 0), view(width, height)
    pen.outline(Rect(min(left, right), min(top, bottom), abs(right - left), abs(bottom - top)))
    origin = view(x0, y0)
    pen.dot(*origin, 0.7)
    for axis, name in ((0, "x"), (1, "y")):
        reach = 0.4 * scale * min(width, height) * sign[axis]
        end = (origin[0] + reach, origin[1]) if axis == 0 else (origin[0], origin[1] + reach)
        pen.line(*origin, *end)
        pen.text(end[0] + 0.5, end[1] + (0.7 if axis == 0 else 0.0), name)
    return view


def _draw_ticks(pen: Pen, plan: TargetPlan, sheet: Sheet) -> None:
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


def _draw_overview(pen: Pen, plan: TargetPlan) -> None:
    frame = plan.frame
    left, width = frame.left_band.left, frame.window.right - frame.left_band.left
    top = frame.window.top + 5
    pen.text(left, top, plan.board.spec, size_pt=TITLE_PT, bold=True)
    title = f"{len(plan.sheets)} sheets, {plan.rows} x {plan.columns} (rows x columns)"
    pen.text(
        left, top + 7, title + (f"; on {plan.fits_on} it fits as one sheet" if plan.fits_on else ""), size_pt=STEP_PT
    )
    steps = assembly_steps(plan.rows, plan.columns, plan.pattern)
    numbered = [f"{number}. {step}" for number, step in enumerate(steps, start=1)]
    if warning := symmetry_warning(plan.board):
        numbered.append(f"Warning: {warning}")
    lines = wrapped(tuple(numbered), width, STEP_PT)
    for row, line in enumerate(lines):
        pen.text(left, top + 14 + row * STEP_MM, line, size_pt=STEP_PT)
    used = 14 + len(lines) * STEP_MM
    box = Rect(left, top + used, width, frame.bottom_band.bottom - top - used)
    view = _draw_sketch(pen, plan, box)
    for sheet in plan.sheets:
        middle = plan.shown_mm(sheet).reshape(2, 2).mean(axis=0)
        pen.centred(*view(*middle), f"row {sheet.row + 1}, column {sheet.column + 1}", size_pt=STEP_PT)
