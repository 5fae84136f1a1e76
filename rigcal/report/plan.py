"""Geometry of the rig seen from above: where the cameras stand, what they see, how they were joined.

Only numbers and SVG path data come from here; ``figures.svg.j2`` draws them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigcal.evidence import Evidence
from rigcal.geometry import Floats
from rigcal.report.numbers import round_down
from rigcal.report.rays import middle_row_rays
from rigcal.report.svgpath import dots, lines, polygon
from rigcal.report.upright import Upright, greatest_sigma_m, position_covariances, upright_frame
from rigcal.report.words import chain_ends, shortened
from rigcal.rig import RigCamera
from rigcal.rigdocument import RigDocument
from rigcal.rigfile import rig_of

WIDTH, HEIGHT, MARGIN = 640.0, 520.0, 40.0
"""Greatest size of the figure and the room above and below what is drawn to scale, in its units."""
CHARACTER_UNITS = 11.5
"""Width of a character of a camera's id."""
WEDGE_SHARE = 0.22
"""Length of a viewing wedge over the greater extent of the cameras and boards."""
ELLIPSE_UNITS = 26.0
"""Greatest half axis of a position ellipse, which sets its magnification."""
LABEL_UNITS = 13.0
"""Distance of a camera's label from its dot."""


@dataclass(frozen=True, slots=True)
class PlanCamera:
    """One camera of the figure; positions in its units."""

    label: str
    """Its id, shortened."""
    x: float
    y: float
    label_x: float
    label_y: float
    label_anchor: str
    """SVG's ``start``, ``middle`` or ``end``: the label lies on the side that the camera does not look to."""
    wedge: str
    """Outline of what the image's middle row sees, to :data:`WEDGE_SHARE` of the extent."""
    ellipse: tuple[float, float, float] | None
    """Half axes and angle in degrees of one sigma of the position, magnified; None where it is not known or 0."""


@dataclass(frozen=True, slots=True)
class Plan:
    """The rig seen from above, ready to be drawn."""

    width: float
    height: float
    above: str
    """What "above" means here, in words."""
    cameras: tuple[PlanCamera, ...]
    chain: str
    """Lines between neighbours on a chain to the reference."""
    boards: str
    """Dots at the boards' centres; empty where they are not known."""
    board_count: int
    bar_m: float
    """Length that the scale bar stands for."""
    bar_units: float
    magnification: float | None
    """How much larger the position ellipses are drawn than they are; None where there are none."""
    origin: tuple[float, float] | None
    """The world's origin, where there is a world and it lies inside the figure."""


@dataclass(frozen=True, slots=True, eq=False)
class _Page:
    """From metres in the plane to the figure's units, x to the right and y down."""

    low_m: Floats
    high_m: Floats
    margins: Floats
    scale: float
    """Units per metre."""

    def __call__(self, points_m: Floats) -> Floats:
        from_corner_m = np.stack([points_m[..., 0] - self.low_m[0], self.high_m[1] - points_m[..., 1]], axis=-1)
        return np.asarray(self.margins + from_corner_m * self.scale)

    @property
    def size(self) -> tuple[float, float]:
        width, height = (self.high_m - self.low_m) * self.scale + 2 * self.margins
        return float(width), float(height)

    def shows(self, point_m: Floats) -> bool:
        return bool(((self.low_m <= point_m) & (point_m <= self.high_m)).all())


def _page(drawn_m: Floats, label_characters: int) -> _Page:
    low_m, high_m = drawn_m.min(axis=0), drawn_m.max(axis=0)
    label_units = CHARACTER_UNITS * label_characters
    margins = np.array([LABEL_UNITS + label_units, MARGIN])
    room = np.array([WIDTH, HEIGHT]) - 2 * margins
    return _Page(low_m, high_m, margins, float((room / np.maximum(high_m - low_m, 1e-9)).min()))


def plan_of(document: RigDocument, evidence: Evidence | None) -> Plan:
    """The rig of a document, seen from above."""
    rig = rig_of(document)
    upright = upright_frame(rig)
    boards = upright(evidence.board_centres_m)[:, :2] if evidence else np.zeros((0, 2))
    centres = upright(np.array([camera.cam_from_rig.inverse().translation_m for camera in rig.cameras]))[:, :2]
    extent_m = float(np.ptp(np.concatenate([centres, boards]), axis=0).max()) or 1.0
    wedges = [_wedge(camera, upright, WEDGE_SHARE * extent_m) for camera in rig.cameras]
    label_characters = max(len(shortened(camera_id)) for camera_id in rig.camera_ids)
    page = _page(np.concatenate([centres, boards, *wedges]), label_characters)
    covariances = {name: c[:2, :2] for name, c in position_covariances(document, upright).items()}
    greatest_m = greatest_sigma_m(covariances)
    magnification = round_down(ELLIPSE_UNITS / page.scale / greatest_m) if greatest_m > 0 else None
    units_per_m = (magnification or 1.0) * page.scale
    at, bar_m = page(centres), round_down(WIDTH / 4 / page.scale)
    starts, ends = chain_ends(document)
    origin = page(np.zeros(2)) if rig.world_from_rig and page.shows(np.zeros(2)) else None
    return Plan(
        width=page.size[0],
        height=page.size[1],
        above=upright.above,
        cameras=tuple(
            _plan_camera(camera.id, at[i], page(wedges[i]), covariances.get(camera.id), units_per_m)
            for i, camera in enumerate(rig.cameras)
        ),
        chain=lines(at[starts], at[ends] - at[starts]),
        boards=dots(page(boards)),
        board_count=len(boards),
        bar_m=bar_m,
        bar_units=bar_m * page.scale,
        magnification=magnification,
        origin=None if origin is None else (float(origin[0]), float(origin[1])),
    )


def _wedge(camera: RigCamera, upright: Upright, length_m: float) -> Floats:
    rig_from_cam = camera.cam_from_rig.inverse()
    fan = rig_from_cam.apply(np.concatenate([np.zeros((1, 3)), length_m * middle_row_rays(camera.camera)]))
    return upright(fan)[:, :2]


def _plan_camera(
    camera_id: str, at: Floats, wedge: Floats, covariance: Floats | None, units_per_m: float
) -> PlanCamera:
    looks = wedge[1:].mean(axis=0) - at
    away = -looks / max(float(np.linalg.norm(looks)), 1e-9)
    anchor = "middle" if abs(away[0]) < 0.5 else "start" if away[0] > 0 else "end"
    ellipse = None
    if covariance is not None:
        values, vectors = np.linalg.eigh(covariance)
        minor, major = np.sqrt(np.maximum(values, 0)) * units_per_m
        ellipse = (float(major), float(minor), float(np.rad2deg(np.arctan2(-vectors[1, 1], vectors[0, 1]))))
    x, y, label_x, label_y = (float(v) for v in (*at, *(at + LABEL_UNITS * away)))
    return PlanCamera(shortened(camera_id), x, y, label_x, label_y, anchor, polygon(wedge), ellipse)
