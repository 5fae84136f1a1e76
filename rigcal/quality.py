"""Is the calibration good? Measures beyond the RMSE, the gates that judge them, and what to do next.

An RMSE says how well a model fits the corners that it was fitted to; it cannot see a focal length that trades with
distance, or poses that drift along a chain. So the rig is also measured on views kept out of the solve, on two halves
solved apart, by an independent solver, and by what the covariance says of lenses, positions and a point in the scene.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import cv2
import numpy as np

from rigcal._colmap import solve_with_colmap
from rigcal.bundle import POSE, Freedom, Solution, SolveOptions, State, rmse_px, solve
from rigcal.geometry import Bools, Floats, Pose
from rigcal.refine import JointResult

FOLDS = 5
"""Parts of the board positions that are kept out in turn."""


@dataclass(frozen=True, slots=True, eq=False)
class JointQuality:
    """What the joint solve is worth, beyond its RMSE."""

    held_out_px: tuple[float | None, ...]
    """Per camera the RMSE over board positions that were kept out of the solve."""
    split_half: float | None
    """Difference of the camera poses of two halves solved apart, over its own sigma; None where the halves cannot
    be solved apart."""
    solver_agreement: float
    """Greatest difference of a pose from the second solver's, over its own sigma."""
    lens_sigma: tuple[Floats, ...]
    """Per camera (P,) one sigma of each coefficient."""
    focal_sigma_percent: tuple[float, ...]
    """Per camera one sigma of the focal length."""
    position_sigma_m: tuple[float, ...]
    """Per camera one sigma of its position in the rig frame (root of the covariance's trace)."""
    rotation_sigma_deg: tuple[float, ...]
    """Per camera one sigma of its orientation (root of the covariance's trace)."""
    scene_centre_m: Floats | None
    """(3,) mean of the boards' centres seen by two or more cameras, in the rig frame; None where there are none."""
    scene_sigma_m: float | None
    """One sigma of a point triangulated there, from the rig's covariance alone."""
    image_coverage: tuple[float, ...]
    """Per camera the share of its image that boards covered."""
    tilt_spread_deg: tuple[float, ...]
    """Per camera the root-mean-square angle of the boards' normals from their mean."""


def assess(joint: JointResult, lens_sigmas: Sequence[Floats]) -> JointQuality:
    """Measure a solved rig; ``lens_sigmas`` (P,) per camera are those of its lens alone, for lenses that were held."""
    solution = joint.solution
    count = len(joint.cameras)
    position, rotation = [], []
    for camera in range(count):
        covariance = solution.camera_covariance(camera, range(POSE))
        change = _centre_by_pose(solution.state.cam_from_rig[camera])
        position.append(float(np.sqrt(np.trace(change @ covariance @ change.T))))
        rotation.append(float(np.rad2deg(np.sqrt(np.trace(covariance[:3, :3])))))
    centre = _scene_centre(joint)
    sigmas = tuple(_lens_sigma(joint, camera, alone) for camera, alone in enumerate(lens_sigmas))
    return JointQuality(
        _held_out(joint),
        _split_half(joint),
        _solver_agreement(joint),
        sigmas,
        tuple(
            float(100 * (sigma[:2] / lens.params[:2]).max())
            for sigma, lens in zip(sigmas, solution.state.cameras, strict=True)
        ),
        tuple(position),
        tuple(rotation),
        centre,
        None if centre is None else _point_sigma_m(solution, centre),
        tuple(_coverage(joint, camera) for camera in range(count)),
        tuple(_tilt_spread_deg(joint, camera) for camera in range(count)),
    )


def _centre_by_pose(cam_from_rig: Pose) -> Floats:
    """(3, 6) derivative of a camera's centre in the rig by its pose's perturbation."""
    R, t = cam_from_rig.rotation, cam_from_rig.translation_m
    return np.hstack([-R.T @ _cross(t), -R.T])


def _cross(v: Floats) -> Floats:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def _lens_sigma(joint: JointResult, camera: int, alone: Floats) -> Floats:
    if not joint.freedom.params[camera].any():
        return alone
    unknowns = range(POSE, POSE + len(joint.cameras[camera].params))
    return np.asarray(np.sqrt(np.diag(joint.solution.camera_covariance(camera, unknowns))))


def _held_out(joint: JointResult) -> tuple[float | None, ...]:
    """K-fold over board positions: solve without a fifth of them, then place only their boards."""
    obs, state = joint.observations, joint.solution.state
    squared: list[list[Floats]] = [[] for _ in state.cameras]
    order = np.unique(obs.board_idx)
    for fold in range(min(FOLDS, len(order))):
        out = np.isin(obs.board_idx, order[fold::FOLDS])
        if not _solvable(joint, ~out):
            continue
        options = SolveOptions(sigma_px=max(joint.solution.sigma_px, 0.01), tolerance=1e-8)
        trained = solve(obs.subset(~out), state, joint.freedom, options).state
        fixed = Freedom(
            tuple(np.zeros(len(c.params), dtype=bool) for c in state.cameras), np.zeros(len(state.cameras), dtype=bool)
        )
        test = obs.subset(out)
        residuals = solve(test, replace(trained, rig_from_board=state.rig_from_board), fixed, options).residuals_px
        for camera, rows in enumerate(squared):
            rows.append(residuals[test.camera_idx == camera])
    return tuple(rmse_px(np.concatenate(rows)) if rows else None for rows in squared)


def _solvable(joint: JointResult, rows: Bools) -> bool:
    """Whether these rows still join every camera to the first, with at least three boards in each."""
    obs, count = joint.observations, len(joint.cameras)
    pairs = {(int(c), int(b)) for c, b in zip(obs.camera_idx[rows], obs.board_idx[rows], strict=True)}
    boards_of = [{b for c, b in pairs if c == camera} for camera in range(count)]
    if min(len(boards) for boards in boards_of) < 3:
        return False
    reached, frontier = {0}, [0]
    while frontier:
        near = frontier.pop()
        for other in range(count):
            if other not in reached and boards_of[near] & boards_of[other]:
                reached.add(other)
                frontier.append(other)
    return len(reached) == count


def _split_half(joint: JointResult) -> float | None:
    """Mahalanobis distance per root degree of freedom between the camera poses of two halves."""
    obs, count = joint.observations, len(joint.cameras)
    if count == 1:
        return None
    order = np.unique(obs.board_idx)
    shared = [b for b in order if len(np.unique(obs.camera_idx[obs.board_idx == b])) > 1]
    single = [b for b in order if b not in set(shared)]
    first = np.isin(obs.board_idx, np.concatenate([shared[::2], single[::2]]))
    if not (_solvable(joint, first) and _solvable(joint, ~first)):
        return None
    options = SolveOptions(sigma_px=max(joint.solution.sigma_px, 0.01))
    halves = [solve(obs.subset(rows), joint.solution.state, joint.freedom, options) for rows in (first, ~first)]
    wanted = [(camera, unknown) for camera in range(1, count) for unknown in range(POSE)]
    covariance = halves[0].joint_covariance(wanted) + halves[1].joint_covariance(wanted)
    gap = _pose_gap(halves[0].state.cam_from_rig[1:], halves[1].state.cam_from_rig[1:])
    return float(np.sqrt(gap @ np.linalg.pinv(covariance, hermitian=True) @ gap / len(gap)))


def _pose_gap(first: Sequence[Pose], second: Sequence[Pose]) -> Floats:
    """(6n,) perturbations that take the second poses to the first."""
    rows = []
    for one, two in zip(first, second, strict=True):
        turn = Pose(one.rotation @ two.rotation.T, np.zeros(3)).rvec_rad
        rows.append(np.concatenate([turn, one.translation_m - two.translation_m]))
    return np.concatenate(rows)


def _solver_agreement(joint: JointResult) -> float:
    solution = joint.solution
    free = [bool(params.any()) for params in joint.freedom.params]
    held_cameras = State(solution.state.cameras, joint.start.cam_from_rig, joint.start.rig_from_board)
    opinion = solve_with_colmap(joint.observations, held_cameras, free_lenses=free)
    if len(joint.cameras) == 1:
        return 0.0
    gap = _pose_gap(solution.state.cam_from_rig[1:], opinion.cam_from_rig[1:])
    wanted = [(camera, unknown) for camera in range(1, len(joint.cameras)) for unknown in range(POSE)]
    sigma = np.sqrt(np.diag(solution.joint_covariance(wanted)))
    return float((np.abs(gap) / np.maximum(sigma, 1e-9)).max())


def _scene_centre(joint: JointResult) -> Floats | None:
    obs = joint.observations
    middle = obs.corners_in_board.mean(axis=0)
    centres = [
        joint.solution.state.rig_from_board[int(b)].apply(middle)
        for b in np.unique(obs.board_idx)
        if len(np.unique(obs.camera_idx[obs.board_idx == b])) > 1
    ]
    return np.mean(centres, axis=0) if centres else None


def _point_sigma_m(solution: Solution, point_in_rig: Floats) -> float | None:
    """One sigma of the place where all cameras that see the point triangulate it, from the rig's covariance.

    With ``J`` the derivative of the pixels by the point and ``G`` by the cameras' unknowns, a small error ``d`` of the
    unknowns moves the point by ``-(J^T J)^-1 J^T G d``.
    """
    state = solution.state
    wanted: list[tuple[int, int]] = []
    J, G = [], []
    for camera, (lens, pose) in enumerate(zip(state.cameras, state.cam_from_rig, strict=True)):
        in_cam = pose.apply(point_in_rig)
        pixel = lens.project(in_cam)
        if not (np.isfinite(pixel).all() and (pixel >= 0).all() and (pixel < lens.size_wh).all()):
            continue
        _, by_point, by_params = lens.project_with_jacobians(in_cam[None])
        J.append(by_point[0] @ pose.rotation)
        turned = pose.rotation @ point_in_rig
        G.append(np.hstack([-by_point[0] @ _cross(turned), by_point[0], by_params[0]]))
        wanted += [(camera, unknown) for unknown in range(POSE + len(lens.params))]
    if len(J) < 2:
        return None
    stacked = np.vstack(J)
    by_unknowns = np.zeros((len(stacked), len(wanted)))
    column = 0
    for row, block in enumerate(G):
        by_unknowns[2 * row : 2 * row + 2, column : column + block.shape[1]] = block
        column += block.shape[1]
    moved = np.linalg.solve(stacked.T @ stacked, stacked.T @ by_unknowns)
    return float(np.sqrt(np.trace(moved @ solution.joint_covariance(wanted) @ moved.T)))


def _coverage(joint: JointResult, camera: int) -> float:
    """Share of the image inside the outlines of the boards, on a grid of 64 cells along the longer side."""
    obs = joint.observations
    width, height = joint.cameras[camera].size_wh
    scale = 64 / max(width, height)
    mask = np.zeros((max(round(height * scale), 1), max(round(width * scale), 1)), dtype=np.uint8)
    mine = obs.camera_idx == camera
    for board in np.unique(obs.board_idx[mine]):
        corners = (obs.pixels[mine & (obs.board_idx == board)] * scale).astype(np.float32)
        outline = np.rint(cv2.convexHull(corners)).astype(np.int32)
        cv2.fillConvexPoly(mask, outline, 1)
    return float(mask.mean())


def _tilt_spread_deg(joint: JointResult, camera: int) -> float:
    obs, state = joint.observations, joint.solution.state
    boards = np.unique(obs.board_idx[obs.camera_idx == camera])
    normals = np.array([(state.cam_from_rig[camera] @ state.rig_from_board[int(b)]).rotation[:, 2] for b in boards])
    mean = normals.mean(axis=0)
    cosines = np.clip(normals @ (mean / np.linalg.norm(mean)), -1, 1)
    return float(np.rad2deg(np.sqrt((np.arccos(cosines) ** 2).mean())))


@dataclass(frozen=True, slots=True)
class Gate:
    """One judged figure."""

    name: str
    """Field of :class:`rigcal.site.GateLimits`."""
    camera: str | None
    """The camera it is about; None: the whole rig."""
    value: float | None
    """None where it could not be measured, which fails the gate."""
    limit: float
    passed: bool
    advice: str | None
    """The next action, where the gate failed."""


AT_LEAST = frozenset({"views", "tilt_spread_deg", "image_coverage", "chain_overlap_views"})
"""Gates whose value must not fall below the limit; all others must not exceed it."""

_ADVICE: Mapping[str, str] = {
    "intrinsic_rmse_px": "show {camera} a sharp, still board again; check that the board is stiff and flat",
    "pairwise_rmse_px": "hold the board still while {camera} and its neighbour on the chain both see it; check that "
    "their images are taken at the same time",
    "refined_rmse_px": "look at {camera}'s dropped views in the report; hold the board still, and check that the "
    "cameras' images are taken at the same time",
    "held_out_ratio": "add views to {camera}: other distances, tilts of 20-45 degrees, every corner of the image",
    "focal_sigma_percent": "show {camera} the board tilted by 30 degrees or more, at near and far distances",
    "position_sigma_m": "show the board to {camera} and {parent} together, nearer and tilted, in 10 or more positions",
    "scene_sigma_m": "show the board to several cameras together in the middle of the scene, in 10 or more positions",
    "split_half": "add shared views in other places; if it stays, the board bends, or moves between exposures",
    "solver_agreement": "add shared views: the two solvers found different rigs, so the views do not determine it",
    "views": "show the board to {camera} in more positions",
    "tilt_spread_deg": "tilt the board by 20-45 degrees to all sides in front of {camera}",
    "image_coverage": "show the board in every corner of {camera}'s image, and near enough to fill a quarter of it",
    "chain_overlap_views": "show the board to {camera} and {parent} together in more positions",
}


@dataclass(frozen=True, slots=True)
class CameraFigures:
    """Figures of one camera that the gates judge beside the joint quality."""

    camera_id: str
    parent_id: str | None
    """The camera before it on its chain; None for the reference."""
    intrinsic_rmse_px: float | None
    pairwise_rmse_px: float | None
    refined_rmse_px: float
    views: int
    chain_overlap_views: int | None


def judge(figures: Sequence[CameraFigures], quality: JointQuality, limits: Mapping[str, float]) -> tuple[Gate, ...]:
    """Every gate, per camera and for the rig; ``limits`` by name, as in :class:`rigcal.site.GateLimits`."""
    gates: list[Gate] = []

    def add(name: str, value: float | None, camera: CameraFigures | None) -> None:
        limit = float(limits[name])
        passed = value is not None and (value >= limit if name in AT_LEAST else value <= limit)
        advice = None
        if not passed:
            advice = _ADVICE[name].format(
                camera=camera.camera_id if camera else "", parent=camera.parent_id if camera else ""
            )
            if value is None:
                advice = "too few views to measure this: " + advice
        rounded = None if value is None else float(f"{value:.6g}")
        gates.append(Gate(name, camera.camera_id if camera else None, rounded, limit, passed, advice))

    for index, camera in enumerate(figures):
        held = quality.held_out_px[index]
        if camera.intrinsic_rmse_px is not None:
            add("intrinsic_rmse_px", camera.intrinsic_rmse_px, camera)
        add("refined_rmse_px", camera.refined_rmse_px, camera)
        add("held_out_ratio", None if held is None else held / max(camera.refined_rmse_px, 1e-9), camera)
        add("focal_sigma_percent", quality.focal_sigma_percent[index], camera)
        add("views", camera.views, camera)
        add("tilt_spread_deg", quality.tilt_spread_deg[index], camera)
        add("image_coverage", quality.image_coverage[index], camera)
        if camera.parent_id is not None:
            add("pairwise_rmse_px", camera.pairwise_rmse_px, camera)
            add("position_sigma_m", quality.position_sigma_m[index], camera)
            add("chain_overlap_views", camera.chain_overlap_views, camera)
    if len(figures) > 1:
        add("scene_sigma_m", quality.scene_sigma_m, None)
        add("split_half", quality.split_half, None)
        add("solver_agreement", quality.solver_agreement, None)
    return tuple(gates)


def verdict(gates: Sequence[Gate]) -> str:
    """``PASS`` where every gate passed, else ``RECAPTURE``."""
    return "PASS" if all(gate.passed for gate in gates) else "RECAPTURE"


def joint_camera_covariance(solution: Solution) -> tuple[tuple[int, ...], Floats]:
    """Free cameras and the (6n, 6n) covariance of their poses, rotation (rad) then translation (m) each."""
    free = tuple(camera for camera in range(len(solution.state.cameras)) if (camera, 0) in set(solution.index))
    return free, solution.joint_covariance(list(product(free, range(POSE))))
