"""ChArUco boards and AprilGrids in one image: OpenCV's markers say which corner is which, the fit says where it is.

Two-sided boards carry the mirror image on the back of the sheet, so that every corner lies upon itself. Markers are
looked up among those printed and among their mirror images at once: that costs a fifteenth more, where searching the
mirrored image as well would cost as much again. Corners keep their numbers, and run the other way round in the image;
:func:`shows_back` tells the two apart.

Measured on a real capture of an inverted 4x5 ChArUco (4 cameras, 111 frames each): 46, 34, 44 and 45 views, none of
them of a back, and ``cv2.calibrateCamera`` leaves 0.04-0.07 px where the detector's own corners leave 0.15-0.26. On
nine real AprilGrids the fit moves the tag detector's corners by 1.2-2.7 px (median per image), since the black squares
between the tags draw them outwards.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rigcal.board import AprilGrid, Charuco
from rigcal.detect.crossings import Crossings, are_crossings, fit_crossings
from rigcal.detect.found import FoundBoard, Grey
from rigcal.geometry import Bools, Floats, Ints
from rigcal.synthetic import opencv_charuco

LEAST_CORNERS = 6
"""Fewer corners of a board do not tell a pose from its mirror image."""
CODE_BITS = {"tag16h5": 4, "tag25h9": 5, "tag36h10": 6, "tag36h11": 6}
"""Bits of a tag's code along one side, without its border."""
SMALLEST_MARKER_PX = 10.0
TOUCHED_THRESHOLD = 20.0
"""Grey levels below the surroundings that are black where black squares touch a tag's corners; OpenCV's 7 joins them.
With both, 97 of 100 tags with a border of one bit are seen on sharp renders and 30 of 36 in a real fisheye view, with
the usual one alone 51 and 14."""
FAINT = 100
"""Grey levels of an image, without its lowest and highest half per cent, below which its contrast is stretched: boards
of 4 to 10 levels from black to white are found so, and none without."""
MOST_MISFIT, MISFIT_OF_MEDIAN = 0.26, 2.0
"""A corner's misfit, or its ratio to the view's median, whichever is greater. A hand or an edge that ends beside a
corner leaves 0.29-0.45 and draws it up to 1.6 px away; 99 of 100 corners of a real capture leave less than 0.25."""
MOST_OFF_LATTICE = 0.5
"""Distance of a corner from where its neighbour has it, in steps. A wrong layout is off by one or more, real fisheye
views by 0.4 at most and by 0.23 in nine of ten places."""
LEAST_ON_LATTICE = 0.8
_AS_PRINTED, _FROM_BEHIND = [0, 1, 2, 3], [1, 0, 3, 2]


@dataclass(frozen=True, slots=True, eq=False)
class Markers:
    """Markers of one side of a board in an image."""

    ids: Ints
    """(n,) numbers, ascending."""
    quads_px: Floats
    """(n, 4, 2) corners in the marker's own order: clockwise from the front, counter-clockwise from behind."""
    back: bool
    """Whether these are mirror images."""


def find_charuco(grey: Grey, board: Charuco) -> FoundBoard | None:
    """Chessboard corners of a ChArUco board, wholly or partly in view; None where they are too few to be of use.

    Args:
        grey: (height, width) 8-bit image.
        board: the board; an ``inverted`` one is looked for in the negative.
    """
    image = np.asarray(cv2.bitwise_not(grey), dtype=np.uint8) if board.inverted else grey
    sides = find_markers(image, board.dictionary, count=board.columns * board.rows // 2)
    return _best(_charuco_corners(image, board, markers) for markers in sides)


def find_aprilgrid(grey: Grey, board: AprilGrid) -> FoundBoard | None:
    """Tag corners of a Kalibr AprilGrid, wholly or partly in view; None where they are too few to be of use.

    Tags with numbers beyond the grid's are another board's and are left out, and so are tags seen twice.

    Args:
        grey: (height, width) 8-bit image.
        board: the grid.
    """
    count = board.columns * board.rows
    sides = find_markers(grey, board.dictionary, count=count, border_bits=board.border_bits, touched=True)
    return _best(_aprilgrid_corners(grey, board, markers) for markers in sides)


def shows_back(board: Charuco | AprilGrid, corner_ids: Ints, corners_px: Floats) -> bool:
    """Whether corners (n,), (n, 2) in pixels are those of the back of a two-sided board."""
    along_x, along_y = corner_steps(board.corners_in_board[corner_ids] / board.square_size_m, corners_px)
    return bool(np.median(_cross(along_x, along_y)) < 0)


def find_markers(
    image: Grey, dictionary: str, *, count: int, border_bits: int = 1, touched: bool = False
) -> list[Markers]:
    """Markers seen once, of the front and of the back; the side with more of them first.

    Args:
        image: (height, width) 8-bit image in which the markers' borders are black.
        dictionary: OpenCV's name of the dictionary.
        count: how many of its markers, from number 0, may be there.
        border_bits: width of the black border in bits.
        touched: whether black squares touch the markers' corners; then a second, stricter threshold is tried too.
    """
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = border_bits
    parameters.minMarkerPerimeterRate = 4 * SMALLEST_MARKER_PX / max(image.shape)
    dictionaries = _both_sides(dictionary, count)
    image = _clear(image)
    seen = _seen(image, cv2.aruco.ArucoDetector(dictionaries, parameters))
    if touched and len(seen) < count:
        parameters.adaptiveThreshConstant = TOUCHED_THRESHOLD
        smooth = np.asarray(cv2.GaussianBlur(image, (0, 0), 0.8), dtype=np.uint8)
        seen = _seen(smooth, cv2.aruco.ArucoDetector(dictionaries, parameters)) | seen
    found = []
    for back, order in ((False, _AS_PRINTED), (True, _FROM_BEHIND)):
        once = sorted(number for (side, number), quads in seen.items() if side == back and len(quads) == 1)
        quads = np.array([seen[back, number][0] for number in once], dtype=np.float64).reshape(-1, 4, 2)
        found.append(Markers(np.array(once, dtype=np.int64), quads[:, order], back))
    return sorted(found, key=lambda markers: -len(markers.ids))


def _clear(image: Grey) -> Grey:
    """The image, smoothed and with its contrast stretched where it is faint: thresholds are in grey levels."""
    below = np.cumsum(cv2.calcHist([image], [0], None, [256], [0, 256])) / image.size
    low, high = (int(np.searchsorted(below, share)) for share in (0.005, 0.995))
    if high - low >= FAINT:
        return image
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 1.0)
    return np.asarray(np.clip((smooth - low) * 255 / max(high - low, 1), 0, 255), dtype=np.uint8)


def _seen(image: Grey, detector: cv2.aruco.ArucoDetector) -> dict[tuple[bool, int], list[NDArray[Any]]]:
    """Quads (1, 4, 2) in pixels of each marker, by side (whether the back) and number."""
    quads, ids, _, sides = detector.detectMarkersMultiDict(image)
    seen: dict[tuple[bool, int], list[NDArray[Any]]] = defaultdict(list)
    for k, quad in enumerate(quads):
        seen[bool(np.ravel(sides)[k]), int(np.ravel(ids)[k])].append(quad)
    return seen


@lru_cache(maxsize=32)
def _both_sides(name: str, count: int) -> tuple[cv2.aruco.Dictionary, cv2.aruco.Dictionary]:
    """The first ``count`` markers of a dictionary, and their mirror images."""
    whole = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    size, corrected_bits = whole.markerSize, whole.maxCorrectionBits
    codes = [cv2.aruco.Dictionary.getBitsFromByteList(code[None], size) for code in whole.bytesList[:count]]
    mirrored = [cv2.aruco.Dictionary.getByteListFromBits(np.ascontiguousarray(code[:, ::-1])) for code in codes]
    return (
        cv2.aruco.Dictionary(whole.bytesList[:count].copy(), size, corrected_bits),
        cv2.aruco.Dictionary(np.concatenate(mirrored), size, corrected_bits),
    )


def _best(sides: Iterable[FoundBoard | None]) -> FoundBoard | None:
    """The first side that may be used, else the first that is seen at all."""
    refused = None
    for found in sides:
        if found is not None and not found.problem:
            return found
        refused = refused or found
    return refused


def _charuco_corners(image: Grey, board: Charuco, markers: Markers) -> FoundBoard | None:
    """Corners beside one marker or more: with two at least, as OpenCV would have it, a twentieth of them is lost."""
    if not len(markers.ids):
        return None
    parameters = cv2.aruco.CharucoParameters()
    parameters.minMarkers = 1
    quads = [np.ascontiguousarray(quad[None]) for quad in markers.quads_px.astype(np.float32)]
    raw, raw_ids, _, _ = cv2.aruco.CharucoDetector(opencv_charuco(board), parameters).detectBoard(
        image, markerCorners=quads, markerIds=markers.ids.astype(np.int32)[:, None]
    )
    if raw_ids is None or not _is_useful(board, ids := np.ravel(raw_ids).astype(np.int64)):
        return None
    corners, squares = np.reshape(raw, (-1, 2)).astype(np.float64), board.corners_in_board[ids] / board.square_size_m
    along_x, along_y = corner_steps(squares, corners)
    if (_cross(along_x, along_y) * (-1.0 if markers.back else 1.0)).min() <= 0:
        return None
    # What is nearest to a corner apart from its edges is the corner of a marker, on the diagonal of the square.
    fit = fit_crossings(image, corners, along_x, along_y, reach=0.95 * np.sqrt(0.5) * (1 - board.marker_ratio))
    alternating = fit.contrast * (1 - 2 * (squares.sum(axis=1).round() % 2))
    good = _are_whole(fit, along_x, along_y) & (alternating * np.median(alternating) > 0)
    return _found(board, ids, fit, good)


def _aprilgrid_corners(grey: Grey, board: AprilGrid, markers: Markers) -> FoundBoard | None:
    """Corners of tags, each where the tag's border meets the small black square beside it."""
    if not len(markers.ids):
        return None
    quads = markers.quads_px
    right, down = quads[:, [1, 1, 2, 2]] - quads[:, [0, 0, 3, 3]], quads[:, [3, 2, 2, 3]] - quads[:, [0, 1, 1, 0]]
    along_x, along_y = right.reshape(-1, 2), down.reshape(-1, 2)
    border = board.border_bits / (CODE_BITS[board.family] + 2 * board.border_bits)
    fit = fit_crossings(grey, quads.reshape(-1, 2), along_x, along_y, reach=min(border, board.spacing))
    alternating = fit.contrast * np.tile([-1.0, 1.0, -1.0, 1.0], len(quads))
    good = _are_whole(fit, along_x, along_y) & (alternating > 0)
    return _found(board, (4 * markers.ids[:, None] + np.arange(4)).ravel(), fit, good)


def _are_whole(fit: Crossings, along_x: Floats, along_y: Floats) -> Bools:
    """(n,) whether corners are crossings of which nothing is hidden."""
    most = max(MOST_MISFIT, MISFIT_OF_MEDIAN * float(np.median(fit.misfit)))
    return np.asarray(are_crossings(fit, along_x, along_y) & (fit.misfit < most))


def _found(board: Charuco | AprilGrid, ids: Ints, fit: Crossings, good: Bools) -> FoundBoard | None:
    """The good corners, judged together."""
    order = np.argsort(ids[good])
    ids, corners = ids[good][order], fit.corners_px[good][order]
    if not _is_useful(board, ids):
        return None
    on_lattice = _on_lattice(board.corners_in_board[ids] / board.square_size_m, corners) >= LEAST_ON_LATTICE
    problem = "" if on_lattice else f"its markers do not lie as on {board.spec}"
    return FoundBoard(ids, corners, problem=problem, blur_px=float(np.median(fit.blur_px[good])))


def _is_useful(board: Charuco | AprilGrid, ids: Ints) -> bool:
    """Whether there are six corners, and four of them fix the plane: two rows or columns with two corners each."""
    if len(ids) < LEAST_CORNERS:
        return False
    steps = np.rint(board.corners_in_board[ids, :2] / board.square_size_m * 1e6)
    return any((np.unique(steps[:, axis], return_counts=True)[1] >= 2).sum() >= 2 for axis in (0, 1))


def corner_steps(squares: Floats, corners_px: Floats) -> tuple[Floats, Floats]:
    """Steps (n, 2) of one square along the board's axes at each corner, by the homography of them all."""
    board_to_image, _ = cv2.findHomography(squares[:, :2], corners_px)
    half = np.array([0.5, 0.0])

    def between(offset: Floats) -> Floats:
        ends = [cv2.perspectiveTransform((squares[None, :, :2] + sign * offset), board_to_image)[0] for sign in (1, -1)]
        return np.asarray(ends[0] - ends[1])

    return between(half), between(half[::-1])


def _on_lattice(squares: Floats, corners_px: Floats) -> float:
    """Share of neighbouring corners that lie to each other as they do on the board."""
    along_x, along_y = corner_steps(squares, corners_px)
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
