"""Camera poses with their joint covariance, seen from whichever camera one likes.

Which camera's frame a rig is written in is a choice, and so is where its uncertainty vanishes. Two solves of the same
cameras can only be compared from a common camera; that camera must not be one that moved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from rigcal.geometry import Floats, Pose, freeze
from rigcal.rigdocument import CovarianceEntry, RigDocument

POSE = 6
"""Unknowns of a pose: rotation (3, rad), then translation (3, m), see :mod:`rigcal.geometry`."""


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
    ids = document.camera_ids
    covariance = np.zeros((POSE * len(ids),) * 2)
    if document.covariance is not None and document.covariance.order:
        named = [name.rpartition(".")[0] for name in document.covariance.order[::2]]
        rows = [POSE * ids.index(camera) + i for camera in named for i in range(POSE)]
        covariance[np.ix_(rows, rows)] = document.covariance.matrix
    return RelativePoses(ids, tuple(camera.cam_from_rig.pose for camera in document.cameras), covariance)


def covariance_entry(poses: RelativePoses, reference: str) -> CovarianceEntry | None:
    """The rig file's entry for poses seen from its reference camera; None for a rig of one camera."""
    free = [camera_id for camera_id in poses.ids if camera_id != reference]
    if not free:
        return None
    matrix = poses.of(free).covariance
    symmetric = (matrix + matrix.T) / 2
    return CovarianceEntry(
        order=tuple(f"{camera_id}.{part}" for camera_id in free for part in ("rotation_rad", "translation_m")),
        matrix=tuple(tuple(row) for row in symmetric.tolist()),
    )


def perturbation(new: Pose, old: Pose) -> Floats:
    """(6,) left perturbation that takes the old pose to the new one: rotation vector (rad), translation (m)."""
    turn = Rotation.from_matrix(new.rotation @ old.rotation.T).as_rotvec()
    return np.concatenate([turn, new.translation_m - old.translation_m])


def perturbed(pose: Pose, by: Floats) -> Pose:
    """The pose after a left perturbation (6,), as :func:`perturbation` has it."""
    return pose.perturbed(by[:3], by[3:])


def centre_by_pose(cam_from_frame: Pose) -> Floats:
    """(3, 6) derivative of a camera's centre in the frame by a left perturbation of its pose."""
    turned = cam_from_frame.rotation.T
    return np.hstack([-turned @ cross_matrix(cam_from_frame.translation_m), -turned])


def cross_matrix(v: Floats) -> Floats:
    """(3, 3) matrix of the cross product with ``v`` (3,)."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
