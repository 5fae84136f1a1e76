"""Camera poses with their joint covariance, seen from whichever camera one likes.

Which camera's frame a rig is written in is a choice, and so is where its uncertainty vanishes. Two solves of the same
cameras can only be compared from a common camera; that camera must not be one that moved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from rigcal.bundle import POSE
from rigcal.geometry import Floats, Pose, freeze
from rigcal.rigdocument import CovarianceEntry, RigDocument
from rigcal.uncertainty import RigCovariance, cross_matrix


@dataclass(frozen=True, slots=True, eq=False)
class RelativePoses:
    """Poses of several cameras in one frame, and how well they are known together."""

    ids: tuple[str, ...]
    cam_from_frame: tuple[Pose, ...]
    covariance: Floats
    """(6n, 6n) of left perturbations of ``cam_from_frame``; rad and m."""

    def __post_init__(self) -> None:
        freeze(self, np.float64, covariance=(POSE * len(self.ids),) * 2)

    def pose(self, camera_id: str) -> Pose:
        """``cam_from_frame`` of one camera."""
        return self.cam_from_frame[self.ids.index(camera_id)]

    def rows(self, camera_ids: Sequence[str]) -> list[int]:
        """Rows of the covariance that belong to these cameras, in their order."""
        return [POSE * self.ids.index(camera_id) + i for camera_id in camera_ids for i in range(POSE)]

    def of(self, camera_ids: Sequence[str]) -> RelativePoses:
        """Only these cameras, in their order."""
        rows = self.rows(camera_ids)
        return RelativePoses(
            tuple(camera_ids), tuple(self.pose(c) for c in camera_ids), self.covariance[np.ix_(rows, rows)]
        )

    def seen_from(self, anchor: str) -> RelativePoses:
        """The same cameras in the frame of one of them, which then is the identity and has no uncertainty.

        With ``R, t = cam_from_anchor`` a perturbation ``(w, v)`` of the camera and ``(a, b)`` of the anchor perturb it
        by ``(w - R a, v - R b + [R t_anchor] (w - R a))``, ``[x]`` being the matrix of the cross product.
        """
        at = self.ids.index(anchor)
        anchor_from_frame = self.cam_from_frame[at]
        frame_from_anchor = anchor_from_frame.inverse()
        change = np.zeros_like(self.covariance)
        poses = []
        for i, pose in enumerate(self.cam_from_frame):
            relative = pose @ frame_from_anchor if i != at else Pose.identity()
            poses.append(relative)
            if i == at:
                continue
            lever = np.eye(POSE)
            lever[3:, :3] = cross_matrix(relative.rotation @ anchor_from_frame.translation_m)
            turn = np.kron(np.eye(2), relative.rotation)
            own, other = (slice(POSE * k, POSE * k + POSE) for k in (i, at))
            change[own, own], change[own, other] = lever, -lever @ turn
        return RelativePoses(self.ids, tuple(poses), change @ self.covariance @ change.T)


def poses_of(document: RigDocument) -> RelativePoses:
    """The poses of a rig file; cameras that its covariance does not name count as exact."""
    entry = document.covariance
    return _poses(document, entry.matrix if entry else ())


def poses_given_lenses(document: RigDocument) -> RelativePoses | None:
    """The same with the uncertainty that is left if the lenses are exact; None where the rig file does not state it.

    Most of what a rig file does not know of its poses it does not know of its lenses: a principal point trades with a
    rotation. Poses solved later with the same lenses repeat that error, so it is no part of their difference.
    """
    entry = document.covariance
    return _poses(document, entry.given_lenses) if entry and entry.given_lenses is not None else None


def _poses(document: RigDocument, matrix: Sequence[Sequence[float]]) -> RelativePoses:
    ids = document.camera_ids
    covariance = np.zeros((POSE * len(ids),) * 2)
    if document.covariance is not None and len(matrix):
        named = [name.rpartition(".")[0] for name in document.covariance.order[::2]]
        rows = [POSE * ids.index(camera) + i for camera in named for i in range(POSE)]
        covariance[np.ix_(rows, rows)] = matrix
    return RelativePoses(ids, tuple(camera.cam_from_rig.pose for camera in document.cameras), covariance)


def covariance_entry(ids: Sequence[str], covariance: Floats, given_lenses: Floats | None) -> CovarianceEntry | None:
    """The rig file's entry for the cameras beside the reference; None where there are none.

    Args:
        ids: Cameras in rig order, without the reference.
        covariance: (6n, 6n) of their poses.
        given_lenses: (6n, 6n) of their poses if the lenses are exact, where it is known.
    """
    if not ids:
        return None
    return CovarianceEntry(
        order=tuple(f"{camera_id}.{part}" for camera_id in ids for part in ("rotation_rad", "translation_m")),
        matrix=_symmetric(covariance),
        given_lenses=None if given_lenses is None else _symmetric(given_lenses),
    )


def solved_covariance_entry(covariance: RigCovariance, ids: Sequence[str]) -> CovarianceEntry | None:
    """The rig file's entry for a solved rig: of the poses, and of the poses if the lenses are exact."""
    poses = [(camera, unknown) for camera, unknown in covariance.index if camera < len(ids) and unknown < POSE]
    lenses = [key for key in covariance.index if key not in poses]  # and the board's bow
    joint, n = covariance.of([*poses, *lenses]), len(poses)
    by_lenses = times_inverse(joint[:n, n:], joint[n:, n:]) @ joint[n:, :n]
    free = [ids[camera] for camera, unknown in poses if unknown == 0]
    return covariance_entry(free, joint[:n, :n], joint[:n, :n] - by_lenses)


def _symmetric(matrix: Floats) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in ((matrix + matrix.T) / 2).tolist())


def perturbation(new: Pose, old: Pose) -> Floats:
    """(6,) left perturbation that takes the old pose to the new one: rotation vector (rad), translation (m)."""
    turn = Rotation.from_matrix(new.rotation @ old.rotation.T).as_rotvec()
    return np.concatenate([turn, new.translation_m - old.translation_m])


def perturbed(pose: Pose, by: Floats) -> Pose:
    """The pose after a left perturbation (6,), as :func:`perturbation` has it."""
    return pose.perturbed(by[:3], by[3:])


def times_inverse(matrix: Floats, symmetric: Floats) -> Floats:
    """``matrix @ symmetric^-1``, scaled first since units differ; a direction without variance has no weight."""
    scale = 1 / np.sqrt(np.maximum(np.diag(symmetric), np.finfo(np.float64).tiny))
    inverse = np.linalg.pinv(symmetric * scale[:, None] * scale, rcond=1e-12, hermitian=True)
    return np.asarray(((matrix * scale) @ inverse) * scale)
