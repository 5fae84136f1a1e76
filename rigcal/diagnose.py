"""Why no board is found: another board than the one given is in the images, or none.

Only called for when something is wrong, and then on a dozen images, so that the answer comes in seconds. A larger or
smaller checkerboard is proposed by OpenCV's newer finder, which can let a grid grow to its true size; every proposal
is then searched for like a board that was given, and counted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice

import cv2
import numpy as np

from rigcal.board import AprilGrid, Board, Charuco, Checkerboard
from rigcal.captures import Capture, read_frames, read_image
from rigcal.detect import find_board
from rigcal.detect.found import Grey
from rigcal.detect.markers import CODE_BITS
from rigcal.detect.sweep import core_count, one_thread_per_image
from rigcal.detections import SiteDetections
from rigcal.errors import NoBoardError, WrongBoardError

SAMPLED_IMAGES = 12
COUNTED_IMAGES = 60
"""Captures of at most this many images are counted in full, others in the sample."""
LEAST_SHARE = 0.1
"""Share of the images in which another board must be found to be named."""
SMALLEST_GRID = (4, 3)
"""Where the growing grid starts: on real images 3x3 and 5x4 grow to the true size less often."""
MARKER_DICTIONARIES = ("DICT_4X4_1000", "DICT_5X5_1000", "DICT_6X6_1000", "DICT_7X7_1000", "DICT_ARUCO_ORIGINAL")
MARKER_RATIOS = (0.75, 0.8, 0.7, 0.6, 0.5)


def check_boards(capture: Capture, detections: SiteDetections) -> None:
    """Refuse detections that say the board is another one.

    Nothing is read where every camera sees the board, and more often than a part of a larger board or markers in
    another layout.

    Args:
        capture: the images, read again for a sample.
        detections: what was found of the board that was given.

    Raises:
        WrongBoardError: where another board is found in the images of the cameras that do not see the given one.
        NoBoardError: where a camera sees no board at all.
    """
    views = sum(len(camera.views) for camera in detections.cameras)
    refused = [f for camera in detections.cameras for f in camera.findings if f.action == "dropped"]
    silent = [c for c, camera in enumerate(detections.cameras) if not camera.views]
    contradicted = len(refused) > views
    if not silent and not contradicted:
        return
    cameras = list(range(len(detections.cameras))) if contradicted else silent
    other = _other_board(capture, detections, cameras)
    names = ", ".join(detections.cameras[c].camera_id for c in cameras)
    given = detections.board.spec
    if isinstance(other, _Count):
        spec = other.board.spec
        raise WrongBoardError(
            where=f"camera {names}",
            given=given,
            given_count=other.given,
            found=spec,
            found_count=other.found,
            images=other.images,
            sampled=other.sampled,
            spec=spec,
        )
    if contradicted:
        raise WrongBoardError(
            where=f"camera {names}",
            given=given,
            given_count=views,
            found=refused[0].reason,
            found_count=len(refused),
            images=sum(len(camera.frames) for camera in detections.cameras),
        )
    first = detections.cameras[silent[0]]
    raise NoBoardError(first.camera_id, board=given, images=len(first.frames), tried=other)


@dataclass(frozen=True, slots=True)
class _Count:
    """In how many images another board is found."""

    board: Board
    found: int
    given: int
    """In how many of them the given board was found."""
    images: int
    sampled: bool
    """Whether these are not all images."""


def _other_board(capture: Capture, detections: SiteDetections, cameras: Sequence[int]) -> _Count | list[str]:
    """The other board that is found in the most images, or, where none is, what was tried in vain."""
    every = [(c, k) for c in cameras for k in range(len(capture.cameras[c].frames))]
    chosen = [every[k] for k in np.unique(np.linspace(0, len(every) - 1, SAMPLED_IMAGES).round().astype(int))]
    with one_thread_per_image(), ThreadPoolExecutor(core_count()) as pool:
        sample = list(_images(capture, chosen))
        tried: list[str] = []
        for group in _alternatives(detections.board, sample):
            tried += [board.spec for board in group]
            scores = [_score(list(pool.map(partial(_corners, board), sample))) for board in group]
            best = max(range(len(group)), key=scores.__getitem__, default=None)
            if best is None or scores[best][0] < max(1.0, LEAST_SHARE * len(sample)):
                continue
            found = scores[best][0]
            if len(every) <= COUNTED_IMAGES and all(capture.cameras[c].kind == "images" for c in cameras):
                chosen = every
                found, _ = _score(list(pool.map(partial(_corners, group[best]), _images(capture, every))))
            seen = {(c, view.frame_idx) for c in cameras for view in detections.cameras[c].views}
            return _Count(group[best], found, len(seen & set(chosen)), len(chosen), len(chosen) < len(every))
    return tried


def _corners(board: Board, grey: Grey) -> int:
    """Usable corners of a board in an image."""
    found = find_board(grey, board, thorough=False)
    return len(found.corner_ids) if found is not None and not found.problem else 0


def _score(corners: Sequence[int]) -> tuple[int, int]:
    """In how many images a board is found, and with how many corners."""
    return sum(count > 0 for count in corners), sum(corners)


def _images(capture: Capture, frames: Sequence[tuple[int, int]]) -> Iterator[Grey]:
    """The images of (camera, frame), which are in order."""
    for c, camera in enumerate(capture.cameras):
        wanted = [frame for of_camera, frame in frames if of_camera == c]
        if camera.kind == "images":
            yield from (read_image(camera, camera.paths[frame]) for frame in wanted)
        elif wanted:
            frames_to_last = islice(read_frames(camera), wanted[-1] + 1)
            yield from (image for index, image in frames_to_last if index in wanted)


def _alternatives(board: Board, sample: Sequence[Grey]) -> list[list[Board]]:
    """Groups of other boards that may have been meant, likely groups first."""
    if isinstance(board, Checkerboard):
        groups: list[list[Board]] = _other_checkerboards(board, sample)
    elif isinstance(board, Charuco):
        groups = _other_charucos(board)
    else:
        groups = _other_aprilgrids(board)
    return [[other for other in dict.fromkeys(group) if other != board] for group in groups]


def _other_checkerboards(board: Checkerboard, sample: Sequence[Grey]) -> list[list[Board]]:
    """Sizes that the growing grid reaches most often; squares counted instead of inner corners, and the reverse."""
    votes = Counter(size for grey in sample if (size := _grown_size(grey)) is not None)
    long, short = max(board.columns, board.rows), min(board.columns, board.rows)
    groups = [[size for size, _ in votes.most_common(4)], [(long - 1, short - 1), (long + 1, short + 1)]]
    upright = board.columns < board.rows
    return [
        [
            replace(board, columns=min(size) if upright else max(size), rows=max(size) if upright else min(size))
            for size in group
            if min(size) >= 3 and size != (long, short)
        ]
        for group in groups
    ]


def _grown_size(grey: Grey) -> tuple[int, int] | None:
    """Corners along the longer and the shorter side of the checkerboard that a small grid grows to."""
    scale = min(1.0, (1_000_000 / grey.size) ** 0.5)
    small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    cv2.setRNGSeed(0)
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, _, meta = cv2.findChessboardCornersSBWithMeta(small, SMALLEST_GRID, flags)
    return (max(meta.shape), min(meta.shape)) if found else None


def _other_charucos(board: Charuco) -> list[list[Board]]:
    """Black and white exchanged, columns and rows exchanged, the older layout; inner corners counted, other markers."""
    printed = [board, replace(board, inverted=not board.inverted)]
    turned = [replace(b, columns=b.rows, rows=b.columns) for b in printed]
    older = [replace(b, legacy=not b.legacy) for b in (*printed, *turned)]
    counted = [replace(b, columns=b.columns + 1, rows=b.rows + 1) for b in printed]
    markers = [replace(b, dictionary=name) for name in MARKER_DICTIONARIES for b in printed]
    ratios = [replace(b, marker_ratio=ratio) for ratio in MARKER_RATIOS for b in printed]
    return [[*printed], [*turned, *older], [*counted], [*markers], [*ratios]]


def _other_aprilgrids(board: AprilGrid) -> list[list[Board]]:
    """The other border, one or two columns or rows more or less, other families.

    More rows than there are change no tag's place, so that the smallest of the grids that show the most corners counts.
    """
    borders = [board, replace(board, border_bits=3 - board.border_bits)]
    sizes = {(board.columns + c, board.rows + r) for c in range(-2, 3) for r in range(-2, 3)} | {
        (board.rows, board.columns)
    }
    grids = [
        replace(board, columns=c, rows=r) for c, r in sorted(sizes, key=lambda s: (s[0] * s[1], s)) if min(c, r) >= 2
    ]
    return [[*borders], [*grids], [replace(b, family=name) for name in CODE_BITS for b in borders]]
