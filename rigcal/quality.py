"""Is the calibration good? Measures beyond the RMSE, which :mod:`rigcal.gates` then judges.

An RMSE says how well a model fits the corners that it was fitted to; it cannot see a focal length that trades with
distance, or poses that drift along a chain. So the rig is also measured on views kept out of the solve, on two halves
solved apart, by an independent solver, and by what the covariance says of lenses, positions and points in the scene.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from rigcal._colmap import solve_with_colmap
from rigcal.bundle import POSE, Freedom, SolveOptions, rmse_px, solve
from rigcal.coverage import ImageCoverage, coverage_of
from rigcal.geometry import Floats
from rigcal.halves import SplitHalf, pose_gap, solvable, split_half
from rigcal.intrinsics import lens_freedom
from rigcal.refine import JointResult
from rigcal.scene import ScenePoint, scene_points
from rigcal.uncertainty import RigCovariance, centre_by_pose, rig_covariance

FOLDS = 5
"""Parts of the board positions that are kept out in turn."""
THREADS = 2
"""Measures taken at a time: each is a solve of its own, and numpy and pycolmap let others run meanwhile."""
AGREE_SIGMA = 3.0
"""Difference over its sigma below which two cameras' halves agree, when a camera that moved is looked for."""
FOCAL_RANGE = (0.125, 16.0)
"""Focal lengths over the image's longer side outside which a lens is not determined: views without tilt let the solve
run to a thousandth of the true focal length with a sigma to match; real lenses lie between 0.25 and 8."""
_WEAK_FOCAL = 0.1  # relative sigma of a given focal length when this capture is asked what it says of the lens


@dataclass(frozen=True, slots=True, eq=False)
class JointQuality:
    """What the joint solve is worth, beyond its RMSE."""

    held_out_px: tuple[float | None, ...]
    """Per camera the RMSE over board positions that were kept out of the solve."""
    split_half: SplitHalf | None
    """How two halves solved apart differ; None where they cannot be solved apart."""
    solver_agreement: float
    """Greatest difference of a pose from the second solver's, over its own sigma."""
    lens_sigma: tuple[Floats, ...]
    """Per camera (P,) one sigma of each coefficient."""
    focal_sigma_percent: tuple[float | None, ...]
    """Per camera one sigma of the focal length; None where it is not determined at all."""
    position_sigma_m: tuple[float, ...]
    """Per camera one sigma of its position in the rig frame (root of the covariance's trace)."""
    rotation_sigma_deg: tuple[float, ...]
    """Per camera one sigma of its orientation (root of the covariance's trace)."""
    lens_agreement: tuple[float | None, ...]
    """Per camera how far this capture's opinion of the lens lies from the one that was given, over its own sigma; None
    where the lens was calibrated from this capture."""
    scene_centre: ScenePoint | None
    """The middle of where two cameras or more saw boards; None where no two cameras see it."""
    scene_edges: tuple[ScenePoint, ...]
    """The outermost places where two cameras or more saw boards."""
    coverage: tuple[ImageCoverage, ...]
    """Per camera where it saw the board."""
    covariance: RigCovariance
    """Of every pose and lens."""


def assess(joint: JointResult, alone: Sequence[Floats], *, lenses_given: bool = False) -> JointQuality:
    """Measure a solved rig.

    Args:
        joint: The solved rig.
        alone: Per camera (P, P) covariance of its lens calibrated alone.
        lenses_given: Whether the lenses come from another capture, and are to be held against this one.
    """
    state, count = joint.solution.state, len(joint.cameras)
    covariance = rig_covariance(joint, alone)
    poses = [covariance.of_pose(camera) for camera in range(count)]
    centres = [centre_by_pose(pose) for pose in state.cam_from_rig]
    sigmas = tuple(_lens_sigma(covariance, camera, len(lens.params)) for camera, lens in enumerate(state.cameras))
    centre, edges = scene_points(joint, covariance)
    with ThreadPoolExecutor(THREADS) as pool:
        agreement = pool.submit(_solver_agreement, joint)
        halves = pool.submit(split_half, joint, AGREE_SIGMA)
        held_out = _held_out(joint, pool)
    return JointQuality(
        held_out_px=held_out,
        split_half=halves.result(),
        solver_agreement=agreement.result(),
        lens_sigma=sigmas,
        focal_sigma_percent=tuple(
            _focal_percent(lens.params, lens.size_wh, sigma) for lens, sigma in zip(state.cameras, sigmas, strict=True)
        ),
        position_sigma_m=tuple(
            float(np.sqrt(np.trace(change @ pose @ change.T))) for change, pose in zip(centres, poses, strict=True)
        ),
        rotation_sigma_deg=tuple(float(np.rad2deg(np.sqrt(np.trace(pose[:3, :3])))) for pose in poses),
        lens_agreement=_lens_agreement(joint, alone) if lenses_given else (None,) * count,
        scene_centre=centre,
        scene_edges=edges,
        coverage=tuple(coverage_of(joint, camera) for camera in range(count)),
        covariance=covariance,
    )


def _lens_sigma(covariance: RigCovariance, camera: int, count: int) -> Floats:
    return np.asarray(np.sqrt(np.diag(covariance.of([(camera, POSE + p) for p in range(count)])).clip(0)))


def _focal_percent(params: Floats, size_wh: tuple[int, int], sigma: Floats) -> float | None:
    relative = params[:2] / max(size_wh)
    if not (FOCAL_RANGE[0] <= relative.min() and relative.max() <= FOCAL_RANGE[1]):
        return None
    return float(100 * (sigma[:2] / params[:2]).max())


def _held_out(joint: JointResult, pool: Executor) -> tuple[float | None, ...]:
    """K-fold over board positions: solve without a fifth of them, then place only their boards."""
    obs, state = joint.observations, joint.solution.state
    order = np.unique(obs.board_idx)

    def kept_out(fold: int) -> list[Floats]:
        """Residuals of each camera."""
        out = np.isin(obs.board_idx, order[fold::FOLDS])
        if not solvable(joint, ~out):
            return []
        options = SolveOptions(sigma_px=max(joint.solution.sigma_px, 0.01), tolerance=1e-6, covariance=False)
        trained = solve(obs.subset(~out), state, joint.freedom, options).state
        fixed = Freedom(
            tuple(np.zeros(len(c.params), dtype=bool) for c in state.cameras), np.zeros(len(state.cameras), dtype=bool)
        )
        test = obs.subset(out)
        residuals = solve(test, replace(trained, rig_from_board=state.rig_from_board), fixed, options).residuals_px
        return [residuals[test.camera_idx == camera] for camera in range(len(state.cameras))]

    told = [found for found in pool.map(kept_out, range(min(FOLDS, len(order)))) if found]
    return tuple(rmse_px(np.concatenate(rows)) for rows in zip(*told, strict=True)) or (None,) * len(state.cameras)


def _solver_agreement(joint: JointResult) -> float:
    """Greatest difference of a pose from the second solver's, over its sigma; neither with weights, as it has none."""
    solution = joint.solution
    free = [bool(params.any()) for params in joint.freedom.params]
    held_cameras = replace(joint.start, cameras=solution.state.cameras, bow_m=solution.state.bow_m)
    if len(joint.cameras) == 1:
        return 0.0
    alike = replace(joint.observations, weights=np.ones(len(joint.observations)))
    opinion = solve_with_colmap(alike, held_cameras, free_lenses=free)
    ours = solution.state
    if not np.array_equal(alike.weights, joint.observations.weights):
        ours = solve(alike, ours, joint.freedom, SolveOptions(sigma_px=max(solution.sigma_px, 0.01))).state
    gap = pose_gap(ours.cam_from_rig[1:], opinion.cam_from_rig[1:])
    wanted = [(camera, unknown) for camera in range(1, len(joint.cameras)) for unknown in range(POSE)]
    sigma = np.sqrt(np.diag(solution.joint_covariance(wanted)))
    return float((np.abs(gap) / np.maximum(sigma, 1e-9)).max())


def _lens_agreement(joint: JointResult, alone: Sequence[Floats]) -> tuple[float, ...]:
    """Greatest difference of each given lens from what this capture says of it, over its sigma: focal length or centre.

    The rig is solved again with the lenses free, under a prior on the focal length that is too weak to matter where
    the views tell anything of it.
    """
    state = joint.solution.state
    measured = np.array([[0.5, 0.5, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])  # the mean focal length, cx and cy
    free = lens_freedom(state.cameras, poses_free=tuple(joint.freedom.poses.tolist()))
    means, information = [], []
    for camera, mean, weight in zip(state.cameras, free.prior_mean, free.prior_information, strict=True):
        weak = np.zeros(len(mean))
        weak[:2] = (_WEAK_FOCAL * camera.params[:2]) ** -2.0
        means.append(np.where(weak > 0, camera.params, mean))
        information.append(weight + np.diag(weak))
    free = replace(free, prior_mean=tuple(means), prior_information=tuple(information), bow=joint.freedom.bow)
    solution = solve(joint.observations, state, free, SolveOptions(sigma_px=max(joint.solution.sigma_px, 0.01)))
    found = []
    for index, (given, said) in enumerate(zip(state.cameras, solution.state.cameras, strict=True)):
        gap = measured @ (said.params - given.params)[:4]
        covariance = solution.camera_covariance(index, range(POSE, POSE + 4)) + alone[index][:4, :4]
        found.append(float((np.abs(gap) / np.sqrt(np.diag(measured @ covariance @ measured.T))).max()))
    return tuple(found)
