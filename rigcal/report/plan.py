"""Geometry of the rig seen from above: where the cameras stand, what they see, how they were joined.

Only numbers and SVG path data come from here; ``figures.svg.j2`` draws them. "Above" is the world's z axis where the rig
file knows a world. Else it is against the mean "down" axis of the cameras, which is near the vertical where cameras are
mounted upright; the figure says which.
"""

from __future__ import annotations

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

WIDTH, HEIGHT, MARGIN = 640.0, 520.0, 56.0
"""Greatest size of the figure and the room for labels around what is drawn to scale, in its units."""
WEDGE_SHARE = 0.22
"""Length of a viewing wedge over the greater extent of the cameras and boards."""
ELLIPSE_UNITS = 26.0
"""Greatest half axis of a position ellipse, which sets its magnification."""
DEGENERATE = 0.2
"""Length of a mean of unit vectors below which they point in no common direction."""
_UNDISTORT_PX = 0.5
_MIDDLE_ROW_SAMPLES = 13


@dataclass(frozen=True, slots=True)
class PlanCamera:
    """One camera of the figure; positions in its units."""

    camera_id: str
    x: float
    y: float
    label_x: float
    label_y: float
    wedge: str
    """Outline of what the image's middle row sees, to :data:`WEDGE_SHARE` of the extent."""
    ellipse: tuple[float, float, float] | None
    """Half axes and angle in degrees of one sigma of the position, magnified; None where it is not known or 0."""


@dataclass(frozen=True, slots=True)
class PlanEdge:
    """A pair of cameras that saw the board together."""

    x1: float
    y1: float
    x2: float
    y2: float
    on_chain: bool
    views: str
    rmse: str

    @property
    def middle(self) -> tuple[float, float]:
        """Where its label stands."""
        return (self.x1 + self.x2) / 2, (self.y1 + self.y2) / 2


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


def plan_of(document: RigDocument, evidence: Evidence | None) -> Plan:
    """The rig of a document, seen from above."""
    rig = rig_of(document)
    view = _view(rig.cameras, rig.world_from_rig, rig.camera(rig.reference))
    boards = view(evidence.board_centres_m) if evidence else np.zeros((0, 2))
    centres = view(np.array([camera.cam_from_rig.inverse().translation_m for camera in rig.cameras]))
    extent_m = max(float(np.ptp(np.concatenate([centres, boards]), axis=0).max()), 1.0)
    wedges = [_wedge(camera, view, WEDGE_SHARE * extent_m) for camera in rig.cameras]
    drawn = np.concatenate([centres, boards, *wedges])
    low, high = drawn.min(axis=0), drawn.max(axis=0)
    scale = float(min((np.array([WIDTH, HEIGHT]) - 2 * MARGIN) / np.maximum(high - low, 1e-9)))

    def page(points_m: Floats) -> Floats:
        return np.asarray(MARGIN + np.stack([points_m[..., 0] - low[0], high[1] - points_m[..., 1]], axis=-1) * scale)

    covariances = _position_covariances(document, view)
    greatest_m = max((float(np.sqrt(np.linalg.eigvalsh(c)[-1])) for c in covariances.values()), default=0.0)
    magnification = round_down(ELLIPSE_UNITS / scale / greatest_m) if greatest_m > 0 else None
    at, bar_m = page(centres), round_down(WIDTH / 4 / scale)
    origin = page(np.zeros(2)) if rig.world_from_rig and ((low <= 0) & (high >= 0)).all() else None
    return Plan(
        width=float(high[0] - low[0]) * scale + 2 * MARGIN,
        height=float(high[1] - low[1]) * scale + 2 * MARGIN,
        above=view.above,
        cameras=tuple(
            _plan_camera(camera.id, at[i], page(wedges[i]), covariances.get(camera.id), (magnification or 1.0) * scale)
            for i, camera in enumerate(rig.cameras)
        ),
        edges=_edges(document, at),
        boards=dots(page(boards)),
        board_count=len(boards),
        bar_m=bar_m,
        bar_units=bar_m * scale,
        magnification=magnification,
        origin=None if origin is None else (float(origin[0]), float(origin[1])),
    )


def horizontal_fov_deg(camera: Camera) -> float:
    """Angle between the rays of the image's left and right edge, at half its height."""
    rays = middle_row_rays(camera)
    return float(np.rad2deg(np.arctan2(np.linalg.norm(np.cross(rays[0], rays[-1])), rays[0] @ rays[-1])))


def middle_row_rays(camera: Camera) -> Floats:
    """(n, 3) unit rays in the camera frame of pixels along the middle row, edge to edge.

    Where the lens model cannot be inverted (its polynomial turns back before the edge), a pinhole of the same focal
    length stands in for that pixel.
    """
    width, height = camera.size_wh
    pixels = np.stack([np.linspace(-0.5, width - 0.5, _MIDDLE_ROW_SAMPLES), np.full(_MIDDLE_ROW_SAMPLES, height / 2)], 1)
    rays = camera.rays(pixels)
    pinhole = np.concatenate([(pixels - camera.params[2:4]) / camera.params[:2], np.ones((len(pixels), 1))], axis=1)
    gap_px = np.linalg.norm(camera.project(rays) - pixels, axis=1)
    inverted = np.nan_to_num(gap_px, nan=np.inf) < _UNDISTORT_PX
    return np.where(inverted[:, None], rays, pinhole / np.linalg.norm(pinhole, axis=1, keepdims=True))


def _view(cameras: tuple[RigCamera, ...], world_from_rig: Pose | None, reference: RigCamera) -> _View:
    if world_from_rig is not None:
        above = "along the world's z axis: x to the right, y up the page"
        return _View(world_from_rig.rotation[:2], world_from_rig.translation_m[:2], above)
    down = np.mean([camera.cam_from_rig.rotation[1] for camera in cameras], axis=0)
    above = "along the mean down axis of the cameras, as the vertical is not known"
    if np.linalg.norm(down) < DEGENERATE:
        down = reference.cam_from_rig.rotation[1]
        above = f"along the down axis of {reference.id}, as the vertical is not known and the cameras have no common one"
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


def _plan_camera(camera_id: str, at: Floats, wedge: Floats, covariance: Floats | None, units_per_m: float) -> PlanCamera:
    looks = wedge[1:].mean(axis=0) - at
    away = -looks / max(float(np.linalg.norm(looks)), 1e-9)
    label = at + 18 * away
    ellipse = None
    if covariance is not None:
        values, vectors = np.linalg.eigh(covariance)
        minor, major = np.sqrt(np.maximum(values, 0)) * units_per_m
        ellipse = (float(major), float(minor), float(np.rad2deg(np.arctan2(-vectors[1, 1], vectors[0, 1]))))
    x, y, label_x, label_y = (float(v) for v in (*at, *label))
    return PlanCamera(camera_id, x, y, label_x, label_y, polygon(wedge), ellipse)


def _edges(document: RigDocument, at: Floats) -> tuple[PlanEdge, ...]:
    places = dict(zip(document.camera_ids, at.tolist(), strict=True))
    links = chain_links(document)
    edges = [
        PlanEdge(
            *places[pair.cameras[0]],
            *places[pair.cameras[1]],
            frozenset(pair.cameras) in links,
            counted(pair.views, "view"),
            fixed(pair.rmse_px) + " px",
        )
        for pair in document.pairs
    ]
    return tuple(sorted(edges, key=lambda edge: edge.on_chain))
