"""What is black on a printed board: rectangles, exact, in millimetres from the pattern's top-left corner.

The same patterns as :func:`rigcal.synthetic.draw_board` paints in pixels, without a pixel's rounding. x runs to the
right and y down, as in the board frame; the pattern's top-left corner is not the board's origin.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from rigcal.board import AprilGrid, Board, Charuco, Checkerboard
from rigcal.errors import TargetError
from rigcal.geometry import Bools, Floats
from rigcal.synthetic import opencv_charuco

MARKER_BORDER_BITS = 1
"""Width of a ChArUco marker's border, OpenCV's default."""
LEAST_CELL_MM = 0.5
"""Twelve dots of a printer with 600 dots per inch; finer cells fray."""


@dataclass(frozen=True, slots=True, eq=False)
class Pattern:
    """A board's black rectangles; they touch and never overlap."""

    size_mm: tuple[float, float]
    """Width and height of the pattern without any margin."""
    origin_mm: tuple[float, float]
    """Where the board frame's origin lies in the pattern."""
    square_mm: float
    """Side of a square, of an AprilGrid's tag: the unit of the white margin."""
    black_mm: Floats
    """(N, 4) left, top, right, bottom of the black rectangles."""


def pattern_of(board: Board) -> Pattern:
    """The pattern of a board.

    Raises:
        TargetError: where the board's cells are too fine to print.
    """
    match board:
        case Checkerboard():
            pattern, cells_per_square = _checkerboard(board), 1.0
        case Charuco():
            dictionary = _dictionary(board)
            pattern = _charuco(board, dictionary)
            cells_per_square = (dictionary.markerSize + 2 * MARKER_BORDER_BITS) / board.marker_ratio
        case AprilGrid():
            dictionary = _dictionary(board)
            pattern, cells_per_square = _aprilgrid(board, dictionary), dictionary.markerSize + 2 * board.border_bits
    if pattern.square_mm / cells_per_square < LEAST_CELL_MM:
        raise TargetError(
            "its cells are too fine to print",
            where=board.spec,
            expected=f"cells of {LEAST_CELL_MM:g} mm or more",
            got=f"cells of {pattern.square_mm / cells_per_square:.3g} mm",
            do_next=f"choose a size of {LEAST_CELL_MM * cells_per_square:.3g} mm or more, and check its unit",
        )
    return pattern


def _checkerboard(board: Checkerboard) -> Pattern:
    square = board.square_size_m * 1e3
    columns, rows = board.columns + 1, board.rows + 1
    black = np.indices((rows, columns)).sum(axis=0) % 2 == 0
    return Pattern((columns * square, rows * square), (square, square), square, _cells(black, square))


def _charuco(board: Charuco, dictionary: cv2.aruco.Dictionary) -> Pattern:
    square = board.square_size_m * 1e3
    marker, gap = square * board.marker_ratio, square * (1 - board.marker_ratio) / 2
    layout = opencv_charuco(board)
    corners = np.asarray(layout.getObjPoints())[:, 0, :2] * 1e3
    squares = np.rint((corners - gap) / square).astype(int)
    black = np.ones((board.rows, board.columns), dtype=bool)
    black[squares[:, 1], squares[:, 0]] = False
    parts = [] if board.inverted else [_cells(black, square)]
    for marker_id, (column, row) in zip(np.ravel(layout.getIds()), squares, strict=True):
        bits = _bits(dictionary, int(marker_id), MARKER_BORDER_BITS) != board.inverted
        left_top = np.array([column, row]) * square
        parts.append(_cells(bits, marker / len(bits)) + np.tile(left_top + gap, 2))
        if board.inverted:
            parts.append(_frame(square, gap) + np.tile(left_top, 2))
    size = (board.columns * square, board.rows * square)
    return Pattern(size, (square, square), square, np.concatenate(parts))


def _aprilgrid(board: AprilGrid, dictionary: cv2.aruco.Dictionary) -> Pattern:
    tag, gap = board.tag_size_m * 1e3, board.tag_size_m * 1e3 * board.spacing
    parts = [
        np.array([[column, row, column, row]]) * (tag + gap) + [0, 0, gap, gap]
        for row, column in np.ndindex(board.rows + 1, board.columns + 1)
    ]
    for number, corner in enumerate(board.corners_in_board[::4, :2] * 1e3):
        bits = _bits(dictionary, number, board.border_bits)
        parts.append(_cells(bits, tag / len(bits)) + np.tile(corner + gap, 2))
    size = (board.columns * (tag + gap) + gap, board.rows * (tag + gap) + gap)
    return Pattern(size, (gap, gap), tag, np.concatenate(parts))


def _dictionary(board: Charuco | AprilGrid) -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))


def _bits(dictionary: cv2.aruco.Dictionary, marker_id: int, border: int) -> Bools:
    """(n, n) whether each cell of a marker is black, its border included."""
    cells = dictionary.markerSize + 2 * border
    return np.asarray(cv2.aruco.generateImageMarker(dictionary, marker_id, cells, borderBits=border) == 0)


def _cells(black: Bools, cell_mm: float) -> Floats:
    """(N, 4) rectangles of a raster's black cells, one for each run along a row."""
    edges = np.diff(np.pad(black, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    row, left = np.nonzero(edges == 1)
    _, right = np.nonzero(edges == -1)
    return np.asarray(np.stack([left, row, right, row + 1], axis=-1) * cell_mm, dtype=np.float64)


def _frame(side_mm: float, width_mm: float) -> Floats:
    """(4, 4) rectangles of a square's rim."""
    near, far = width_mm, side_mm - width_mm
    return np.array(
        [[0, 0, side_mm, near], [0, near, near, far], [far, near, side_mm, far], [0, far, side_mm, side_mm]]
    )
