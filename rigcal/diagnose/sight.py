"""The given board is there, but too small, blurred or faint to be found: measured on what shows it all the same.

The sample is searched again enlarged, with its contrast stretched and sharpened. Where that shows the board, its
squares, the blur of its edges and the step from black to white are measured in the image as it is, and the measure
that is farthest beyond its limit is the cause. The squares of a ChArUco board are seen longer than its markers are
read, so they count as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import cv2
import numpy as np

from rigcal.board import AprilGrid, Board, Charuco, Checkerboard
from rigcal.detect import find_board
from rigcal.detect.found import FoundBoard, Grey
from rigcal.detect.lattice import find_grids
from rigcal.detect.markers import CODE_BITS, corner_steps
from rigcal.detect.saddles import find_saddles
from rigcal.diagnose.sample import Shot
from rigcal.geometry import Floats

LEAST_STEP = 5.0
"""Grey levels from black to white: at 4 half of the boards are missed, at 10 none."""
SQUARE_PX = 6.0
"""Side of a checkerboard's square: at 5.8 px some tilted ones are missed, at 7 none."""
BIT_PX = 2.75
"""Side of a marker's bit: at 2.2 px half of the boards are missed."""
SQUARE_BLUR, BIT_BLUR = 0.22, 0.4
"""Sigma of the blur in squares and in bits: beyond it finders lose the board."""
CLEAR = 1.3
"""Times better than its limit: then it is not what hides a board."""
LEAST_SHARE = 0.1
"""Share of the images that must show the board."""
NOISE_BLUR_PX = 1.0
"""Gaussian blur against noise before slopes are measured; it is taken off again."""
STEEPEST = 0.995
"""Quantile of the slopes from which on a place belongs to the sharpest edges."""
PROBED = 5
"""Images, the likeliest ones, that are looked at in every way."""

_Look: TypeAlias = Callable[[Grey], FoundBoard | None]
"""A way to look for a board in an image; its corners are in the pixels of the image as it is."""


@dataclass(frozen=True, slots=True)
class Measure:
    """Something that was measured where the board shows."""

    name: str
    """``square``, ``blur``, ``step``, ``markers`` or ``part``."""
    value: float
    """Median over the images in pixels or grey levels; of a part, its corners."""
    limit: float
    """What finders need: at least this, for a blur at most."""
    square_px: float
    """Median side of a square in the same images."""

    @property
    def margin(self) -> float:
        """1 at the limit, less where it is worse."""
        return self.limit / max(self.value, 1e-9) if self.name == "blur" else self.value / self.limit


@dataclass(frozen=True, slots=True)
class Sight:
    """Why a board that is there is not found."""

    cause: Measure
    shown: int
    """Images that show the board after all."""
    images: int


def poor_sight(given: Board, shots: Sequence[Shot], pool: ThreadPoolExecutor) -> Sight | None:
    """Why the given board is not found in images that show it, or None where they do not.

    Args:
        given: the board that was given.
        shots: a sample of images, the likeliest first.
        pool: threads.
    """
    looks = _looks(given)
    probed = [len(_shown(look, shots[:PROBED], pool)) for _, look in looks]
    board, look = looks[probed.index(max(probed))]
    shown = _shown(look, shots, pool) if max(probed) else []
    if len(shown) < max(1.0, LEAST_SHARE * len(shots)):
        return None
    side_px = float(np.median([square_px(board, found) for _, found in shown]))
    blur_px = float(np.median([_sharpest_px(_part(shot.grey, found), side_px) for shot, found in shown]))
    step = float(np.median([_step(shot.grey, found.corners_px) for shot, found in shown]))
    bit = _bit(given)
    measures = [
        Measure("square", side_px, BIT_PX / bit if bit else SQUARE_PX, side_px),
        Measure("blur", blur_px, side_px * (BIT_BLUR * bit if bit else SQUARE_BLUR), side_px),
        Measure("step", step, LEAST_STEP, side_px),
    ]
    cause = min(measures, key=lambda measure: measure.margin)
    if cause.margin > CLEAR:
        if board == given:
            return None
        cause = Measure("markers", 0.0, 0.0, side_px)
    return Sight(cause, len(shown), len(shots))


def _looks(given: Board) -> list[tuple[Board, _Look]]:
    """Ways to look, and for which board: the given one in prepared images, and the squares of a ChArUco board."""
    prepared = ((2.0, _enlarged), (1.0, _stretched), (1.0, _sharpened))
    looks: list[tuple[Board, _Look]] = [(given, partial(_find, given, *way)) for way in prepared]
    if isinstance(given, Charuco) and min(given.columns, given.rows) >= 4:
        squares = Checkerboard(given.columns - 1, given.rows - 1, given.square_size_m)
        looks.append((squares, partial(_squares, squares)))
    return looks


def _shown(look: _Look, shots: Sequence[Shot], pool: ThreadPoolExecutor) -> list[tuple[Shot, FoundBoard]]:
    """Images that show the board when looked at in one way."""
    finds = pool.map(look, [shot.grey for shot in shots])
    return [(shot, found) for shot, found in zip(shots, finds, strict=True) if found is not None]


def _find(board: Board, scale: float, prepare: Callable[[Grey], Grey], grey: Grey) -> FoundBoard | None:
    """The board in the prepared image, which is ``scale`` times larger."""
    found = find_board(prepare(grey), board, thorough=False)
    if found is None or found.problem:
        return None
    return replace(found, corners_px=(found.corners_px + 0.5) / scale - 0.5)


def _squares(board: Checkerboard, grey: Grey) -> FoundBoard | None:
    """A grid of crossings, whatever is printed in the squares; markers are finer, and are gone in smaller copies."""
    for scale in (4, 2, 1):
        small = cv2.resize(grey, None, fx=1 / scale, fy=1 / scale, interpolation=cv2.INTER_AREA)
        grids = find_grids(find_saddles(np.asarray(small, dtype=np.uint8)), (board.columns, board.rows))
        if grids:
            return FoundBoard(np.arange(board.columns * board.rows), (grids[0].reshape(-1, 2) + 0.5) * scale - 0.5)
    return None


def _enlarged(grey: Grey) -> Grey:
    return np.asarray(cv2.resize(grey, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC), dtype=np.uint8)


def _stretched(grey: Grey) -> Grey:
    """Smoothed against noise, from its darkest to its brightest half per cent."""
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), 1.0)
    low, high = np.percentile(smooth, [0.5, 99.5])
    return np.asarray(np.clip((smooth - low) * 255 / max(high - low, 1.0), 0, 255), dtype=np.uint8)


def _sharpened(grey: Grey) -> Grey:
    """Details of a few pixels seven times as strong."""
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), 1.3)
    return np.asarray(np.clip(7 * smooth - 6 * cv2.GaussianBlur(smooth, (0, 0), 4.0), 0, 255), dtype=np.uint8)


def square_px(board: Board, found: FoundBoard) -> float:
    """Median side of a board's squares or tags in pixels."""
    return float(np.median(np.linalg.norm(np.concatenate(_steps(board, found)), axis=1)))


def _steps(board: Board, found: FoundBoard) -> tuple[Floats, Floats]:
    return corner_steps(board.corners_in_board[found.corner_ids] / board.square_size_m, found.corners_px)


def _step(grey: Grey, corners_px: Floats) -> float:
    """Grey levels from the dark to the light squares within the board's outline."""
    outline = cv2.convexHull(np.rint(corners_px).astype(np.int32))
    inside = cv2.fillConvexPoly(np.zeros_like(grey), outline, (1,)) > 0
    low, high = np.percentile(cv2.blur(grey, (3, 3))[inside], [10, 90])
    return float(high - low)


def _bit(board: Board) -> float | None:
    """Side of a marker's bit in squares or tags; None for checkerboards."""
    if isinstance(board, AprilGrid):
        return 1 / (CODE_BITS[board.family] + 2 * board.border_bits)
    if isinstance(board, Charuco):
        code = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary)).markerSize
        return board.marker_ratio / (code + 2)
    return None


def part_in_sight(given: Board, shots: Sequence[Shot], pool: ThreadPoolExecutor) -> Sight | None:
    """Whether images show a part of a checkerboard, half of its columns and rows at least; the others are hidden."""
    if not isinstance(given, Checkerboard):
        return None
    most = list(pool.map(partial(_corners_of_part, given), [shot.grey for shot in shots[:PROBED]]))
    shown = [count for count in most if count]
    if not shown:
        return None
    part = Measure("part", float(np.median(shown)), given.columns * given.rows, 0.0)
    return Sight(part, len(shown), len(most))


def _corners_of_part(given: Checkerboard, grey: Grey) -> int:
    """Corners of the largest part of a checkerboard that an image shows; 0 where there is none."""
    cut = np.indices((given.columns // 2 + 1, given.rows // 2 + 1)).reshape(2, -1).T[1:]
    sizes = [(given.columns - int(c), given.rows - int(r)) for c, r in cut]
    for columns, rows in sorted(sizes, key=lambda size: -size[0] * size[1]):
        if min(columns, rows) >= 3:
            part = replace(given, columns=columns, rows=rows)
            if find_board(grey, part, thorough=False) is not None:
                return columns * rows
    return 0


def looks_of_images(shots: Sequence[Shot]) -> str:
    """What the images are like, in words: their grey values, and how wide their sharpest edges are blurred."""
    low, high = np.median([np.percentile(shot.grey, [1, 99]) for shot in shots], axis=0)
    greys = f"grey values {low:.0f} to {high:.0f} of 255"
    if high - low < LEAST_STEP:
        return f"{greys} and no edge"
    edges_px = float(np.median([_sharpest_px(shot.grey) for shot in shots]))
    return f"{greys}, the sharpest edges blurred over {edges_px:.1f} px"


def _part(grey: Grey, found: FoundBoard) -> Grey:
    """The part of an image within a board's outermost corners."""
    low, high = np.floor(found.corners_px.min(axis=0)).astype(int), np.ceil(found.corners_px.max(axis=0)).astype(int)
    return grey[max(low[1], 0) : high[1] + 1, max(low[0], 0) : high[0] + 1]


def _sharpest_px(grey: Grey, square_px: float = 25.0) -> float:
    """Sigma of the blur of an image's steepest places: an edge's height over its slope and sqrt(2 pi)."""
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), NOISE_BLUR_PX)
    slope = np.hypot(cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)) / 8
    around = np.ones((max(round(square_px), 3),) * 2, np.uint8)
    height = cv2.dilate(smooth, around) - cv2.erode(smooth, around)
    steep = slope >= np.quantile(slope, STEEPEST)
    sigma = float(np.median(height[steep] / np.maximum(slope[steep], 1e-3))) / np.sqrt(2 * np.pi)
    return float(np.sqrt(max(sigma**2 - NOISE_BLUR_PX**2, 0.0)))
