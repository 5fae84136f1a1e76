"""Geometry of the residual figures: each camera's residuals on its image plane, and as a cloud of dx, dy.

Only numbers and SVG path data come from here; ``figures.svg.j2`` draws them. A figure shows a bounded number of
corners, so that the page of a rig with many cameras stays small; the rule that picks them is fixed, so that the same
rig file gives the same page.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigcal.bundle import rmse_px
from rigcal.evidence import Evidence
from rigcal.geometry import Ints
from rigcal.report.numbers import round_down, round_up
from rigcal.report.svgpath import crosses, dots, lines
from rigcal.rigdocument import CameraEntry

SHOWN_CORNERS = 1000
"""Used corners drawn per camera; beyond this a figure of 650 px gains ink and no information."""
SHOWN_REJECTED = 300
"""Rejected corners drawn per camera."""
IMAGE_UNITS = 1000.0
"""Longer side of the image plane in the figure's units."""
LONG_LINE_UNITS = 45.0
"""Length that 95 of 100 residual lines stay below: about the distance of corners in a view that fills the image."""
CLOUD_UNITS = 100.0
"""Half the width of the cloud in the figure's units."""
REJECTED_LINE_UNITS = 2 * LONG_LINE_UNITS
"""Length at which a rejected corner's line is cut: a gross one would cross the whole figure."""
PLANE_CROSS_UNITS, CLOUD_CROSS_UNITS = 6.0, 2.5
"""Half the width of a rejected corner's cross."""
_GOLDEN = (5**0.5 - 1) / 2


@dataclass(frozen=True, slots=True)
class Marks:
    """Corners of one kind, as SVG path data in the image plane's and the cloud's units."""

    corners: str
    """Each detected corner on the image plane: a dot where it was used, a cross where it was rejected."""
    lines: str
    """From each corner along its magnified residual; that of a rejected one is cut."""
    cloud: str
    """Each dx, dy likewise; those beyond the frame lie on it."""


@dataclass(frozen=True, slots=True)
class ResidualFigure:
    """One camera's residuals, ready to be drawn."""

    camera_id: str
    width: float
    height: float
    """Of the image plane in units; the longer one is :data:`IMAGE_UNITS`."""
    used: int
    """Corners that the joint solve used."""
    rejected: int
    """Corners that it did not use."""
    used_shown: int
    rejected_shown: int
    rmse_px: float | None
    """Over the used corners."""
    sigma_px: float
    """One sigma along one axis, over the used corners."""
    mean_px: tuple[float, float]
    """Mean of dx and dy over the used corners."""
    magnification: float
    """How much longer a line is drawn than its residual is in the image."""
    key_px: float
    """Residual that the key line stands for."""
    key_units: float
    """Length of the key line."""
    cloud_px: float
    """Residual at the frame of the cloud."""
    sigma_units: float
    """Radius of the one-sigma circle in the cloud."""
    beyond: int
    """Corners, of all, that lie beyond the frame of the cloud."""
    used_marks: Marks
    rejected_marks: Marks


def residual_figure(camera: CameraEntry, evidence: Evidence) -> ResidualFigure | None:
    """The residual figure of one of the evidence's cameras; None where it holds no corner of that camera."""
    mine = evidence.camera_idx == evidence.camera_ids.index(camera.id)
    if not mine.any():
        return None
    pixels, residuals, used = evidence.pixels[mine], evidence.residuals_px[mine], evidence.used[mine]
    judged = residuals[used] if used.any() else residuals
    unit_px = max(camera.size_wh) / IMAGE_UNITS
    lengths_px = np.linalg.norm(judged, axis=1)
    magnification = round_down(LONG_LINE_UNITS * unit_px / max(float(np.percentile(lengths_px, 95)), 1e-9))
    key_px = round_up(2 * LONG_LINE_UNITS * unit_px / magnification / 2.5)
    cloud_px = round_up(max(float(np.percentile(np.abs(judged).max(axis=1), 99.5)), 1e-9))
    kept, left = spread(np.flatnonzero(used), SHOWN_CORNERS), spread(np.flatnonzero(~used), SHOWN_REJECTED)
    sigma_px = float(np.sqrt((judged**2).mean()))
    at, steps = (pixels + 0.5) / unit_px, residuals * magnification / unit_px
    cloud = np.clip(residuals / cloud_px, -1, 1) * CLOUD_UNITS
    cut = REJECTED_LINE_UNITS / np.maximum(np.linalg.norm(steps, axis=1, keepdims=True), REJECTED_LINE_UNITS)
    return ResidualFigure(
        camera_id=camera.id,
        width=camera.size_wh[0] / unit_px,
        height=camera.size_wh[1] / unit_px,
        used=int(used.sum()),
        rejected=int((~used).sum()),
        used_shown=len(kept),
        rejected_shown=len(left),
        rmse_px=rmse_px(residuals[used]),
        sigma_px=sigma_px,
        mean_px=(float(judged[:, 0].mean()), float(judged[:, 1].mean())),
        magnification=magnification,
        key_px=key_px,
        key_units=key_px * magnification / unit_px,
        cloud_px=cloud_px,
        sigma_units=sigma_px / cloud_px * CLOUD_UNITS,
        beyond=int((np.abs(residuals).max(axis=1) > cloud_px).sum()),
        used_marks=Marks(dots(at[kept]), lines(at[kept], steps[kept]), dots(cloud[kept])),
        rejected_marks=Marks(
            crosses(at[left], PLANE_CROSS_UNITS),
            lines(at[left], (steps * cut)[left]),
            crosses(cloud[left], CLOUD_CROSS_UNITS),
        ),
    )


def spread(rows: Ints, most: int) -> Ints:
    """At most ``most`` of the rows, in their order, spread over all of them.

    Multiples of the golden ratio are even over every period (Weyl), so no corner of the board is picked more often
    than another, as each n-th row would where n and the number of corners have a common factor.
    """
    if len(rows) <= most:
        return rows
    return rows[np.sort(np.argsort((np.arange(len(rows)) * _GOLDEN) % 1, kind="stable")[:most])]
