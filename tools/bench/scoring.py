"""How good an estimated rig is: against the truth, on views that were kept out, and by what it says of itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rigs import BenchSite, Planted
from scipy.spatial.transform import Rotation

from rigcal.boardpose import board_poses
from rigcal.bundle import POSE, Freedom, SolveOptions, State, solve
from rigcal.camera import Camera
from rigcal.corners import Observations
from rigcal.detections import BoardView, SiteDetections
from rigcal.geometry import Floats, Pose
from rigcal.pipeline import SiteCalibration

_CLIP_PX = 20.0  # a view further off than this says no more about which of its poses is the right one


@dataclass(frozen=True, slots=True)
class Estimate:
    """What a method found."""

    cameras: tuple[Camera, ...]
    cam_from_rig: tuple[Pose, ...]
    """The first is the identity."""


def position_errors_m(site: BenchSite, cam_from_rig: Sequence[Pose]) -> Floats:
    """(C - 1,) distance of each camera but the first from its true position in camera 0's frame."""
    return np.asarray(np.linalg.norm(_centres(cam_from_rig) - _true_centres(site), axis=1)[1:])


def aligned_rms_m(site: BenchSite, cam_from_rig: Sequence[Pose]) -> float:
    """Root-mean-square distance of all cameras after the rigid motion that brings them closest to the truth."""
    found, true = _centres(cam_from_rig), _true_centres(site)
    found, true = found - found.mean(axis=0), true - true.mean(axis=0)
    u, _, vt = np.linalg.svd(true.T @ found)
    turn = u @ np.diag([1, 1, np.sign(np.linalg.det(u @ vt))]) @ vt
    return float(np.sqrt(((found @ turn.T - true) ** 2).sum(axis=1).mean()))


def _centres(cam_from_rig: Sequence[Pose]) -> Floats:
    return np.stack([pose.inverse().translation_m for pose in cam_from_rig])


def _true_centres(site: BenchSite) -> Floats:
    return _centres([camera.cam_from_rig for camera in site.rig.cameras])


def placed_boards(detections: SiteDetections, estimate: Estimate) -> tuple[Observations, State]:
    """Every board where the cameras that saw it agree best, among the planar solutions of each of them."""
    corners = detections.board.corners_in_board
    groups: dict[int, dict[int, BoardView]] = {}
    for c, camera in enumerate(detections.cameras):
        for view in camera.views:
            groups.setdefault(view.frame_idx, {})[c] = view
    entries: list[tuple[int, int, BoardView]] = []
    boards: list[Pose] = []
    for group in groups.values():
        candidates = [
            estimate.cam_from_rig[c].inverse() @ found.cam_from_board
            for c, view in group.items()
            for found in board_poses(estimate.cameras[c], corners, view)
        ]
        entries += [(c, len(boards), view) for c, view in group.items()]
        boards.append(min(candidates, key=lambda pose: _disagreement_px(estimate, corners, group, pose)))
    return Observations.of(corners, entries), State(estimate.cameras, estimate.cam_from_rig, tuple(boards))


def _disagreement_px(estimate: Estimate, corners: Floats, group: dict[int, BoardView], rig_from_board: Pose) -> float:
    total = 0.0
    for c, view in group.items():
        points = (estimate.cam_from_rig[c] @ rig_from_board).apply(corners[view.corner_ids])
        gap = np.linalg.norm(estimate.cameras[c].project(points) - view.corners_px, axis=1)
        total += float(np.minimum(np.nan_to_num(gap, nan=_CLIP_PX), _CLIP_PX).sum())
    return total


def held_out_rmse_px(site: BenchSite, estimate: Estimate) -> float:
    """RMSE over clean views that no method was given, the cameras held and only the boards placed."""
    observations, state = placed_boards(site.held_out, estimate)
    held = Freedom(
        tuple(np.zeros(len(camera.params), dtype=bool) for camera in estimate.cameras),
        np.zeros(len(estimate.cameras), dtype=bool),
    )
    residuals = solve(observations, state, held, SolveOptions(sigma_px=site.noise_px)).residuals_px
    return float(np.sqrt((residuals**2).sum(axis=1).mean()))


def normalised_squared_error(site: BenchSite, result: SiteCalibration) -> float:
    """Squared error of all camera poses in units of the covariance that came with them, per degree of freedom.

    One on average where the sigmas are honest (Bar-Shalom, Li and Kirubarajan, Estimation with Applications to
    Tracking and Navigation, 2001, section 5.4.2); more where they promise too much.
    """
    errors, rows = [], []
    for c, (found, true) in enumerate(zip(result.joint.cam_from_rig, site.rig.cameras, strict=True)):
        if c == 0:
            continue
        turn = Rotation.from_matrix(found.rotation @ true.cam_from_rig.rotation.T).as_rotvec()
        errors += [turn, found.translation_m - true.cam_from_rig.translation_m]
        rows += [(c, unknown) for unknown in range(POSE)]
    error = np.concatenate(errors)
    return float(error @ np.linalg.solve(result.joint.solution.joint_covariance(rows), error)) / len(error)


@dataclass(frozen=True, slots=True)
class Naming:
    """Whether what was wrong was named, and only that."""

    told: float | None
    """Share of the planted views named, of those that geometry can tell: by itself or by a third view."""
    pairs: float | None
    """Share of those that contradict one partner, where either of the two was named; nobody can tell which is bad."""
    good_dropped: float
    """Share of good views that were dropped, partners of such contradictions left aside."""


def naming(result: SiteCalibration, planted: Sequence[Planted]) -> Naming:
    """Compare the findings with what was planted."""
    index_of = [{name: i for i, name in enumerate(camera.frames)} for camera in result.detections.cameras]
    named = {(c, index_of[c][f.frame]): f.action for c, group in enumerate(result.findings) for f in group}
    spoilt = {(p.camera_idx, p.frame_idx) for p in planted}
    doubtful = {p.frame_idx for p in planted if p.told_by == "partner"}
    named_frames = {frame for _, frame in named}
    told = [(p.camera_idx, p.frame_idx) in named for p in planted if p.told_by in ("itself", "third view")]
    good = [
        (c, view.frame_idx)
        for c, camera in enumerate(result.detections.cameras)
        for view in camera.views
        if (c, view.frame_idx) not in spoilt and view.frame_idx not in doubtful
    ]
    return Naming(
        float(np.mean(told)) if told else None,
        float(np.mean([frame in named_frames for frame in doubtful])) if doubtful else None,
        float(np.mean([named.get(key) == "dropped" for key in good])),
    )
