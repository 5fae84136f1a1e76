"""Where a pattern lies on the paper: one sheet where it fits, several that overlap where it does not.

The pattern keeps its size whatever the paper; the number of sheets grows.

Context: a white margin of a whole square would cost the usual 9x6 board of 25 mm its A4 sheet. Decision: the pattern
goes where its narrowest margin is widest, the unprinted edge of the paper counts as the white that it is, and a quarter
of a square is enough. Cost: a ruler may come nearer to the pattern than one square. On rendered pages every kind of
board is found with all its corners from no margin at all upwards.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from rigcal.board import Board, Charuco
from rigcal.errors import TargetError
from rigcal.geometry import Floats
from rigcal.target.paper import PAGES, RULER_MM, US_PAGES, Frame, TargetOptions, divide, page_text
from rigcal.target.pattern import Pattern, pattern_of

OVERLAP_MM = 10.0
"""Width of the strip that neighbouring sheets share."""
LEAST_QUIET_SQUARES = 0.25
"""White around the pattern, at least."""
MOST_SHEETS = 50
"""Fifty A4 sheets make two square metres; nobody glues more of them flat."""


@dataclass(frozen=True, slots=True)
class Sheet:
    """One printed sheet: a window onto the whole pattern."""

    row: int
    column: int
    pattern_left_top_mm: tuple[float, float]
    """Where the pattern's top-left corner would lie on this page; on later sheets that is outside of it."""


@dataclass(frozen=True, slots=True, eq=False)
class TargetPlan:
    """Everything that the drawing needs to know."""

    board: Board
    pattern: Pattern
    frame: Frame
    rows: int
    """Sheets below each other."""
    columns: int
    """Sheets beside each other."""
    first_left_top_mm: tuple[float, float]
    """Where the pattern's top-left corner lies on the first sheet."""
    quiet_mm: float
    """White around the pattern, at its narrowest."""
    two_sided: bool
    fits_on: str | None = None
    """For a pattern on several sheets, the smallest known page that holds all of it; None where none does."""

    @property
    def tiled(self) -> bool:
        """Whether the pattern is glued together from several sheets."""
        return self.rows * self.columns > 1

    @property
    def sheets(self) -> tuple[Sheet, ...]:
        """The sheets, row by row."""
        (left, top), window = self.first_left_top_mm, self.frame.window
        step_x, step_y = window.width - OVERLAP_MM, window.height - OVERLAP_MM
        return tuple(
            Sheet(row, column, (left - column * step_x, top - row * step_y))
            for row in range(self.rows)
            for column in range(self.columns)
        )

    def shown_mm(self, sheet: Sheet) -> Floats:
        """(4,) left, top, right and bottom of the part of the pattern that a sheet shows."""
        (left, top), window = sheet.pattern_left_top_mm, self.frame.window
        ends = np.array([window.left - left, window.top - top, window.right - left, window.bottom - top])
        return np.asarray(np.clip(ends, 0, np.tile(self.pattern.size_mm, 2)))


def plan_target(board: Board, options: TargetOptions) -> TargetPlan:
    """Lay a board out: on as few sheets as possible, with as much white around it as they allow.

    Raises:
        TargetError: where the board cannot be printed true to scale on that paper; the message says what would do.
    """
    if options.two_sided and not isinstance(board, Charuco):
        raise TargetError(
            "only ChArUco boards can have two sides",
            where=board.spec,
            expected="a charuco board with --two-sided",
            got=f"kind {board.kind}",
            do_next="leave --two-sided out, or choose a charuco board",
        )
    pattern = pattern_of(board)
    plan = _best_plan(board, pattern, options)
    if plan is not None and not plan.tiled:
        return plan
    page = page_text(options.page_mm)
    kin_first = sorted(PAGES, key=lambda name: (name in US_PAGES) != (page in US_PAGES))
    fits_on = next((name for name in kin_first if _on_one_sheet(board, pattern, options, PAGES[name])), None)
    if plan is None:
        raise _does_not_fit(
            board,
            fits_on,
            f"page {page} is too small",
            expected=f"room for two rulers of {RULER_MM:g} mm and words inside margins of {options.margin_mm:g} mm",
            got=f"page {page}",
        )
    sheets = plan.rows * plan.columns
    if sheets > MOST_SHEETS:
        problem, expected = "it takes too many sheets", f"at most {MOST_SHEETS} sheets"
        raise _does_not_fit(board, fits_on, problem, expected=expected, got=f"{sheets} sheets of page {page}")
    if plan.two_sided:
        problem, expected = "a board with two sides must fit on one sheet", "one sheet"
        raise _does_not_fit(board, fits_on, problem, expected=expected, got=f"{sheets} sheets of page {page}")
    return replace(plan, fits_on=fits_on)


def _best_plan(board: Board, pattern: Pattern, options: TargetOptions) -> TargetPlan | None:
    """The plan with the fewest sheets, then with the most white."""
    plans = [
        plan
        for page in options.pages_mm
        for words_below in (True, False)
        for tiled in (False, True)
        if (frame := divide(board, pattern, page, options, tiled=tiled, words_below=words_below)) is not None
        and (plan := _plan(board, pattern, frame, options)).tiled == tiled
    ]
    return min(plans, key=lambda plan: (plan.rows * plan.columns, -plan.quiet_mm), default=None)


def _plan(board: Board, pattern: Pattern, frame: Frame, options: TargetOptions) -> TargetPlan:
    window = frame.window
    across = _fit(pattern.size_mm[0], window.width, frame.white_mm, pattern.square_mm)
    upright = _fit(pattern.size_mm[1], window.height, frame.white_mm, pattern.square_mm)
    left_top = (window.left + across.banded_mm, window.top + upright.free_mm)
    quiet = min(across.quiet_mm, upright.quiet_mm)
    return TargetPlan(board, pattern, frame, upright.windows, across.windows, left_top, quiet, options.two_sided)


@dataclass(frozen=True, slots=True)
class _Fit:
    """A pattern along one axis of the paper."""

    windows: int
    banded_mm: float
    """From the pattern to the end of the windows where a band lies: left, or below."""
    free_mm: float
    """From the pattern to the other end: right, or above."""
    quiet_mm: float
    """White on either side, at least."""


def _fit(pattern_mm: float, window_mm: float, white_mm: float, square_mm: float) -> _Fit:
    """The least number of windows that hold the pattern, and its place with the widest margin."""
    quiet = LEAST_QUIET_SQUARES * square_mm
    needed = pattern_mm + max(quiet, 2 * quiet - white_mm)
    windows = max(1, ceil((needed - OVERLAP_MM) / (window_mm - OVERLAP_MM)))
    slack = windows * window_mm - (windows - 1) * OVERLAP_MM - pattern_mm
    banded = min((slack + white_mm) / 2, slack)
    return _Fit(windows, banded, slack - banded, min(banded, slack - banded + white_mm))


def _on_one_sheet(board: Board, pattern: Pattern, options: TargetOptions, page_mm: tuple[float, float]) -> bool:
    if options.margin_mm >= min(page_mm) / 2:
        return False
    plan = _best_plan(board, pattern, replace(options, page_mm=page_mm, landscape=None))
    return plan is not None and not plan.tiled


def _does_not_fit(board: Board, fits_on: str | None, problem: str, *, expected: str, got: str) -> TargetError:
    larger = "give a larger --page, such as A0 or 2000x1500mm for a print shop, or choose smaller squares"
    do_next = f"give --page {fits_on}, on which it fits as one sheet" if fits_on else larger
    return TargetError(problem, where=board.spec, expected=expected, got=got, do_next=do_next)
