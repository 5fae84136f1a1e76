"""Where the cameras look together, and how surely a point there is found from the rig's covariance alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigcal.bundle import POSE
from rigcal.camera import Camera
from rigcal.geometry import Floats, Pose, freeze
from rigcal.refine import JointResult
from rigcal.uncertainty import RigCovariance, cross_matrix


@dataclass(frozen=True, slots=True, eq=False)
class ScenePoint:
    """A place that two cameras or more see, and how surely it is triangulated."""

    point_in_rig_m: Floats
    """(3,) metres, in the rig frame."""
    sigma_m: float
    """One sigma of the triangulated point (root of the covariance's trace), from the rig's covariance alone."""
    cameras: tuple[int, ...]
    """Cameras whose image holds the point."""

    def __post_init__(self) -> None:
        freeze(self, np.float64, point_in_rig_m=(3,))


def scene_points(joint: JointResult, covariance: RigCovariance) -> tuple[ScenePoint | None, tuple[ScenePoint, ...]]:
    """The scene's centre and its edges.

    The scene is where boards were seen by two cameras or more. Its centre is the mean of those boards' centres; its
    edges are the outermost of them along their three principal axes.

    Returns:
        The centre, None where fewer than two cameras see it; and up to six edges, each once.
    """
    centres = _shared_centres(joint)
    if not len(centres):
        return None, ()
    middle = centres.mean(axis=0)
    axes = np.linalg.svd(centres - middle, full_matrices=False)[2]
    along = (centres - middle) @ axes.T
    outermost = dict.fromkeys([*along.argmin(axis=0).tolist(), *along.argmax(axis=0).tolist()])
    state = joint.solution.state
    edges = [_scene_point(state.cameras, state.cam_from_rig, covariance, centres[i]) for i in outermost]
    return _scene_point(state.cameras, state.cam_from_rig, covariance, middle), tuple(edge for edge in edges if edge)


def _shared_centres(joint: JointResult) -> Floats:
    """(B, 3) centres of the boards that two cameras or more saw, in the rig frame."""
    obs = joint.observations
    middle = obs.corners_in_board.mean(axis=0)
    pairs = np.unique(np.stack([obs.board_idx, obs.camera_idx], axis=1), axis=0)
    boards, cameras = np.unique(pairs[:, 0], return_counts=True)
    shared = boards[cameras > 1].tolist()
    return np.array([joint.solution.state.rig_from_board[b].apply(middle) for b in shared]).reshape(-1, 3)


def _scene_point(
    cameras: Sequence[Camera], cam_from_rig: Sequence[Pose], covariance: RigCovariance, point_in_rig: Floats
) -> ScenePoint | None:
    """The point as all cameras that see it triangulate it.

    With ``J`` the derivative of the pixels by the point and ``G`` by the cameras' unknowns, a small error ``d`` of the
    unknowns moves the point by ``-(J^T J)^-1 J^T G d``.
    """
    seen_by: list[int] = []
    J, G = [], []
    for camera, (lens, pose) in enumerate(zip(cameras, cam_from_rig, strict=True)):
        in_cam = pose.apply(point_in_rig)
        pixel = lens.project(in_cam)
        if not (np.isfinite(pixel).all() and (pixel >= 0).all() and (pixel < lens.size_wh).all()):
            continue
        _, by_point, by_params = lens.project_with_jacobians(in_cam[None])
        J.append(by_point[0] @ pose.rotation)
        turned = pose.rotation @ point_in_rig
        G.append(np.hstack([-by_point[0] @ cross_matrix(turned), by_point[0], by_params[0]]))
        seen_by.append(camera)
    if len(J) < 2:
        return None
    stacked = np.vstack(J)
    by_unknowns = np.zeros((len(stacked), sum(block.shape[1] for block in G)))
    column = 0
    for row, block in enumerate(G):
        by_unknowns[2 * row : 2 * row + 2, column : column + block.shape[1]] = block
        column += block.shape[1]
    moved = np.linalg.solve(stacked.T @ stacked, stacked.T @ by_unknowns)
    wanted = [(camera, unknown) for camera in seen_by for unknown in range(POSE + len(cameras[camera].params))]
    variance = float(np.trace(moved @ covariance.of(wanted) @ moved.T))
    return ScenePoint(point_in_rig, float(np.sqrt(max(variance, 0.0))), tuple(seen_by))
