"""Another board than the given one: proposed from what the images show, then searched for as if it had been given.

Larger and smaller checkerboards are proposed by OpenCV's newer finder, which can let a grid grow to its true size, and
by counting a row or column more or less; marker boards are read (:mod:`rigcal.diagnose.printed`). A proposal counts
only by the images in which it is found, so that a wrong one costs time and no truth.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import cv2

from rigcal.board import AprilGrid, Board, Charuco, Checkerboard
from rigcal.captures import Capture, read_image
from rigcal.detect import find_board
from rigcal.detect.found import Grey
from rigcal.detections import SiteDetections
from rigcal.diagnose.printed import RATIO_STEP, printed_board
from rigcal.diagnose.sample import COUNTED, Shot, every_frame
from rigcal.diagnose.sight import square_px

PROBED = 5
"""Images, the likeliest ones, in which every proposal is searched for; the best of them is counted in all."""
LEAST_SHARE = 0.4
"""Share of the likeliest images in which another board must be found to be named."""
MOST_BLUR = 0.18
"""Of a square: at 0.26 a grid of 10x6 corners was found in images of 9x6."""
SMALLEST_GRID = (4, 3)
"""Where the growing grid starts: on real images 3x3 and 5x4 grow to the true size less often."""
GROWN_PX = 1_000_000
"""Pixels of the images in which grids grow."""


@dataclass(frozen=True, slots=True)
class Count:
    """In how many images another board is found."""

    board: Board
    found: int
    given: int
    """In how many of them the given board is found."""
    images: int
    sampled: bool
    """Whether these are not all images."""


def other_board(
    capture: Capture,
    detections: SiteDetections,
    cameras: Sequence[int],
    shots: Sequence[Shot],
    pool: ThreadPoolExecutor,
) -> tuple[Count | None, list[Board]]:
    """The other board that the images show more often than the given one, if any, and all that were tried.

    Args:
        capture: the images, read again where all of them are counted.
        detections: what was found of the given board.
        cameras: the cameras in doubt.
        shots: a sample of their images, the likeliest first.
        pool: threads.
    """
    proposals = _proposals(detections.board, [shot.grey for shot in shots[:PROBED]], pool)
    best = _likeliest(proposals, shots[:PROBED], pool)
    if best is None:
        return None, proposals
    known = {(c, view.frame_idx) for c in cameras for view in detections.cameras[c].views}
    looked_at = [(shot.camera, shot.frame) for shot in shots]
    found, before = _score(best, shots, pool)[0], len(known & set(looked_at))
    if found <= before or found < LEAST_SHARE * len(shots):
        return None, proposals
    every = every_frame(capture, cameras)
    if len(every) > COUNTED or any(capture.cameras[c].kind == "video" for c in cameras):
        return Count(best, found, before, len(shots), len(shots) < len(every)), proposals
    found = sum(pool.map(bool, pool.map(partial(_corners_in_file, capture, best), every)))
    return Count(best, found, len(known), len(every), False), proposals


def _likeliest(proposals: Sequence[Board], shots: Sequence[Shot], pool: ThreadPoolExecutor) -> Board | None:
    """The first board that is found in every image, else the one that is found in the most."""
    best, most = None, (0, 0)
    for board in proposals:
        score = _score(board, shots, pool)
        if score > most:
            best, most = board, score
        if most[0] == len(shots):
            break
    return best


def _corners_in_file(capture: Capture, board: Board, frame: tuple[int, int]) -> int:
    camera = capture.cameras[frame[0]]
    return _corners(board, read_image(camera, camera.paths[frame[1]]))


def _corners(board: Board, grey: Grey) -> int:
    """Usable corners of a board in an image, where its edges are sharp enough to tell a row from its ghost."""
    found = find_board(grey, board, thorough=False)
    if found is None or found.problem or found.blur_px > MOST_BLUR * square_px(board, found):
        return 0
    return len(found.corner_ids)


def _score(board: Board, shots: Sequence[Shot], pool: ThreadPoolExecutor) -> tuple[int, int]:
    """In how many images a board is found, and with how many corners."""
    corners = list(pool.map(partial(_corners, board), [shot.grey for shot in shots]))
    return sum(count > 0 for count in corners), sum(corners)


def _proposals(given: Board, images: Sequence[Grey], pool: ThreadPoolExecutor) -> list[Board]:
    """Other boards that the images may show, likely ones first."""
    size_m = given.square_size_m
    read = printed_board(images, size_m)
    if read is not None:
        return [board for board in [_as_given(read, given)] if board != given]
    grown = Counter(size for size in pool.map(_grown_size, images) if size is not None)
    sizes = [size for size, _ in grown.most_common(2)]
    if isinstance(given, Checkerboard):
        long, short = max(given.columns, given.rows), min(given.columns, given.rows)
        sizes += [(long + c, short + r) for c in (-1, 1, 0) for r in (-1, 1, 0)]
    proposals: list[Board] = []
    upright = isinstance(given, Checkerboard) and given.columns < given.rows
    for size in sizes:
        columns, rows = (min(size), max(size)) if upright else (max(size), min(size))
        if min(size) >= 3:
            proposals.append(Checkerboard(columns, rows, size_m))
    return [board for board in dict.fromkeys(proposals) if board != given]


def _as_given(read: Charuco | AprilGrid, given: Board) -> Board:
    """What was read, in the words of the given board where both mean the same."""
    if not (isinstance(read, Charuco) and isinstance(given, Charuco)):
        return read
    code = read.dictionary.rpartition("_")[0]
    markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, given.dictionary)).bytesList
    if given.dictionary.startswith(code) and read.columns * read.rows // 2 <= len(markers):
        read = replace(read, dictionary=given.dictionary)
    if abs(read.marker_ratio - given.marker_ratio) < 1.5 * RATIO_STEP:
        read = replace(read, marker_ratio=given.marker_ratio)
    return read


def _grown_size(grey: Grey) -> tuple[int, int] | None:
    """Corners along the longer and the shorter side of the checkerboard that a small grid grows to."""
    scale = min(1.0, (GROWN_PX / grey.size) ** 0.5)
    small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    cv2.setRNGSeed(0)
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, _, meta = cv2.findChessboardCornersSBWithMeta(small, SMALLEST_GRID, flags)
    return (max(meta.shape), min(meta.shape)) if found else None
