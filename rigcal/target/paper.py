"""The paper: page sizes, what the printer can reach of them, and how a sheet is divided.

Page coordinates are millimetres from the page's top-left corner, x to the right and y down. Along the bottom and the
left of every sheet lie two bands, one with the words and a ruler, one with the other ruler; the window is what remains
inside the printer's margin.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from rigcal.board import Board, parse_length
from rigcal.errors import TargetError
from rigcal.target.caption import LINE_MM, SKETCH_MM, captions, wrapped
from rigcal.target.pattern import Pattern

PAGES = {
    "A5": (148.0, 210.0),
    "letter": (215.9, 279.4),
    "A4": (210.0, 297.0),
    "legal": (215.9, 355.6),
    "tabloid": (279.4, 431.8),
    "A3": (297.0, 420.0),
    "A2": (420.0, 594.0),
    "A1": (594.0, 841.0),
    "A0": (841.0, 1189.0),
}
"""Width and height of pages in mm, upright, from small to large."""
US_PAGES = frozenset({"letter", "legal", "tabloid"})
"""Who has one of these in the printer has the others rather than A4."""
RULER_MM = 100.0
RULER_BAND_MM = 6.0
"""A ruler with its numbers."""
TICKS_MM = 5.0
"""Room around a window for the marks of cutting and joining."""
LEAST_WINDOW_MM = RULER_MM + 10.0
"""A ruler and the number at its end."""
LARGEST_PAGE_MM = 5080.0
"""The PDF format's limit of 14400 points."""


@dataclass(frozen=True, slots=True)
class TargetOptions:
    """The paper and how to use it.

    Raises:
        TargetError: for a margin outside its range.
    """

    page_mm: tuple[float, float] = PAGES["A4"]
    """Width and height of the page."""
    landscape: bool | None = None
    """Whether the page lies; None: as the pattern fits best."""
    margin_mm: float = 10.0
    """Edge of the page that the printer cannot print on."""
    two_sided: bool = False
    """Add the mirrored back, whose corners lie behind the front's."""

    def __post_init__(self) -> None:
        if not 0 <= self.margin_mm < min(self.page_mm) / 2:
            raise TargetError(
                "the printer's margin leaves no paper",
                where=f"page {page_text(self.page_mm)}",
                expected=f"a margin from 0 to less than {min(self.page_mm) / 2:g} mm",
                got=f"{self.margin_mm:g} mm",
                do_next="give a smaller --margin, or a larger --page",
            )

    @property
    def pages_mm(self) -> tuple[tuple[float, float], ...]:
        """The page as it may lie: upright, lying, or either."""
        upright = (min(self.page_mm), max(self.page_mm))
        lying = (upright[1], upright[0])
        return (upright, lying) if self.landscape is None else (lying,) if self.landscape else (upright,)


@dataclass(frozen=True, slots=True)
class Rect:
    """A rectangle on a page, in mm."""

    left: float
    """Distance of its left edge from the page's."""
    top: float
    """Distance of its top edge from the page's."""
    width: float
    height: float

    @property
    def right(self) -> float:
        """Its right edge."""
        return self.left + self.width

    @property
    def bottom(self) -> float:
        """Its bottom edge."""
        return self.top + self.height


@dataclass(frozen=True, slots=True)
class Frame:
    """How every sheet of a target is divided."""

    page_mm: tuple[float, float]
    """Width and height of the page as it lies."""
    white_mm: float
    """White beyond the window's top and right edge: the unprinted edge of the page, where it is not cut off."""
    window: Rect
    """The part that shows the pattern."""
    bottom_band: Rect
    left_band: Rect
    words_below: bool
    """Whether the words stand in the bottom band; else they stand in the left one, turned."""
    lines: tuple[str, ...]
    """The words, wrapped to the length of their band."""


def parse_page(text: str) -> tuple[float, float]:
    """Width and height in mm of a page's name, such as ``A3``, or of a size such as ``600x400mm``.

    Raises:
        TargetError: for anything else, and for a page beyond what a PDF can hold.
    """
    named = {name.lower(): size for name, size in PAGES.items()}
    if text.lower() in named:
        return named[text.lower()]
    match = re.fullmatch(r"(\d+\.?\d*)x(\d+\.?\d*)(mm|cm|m)", text)
    unit = {"mm": 1.0, "cm": 10.0, "m": 1000.0}[match[3]] if match else 0.0
    width, height = (float(match[1]) * unit, float(match[2]) * unit) if match else (0.0, 0.0)
    if not 0 < min(width, height) <= max(width, height) <= LARGEST_PAGE_MM:
        raise TargetError(
            "unknown page",
            where="--page",
            expected=f"{', '.join(PAGES)}, or width x height of at most {LARGEST_PAGE_MM:g} mm, as in 600x400mm",
            got=repr(text),
            do_next="name one of these pages, or give its size with a unit",
        )
    return width, height


def parse_margin(text: str) -> float:
    """A margin in mm.

    Raises:
        TargetError: for anything but a length with its unit.
    """
    metres = parse_length(
        text,
        lambda problem: TargetError(
            f"the margin: {problem}",
            where="--margin",
            expected="a length with its unit, as in 10mm",
            got=repr(text),
            do_next="give the edge that the printer cannot print on, 5mm to 15mm for most",
        ),
    )
    return metres * 1e3


def page_text(page_mm: tuple[float, float]) -> str:
    """A page as one says it: ``A4``, or ``600x400mm``."""
    upright = (min(page_mm), max(page_mm))
    return next((name for name, size in PAGES.items() if size == upright), f"{page_mm[0]:g}x{page_mm[1]:g}mm")


def divide(
    board: Board,
    pattern: Pattern,
    page_mm: tuple[float, float],
    options: TargetOptions,
    *,
    tiled: bool,
    words_below: bool,
) -> Frame | None:
    """The frame of a sheet, or None where the page has no room for two rulers and their words."""
    ticks, margin = TICKS_MM if tiled else 0.0, options.margin_mm
    length = page_mm[0 if words_below else 1] - 2 * (margin + ticks) - RULER_BAND_MM
    if length < LEAST_WINDOW_MM:
        return None
    lines = wrapped(captions(board, pattern, tiled=tiled, two_sided=options.two_sided), length - SKETCH_MM)
    words = RULER_BAND_MM + LINE_MM * len(lines)
    below, left = (words, RULER_BAND_MM) if words_below else (RULER_BAND_MM, words)
    window = Rect(
        margin + left + ticks,
        margin + ticks,
        page_mm[0] - 2 * (margin + ticks) - left,
        page_mm[1] - 2 * (margin + ticks) - below,
    )
    if min(window.width, window.height) < LEAST_WINDOW_MM:
        return None
    return Frame(
        page_mm,
        0.0 if tiled else margin,
        window,
        Rect(window.left, window.bottom + ticks, window.width, below),
        Rect(margin, window.top, left, window.height),
        words_below,
        lines,
    )
