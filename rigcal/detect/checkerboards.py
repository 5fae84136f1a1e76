"""Checkerboards in one image: several finders from cheap to thorough, and one judge for what any of them returns.

The first finder is ours: saddles of the brightness (:mod:`rigcal.detect.saddles`) that are joined into grids
(:mod:`rigcal.detect.lattice`), in the image reduced as far as boards can be seen, then at twice that size, then in
full. On 112 rendered images of 14 kinds it finds every board, ``cv2.findChessboardCornersSB`` 103; on 114 real ones it
finds 113, the best flag set of that finder 103; in a fifteenth of its time with and without boards. OpenCV's finders
come after it, where a camera has few views.

The judge is the fit of :mod:`rigcal.detect.crossings`. A finder's corners are kept where nearly all of them are
crossings whose light and dark quadrants alternate over the grid, evenly spaced. That tells real boards from the grids
that the exhaustive finder makes up (in 3 of the 28 stills of a real capture). Dark and light must alternate just
beyond the last corners, and no longer a square farther out. So a row too many, at the border of the printed squares, is
told (9x7 corners were found in 7 of 26 images of a 9x6 board), and a part of a larger board: OpenCV's older finder
finds 8x6 corners in 12 of 13 images of a 9x6 board.

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
from rigcal.detect.lattice import find_grids
from rigcal.detect.saddles import find_saddles
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
DISTURBED_TIMES, DISTURBED = 3.0, 0.12
"""A corner is left out where its misfit is that many times the board's median, and that much at least: the edge of a
shadow runs through it, or a reflection. Such corners were 0.4 px (rms) from the truth, the others 0.02; of 5,000
corners of real boards, 4 are left out."""
WORKING_PX = 1_000_000
"""OpenCV's finders search images of at most this many pixels, and the full image only where that finds nothing."""
SMALLEST_PX = 100_000
"""Pixels of the smallest image that is searched; the search begins there."""
WORTH_PX, LEAST_SADDLES = 400_000, 0.4
"""A larger image than that is only searched where the next smaller one shows saddles for that share of the corners:
boards at half the size showed 0.9 of theirs or more."""


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
    blur_px: float
    """Width of the edges in the middle of the good corners, as :class:`Crossings`."""


def find_checkerboard(grey: Grey, board: Checkerboard, *, thorough: bool = True) -> FoundBoard | None:
    """Corners of a checkerboard that is wholly in view, or None.

    Args:
        grey: (height, width) 8-bit image.
        board: inner corners to look for.
        thorough: try OpenCV's finders too, where ours finds nothing.
    """
    refused: FoundBoard | None = None
    known: list[Floats] = []
    for raw, has_order in _proposals(grey, (board.columns, board.rows), thorough):
        grid = None if any(_alike(raw, corners) for corners in known) else _judge(grey, raw)
        if grid is None:
            continue
        known.append(grid.corners_px)
        just_beyond, next_row = _borders(grey, grid)
        if min(just_beyond, default=1.0) < HALF_ALTERNATING:
            continue
        found = _in_order(grid, board, has_order)
        if max(next_row, default=0.0) < HALF_ALTERNATING:
            return found
        refused = replace(found, problem=f"a checkerboard larger than {board.columns}x{board.rows} inner corners")
    return refused


def _proposals(grey: Grey, size: tuple[int, int], thorough: bool) -> Iterator[tuple[Floats, bool]]:
    """Grids (rows, columns, 2) in pixels that the finders propose, cheapest first; and whether their order is that of
    a finder which means something by it."""
    pyramid = _pyramid(grey)
    for scale, image in reversed(pyramid):
        saddles = find_saddles(image)
        yield from ((_enlarged(grid, scale), False) for grid in find_grids(saddles, size))
        if image.size > WORTH_PX and len(saddles.points_px) < LEAST_SADDLES * size[0] * size[1]:
            break
    if not thorough:
        return
    small_scale, small = next((s, image) for s, image in pyramid if image.size <= WORKING_PX)
    searches: list[tuple[Grey, float, Finder]] = [(small, small_scale, _sectors), (grey, 1.0, _quads_if_likely)]
    searches += [(small, small_scale, _quads), (small, small_scale, _sectors_exhaustive), (grey, 1.0, _quads)]
    searches += [(grey, 1.0, _sectors)] if small_scale > 1 else []
    for image, scale, finder in searches:
        corners = finder(image, size)
        if corners is not None:
            yield _enlarged(corners.reshape(size[1], size[0], 2).astype(np.float64), scale), True


def _pyramid(grey: Grey) -> list[tuple[float, Grey]]:
    """Scale and image: the full one, and halves of it down to ``SMALLEST_PX`` or a little more; two halves at least."""
    images = [(1.0, grey)]
    while len(images) < 3 or images[-1][1].size > 4 * SMALLEST_PX:
        scale, larger = images[-1]
        half = cv2.resize(larger, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        images.append((2 * scale, np.asarray(half, dtype=np.uint8)))
    return images


def _enlarged(grid: Floats, scale: float) -> Floats:
    return (grid + 0.5) * scale - 0.5


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
    likely = ((raw > 0) & (raw < np.array(grey.shape[::-1]) - 1)).all(axis=-1) & (_off_lattice(raw) < 2 * MOST_BEND)
    if likely.mean() < LEAST_GOOD or _cross(along_x, along_y).min() < SMALLEST_SQUARE_PX**2:
        return None
    fit = _fit(grey, raw, along_x, along_y)
    corners, contrast = fit.corners_px.reshape(raw.shape), fit.contrast.reshape(raw.shape[:2])
    alternating = contrast * _checker(contrast)
    sign = 1.0 if np.median(alternating) > 0 else -1.0
    good = (alternating * sign > 0) & are_crossings(fit, along_x, along_y).reshape(contrast.shape)
    good &= _off_lattice(corners) < MOST_BEND
    if good.mean() < LEAST_GOOD:
        return None
    misfit = fit.misfit.reshape(good.shape)
    good &= misfit < max(DISTURBED_TIMES * float(np.median(misfit[good])), DISTURBED)
    return _Grid(corners, contrast, good, sign, float(np.median(fit.blur_px[good.ravel()])))


def _alike(one: Floats, other: Floats) -> bool:
    """Whether two grids are the same to a tenth of a square, whichever way round."""
    turned = np.stack([other, other[::-1], other[:, ::-1], other[::-1, ::-1]])
    apart = np.linalg.norm(turned - one, axis=-1).max(axis=(1, 2)).min()
    return bool(apart < 0.1 * np.sqrt(np.abs(_cell_areas(one)).mean()))


def _fit(grey: Grey, corners: Floats, along_x: Floats, along_y: Floats) -> Crossings:
    return fit_crossings(grey, corners.reshape(-1, 2), along_x.reshape(-1, 2), along_y.reshape(-1, 2), reach=REACH)


def _borders(grey: Grey, grid: _Grid) -> tuple[list[float], list[float]]:
    """Per side of the grid in view, the share of places beyond it where dark and light alternate: just beyond it, and a
    square farther out.

    Just beyond the last corners they do, in the outermost squares, although these may be cut to less than half. Just
    beyond where the next corners would be there is a margin of one colour, unless the grid is a part of a larger board.
    """
    p = grid.corners_px
    size_px = float(np.sqrt(np.abs(_cell_areas(p)).mean()))
    reach_px = 3 * max(float(np.linalg.norm(np.gradient(p, axis=axis), axis=-1).max()) for axis in (0, 1))
    low = np.maximum(np.floor(p.min(axis=(0, 1)) - reach_px), 0).astype(int)
    high = np.ceil(p.max(axis=(0, 1)) + reach_px).astype(int)
    part = cv2.blur(grey[low[1] : high[1], low[0] : high[0]], (2 * round(0.1 * size_px) + 1,) * 2)
    placed = np.concatenate([p - low, grid.contrast[..., None]], axis=-1)
    sides = [placed.transpose(*axes, 2)[::turn] for axes in ((0, 1), (1, 0)) for turn in (1, -1)]
    shares = [[_alternating(part, side, beyond) for side in sides] for beyond in (JUST_BEYOND, 1 + JUST_BEYOND)]
    just_beyond, next_row = ([share for share in row if share is not None] for row in shares)
    return just_beyond, next_row


def _alternating(smooth: NDArray[Any], placed: Floats, beyond: float) -> float | None:
    """Share of the places ``beyond`` squares before the first row where the grey values alternate by nearly as much as
    at its corners; None out of view. ``placed`` (rows, columns, 3): corners in pixels, and their contrast."""
    rows, step = placed[:3, :, :2], 2 * np.abs(placed[0, 1:-1, 2])
    outwards, bend = rows[0] - rows[1], rows[0] - 2 * rows[1] + rows[2]
    line = rows[0] + beyond * outwards + beyond * (beyond + 1) / 2 * bend
    between = ((line[:-1] + line[1:]) / 2).astype(np.float32)
    seen = (between > 1).all(axis=1) & (between < np.array(smooth.shape[::-1]) - 2).all(axis=1)
    values = cv2.remap(smooth, between[:, 0], between[:, 1], cv2.INTER_LINEAR).ravel().astype(np.float64)
    turns = 1 - 2 * (np.arange(len(values) - 1) % 2)
    jumps = (np.diff(values) * turns / np.maximum(step, 1.0))[seen[1:] & seen[:-1]]
    return float(max((jumps > 0.4).mean(), (jumps < -0.4).mean())) if len(jumps) >= 2 else None


def _in_order(grid: _Grid, board: Checkerboard, has_order: bool) -> FoundBoard:
    """The good corners in the order that the module describes."""
    corners, good = grid.corners_px.reshape(-1, 2), grid.good.ravel()
    turned = bool(corners[-1].sum() < corners[0].sum()) if board.is_symmetric else grid.sign > 0
    if turned:
        corners, good = corners[::-1], good[::-1]
    ids = np.flatnonzero(good)
    against_colours = turned and has_order and not board.is_symmetric
    return FoundBoard(ids, corners[ids], turned=against_colours, blur_px=grid.blur_px)


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
        square_px = np.maximum(np.linalg.norm(np.gradient(line, axis=0), axis=-1), 1e-9)
        np.maximum(result, np.linalg.norm(line - guess, axis=-1) / square_px, out=result)
    return off
