"""Where a pattern lies on the paper: one sheet where it fits, several that overlap where it does not.

The pattern keeps its size whatever the paper; the number of sheets grows.

Context: a white margin of a whole square would cost the usual 9x6 board of 25 mm its A4 sheet. Decision: the pattern
goes where its narrowest margin is widest, the unprinted edge of the paper counts as the white that it is, and a quarter
of a square is enough. Cost: a ruler may come nearer to the pattern than one square. On rendered pages every kind of
board is found with all its corners from no margin at all upwards.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from rigcal.board import Board, Charuco
from rigcal.errors import TargetError
from rigcal.target.paper import LEAST_WINDOW_MM, PAGES, Frame, TargetOptions, divide, page_text
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
    columns: int
    sheets: tuple[Sheet, ...]
    """Row by row."""
    quiet_mm: float
    """White around the pattern, at its narrowest."""
    two_sided: bool
    fits_on: str | None
    """For a pattern on several sheets, the smallest known page that holds all of it; None where none does."""

    @property
    def tiled(self) -> bool:
        """Whether the pattern is glued together from several sheets."""
        return len(self.sheets) > 1


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
    fits_on = next((name for name, page in PAGES.items() if _on_one_sheet(board, pattern, options, page)), None)
    if plan is None:
        raise _too_small(board, pattern, options, fits_on)
    if plan.two_sided:
        raise TargetError(
            "a board with two sides must fit on one sheet",
            where=board.spec,
            expected=f"page {fits_on}" if fits_on else "a page that holds it",
            got=f"page {page_text(options.page_mm)}, of which it takes {len(plan.sheets)}",
            do_next=_larger_page(fits_on),
        )
    return replace(plan, fits_on=fits_on)


def _best_plan(board: Board, pattern: Pattern, options: TargetOptions) -> TargetPlan | None:
    """The plan with the fewest sheets, then with the most white."""
    plans = [
        plan
        for page in options.pages_mm
        for words_below in (True, False)
        for tiled in (False, True)
        if (frame := divide(board, page, options, tiled=tiled, words_below=words_below)) is not None
        and (plan := _plan(board, pattern, frame, options)) is not None
        and (1 < len(plan.sheets) <= MOST_SHEETS if tiled else not plan.tiled)
    ]
    return min(plans, key=lambda plan: (len(plan.sheets), -plan.quiet_mm), default=None)


def _plan(board: Board, pattern: Pattern, frame: Frame, options: TargetOptions) -> TargetPlan:
    window = frame.window
    across = _fit(pattern.size_mm[0], window.width, frame.white_mm, pattern.square_mm)
    upright = _fit(pattern.size_mm[1], window.height, frame.white_mm, pattern.square_mm)
    sheets = tuple(
        Sheet(
            row,
            column,
            (
                window.left + across.banded_mm - column * (window.width - OVERLAP_MM),
                window.top + upright.free_mm - row * (window.height - OVERLAP_MM),
            ),
        )
        for row in range(upright.windows)
        for column in range(across.windows)
    )
    quiet = min(across.quiet_mm, upright.quiet_mm)
    return TargetPlan(board, pattern, frame, upright.windows, across.windows, sheets, quiet, options.two_sided, None)


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
    windows = 0
    while True:
        windows += 1
        slack = windows * window_mm - (windows - 1) * OVERLAP_MM - pattern_mm
        banded = min((slack + white_mm) / 2, slack)
        quiet = min(banded, slack - banded + white_mm)
        if quiet >= LEAST_QUIET_SQUARES * square_mm:
            return _Fit(windows, banded, slack - banded, quiet)


def _on_one_sheet(board: Board, pattern: Pattern, options: TargetOptions, page_mm: tuple[float, float]) -> bool:
    if options.margin_mm >= min(page_mm) / 2:
        return False
    plan = _best_plan(board, pattern, replace(options, page_mm=page_mm, landscape=None))
    return plan is not None and not plan.tiled


def _too_small(board: Board, pattern: Pattern, options: TargetOptions, fits_on: str | None) -> TargetError:
    return TargetError(
        "the page is too small for it",
        where=board.spec,
        expected=f"two windows' sides of {LEAST_WINDOW_MM:g} mm or more for the rulers, beside words and margins, and "
        f"the board on at most {MOST_SHEETS} sheets",
        got=f"a pattern of {pattern.size_mm[0]:.5g}x{pattern.size_mm[1]:.5g} mm for page {page_text(options.page_mm)} "
        f"with margins of {options.margin_mm:g} mm",
        do_next=_larger_page(fits_on),
    )


def _larger_page(fits_on: str | None) -> str:
    if fits_on:
        return f"give --page {fits_on}, on which it fits as one sheet"
    return "give a larger --page, such as A0 or 2000x1500mm for a print shop, or choose smaller squares"
