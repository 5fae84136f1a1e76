"""How sure the rig is: the covariance of every pose and lens, lenses that were held included.

A solve that holds a lens takes it as exact, and its covariance leaves out that it is not. With ``x`` what was free and
``h`` the coefficients that were held, a change ``dh`` moves the solution by ``K dh``, ``K = -S_xx^-1 S_xh`` in blocks
of the normal equations (the consider covariance of Schmidt; Bierman, Factorization Methods for Discrete Sequential
Estimation, 1977, chapter VIII). With ``P`` the covariance of the lenses where they were calibrated, the covariance of
``x`` grows by ``K P K^T``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from rigcal.bundle import POSE, SolveOptions, solve
from rigcal.geometry import Floats, Pose, freeze
from rigcal.refine import JointResult

_STIFF = 1e6  # information of a held lens over its own, so that one step of the solver does not move it


@dataclass(frozen=True, slots=True, eq=False)
class RigCovariance:
    """Covariance of the rig's unknowns, noise and inflation as estimated."""

    index: tuple[tuple[int, int], ...]
    """(D) (camera, unknown) of each row: unknowns 0-5 are the pose, 6 and up the coefficients."""
    matrix: Floats
    """(D, D)."""

    def __post_init__(self) -> None:
        freeze(self, np.float64, matrix=(len(self.index), len(self.index)))

    def of(self, wanted: Sequence[tuple[int, int]]) -> Floats:
        """(n, n) covariance of (camera, unknown) pairs; zeros for what is exact, as the reference's pose."""
        where = {key: row for row, key in enumerate(self.index)}
        rows = np.array([where.get(key, -1) for key in wanted], dtype=np.int64)
        known = rows >= 0
        result = np.zeros((len(rows), len(rows)))
        result[np.ix_(known, known)] = self.matrix[np.ix_(rows[known], rows[known])]
        return result

    def of_pose(self, camera: int) -> Floats:
        """(6, 6) of ``cam_from_rig``, rotation (rad) then translation (m)."""
        return self.of([(camera, unknown) for unknown in range(POSE)])


def rig_covariance(joint: JointResult, alone: Sequence[Floats]) -> RigCovariance:
    """The covariance of a solved rig.

    Args:
        joint: The solved rig.
        alone: Per camera (P, P) covariance of its lens where it was calibrated: used where the joint solve held it.
    """
    solution = joint.solution
    index = list(solution.index)
    covariance = solution.joint_covariance(index)
    held = [c for c, free in enumerate(joint.freedom.params) if not free.any() and alone[c].any()]
    if not held:
        return RigCovariance(tuple(index), covariance)
    lens_index = [(c, POSE + p) for c in held for p in range(len(alone[c]))]
    P = block_diag(*(alone[c] for c in held))
    K = _moved_by_lenses(joint, held, alone, index, lens_index)
    return RigCovariance((*index, *lens_index), np.block([[covariance + K @ P @ K.T, K @ P], [(K @ P).T, P]]))


def _moved_by_lenses(
    joint: JointResult,
    held: Sequence[int],
    alone: Sequence[Floats],
    index: Sequence[tuple[int, int]],
    lens_index: Sequence[tuple[int, int]],
) -> Floats:
    """``K``, from the covariance of a solve in which the held lenses are free too: ``C_xh C_hh^-1``."""
    state = joint.solution.state
    means = list(joint.freedom.prior_mean or (camera.params for camera in state.cameras))
    information = list(joint.freedom.prior_information or (np.zeros((len(p), len(p))) for p in means))
    params = list(joint.freedom.params)
    for c in held:
        means[c], information[c] = state.cameras[c].params, np.diag(_STIFF / np.diag(alone[c]).clip(1e-30))
        params[c] = np.ones(len(means[c]), dtype=bool)
    freedom = replace(
        joint.freedom, params=tuple(params), prior_mean=tuple(means), prior_information=tuple(information)
    )
    options = SolveOptions(sigma_px=max(joint.solution.sigma_px, 0.01), max_iterations=1)
    opened = solve(joint.observations, state, freedom, options)
    both = replace(opened, sigma_px=1.0, inflation=1.0).joint_covariance([*index, *lens_index])
    free, count = slice(len(index)), len(index)
    scale = np.sqrt(np.diag(both)[count:])
    unit = both[count:, count:] / np.outer(scale, scale)
    return np.asarray(np.linalg.solve(unit, (both[free, count:] / scale).T).T / scale)


def centre_by_pose(cam_from_rig: Pose) -> Floats:
    """(3, 6) derivative of a camera's centre in the rig by its pose's perturbation."""
    R, t = cam_from_rig.rotation, cam_from_rig.translation_m
    return np.hstack([-R.T @ cross_matrix(t), -R.T])


def cross_matrix(v: Floats) -> Floats:
    """(3, 3) matrix that crosses ``v`` (3,) with what it multiplies."""
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def camera_distance(
    cam_from_rig: Sequence[Pose], covariance: RigCovariance, first: int, second: int
) -> tuple[float, float]:
    """Metres between the centres (entrance pupils) of two cameras, and one sigma of it."""
    centres = [cam_from_rig[c].inverse().translation_m for c in (first, second)]
    between = centres[1] - centres[0]
    distance = float(np.linalg.norm(between))
    towards = between / max(distance, 1e-12)
    row = np.concatenate(
        [-towards @ centre_by_pose(cam_from_rig[first]), towards @ centre_by_pose(cam_from_rig[second])]
    )
    wanted = [(camera, unknown) for camera in (first, second) for unknown in range(POSE)]
    return distance, float(np.sqrt(max(row @ covariance.of(wanted) @ row, 0.0)))
