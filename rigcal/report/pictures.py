"""The views that fit worst: their pictures, with the detected and the projected corners over them."""

from __future__ import annotations

import base64
from dataclasses import dataclass

import numpy as np

from rigcal.evidence import Evidence, ViewPicture
from rigcal.geometry import Floats
from rigcal.report.svgpath import crosses, dots, lines
from rigcal.rigdocument import CameraEntry, RigDocument

WIDTH = 1000.0
"""Of a picture in the figure's units."""
CROSS_UNITS = 13.0
"""Half the width of a projected corner's cross."""


@dataclass(frozen=True, slots=True)
class PictureFigure:
    """One view, ready to be drawn."""

    camera_id: str
    frame: str
    image: str
    """As a data URI."""
    height: float
    """In units; the width is :data:`WIDTH`."""
    detected: str
    """Dots where corners were detected."""
    projected: str
    """Crosses where the solved rig projects them."""
    gaps: str
    """Lines from the detected to the projected corners, true to scale."""
    rmse_px: float
    worst_px: float
    used: int
    corners: int
    finding: str
    """What was done to the view and why; empty where it was used as it was detected."""


def picture_figures(document: RigDocument, evidence: Evidence) -> tuple[PictureFigure, ...]:
    """The pictures of the evidence, in its order: the worst first."""
    cameras = {camera.id: camera for camera in document.cameras}
    return tuple(
        _figure(cameras[evidence.camera_ids[picture.camera_idx]], evidence, picture) for picture in evidence.pictures
    )


def _figure(camera: CameraEntry, evidence: Evidence, picture: ViewPicture) -> PictureFigure:
    rows = evidence.rows_of(picture.camera_idx, picture.frame_idx)
    frame = evidence.frames[picture.camera_idx][picture.frame_idx]
    left, top, width, height = picture.box_px
    units_per_px = WIDTH / width
    found = _placed(evidence.pixels[rows], left, top, units_per_px)
    gaps = -evidence.residuals_px[rows] * units_per_px
    lengths_px = np.linalg.norm(evidence.residuals_px[rows], axis=1)
    findings = [f"{finding.action}: {finding.reason}" for finding in camera.views.findings if finding.frame == frame]
    return PictureFigure(
        camera.id,
        frame,
        "data:image/jpeg;base64," + base64.b64encode(picture.jpeg).decode("ascii"),
        height * units_per_px,
        dots(found),
        crosses(found + gaps, CROSS_UNITS),
        lines(found, gaps),
        float(np.sqrt((lengths_px**2).mean())),
        float(lengths_px.max()),
        int(evidence.used[rows].sum()),
        len(rows),
        "; ".join(findings),
    )


def _placed(pixels: Floats, left: int, top: int, units_per_px: float) -> Floats:
    """A box begins at the outer edge of its first pixel, half a pixel before that pixel's centre."""
    return np.asarray((pixels - (left, top) + 0.5) * units_per_px)
