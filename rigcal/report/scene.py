"""The rig in 3D: cameras with what they see, board positions and the floor, from obliquely above."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rigcal.board import Board
from rigcal.evidence import Evidence
from rigcal.geometry import Floats
from rigcal.report.aspect import RADIUS, Aspect, Lines, Mark, lines_of, mark_of
from rigcal.report.numbers import round_down
from rigcal.report.rays import SIDE_SAMPLES, border_rays
from rigcal.report.upright import Upright, greatest_sigma_m, position_covariances, upright_frame
from rigcal.report.words import chain_ends, shortened
from rigcal.rig import Rig
from rigcal.rigdocument import RigDocument
from rigcal.rigfile import rig_of

TURN_DEG, TILT_DEG = -28.0, 26.0
"""From where the picture as it stands is seen: from above, and to the left behind the reference."""
SIGHT_SHARE, ELLIPSOID_SHARE = 0.16, 0.06
"""Depth of what a camera sees, and of the longest half axis of a position's ellipsoid, over the scene's radius."""
LEAST_DEPTH = 0.4
"""Share of a unit ray along the optical axis up to which it ends on a plane before the camera; a wide lens's rays
beside the camera would reach it far away."""
GRID_SQUARES = 4
"""The floor's grid has at least as many squares from its middle to its edge."""
MOST_BOARDS = 80
"""Boards drawn; more would hide the cameras."""
CIRCLE_RAD = np.linspace(0, 2 * np.pi, 25)


@dataclass(frozen=True, slots=True)
class Scene:
    """The rig in 3D, ready to be drawn."""

    aspect: Aspect
    lines: tuple[Lines, ...]
    """In the order of drawing."""
    marks: tuple[Mark, ...]
    """The cameras."""
    grid_m: float
    """Side of a square of the floor's grid."""
    floor: str
    """Where the grid lies, in words."""
    boards: int
    """Board positions that are drawn."""
    magnification: float | None
    """How much larger the position ellipsoids are drawn than they are; None where there are none."""


@dataclass(frozen=True, slots=True, eq=False)
class _Room:
    """The part of the upright frame that is drawn."""

    middle_m: Floats
    radius_m: float
    rise_m: float
    floor_m: float

    def __call__(self, points_m: Floats) -> Floats:
        return (points_m - self.middle_m) * RADIUS / self.radius_m


def scene_of(document: RigDocument, evidence: Evidence | None) -> Scene:
    """The rig of a document in 3D."""
    rig = rig_of(document)
    upright = upright_frame(rig)
    centres = upright(np.array([camera.cam_from_rig.inverse().translation_m for camera in rig.cameras]))
    boards = upright(_board_outlines(document.calibration_board, evidence))
    room = _room(np.concatenate([centres, boards.reshape(-1, 3)]), floor_m=0.0 if rig.world_from_rig else None)
    aspect = Aspect(TURN_DEG, TILT_DEG, room.rise_m / room.radius_m * RADIUS)
    covariances = position_covariances(document, upright)
    greatest_m = greatest_sigma_m(covariances)
    magnification = round_down(ELLIPSOID_SHARE * room.radius_m / greatest_m) if greatest_m > 0 else None
    ellipsoids = {
        centre: (magnification or 1.0) * _ellipsoid(covariances[camera_id])
        for centre, camera_id in enumerate(rig.camera_ids)
        if camera_id in covariances
    }
    grid_m = round_down(room.radius_m / GRID_SQUARES)
    on_floor = np.column_stack([centres[:, :2], np.full(len(centres), room.floor_m)])
    starts, ends = chain_ends(document)
    drawn: list[tuple[str, list[Floats]]] = [
        ("floor", list(_grid(room, grid_m))),
        ("drop", list(np.stack([centres, on_floor], axis=1))),
        ("board", [np.concatenate([outline, outline[:1]]) for outline in boards]),
        ("sight", list(_sights(rig, upright, SIGHT_SHARE * room.radius_m))),
        ("chain", list(np.stack([centres[starts], centres[ends]], axis=1))),
        ("sigma", [centres[index] + circle for index, circles in ellipsoids.items() for circle in circles]),
    ]
    return Scene(
        aspect,
        tuple(lines_of(aspect, kind, [room(line) for line in lines]) for kind, lines in drawn if lines),
        tuple(mark_of(aspect, shortened(i), room(c)) for i, c in zip(rig.camera_ids, centres, strict=True)),
        grid_m,
        "on the world's floor" if rig.world_from_rig else "as low as the lowest camera or board, for the eye only",
        len(boards),
        magnification,
    )


def _room(points_m: Floats, *, floor_m: float | None) -> _Room:
    """The room around points, with a share more for what the outer cameras see."""
    low, high = points_m.min(axis=0), points_m.max(axis=0)
    floor = float(low[2]) if floor_m is None else floor_m
    low[2], high[2] = min(low[2], floor), max(high[2], floor)
    middle = (low + high) / 2
    rise_m = float(high[2] - low[2]) / 2
    across_m = float(np.linalg.norm((points_m - middle)[:, :2], axis=1).max())
    radius_m = (1 + SIGHT_SHARE) * max(across_m, rise_m, 1e-3)
    return _Room(middle, radius_m, max(rise_m, SIGHT_SHARE * radius_m / 2), floor)


def _board_outlines(board: Board | None, evidence: Evidence | None) -> Floats:
    """(B, 4, 3) outer corners of at most :data:`MOST_BOARDS` board positions in the rig frame."""
    if board is None or evidence is None or not len(evidence.rig_from_board):
        return np.zeros((0, 4, 3))
    (x0, y0), (x1, y1) = board.corners_in_board.min(axis=0)[:2], board.corners_in_board.max(axis=0)[:2]
    outline = np.array([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]])
    shown = np.linspace(0, len(evidence.rig_from_board) - 1, min(len(evidence.rig_from_board), MOST_BOARDS))
    poses = evidence.rig_from_board[np.rint(shown).astype(int)]
    return np.asarray(outline @ poses[:, :, :3].transpose(0, 2, 1) + poses[:, None, :, 3])


def _sights(rig: Rig, upright: Upright, length_m: float) -> Iterator[Floats]:
    """What each camera sees: lines from its centre to the corners of its image, and around its border."""
    for camera in rig.cameras:
        rig_from_cam = camera.cam_from_rig.inverse()
        rays = border_rays(camera.camera)
        depths = np.maximum(rays[:, 2:], LEAST_DEPTH)
        border = upright(rig_from_cam.apply(length_m * rays / depths))
        yield np.concatenate([border, border[:1]])
        for corner in border[:: SIDE_SAMPLES - 1]:
            yield np.stack([upright(rig_from_cam.translation_m), corner])


def _ellipsoid(covariance: Floats) -> Floats:
    """(3, n, 3) outlines of the one-sigma ellipsoid in its three principal planes."""
    values, vectors = np.linalg.eigh(covariance)
    axes = vectors.T * np.sqrt(np.maximum(values, 0))[:, None]
    one, two = axes, np.roll(axes, 1, axis=0)
    circles = np.cos(CIRCLE_RAD)[:, None] * one[:, None] + np.sin(CIRCLE_RAD)[:, None] * two[:, None]
    return np.asarray(circles)


def _grid(room: _Room, step_m: float) -> Iterator[Floats]:
    """Lines of the floor at whole multiples of the step, within the circle that the room's radius draws."""
    for axis in (0, 1):
        middle, across = room.middle_m[axis], room.middle_m[1 - axis]
        ends = (middle - room.radius_m) / step_m, (middle + room.radius_m) / step_m
        for at in step_m * np.arange(np.ceil(ends[0]), np.floor(ends[1]) + 1):
            half = np.sqrt(max(room.radius_m**2 - (at - middle) ** 2, 0.0))
            line = np.full((2, 3), room.floor_m)
            line[:, axis], line[:, 1 - axis] = at, (across - half, across + half)
            yield line
