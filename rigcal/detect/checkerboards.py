"""Checkerboards in one image: several finders from cheap to thorough, and one judge for what any of them returns.

The judge is the fit of :mod:`rigcal.detect.crossings`. A finder's corners are kept where nearly all of them are
crossings whose light and dark quadrants alternate over the grid, evenly spaced. That tells real boards from the grids
that the exhaustive finder makes up (in 3 of the 28 stills of a real capture). Dark and light must alternate just
beyond the last corners, and no longer a square farther out. So a row too many, at the border of the printed squares, is
told (9x7 corners were found in 7 of 26 images of a 9x6 board), and a part of a larger board: the older finder finds 8x6
corners in 12 of 13 images of a 9x6 board.

Order: right-handed as seen from the front, x along the columns. Where columns + rows is odd, the square between
corners 0, 1, ``columns`` and ``columns + 1`` is dark, as on a board whose top left square is black. OpenCV's older
finder gives this order, and its newer one the opposite, in every real image tried (112). Where columns + rows is even,
the board looks the same turned by 180 degrees; then the first corner is the one of the two nearer to the upper left.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from rigcal.board import Checkerboard
from rigcal.detect.crossings import Crossings, are_crossings, fit_crossings
from rigcal.detect.found import FoundBoard, Grey
from rigcal.geometry import Bools, Floats

REACH = 0.42
"""Radius of the fitted window in squares; the neighbours' edges begin at 1, blur and a rough guess need the rest."""
SMALLEST_SQUARE_PX = 4.0
MOST_BEND = 0.3
"""Distance of a corner from the middle of its neighbours, in squares; 0.06 at the steepest real view."""
JUST_BEYOND = 0.25
"""Squares outside of the last corners: boards are seen whose outermost squares are cut to 0.4 of the others."""
HALF_ALTERNATING = 0.6
"""Share of the places along a side. In the outermost squares of 290 finds of whole boards it is 0.71 or more, beyond
them 0.29 or less; a row of corners too many has 0 where it should have 1, one too few 0.75 or more where 0 is due."""
LEAST_GOOD = 0.9
"""Share of the corners that must pass; a finger or a reflection may hide the others."""
WORKING_PX = 1_000_000
"""Finders search images of at most this many pixels, and the full image only where that finds nothing."""


Finder: TypeAlias = Callable[[Grey, tuple[int, int]], NDArray[Any] | None]
"""Finds a grid of (columns, rows) corners in an image."""


@dataclass(frozen=True, slots=True, eq=False)
class _Grid:
    """Judged corners in the order of the board."""

    corners_px: Floats
    """(rows, columns, 2) pixels."""
    contrast: Floats
    """(rows, columns) as :class:`Crossings`, positive where the square below and right of the corner is light."""
    good: Bools
    """(rows, columns) whether the corner is a crossing."""
    sign: float
    """Sign of the contrast of corner (0, 0)."""


def find_checkerboard(grey: Grey, board: Checkerboard, *, thorough: bool = True) -> FoundBoard | None:
    """Corners of a checkerboard that is wholly in view, or None.

    Args:
        grey: (height, width) 8-bit image.
        board: inner corners to look for.
        thorough: try the slow finders too, where the quick ones find nothing.
    """
    refused = None
    for raw in _proposals(grey, (board.columns, board.rows), thorough):
        grid = _judge(grey, raw)
        if grid is None:
            continue
        if min(_borders(grey, grid, JUST_BEYOND), default=1.0) < HALF_ALTERNATING:
            continue
        found = _in_order(grid, board)
        if max(_borders(grey, grid, 1 + JUST_BEYOND), default=0.0) < HALF_ALTERNATING:
            return found
        refused = replace(found, problem=f"a checkerboard larger than {board.columns}x{board.rows} inner corners")
    return refused


def _proposals(grey: Grey, size: tuple[int, int], thorough: bool) -> Iterator[Floats]:
    """Grids (rows, columns, 2) in pixels that the finders propose, cheapest first."""
    halvings = 0
    while grey.size / 4**halvings > WORKING_PX:
        halvings += 1
    small_scale = 2.0**halvings
    shrunk = cv2.resize(grey, None, fx=1 / small_scale, fy=1 / small_scale, interpolation=cv2.INTER_AREA)
    small = np.asarray(shrunk, dtype=np.uint8)
    searches: list[tuple[Grey, float, Finder]] = [(small, small_scale, _sectors), (grey, 1.0, _quads_if_likely)]
    if thorough:
        searches += [(small, small_scale, _quads), (small, small_scale, _sectors_exhaustive), (grey, 1.0, _quads)]
        searches += [(grey, 1.0, _sectors)] if halvings else []
    for image, scale, finder in searches:
        corners = finder(image, size)
        if corners is not None:
            yield (corners.reshape(size[1], size[0], 2).astype(np.float64) + 0.5) * scale - 0.5


def _sectors(grey: Grey, size: tuple[int, int], flags: int = 0) -> NDArray[Any] | None:
    """OpenCV's newer finder. Its search trees are random, so their seed is set each time."""
    cv2.setRNGSeed(0)
    found, corners = cv2.findChessboardCornersSB(grey, size, flags=flags)
    return corners if found else None


def _sectors_exhaustive(grey: Grey, size: tuple[int, int]) -> NDArray[Any] | None:
    return _sectors(grey, size, cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE)


def _quads(grey: Grey, size: tuple[int, int], flags: int = 0) -> NDArray[Any] | None:
    """OpenCV's older finder."""
    usual = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, corners = cv2.findChessboardCorners(grey, size, flags=usual | flags)
    return corners if found else None


def _quads_if_likely(grey: Grey, size: tuple[int, int]) -> NDArray[Any] | None:
    return _quads(grey, size, cv2.CALIB_CB_FAST_CHECK)


def _judge(grey: Grey, raw: Floats) -> _Grid | None:
    """The fitted grid, right-handed, or None where it is no checkerboard."""
    if _cell_areas(raw).mean() < 0:
        raw = raw[:, ::-1]
    along_x, along_y = np.gradient(raw, axis=1), np.gradient(raw, axis=0)
    if not np.isfinite(raw).all() or _cross(along_x, along_y).min() < SMALLEST_SQUARE_PX**2:
        return None
    fit = _fit(grey, raw, along_x, along_y)
    corners, contrast = fit.corners_px.reshape(raw.shape), fit.contrast.reshape(raw.shape[:2])
    alternating = contrast * _checker(contrast)
    sign = 1.0 if np.median(alternating) > 0 else -1.0
    good = (alternating * sign > 0) & are_crossings(fit, along_x, along_y).reshape(contrast.shape)
    good &= _off_lattice(corners) < MOST_BEND
    if good.mean() < LEAST_GOOD:
        return None
    return _Grid(corners, contrast, good, sign)


def _fit(grey: Grey, corners: Floats, along_x: Floats, along_y: Floats) -> Crossings:
    return fit_crossings(grey, corners.reshape(-1, 2), along_x.reshape(-1, 2), along_y.reshape(-1, 2), reach=REACH)


def _borders(grey: Grey, grid: _Grid, beyond: float) -> list[float]:
    """Per side of the grid in view, the share of places that many squares beyond it where dark and light alternate.

    Just beyond the last corners they do, in the outermost squares, although these may be cut to less than half. Just
    beyond where the next corners would be there is a margin of one colour, unless the grid is a part of a larger board.
    """
    p, step = grid.corners_px, 2 * float(np.median(np.abs(grid.contrast)))
    size_px = float(np.sqrt(np.abs(_cell_areas(p)).mean()))
    smooth = cv2.blur(grey, (2 * round(0.1 * size_px) + 1,) * 2).astype(np.float32)
    shares = []
    for rows in (p, p[::-1], p.transpose(1, 0, 2), p.transpose(1, 0, 2)[::-1]):
        outwards, bend = rows[0] - rows[1], rows[0] - 2 * rows[1] + rows[2]
        line = rows[0] + beyond * outwards + beyond * (beyond + 1) / 2 * bend
        between = ((line[:-1] + line[1:]) / 2).astype(np.float32)
        seen = (between > 1).all(axis=1) & (between < np.array(grey.shape[::-1]) - 2).all(axis=1)
        values = cv2.remap(smooth, between[:, 0], between[:, 1], cv2.INTER_LINEAR).ravel()
        jumps = (np.diff(values) * (1 - 2 * (np.arange(len(values) - 1) % 2)) / step)[seen[1:] & seen[:-1]]
        if len(jumps) >= 2:
            shares.append(float(max((jumps > 0.4).mean(), (jumps < -0.4).mean())))
    return shares


def _in_order(grid: _Grid, board: Checkerboard) -> FoundBoard:
    """The good corners in the order that the module describes."""
    corners, good = grid.corners_px.reshape(-1, 2), grid.good.ravel()
    turned = bool(corners[-1].sum() < corners[0].sum()) if board.is_symmetric else grid.sign > 0
    if turned:
        corners, good = corners[::-1], good[::-1]
    ids = np.flatnonzero(good)
    return FoundBoard(ids, corners[ids], turned=turned and not board.is_symmetric)


def _checker(like: Floats) -> Floats:
    return np.asarray(1.0 - 2.0 * (np.indices(like.shape).sum(axis=0) % 2))


def _cross(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _cell_areas(grid: Floats) -> Floats:
    return _cross(np.diff(grid, axis=1)[:-1], np.diff(grid, axis=0)[:, :-1])


def _off_lattice(grid: Floats) -> Floats:
    """(rows, columns) distance of each corner from where its neighbours in a line have it, in squares, at most."""
    off = np.zeros(grid.shape[:2])
    for line, result in ((grid, off), (grid.transpose(1, 0, 2), off.T)):
        guess = np.concatenate([2 * line[1:2] - line[2:3], (line[:-2] + line[2:]) / 2, 2 * line[-2:-1] - line[-3:-2]])
        square_px = np.linalg.norm(np.gradient(line, axis=0), axis=-1)
        np.maximum(result, np.linalg.norm(line - guess, axis=-1) / square_px, out=result)
    return off
