"""Geometry of the rig seen from above: where the cameras stand, what they see, how they were joined.

Only numbers and SVG path data come from here; ``figures.svg.j2`` draws them. "Above" is the world's z axis where the
rig file knows a world. Else it is against the mean "down" axis of the cameras, which is near the vertical where cameras
are mounted upright; the figure says which.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigcal.camera import Camera
from rigcal.evidence import Evidence
from rigcal.geometry import Floats, Pose
from rigcal.report.numbers import fixed, round_down
from rigcal.report.svgpath import dots, polygon
from rigcal.report.words import chain_links, counted
from rigcal.rig import RigCamera
from rigcal.rigdocument import RigDocument
from rigcal.rigfile import rig_of

WIDTH, HEIGHT, MARGIN = 640.0, 520.0, 40.0
"""Greatest size of the figure and the room above and below what is drawn to scale, in its units."""
LABEL_CHARACTERS, CHARACTER_UNITS = 14, 11.5
"""Characters of a camera's id that are shown beside its dot, and the width of one; longer ids end in an ellipsis."""
WEDGE_SHARE = 0.22
"""Length of a viewing wedge over the greater extent of the cameras and boards."""
ELLIPSE_UNITS = 26.0
"""Greatest half axis of a position ellipse, which sets its magnification."""
LABELLED_UNITS = 96.0
"""Length of a line below which its label would cover the cameras at its ends."""
LABEL_UNITS = 13.0
"""Distance of a camera's label from its dot."""
DEGENERATE = 0.2
"""Length of a mean of unit vectors below which they point in no common direction."""
INVERTED_PX = 0.5
"""Distance from its pixel at which a ray's projection shows that the lens model was not inverted there."""
MIDDLE_ROW_SAMPLES = 13
"""Rays of a wedge: its far side looks round."""


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
class PlanEdge:
    """A pair of cameras that saw the board together."""

    start: tuple[float, float]
    end: tuple[float, float]
    on_chain: bool
    views: str
    rmse: str

    @property
    def labelled(self) -> bool:
        """Whether its figures have room in the drawing."""
        return self.on_chain and math.dist(self.start, self.end) >= LABELLED_UNITS

    @property
    def middle(self) -> tuple[float, float]:
        """Where its label stands."""
        return (self.start[0] + self.end[0]) / 2, (self.start[1] + self.end[1]) / 2


@dataclass(frozen=True, slots=True)
class Plan:
    """The rig seen from above, ready to be drawn."""

    width: float
    height: float
    above: str
    """What "above" means here, in words."""
    cameras: tuple[PlanCamera, ...]
    edges: tuple[PlanEdge, ...]
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
class _View:
    """The projection to the plane: ``rows @ point_in_rig + offset_m`` is (right, up the page) in metres."""

    rows: Floats
    offset_m: Floats
    above: str

    def __call__(self, points_in_rig: Floats) -> Floats:
        return np.asarray(points_in_rig @ self.rows.T + self.offset_m)


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
    label_units = CHARACTER_UNITS * min(label_characters, LABEL_CHARACTERS)
    margins = np.array([LABEL_UNITS + label_units, MARGIN])
    room = np.array([WIDTH, HEIGHT]) - 2 * margins
    return _Page(low_m, high_m, margins, float((room / np.maximum(high_m - low_m, 1e-9)).min()))


def plan_of(document: RigDocument, evidence: Evidence | None) -> Plan:
    """The rig of a document, seen from above."""
    rig = rig_of(document)
    view = _view(rig.cameras, rig.world_from_rig, rig.camera(rig.reference))
    boards = view(evidence.board_centres_m) if evidence else np.zeros((0, 2))
    centres = view(np.array([camera.cam_from_rig.inverse().translation_m for camera in rig.cameras]))
    extent_m = float(np.ptp(np.concatenate([centres, boards]), axis=0).max()) or 1.0
    wedges = [_wedge(camera, view, WEDGE_SHARE * extent_m) for camera in rig.cameras]
    page = _page(np.concatenate([centres, boards, *wedges]), max(len(camera_id) for camera_id in rig.camera_ids))
    covariances = _position_covariances(document, view)
    greatest_m = max((float(np.sqrt(np.linalg.eigvalsh(c)[-1])) for c in covariances.values()), default=0.0)
    magnification = round_down(ELLIPSE_UNITS / page.scale / greatest_m) if greatest_m > 0 else None
    units_per_m = (magnification or 1.0) * page.scale
    at, bar_m = page(centres), round_down(WIDTH / 4 / page.scale)
    origin = page(np.zeros(2)) if rig.world_from_rig and page.shows(np.zeros(2)) else None
    return Plan(
        width=page.size[0],
        height=page.size[1],
        above=view.above,
        cameras=tuple(
            _plan_camera(camera.id, at[i], page(wedges[i]), covariances.get(camera.id), units_per_m)
            for i, camera in enumerate(rig.cameras)
        ),
        edges=_edges(document, at),
        boards=dots(page(boards)),
        board_count=len(boards),
        bar_m=bar_m,
        bar_units=bar_m * page.scale,
        magnification=magnification,
        origin=None if origin is None else (float(origin[0]), float(origin[1])),
    )


def horizontal_fov_deg(camera: Camera) -> float:
    """Angle that the image's middle row spans, edge to edge."""
    rays = middle_row_rays(camera)
    sines, cosines = np.linalg.norm(np.cross(rays[:-1], rays[1:]), axis=1), (rays[:-1] * rays[1:]).sum(axis=1)
    return float(np.rad2deg(np.arctan2(sines, cosines).sum()))


def middle_row_rays(camera: Camera) -> Floats:
    """(n, 3) unit rays in the camera frame of pixels along the middle row, edge to edge.

    Where the lens model cannot be inverted (its polynomial turns back before the edge, or the ray lies beside the
    camera), the ray is that of the same lens without distortion.
    """
    width, height = camera.size_wh
    columns = np.linspace(-0.5, width - 0.5, MIDDLE_ROW_SAMPLES)
    pixels = np.stack([columns, np.full_like(columns, (height - 1) / 2)], axis=1)
    rays = camera.rays(pixels)
    gap_px = np.linalg.norm(camera.project(rays) - pixels, axis=1)
    inverted = np.nan_to_num(gap_px, nan=np.inf) < INVERTED_PX
    return np.where(inverted[:, None], rays, _undistorted_rays(camera, pixels))


def _undistorted_rays(camera: Camera, pixels: Floats) -> Floats:
    xy = (pixels - camera.params[2:4]) / camera.params[:2]
    if camera.is_fisheye:  # equidistant: the distance from the centre is the angle
        angle = np.linalg.norm(xy, axis=1, keepdims=True)
        return np.concatenate([xy * np.sinc(angle / np.pi), np.cos(angle)], axis=1)
    rays = np.concatenate([xy, np.ones((len(xy), 1))], axis=1)
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def _view(cameras: tuple[RigCamera, ...], world_from_rig: Pose | None, reference: RigCamera) -> _View:
    if world_from_rig is not None:
        above = "along the world's z axis: x to the right, y up the page"
        return _View(world_from_rig.rotation[:2], world_from_rig.translation_m[:2], above)
    down = np.mean([camera.cam_from_rig.rotation[1] for camera in cameras], axis=0)
    above = "along the mean down axis of the cameras, as the vertical is not known"
    if np.linalg.norm(down) < DEGENERATE:
        down = reference.cam_from_rig.rotation[1]
        above = f"along the down axis of {reference.id}, as the vertical is not known and the cameras' down axes differ"
    up = -down / np.linalg.norm(down)
    forwards = (axis - (axis @ up) * up for axis in reference.cam_from_rig.rotation[[2, 1, 0]])
    forward = next(axis for axis in forwards if np.linalg.norm(axis) > DEGENERATE)
    ahead = forward / np.linalg.norm(forward)
    return _View(np.stack([np.cross(ahead, up), ahead]), np.zeros(2), above)


def _wedge(camera: RigCamera, view: _View, length_m: float) -> Floats:
    rig_from_cam = camera.cam_from_rig.inverse()
    fan = rig_from_cam.apply(np.concatenate([np.zeros((1, 3)), length_m * middle_row_rays(camera.camera)]))
    return view(fan)


def _position_covariances(document: RigDocument, view: _View) -> dict[str, Floats]:
    """(2, 2) covariance in m^2 of each camera's position in the plane, where the file has one.

    With ``c = -R^T t`` and the left perturbation ``(exp(w) R, t + v)``: ``dc = -R^T [t]x w - R^T v``.
    """
    if document.covariance is None:
        return {}
    matrix, found = np.array(document.covariance.matrix), {}
    ids = [name.rpartition(".")[0] for name in document.covariance.order[::2]]
    poses = {camera.id: camera.cam_from_rig.pose for camera in document.cameras}
    for index, camera_id in enumerate(ids):
        R, t = poses[camera_id].rotation, poses[camera_id].translation_m
        by_pose = view.rows @ np.hstack([-np.cross(R.T, t), -R.T])
        rows = slice(6 * index, 6 * index + 6)
        found[camera_id] = by_pose @ matrix[rows, rows] @ by_pose.T
    return found


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
    shown = camera_id if len(camera_id) <= LABEL_CHARACTERS else camera_id[: LABEL_CHARACTERS - 1] + "…"
    return PlanCamera(shown, x, y, label_x, label_y, anchor, polygon(wedge), ellipse)


def _edges(document: RigDocument, at: Floats) -> tuple[PlanEdge, ...]:
    places = {camera_id: (float(x), float(y)) for camera_id, (x, y) in zip(document.camera_ids, at, strict=True)}
    links = chain_links(document)
    edges = [
        PlanEdge(
            places[pair.cameras[0]],
            places[pair.cameras[1]],
            frozenset(pair.cameras) in links,
            counted(pair.views, "view"),
            fixed(pair.rmse_px) + " px",
        )
        for pair in document.pairs
    ]
    return tuple(sorted(edges, key=lambda edge: edge.on_chain))
