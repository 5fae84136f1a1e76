"""How densely corners cover a camera's image, and what their residuals have in common in each part of it.

Noise averages out in the mean residual of many corners; what the lens model does not fit stays. Cells without corners
are where the lens is not known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigcal.evidence import Evidence
from rigcal.geometry import Floats, Ints
from rigcal.report.numbers import round_down, round_up
from rigcal.report.svgpath import lines
from rigcal.rigdocument import CameraEntry

CELLS = 16
"""Cells along the longer side of the image."""
LONGER = 400.0
"""Longer side of the image in the figure's units."""
NEEDED_CORNERS = 8
"""Corners of a cell below which their mean residual is mostly noise: a third of one corner's."""
LONG_CELLS = 1.2
"""Length in cells that 95 of 100 mean residuals stay below."""


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell with corners."""

    x: float
    y: float
    shade: float
    """0 to 1: the root of its corners over the root of the most."""


@dataclass(frozen=True, slots=True)
class Coverage:
    """One camera's used corners on its image, ready to be drawn."""

    width: float
    height: float
    side: float
    """Of a cell; those at the right and lower edge are cut."""
    cells: tuple[Cell, ...]
    covered_percent: float
    """Share of the cells that hold a corner."""
    most: int
    """Corners in the fullest cell."""
    arrows: str
    """Mean residuals of cells with enough corners, from the middle of each."""
    magnification: float | None
    """How much longer they are drawn than they are; None where there are none."""
    key_px: float
    key_units: float


def coverage_of(camera: CameraEntry, evidence: Evidence) -> Coverage | None:
    """The coverage of one of the evidence's cameras; None where no corner of it was used."""
    mine = (evidence.camera_idx == evidence.camera_ids.index(camera.id)) & evidence.used
    if not mine.any():
        return None
    side_px = max(camera.size_wh) / CELLS
    counts_wh = np.ceil(np.array(camera.size_wh) / side_px - 1e-9).astype(int)
    place = np.clip(((evidence.pixels[mine] + 0.5) // side_px).astype(int), 0, counts_wh - 1)
    cell_of = place[:, 1] * counts_wh[0] + place[:, 0]
    counts = np.bincount(cell_of, minlength=int(counts_wh.prod()))
    units_per_px = LONGER / max(camera.size_wh)
    side = side_px * units_per_px
    filled = np.flatnonzero(counts)
    arrows, magnification, key_px = _arrows(evidence.residuals_px[mine], cell_of, counts, int(counts_wh[0]), side_px)
    return Coverage(
        camera.size_wh[0] * units_per_px,
        camera.size_wh[1] * units_per_px,
        side,
        tuple(
            Cell(float(c % counts_wh[0]) * side, float(c // counts_wh[0]) * side, shade)
            for c, shade in zip(filled, np.sqrt(counts[filled] / counts.max()).tolist(), strict=True)
        ),
        100 * len(filled) / int(counts_wh.prod()),
        int(counts.max()),
        arrows,
        magnification,
        key_px,
        0.0 if magnification is None else key_px * magnification * units_per_px,
    )


def _arrows(
    residuals_px: Floats, cell_of: Ints, counts: Ints, columns: int, side_px: float
) -> tuple[str, float | None, float]:
    """Path of the mean residuals, their magnification, and the residual that the key stands for."""
    enough = np.flatnonzero(counts >= NEEDED_CORNERS)
    if not len(enough):
        return "", None, 0.0
    sums = np.stack([np.bincount(cell_of, weights=r, minlength=len(counts)) for r in residuals_px.T], axis=1)
    means_px = sums[enough] / counts[enough, None]
    typical_px = max(float(np.percentile(np.linalg.norm(means_px, axis=1), 95)), 1e-9)
    magnification = round_down(LONG_CELLS * side_px / typical_px)
    middles = np.asarray((np.stack([enough % columns, enough // columns], axis=1) + 0.5) * side_px)
    units_per_px = LONGER / (side_px * CELLS)
    key_px = round_up(typical_px)
    return lines(middles * units_per_px, means_px * magnification * units_per_px), magnification, key_px
