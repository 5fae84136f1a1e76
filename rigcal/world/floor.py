"""The floor from a board that lies on it, in one place or in several.

Each instant's board is placed by all cameras that see it, their poses and lenses held. In a plane's own coordinates a
board says three things of the floor: two tilts and a height. Their covariance comes from the corners' noise and from
that of the rig, which all placements share; the floor is the plane that fits them best (generalised least squares).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigcal.agreement import Names
from rigcal.bundle import POSE, Freedom, Solution, State
from rigcal.corners import Observations
from rigcal.detections import SiteDetections
from rigcal.errors import NotFlatError, WorldError
from rigcal.geometry import Floats, Pose
from rigcal.intrinsics import IntrinsicsResult
from rigcal.outliers import RejectionRule
from rigcal.placing import groups_of_views, place_boards
from rigcal.relative import RelativePoses, poses_given_lenses, poses_of
from rigcal.rigdocument import RigDocument
from rigcal.rigfile import rig_of
from rigcal.rigviews import held_lenses, of_cameras
from rigcal.robust import solve_robustly
from rigcal.uncertainty import cross_matrix
from rigcal.world.frame import Residual, World, centre_of, check_above_floor, world_at

FLAT_M, FLAT_DEG = 0.015, 1.0
"""How far a placement may lie from the common plane where its own uncertainty allows no more: floors of halls are
level within a few millimetres per metre."""
_SIGMAS = 4.0
_CLIP_PX = 20.0


@dataclass(frozen=True, slots=True, eq=False)
class _Placement:
    """One position of the board."""

    name: str
    rig_from_board: Pose
    up: Floats
    """(3,) its normal towards the cameras."""
    centre: Floats
    """(3,) the middle of its corners."""


def world_from_floor_board(detections: SiteDetections, document: RigDocument, thickness_m: float) -> World:
    """Find the floor.

    The world's origin is the board's first corner in its first placement, moved down by the thickness; x is along the
    board's columns, z away from the floor.

    Args:
        detections: Views of a board that lies on the floor, from some of the rig's cameras, in rig order.
        document: The rig file.
        thickness_m: From the floor to the printed side.

    Raises:
        WorldError: where no camera has a usable view of the board.
        NotFlatError: where a placement does not lie on the plane of the others.
        BelowFloorError: where a camera would lie below the floor.
    """
    rig, lenses = rig_of(document), held_lenses(detections, document)
    if not lenses:
        raise WorldError(
            "no camera sees the board on the floor well enough",
            where=f"{len(detections.cameras)} cameras",
            expected="a view with six or more corners in at least one camera",
            got=", ".join(f"{camera.camera_id}: {len(camera.views)} views" for camera in detections.cameras),
            do_next="lay the board nearer to a camera, flat, its whole pattern in view, and capture it again",
        )
    ids = [camera_id for camera_id in detections.camera_ids if camera_id in lenses]
    part = of_cameras(detections, ids)
    solution, observations = _boards(part, [lenses[c] for c in ids], [rig.camera(c).cam_from_rig for c in ids])
    placements = _placements(part, solution, observations)
    known = (poses_given_lenses(document) or poses_of(document)).of(ids)
    base, y, A, covariance = _equations(placements, solution, observations, known)
    _check_flat(placements, y, A, covariance)
    plane, plane_covariance = _fitted(y, A, covariance)
    residuals = (y - A @ plane).reshape(-1, 3)
    up = base.rotation[:, :2] @ plane[:2] + base.rotation[:, 2]
    up /= np.linalg.norm(up)
    first = placements[0].rig_from_board
    on_plane = base.translation_m + plane[2] * base.rotation[:, 2]
    origin = first.translation_m - ((first.translation_m - on_plane) @ up + thickness_m) * up
    at_origin = np.append(-(base.inverse().apply(origin)[:2]), 1.0)
    world = World(
        "floor board",
        world_at(up, origin, first.rotation[:, 0]),
        float(np.rad2deg(np.sqrt(plane_covariance[0, 0] + plane_covariance[1, 1]))),
        float(np.sqrt(at_origin @ plane_covariance @ at_origin)),
        tuple(
            Residual(placement.name, float(height), float(np.rad2deg(np.hypot(a, b))))
            for placement, (a, b, height) in zip(placements, residuals, strict=True)
        ),
    )
    check_above_floor(
        world, rig, do_next="lay the board on the floor, below every camera, its printed side up, and capture it again"
    )
    return world


def _boards(
    detections: SiteDetections, lenses: Sequence[IntrinsicsResult], cam_from_rig: Sequence[Pose]
) -> tuple[Solution, Observations]:
    """Every board placed with the cameras held, and the corners that were believed."""
    board, cameras = detections.board, tuple(lens.camera for lens in lenses)
    names = Names(detections.camera_ids, tuple(camera.frames for camera in detections.cameras))
    groups = groups_of_views(lenses, detections.instants, names)
    placed = place_boards(board, cameras, cam_from_rig, groups.views, names, _CLIP_PX)
    held = Freedom(
        tuple(np.zeros(len(camera.params), dtype=bool) for camera in cameras), np.zeros(len(cameras), dtype=bool)
    )
    solved = solve_robustly(
        Observations.of(board.corners_in_board, placed.entries),
        State(cameras, tuple(cam_from_rig), placed.rig_from_board),
        held,
        names,
        RejectionRule(),
    )
    return solved.solution, solved.observations


def _placements(detections: SiteDetections, solution: Solution, observations: Observations) -> list[_Placement]:
    middle = observations.corners_in_board.mean(axis=0)
    found = []
    for board in np.unique(observations.board_idx):
        mine = observations.board_idx == board
        views = sorted(
            set(zip(observations.camera_idx[mine].tolist(), observations.frame_idx[mine].tolist(), strict=True))
        )
        seen_by = ", ".join(detections.camera_ids[camera] for camera, _ in views)
        camera, frame = views[0]
        pose = solution.state.rig_from_board[int(board)]
        centre = pose.apply(middle)
        towards = centre_of(solution.state.cam_from_rig[camera]) - centre
        up = pose.rotation[:, 2] * np.sign(pose.rotation[:, 2] @ towards)
        found.append(_Placement(f"frame {detections.cameras[camera].frames[frame]} ({seen_by})", pose, up, centre))
    return found


def _equations(
    placements: Sequence[_Placement], solution: Solution, observations: Observations, known: RelativePoses
) -> tuple[Pose, Floats, Floats, Floats]:
    """What the placements say of one plane, linear in its two tilts and its height.

    Returns:
        ``rig_from_plane``, a plane near to most placements; (3n,) tilts and height of each placement in it; (3n, 3)
        derivative by the plane's own; (3n, 3n) covariance.
    """
    ups = np.array([placement.up for placement in placements])
    medoid = placements[int(np.argmax(np.median(ups @ ups.T, axis=1)))]
    z = medoid.up
    x = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    x /= np.linalg.norm(x)
    base = Pose(np.column_stack([x, np.cross(z, x), z]), medoid.centre)
    n = len(placements)
    y, A, own, by_rig = (
        np.zeros((n, 3)),
        np.zeros((n, 3, 3)),
        np.zeros((n, 3, 3)),
        np.zeros((n, 3, len(known.covariance))),
    )
    for i, (placement, board) in enumerate(zip(placements, np.unique(observations.board_idx), strict=True)):
        u, v, height = base.inverse().apply(placement.centre)
        y[i] = [*(base.rotation[:, :2].T @ placement.up), height]
        A[i] = [[1, 0, 0], [0, 1, 0], [-u, -v, 1]]
        lever = placement.centre - placement.rig_from_board.translation_m
        turning = np.cross(np.array([placement.up, placement.up, lever]), base.rotation.T)
        by_pose = np.hstack([turning, np.array([np.zeros(3), np.zeros(3), z])])
        H, E = _normal_equations(solution, observations, int(board))
        by_corners = by_pose @ np.linalg.inv(H)
        own[i] = solution.sigma_px**2 * by_corners @ by_pose.T
        by_rig[i] = -by_corners @ E
    shared = by_rig.reshape(3 * n, -1)
    covariance = shared @ known.covariance @ shared.T
    for i in range(n):
        at = slice(3 * i, 3 * i + 3)
        covariance[at, at] += own[i]
    return base, y.ravel(), A.reshape(3 * n, 3), covariance


def _normal_equations(solution: Solution, observations: Observations, board: int) -> tuple[Floats, Floats]:
    """Of one board: (6, 6) of its pose, and (6, 6C) with the cameras' poses."""
    state = solution.state
    H, E = np.zeros((POSE, POSE)), np.zeros((POSE, POSE * len(state.cameras)))
    rig_from_board = state.rig_from_board[board]
    for camera, (lens, cam_from_rig) in enumerate(zip(state.cameras, state.cam_from_rig, strict=True)):
        rows = np.flatnonzero((observations.board_idx == board) & (observations.camera_idx == camera))
        if not len(rows):
            continue
        in_board = observations.points_in_board[rows]
        in_rig = rig_from_board.apply(in_board)
        _, by_point, _ = lens.project_with_jacobians(cam_from_rig.apply(in_rig))
        by_board = _by_pose(by_point @ cam_from_rig.rotation, in_board @ rig_from_board.rotation.T)
        by_camera = _by_pose(by_point, in_rig @ cam_from_rig.rotation.T)
        H += by_board.T @ by_board
        E[:, POSE * camera : POSE * camera + POSE] = by_board.T @ by_camera
    return H, E


def _by_pose(by_point: Floats, turned: Floats) -> Floats:
    """(2n, 6) derivative by a left perturbation of a pose, of pixels with ``by_point`` (n, 2, 3)."""
    rows = [np.hstack([-J @ cross_matrix(point), J]) for J, point in zip(by_point, turned, strict=True)]
    return np.concatenate(rows)


def _fitted(y: Floats, A: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """The plane (3,) and its covariance (3, 3); widened where the placements scatter more than they should."""
    weight = np.linalg.inv(covariance)
    plane_covariance = np.linalg.inv(A.T @ weight @ A)
    plane = plane_covariance @ A.T @ weight @ y
    gap = y - A @ plane
    scatter = float(gap @ weight @ gap) / (len(y) - 3) if len(y) > 3 else 1.0
    return plane, np.asarray(plane_covariance * max(scatter, 1.0), dtype=np.float64)


def _check_flat(placements: Sequence[_Placement], y: Floats, A: Floats, covariance: Floats) -> None:
    """Refuse the placement that contradicts the others, if there is one."""
    n = len(placements)
    if n == 1:
        return
    blocks = np.array([covariance[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] for i in range(n)])
    allowed = np.diag([np.deg2rad(FLAT_DEG), np.deg2rad(FLAT_DEG), FLAT_M]) ** 2
    weights = np.linalg.inv(blocks + allowed)
    A_of, y_of, trust = A.reshape(n, 3, 3), y.reshape(n, 3), np.ones(n)
    for _ in range(20):  # robust: a bad placement must not drag the plane towards it
        normal = np.einsum("n,nji,njk,nkl->il", trust, A_of, weights, A_of)
        plane = np.linalg.solve(normal, np.einsum("n,nji,njk,nk->i", trust, A_of, weights, y_of))
        gaps = y_of - A_of @ plane
        squared = np.einsum("ni,nij,nj->n", gaps, weights, gaps)
        trust = 1 / (1 + squared / 3)
    worst = int(np.argmax(squared))
    others = np.repeat(np.arange(n) != worst, 3)
    plane, plane_covariance = _fitted(y[others], A[others], covariance[np.ix_(others, others)])
    gap = y_of[worst] - A_of[worst] @ plane
    sigma = np.sqrt(np.diag(blocks[worst] + A_of[worst] @ plane_covariance @ A_of[worst].T))
    limits = np.maximum([np.deg2rad(FLAT_DEG)] * 2 + [FLAT_M], _SIGMAS * sigma)
    tilt, tilt_limit = float(np.hypot(*gap[:2])), float(limits[:2].max())
    if abs(gap[2]) > limits[2] or tilt > tilt_limit:
        raise NotFlatError(
            placements[worst].name,
            height_mm=1e3 * float(gap[2]),
            tilt_deg=float(np.rad2deg(tilt)),
            limit_mm=1e3 * float(limits[2]),
            limit_deg=float(np.rad2deg(tilt_limit)),
        )
