"""Which marker board is in the images: its dictionary, layout, proportions and colours, read from the markers alone.

Markers carry numbers, and a board sets them in rows. So the number of columns is the one with which the markers'
centres lie as on a plane, the number of rows follows from the highest number, and the markers' own size, measured in
steps from one to the next, is the ratio that was printed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import cv2
import numpy as np

from rigcal.board import AprilGrid, Charuco
from rigcal.detect.found import Grey
from rigcal.detect.markers import SMALLEST_MARKER_PX, TOUCHED_THRESHOLD, find_aprilgrid
from rigcal.diagnose.spacing import measured_spacing
from rigcal.geometry import Floats, Ints

DICTIONARIES = ("DICT_4X4_100", "DICT_5X5_100", "DICT_6X6_100", "DICT_7X7_100", "DICT_ARUCO_ORIGINAL")
"""Those of one code begin alike, so that one stands for all of its sizes; boards seldom have more than 100 markers."""
MOST_MARKERS = 100
SET_SIZES = (50, 100, 250)
FAMILIES = ("tag36h11", "tag25h9", "tag16h5", "tag36h10")
COLUMNS = range(2, 17)
LEAST_MARKERS = 6
"""In an image: a plane goes through any four."""
OFF_PLACE = 0.3
"""Distance of a marker's centre from its place, in steps."""
LEAST_FITTING = 0.8
"""Share of the markers that must lie in their places."""
RATIO_STEP, RATIO_SHRUNK = 0.05, 0.015
"""Marker ratios are told to that step; markers come out 0.01-0.02 smaller than printed, for want of sharpness."""

Seen: TypeAlias = tuple[Ints, Floats]
"""Markers in an image: numbers (n,) and corners (n, 4, 2) in pixels."""
Places: TypeAlias = Callable[[Ints], Floats]
"""(n, 2) places of numbered markers, in steps along the board's x and y axes."""


@dataclass(frozen=True, slots=True)
class _Layout:
    """How a board may number its markers."""

    columns: int
    legacy: bool
    places: Places


@dataclass(frozen=True, slots=True)
class _Fit:
    """The layout that the markers of one dictionary fit best."""

    name: str
    """Dictionary, or family of tags."""
    layout: _Layout
    fitting: int
    """Markers in their places, in all images."""
    last: int
    """The highest number among them."""
    marker_size: float
    """Side of a marker in steps."""
    variant: bool | int
    """Whether black and white are exchanged, or the width of a tag's border in bits."""


def printed_board(images: Sequence[Grey], size_m: float) -> Charuco | AprilGrid | None:
    """The marker board that images (height, width) show, or None.

    Args:
        images: 8-bit images.
        size_m: what is to be said of the side of a square or a tag, which cannot be seen.
    """
    for inverted in (False, True):
        shown = [np.asarray(cv2.bitwise_not(image), dtype=np.uint8) for image in images] if inverted else images
        fit = _best_fit(DICTIONARIES, DICTIONARIES, _charuco_layouts(), shown, inverted)
        if fit is not None and (charuco := _charuco(fit, size_m)) is not None:
            return charuco
    smooth = [np.asarray(cv2.GaussianBlur(image, (0, 0), 0.8), dtype=np.uint8) for image in images]
    names = [AprilGrid(2, 2, size_m, family=family).dictionary for family in FAMILIES]
    for border_bits in (2, 1):
        fit = _best_fit(FAMILIES, names, _grid_layouts(), smooth, border_bits)
        if fit is not None and (grid := _aprilgrid(fit, images, size_m)) is not None:
            return grid
    return None


def _best_fit(
    names: Sequence[str],
    dictionaries: Sequence[str],
    layouts: Sequence[_Layout],
    images: Sequence[Grey],
    variant: bool | int,
) -> _Fit | None:
    """The dictionary and the layout that the most markers fit; the images are searched once for all dictionaries."""
    found = [_read(image, dictionaries, 1 if isinstance(variant, bool) else variant) for image in images]
    fits: list[_Fit] = []
    for k, name in enumerate(names):
        seen = [by_dictionary[k] for by_dictionary in found if len(by_dictionary[k][0]) >= LEAST_MARKERS]
        tried = [fit for layout in layouts if seen and (fit := _fit(seen, layout, name, variant)) is not None]
        best = max(tried, key=lambda fit: fit.fitting, default=None)
        if best is not None and best.fitting >= LEAST_FITTING * sum(len(ids) for ids, _ in seen):
            fits.append(best)
    return max(fits, key=lambda fit: fit.fitting, default=None)


def _read(image: Grey, dictionaries: Sequence[str], border_bits: int) -> list[Seen]:
    """The markers of each dictionary in an image."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.minMarkerPerimeterRate = 4 * SMALLEST_MARKER_PX / max(image.shape)
    parameters.markerBorderBits = border_bits
    if any("APRILTAG" in name for name in dictionaries):
        parameters.adaptiveThreshConstant = TOUCHED_THRESHOLD
    whole = [cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name)) for name in dictionaries]
    short = [cv2.aruco.Dictionary(d.bytesList[:MOST_MARKERS].copy(), d.markerSize, d.maxCorrectionBits) for d in whole]
    quads, ids, _, which = cv2.aruco.ArucoDetector(tuple(short), parameters).detectMarkersMultiDict(image)
    corners = np.array(quads, dtype=np.float64).reshape(-1, 4, 2)
    numbers, index = (np.array([] if a is None else a, dtype=np.int64).ravel() for a in (ids, which))
    return [(numbers[index == k], corners[index == k]) for k in range(len(short))]


def _charuco_layouts() -> list[_Layout]:
    """Markers in the white squares; the upper left square is black, on older boards with even rows white."""
    return [_Layout(c, legacy, _white_squares(c, legacy)) for c in COLUMNS[1:] for legacy in (False, True)]


def _white_squares(columns: int, first_is_white: bool) -> Places:
    row, column = (index.ravel() for index in np.indices((2 * MOST_MARKERS // columns + 4, columns)))
    white = (row + column) % 2 == (0 if first_is_white else 1)
    places = np.stack([column[white], row[white]], axis=-1).astype(np.float64)
    return lambda ids: places[ids]


def _grid_layouts() -> list[_Layout]:
    return [_Layout(columns, False, _rows_of(columns)) for columns in COLUMNS]


def _rows_of(columns: int) -> Places:
    return lambda ids: np.stack([columns - 1 - ids % columns, ids // columns], axis=-1).astype(np.float64)


def _fit(seen: Iterable[Seen], layout: _Layout, name: str, variant: bool | int) -> _Fit | None:
    """How many markers lie in the layout's places, on one plane in each image and not mirrored."""
    placed_ids, sizes = [], []
    for ids, quads_px in seen:
        places = layout.places(ids)
        image_to_board: Any = cv2.findHomography(quads_px.mean(axis=1), places, cv2.RANSAC, OFF_PLACE)[0]
        if image_to_board is None:
            continue
        quads = cv2.perspectiveTransform(quads_px.reshape(1, -1, 2), image_to_board).reshape(-1, 4, 2)
        sides = np.roll(quads, -1, axis=1) - quads
        as_printed = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0] > 0
        placed = as_printed & (np.linalg.norm(quads.mean(axis=1) - places, axis=1) < OFF_PLACE)
        placed_ids.append(ids[placed])
        sizes.append(np.linalg.norm(sides[placed], axis=-1).mean(axis=-1))
    count = sum(map(len, placed_ids))
    if not count:
        return None
    last, size = int(np.concatenate(placed_ids).max()), float(np.median(np.concatenate(sizes)))
    return _Fit(name, layout, count, last, size, variant)


def _charuco(fit: _Fit, square_size_m: float) -> Charuco | None:
    rows = int(fit.layout.places(np.array([fit.last]))[0, 1]) + 1
    ratio = round(round((fit.marker_size + RATIO_SHRUNK) / RATIO_STEP) * RATIO_STEP, 2)
    if rows < 3 or not 0 < ratio < 1:
        return None
    columns = fit.layout.columns
    code, _, size = fit.name.rpartition("_")
    smallest = next(count for count in SET_SIZES if count >= columns * rows // 2)
    name = f"{code}_{smallest}" if size.isdigit() else fit.name
    return Charuco(columns, rows, square_size_m, ratio, name, bool(fit.variant), fit.layout.legacy)


def _aprilgrid(fit: _Fit, images: Sequence[Grey], tag_size_m: float) -> AprilGrid | None:
    columns, rows = fit.layout.columns, fit.last // fit.layout.columns + 1
    if rows < 2:
        return None
    grid = AprilGrid(columns, rows, tag_size_m, family=fit.name, border_bits=int(fit.variant))
    found = [board for image in images if (board := find_aprilgrid(image, grid)) is not None]
    spacing = measured_spacing(grid, [(board.corner_ids, board.corners_px) for board in found])
    return AprilGrid(columns, rows, tag_size_m, round(spacing, 2), fit.name, grid.border_bits) if spacing else None
