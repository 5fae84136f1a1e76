"""Residuals beyond those of a solve: through the chain of pairs, and of corners that were rejected."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigcal.boardpose import board_poses
from rigcal.bundle import bent, rmse_px
from rigcal.detections import BoardView, SiteDetections
from rigcal.geometry import Floats
from rigcal.graph import Chain
from rigcal.intrinsics import IntrinsicsResult
from rigcal.order import corner_orders, reordered
from rigcal.refine import JointResult


def chained_rmse_px(
    detections: SiteDetections, lenses: Sequence[IntrinsicsResult], chain: Chain, camera: int
) -> float | None:
    """Boards placed by the reference and seen through the chain: the error that compounds along it.

    Where a camera shares no view with the reference, the nearest camera to it on the chain that does places them.
    """
    corners, orders = detections.board.corners_in_board, corner_orders(detections.board)
    mine = {view.frame_idx: view for view in lenses[camera].views}
    for placer in chain.paths[camera][:-1]:
        placed = dict(
            zip([view.frame_idx for view in lenses[placer].views], lenses[placer].cam_from_board, strict=True)
        )
        cam_from_placer = chain.cam_from_rig[camera] @ chain.cam_from_rig[placer].inverse()
        gaps = []
        for row in detections.instants.frame_idx:
            view = mine.get(int(row[camera]))
            if view is not None and int(row[placer]) in placed:
                pixels = lenses[camera].camera.project((cam_from_placer @ placed[int(row[placer])]).apply(corners))
                gaps.append(min((pixels[order[view.corner_ids]] - view.corners_px for order in orders), key=_squared))
        if gaps:
            stacked = np.concatenate(gaps)
            return rmse_px(stacked[np.isfinite(stacked).all(axis=1)])
    return None


def _squared(gap: Floats) -> float:
    return float(np.nan_to_num(gap**2, nan=1e12).sum())


def rmse_of_all_px(detections: SiteDetections, joint: JointResult, camera: int) -> float:
    """RMSE of one camera over every detected corner, rejected ones too."""
    residuals = [residual for _, residual in residuals_of_all(detections, joint, camera)]
    return rmse_px(np.concatenate(residuals)) or 0.0


def residuals_of_all(detections: SiteDetections, joint: JointResult, camera: int) -> list[tuple[BoardView, Floats]]:
    """Residuals (n, 2) of every detected view of one camera, rejected ones too.

    A view whose instant was used keeps that board's pose; any other is placed by itself. Corner orders that the joint
    solve turned are turned here.
    """
    obs, corners = joint.observations, bent(detections.board.corners_in_board, joint.solution.state.bow_m)
    lens, cam_from_rig = joint.cameras[camera], joint.cam_from_rig[camera]
    boards = {(int(c), int(f)): int(b) for c, f, b in zip(obs.camera_idx, obs.frame_idx, obs.board_idx, strict=True)}
    instant_of = {int(row[camera]): row for row in detections.instants.frame_idx}
    orders = corner_orders(detections.board)
    found = []
    for view in detections.cameras[camera].views:
        view = reordered(view, orders[joint.order_of.get((camera, view.frame_idx), 0)])  # noqa: PLW2901
        row = instant_of[view.frame_idx]
        board = next((boards[c, int(f)] for c, f in enumerate(row) if (c, int(f)) in boards), None)
        if board is not None:
            pose = cam_from_rig @ joint.solution.state.rig_from_board[board]
        elif candidates := board_poses(lens, corners, view):
            pose = candidates[0].cam_from_board
        else:
            continue
        found.append((view, view.corners_px - lens.project(pose.apply(corners[view.corner_ids]))))
    return [(view, gap) for view, gap in found if np.isfinite(gap).all()]
