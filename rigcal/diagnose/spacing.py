"""The gap between the tags of an AprilGrid over the side of a tag, as it was printed: measured in every view.

Along a row, the four corners of two neighbouring tags lie on a line at 0, 1, 1 + s and 2 + s. Their cross-ratio
(1 + s)^2 / (s (2 + s)) survives perspective, so that it tells the spacing s from any view without a lens model.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from rigcal.board import AprilGrid
from rigcal.geometry import Floats, Ints

LEAST_PAIRS = 8
"""Pairs of neighbouring edges; a single one is 5 % off where corners are 0.1 px off on tags of 40 px."""


def measured_spacing(board: AprilGrid, views: Iterable[tuple[Ints, Floats]]) -> float | None:
    """Median spacing over views of corner ids (n,) and corners (n, 2) in pixels; None where they show too little."""
    measured = np.concatenate([np.zeros(0), *(_spacings(board, ids, corners) for ids, corners in views)])
    return float(np.median(measured)) if len(measured) >= LEAST_PAIRS else None


def _spacings(board: AprilGrid, corner_ids: Ints, corners_px: Floats) -> Floats:
    """(n,) the spacing by each pair of edges in line, of neighbours in a row and in a column."""
    corners = np.full((board.rows, board.columns, 4, 2), np.nan)
    corners.reshape(-1, 2)[corner_ids] = corners_px
    right, left = corners[:, :-1], corners[:, 1:]  # tags of a row run from right to left
    upper, lower = corners[:-1], corners[1:]
    lines = [(left[:, :, a], left[:, :, b], right[:, :, a], right[:, :, b]) for a, b in ((0, 1), (3, 2))]
    lines += [(upper[:, :, a], upper[:, :, b], lower[:, :, a], lower[:, :, b]) for a, b in ((0, 3), (1, 2))]
    return np.concatenate([_by_cross_ratio(*(points.reshape(-1, 2) for points in line)) for line in lines])


def _by_cross_ratio(a: Floats, b: Floats, c: Floats, d: Floats) -> Floats:
    """(n,) s for points (n, 2) at 0, 1, 1 + s and 2 + s of a line, those that are seen."""
    ac, bd, bc, ad = (np.linalg.norm(p - q, axis=-1) for p, q in ((a, c), (b, d), (b, c), (a, d)))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = ac * bd / (bc * ad)
        spacing = np.sqrt(1 + 1 / (ratio - 1)) - 1
    return np.asarray(spacing[np.isfinite(spacing)])
