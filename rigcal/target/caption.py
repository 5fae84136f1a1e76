"""What stands beside a printed board: the words that whoever prints, glues and uses it must read."""

from __future__ import annotations

from dataclasses import replace

from reportlab.lib.utils import simpleSplit

from rigcal.board import AprilGrid, Board, Checkerboard
from rigcal.target.pattern import Pattern

FONT, BOLD = "Helvetica", "Helvetica-Bold"
FONT_PT = 6.5
LINE_MM = 2.8
"""Distance of two lines of words."""
SKETCH_MM = 18.0
"""Room at the end of the words for the sketch of the board."""
POINTS_PER_MM = 72 / 25.4


def captions(board: Board, pattern: Pattern, *, tiled: bool, two_sided: bool) -> tuple[str, ...]:
    """The words of every sheet, a paragraph each; the first is the board's ``--board`` string."""
    lines = [
        f"--board {board.spec}",
        f"Print at 100 % (actual size), never fitted to the page. Both rulers must measure 100 mm, {_whole(pattern)}. "
        "If not, the printer scaled it: print again.",
        f"Origin: the dot in the sketch, which lies as the board does: {_origin(board)}. Mount the sheet flat on "
        "a stiff plate.",
    ]
    if tiled:
        lines.append("One of several sheets: measure its rulers, then cut and glue it as the first page says.")
    if two_sided:
        lines.append(
            "Two sides: print both pages on one sheet, turned over its long edge, or glue them back to back. Held "
            "against the light, all squares must coincide."
        )
    warning = symmetry_warning(board)
    return (*lines, f"Warning: {warning}") if warning else tuple(lines)


def symmetry_warning(board: Board) -> str | None:
    """What to print instead of a checkerboard that looks the same upside down; None for every other board."""
    if not isinstance(board, Checkerboard) or not board.is_symmetric:
        return None
    other = replace(board, rows=board.rows - 1 if board.rows > 3 else board.rows + 1)
    return (
        f"{board.columns}x{board.rows} inner corners look the same turned by 180 degrees, so its corner order can flip "
        f"from view to view. Prefer one odd and one even count: {other.spec}"
    )


def assembly_steps(rows: int, columns: int, pattern: Pattern) -> tuple[str, ...]:
    """How to glue a pattern on several sheets together."""
    steps = ["Print all sheets at 100 % on one printer and measure both rulers of each."]
    if columns > 1:
        steps.append(
            "Columns: cut every sheet but the first of a row along the line between its CUT ticks at the left. Lay it "
            "on its left neighbour, its cut edge at the JOIN ticks, and glue it where the squares continue."
        )
    if rows > 1:
        steps.append(
            "Rows: cut every row but the first along the line between its CUT ticks at the top. Lay it on the row "
            "above, its cut edge at the JOIN ticks, and glue it where the squares continue."
        )
    return (
        *steps,
        "Glue the whole on a flat, stiff plate and trim what stands out, but keep the white margin.",
        f"Measure it before you use it: {_whole(pattern)}.",
    )


def wrapped(lines: tuple[str, ...], width_mm: float, size_pt: float = FONT_PT) -> tuple[str, ...]:
    """The lines, broken where they are longer than ``width_mm``."""
    return tuple(part for line in lines for part in simpleSplit(line, BOLD, size_pt, width_mm * POINTS_PER_MM))


def _whole(pattern: Pattern) -> str:
    return f"the whole pattern {pattern.size_mm[0]:.6g} x {pattern.size_mm[1]:.6g} mm"


def _origin(board: Board) -> str:
    if isinstance(board, AprilGrid):
        return "the outer corner of the tag in that corner"
    return "the first inner corner, a square away from both edges"
