"""Where a board is, seen by one calibrated camera: both solutions of the planar ambiguity, best first."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from rigcal.camera import Camera
from rigcal.detections import BoardView
from rigcal.geometry import Floats, Pose

_FROM_BEHIND = Pose(np.diag([-1.0, 1.0, -1.0]), np.zeros(3))  # OpenCV's solver takes boards for facing the camera


@dataclass(frozen=True, slots=True)
class BoardPose:
    """One candidate pose of a board and how well it fits."""

    cam_from_board: Pose
    rmse_px: float
    """Reprojection error over the view's corners."""


def board_poses(camera: Camera, corners_in_board: Floats, view: BoardView) -> tuple[BoardPose, ...]:
    """Candidate poses of a planar board in the camera frame, best fit first.

    Infinitesimal plane-based pose estimation on undistorted corners (Collins and Bartoli, IPPE, IJCV 2014), so any
    lens model serves. A flat board seen by one camera has two poses that fit almost alike when it is far or frontal;
    both are returned, for other cameras to decide.

    Args:
        camera: Intrinsics.
        corners_in_board: (K, 3) corners of the board in metres.
        view: At least four corners, not on one line.

    Returns:
        One or two candidates; none where the corners do not determine a pose.
    """
    points = corners_in_board[view.corner_ids]
    normalised = camera.undistort(view.corners_px)
    if len(points) < 4 or not np.isfinite(normalised).all():
        return ()
    board_from_facing = _FROM_BEHIND if _shows_back(points, normalised) else Pose.identity()
    facing = board_from_facing.inverse().apply(points)
    try:
        count, rvecs, tvecs, _ = cv2.solvePnPGeneric(
            facing, normalised, np.eye(3), np.zeros(5), flags=cv2.SOLVEPNP_IPPE
        )
    except cv2.error:
        return ()  # OpenCV refuses collinear corners in this way: no pose, as documented
    found = []
    for k in range(count):
        if not (np.isfinite(rvecs[k]).all() and np.isfinite(tvecs[k]).all()):
            continue
        pose = Pose.from_rvec(rvecs[k].ravel(), tvecs[k].ravel()) @ board_from_facing.inverse()
        error = camera.project(pose.apply(points)) - view.corners_px
        if np.isfinite(error).all():
            found.append(BoardPose(pose, float(np.sqrt((error**2).sum(axis=1).mean()))))
    return tuple(sorted(found, key=lambda candidate: candidate.rmse_px))


def _shows_back(points_in_board: Floats, normalised: Floats) -> bool:
    """Whether the corners go round the other way than on the board's front."""
    plane = np.column_stack([points_in_board[:, :2], np.ones(len(points_in_board))])
    affine = np.linalg.lstsq(plane, normalised, rcond=None)[0][:2]
    return float(np.linalg.det(affine)) < 0
