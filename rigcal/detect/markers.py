"""ChArUco boards and AprilGrids in one image: OpenCV's markers say which corner is which, the fit says where it is.

Measured on a real capture of an inverted 4x5 ChArUco (4 cameras, 111 frames each): 46, 28, 43 and 45 views, and
``cv2.calibrateCamera`` leaves 0.07, 0.04, 0.05 and 0.07 px where the detector's own corners leave 0.16, 0.15, 0.26 and
0.26. Inverting the image finds 162 views, ``detectInvertedMarker`` 146. On nine real AprilGrids the fit moves the tag
detector's corners by 1.2-2.7 px (median per image), since the black squares between the tags draw them outwards.
"""

from __future__ import annotations

import cv2
import numpy as np

from rigcal.board import AprilGrid, Charuco
from rigcal.detect.crossings import Crossings, are_crossings, fit_crossings
from rigcal.detect.found import FoundBoard, Grey
from rigcal.geometry import Bools, Floats, Ints
from rigcal.synthetic import opencv_charuco

LEAST_CORNERS = 6
"""Fewer corners of a board do not tell a pose from its mirror image."""
CODE_BITS = {"tag16h5": 4, "tag25h9": 5, "tag36h10": 6, "tag36h11": 6}
"""Bits of a tag's code along one side, without its border."""
MOST_OFF_LATTICE = 0.5
"""Distance of a corner from where its neighbour has it, in steps. A wrong layout is off by one or more, real fisheye
views by 0.4 at most and by 0.23 in nine of ten places."""
LEAST_ON_LATTICE = 0.8


def find_charuco(grey: Grey, board: Charuco) -> FoundBoard | None:
    """Chessboard corners of a ChArUco board, wholly or partly in view; None where they are too few to be of use.

    Args:
        grey: (height, width) 8-bit image.
        board: the board; an ``inverted`` one is looked for in the negative.
    """
    image = np.asarray(cv2.bitwise_not(grey), dtype=np.uint8) if board.inverted else grey
    raw, raw_ids, _, _ = cv2.aruco.CharucoDetector(opencv_charuco(board)).detectBoard(image)
    if raw_ids is None or not _is_useful(board, ids := np.ravel(raw_ids).astype(np.int64)):
        return None
    corners, squares = np.reshape(raw, (-1, 2)).astype(np.float64), board.corners_in_board[ids] / board.square_size_m
    along_x, along_y = _steps(squares, corners)
    if _cross(along_x, along_y).min() <= 0:
        return None
    # What is nearest to a corner apart from its edges is the corner of a marker, on the diagonal of the square.
    fit = fit_crossings(image, corners, along_x, along_y, reach=0.95 * np.sqrt(0.5) * (1 - board.marker_ratio))
    alternating = fit.contrast * (1 - 2 * (squares.sum(axis=1).round() % 2))
    good = are_crossings(fit, along_x, along_y) & (alternating * np.median(alternating) > 0)
    return _found(board, ids, fit, good)


def find_aprilgrid(grey: Grey, board: AprilGrid) -> FoundBoard | None:
    """Tag corners of a Kalibr AprilGrid, wholly or partly in view; None where they are too few to be of use.

    Tags with numbers beyond the grid's are another board's and are left out, and so are tags seen twice.

    Args:
        grey: (height, width) 8-bit image.
        board: the grid.
    """
    tags, quads = _tags(grey, board)
    if not len(tags):
        return None
    right, down = quads[:, [1, 1, 2, 2]] - quads[:, [0, 0, 3, 3]], quads[:, [3, 2, 2, 3]] - quads[:, [0, 1, 1, 0]]
    along_x, along_y = right.reshape(-1, 2), down.reshape(-1, 2)
    border = board.border_bits / (CODE_BITS[board.family] + 2 * board.border_bits)
    fit = fit_crossings(grey, quads.reshape(-1, 2), along_x, along_y, reach=min(border, board.spacing))
    good = are_crossings(fit, along_x, along_y) & (fit.contrast * np.tile([-1.0, 1.0, -1.0, 1.0], len(tags)) > 0)
    return _found(board, (4 * tags[:, None] + np.arange(4)).ravel(), fit, good)


def _tags(grey: Grey, board: AprilGrid) -> tuple[Ints, Floats]:
    """Numbers (n,) ascending and corners (n, 4, 2) of the grid's tags that are seen once."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = board.border_bits
    family = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    quads, raw_ids, _ = cv2.aruco.ArucoDetector(family, parameters).detectMarkers(grey)
    if not len(quads):
        return np.zeros(0, dtype=np.int64), np.zeros((0, 4, 2))
    numbers, first, count = np.unique(np.ravel(raw_ids), return_index=True, return_counts=True)
    used = (count == 1) & (numbers < board.columns * board.rows)
    return numbers[used].astype(np.int64), np.reshape(quads, (-1, 4, 2))[first[used]].astype(np.float64)


def _found(board: Charuco | AprilGrid, ids: Ints, fit: Crossings, good: Bools) -> FoundBoard | None:
    """The good corners, judged together."""
    order = np.argsort(ids[good])
    ids, corners = ids[good][order], fit.corners_px[good][order]
    if not _is_useful(board, ids):
        return None
    if _on_lattice(board.corners_in_board[ids] / board.square_size_m, corners) < LEAST_ON_LATTICE:
        return FoundBoard(ids, corners, problem=f"its markers do not lie as on {board.spec}")
    return FoundBoard(ids, corners)


def _is_useful(board: Charuco | AprilGrid, ids: Ints) -> bool:
    """Whether there are six corners, and four of them fix the plane: two rows or columns with two corners each."""
    if len(ids) < LEAST_CORNERS:
        return False
    steps = np.rint(board.corners_in_board[ids, :2] / board.square_size_m * 1e6)
    return any((np.unique(steps[:, axis], return_counts=True)[1] >= 2).sum() >= 2 for axis in (0, 1))


def _steps(squares: Floats, corners_px: Floats) -> tuple[Floats, Floats]:
    """Steps (n, 2) of one square along the board's axes at each corner, by the homography of them all."""
    board_to_image, _ = cv2.findHomography(squares[:, :2], corners_px)
    half = np.array([0.5, 0.0])

    def between(offset: Floats) -> Floats:
        ends = [cv2.perspectiveTransform((squares[None, :, :2] + sign * offset), board_to_image)[0] for sign in (1, -1)]
        return np.asarray(ends[0] - ends[1])

    return between(half), between(half[::-1])


def _on_lattice(squares: Floats, corners_px: Floats) -> float:
    """Share of neighbouring corners that lie to each other as they do on the board."""
    along_x, along_y = _steps(squares, corners_px)
    apart = squares[None, :, :2] - squares[:, None, :2]
    first, second = np.nonzero((np.abs(apart).sum(axis=-1) < 1.5) & (np.abs(apart).sum(axis=-1) > 0))
    if not len(first):
        return 1.0
    apart = apart[first, second]
    expected = corners_px[first] + apart[:, :1] * along_x[first] + apart[:, 1:] * along_y[first]
    off = np.linalg.norm(corners_px[second] - expected, axis=1)
    step = np.maximum(np.linalg.norm(along_x, axis=1), np.linalg.norm(along_y, axis=1))
    return float((off < MOST_OFF_LATTICE * step[first]).mean())


def _cross(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
