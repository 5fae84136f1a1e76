"""How far cameras moved against others that are taken to have stayed, with the uncertainty of it.

Two measurements of the same poses are compared: those of the rig file, with its covariance, and those of the new views,
with theirs. In the frame of a camera that stayed, let ``g`` be the perturbations that take the old poses to the new
ones. With the cameras ``U`` that stayed held where the rig file has them, the others ``M`` are, by the new views, at
``d_M = g_M - B g_U``, ``B = C_MU C_UU^-1`` and ``C`` the covariance of the new views (conditioning of a Gaussian). The
covariance of ``d_M`` is that of the new views given ``U``, and what the rig file does not know of ``M`` and ``U``:
``C_MM - B C_UM + [I, -B] P [I, -B]^T``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigcal.bundle import POSE
from rigcal.camera import Camera
from rigcal.geometry import Floats, Pose
from rigcal.relative import RelativePoses, perturbation, perturbed, poses_given_lenses, poses_of, times_inverse
from rigcal.rigdocument import RigDocument
from rigcal.uncertainty import centre_by_pose, cross_matrix


@dataclass(frozen=True, slots=True)
class Movement:
    """How far one camera moved, each figure with one sigma."""

    shift_px: float
    """Root-mean-square shift of the board corners that it saw in its image."""
    shift_sigma_px: float
    rotation_deg: float
    rotation_sigma_deg: float
    translation_m: float
    """Of its centre."""
    translation_sigma_m: float
    sigmas: float
    """The movement over its uncertainty, as root mean square over the six degrees of freedom: about 1 for none."""


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """Some cameras of a rig placed by new views, the others held where the rig file has them."""

    poses: RelativePoses
    """Every camera of the rig, in the frame of one that was held; covariance as of the new file."""
    old: RelativePoses
    """The rig file's poses in the same frame."""
    moved_ids: tuple[str, ...]
    """Cameras that were placed."""
    gap: Floats
    """(6m,) perturbations that take their old poses to the new ones."""
    gap_covariance: Floats
    """(6m, 6m) of ``gap``."""

    def movement(self, camera_id: str, lens: Camera, points_in_frame: Floats) -> Movement:
        """Of one placed camera; ``points_in_frame`` (n, 3): corners that it saw, in the frame of ``poses``."""
        at = slice(POSE * self.moved_ids.index(camera_id), POSE * self.moved_ids.index(camera_id) + POSE)
        return movement_between(
            self.poses.pose(camera_id),
            self.old.pose(camera_id),
            self.gap[at],
            self.gap_covariance[at, at],
            lens,
            points_in_frame,
        )


def comparable_poses(document: RigDocument, new: RelativePoses) -> RelativePoses:
    """The rig file's poses as new ones are compared with them: lenses taken as exact, since both used the same.

    Where the rig file does not state that uncertainty (another tool's, or an old file), its poses count as no better
    known than the new ones.
    """
    known = poses_given_lenses(document)
    if known is not None:
        return known
    poses = poses_of(document)
    covariance = np.zeros_like(poses.covariance)
    rows = poses.rows(new.ids)
    covariance[np.ix_(rows, rows)] = new.covariance
    return RelativePoses(poses.ids, poses.cam_from_frame, covariance)


def place_cameras(new: RelativePoses, old: RelativePoses, held: Sequence[str], placed: Sequence[str]) -> Placement:
    """Place cameras by the new views with others held.

    Args:
        new: What the new views say of some cameras, ``held`` and ``placed`` among them.
        old: What the rig file says of all cameras.
        held: Cameras that stayed, at least one.
        placed: Cameras to be placed.
    """
    anchor, stayed = held[0], list(held[1:])
    seen, stood = new.of([*held, *placed]).seen_from(anchor), old.seen_from(anchor)
    U, M = seen.rows(stayed), seen.rows(placed)
    C = seen.covariance
    B = times_inverse(C[np.ix_(M, U)], C[np.ix_(U, U)])
    gap = _gaps(seen, stood, placed) - B @ _gaps(seen, stood, stayed)
    noise = C[np.ix_(M, M)] - B @ C[np.ix_(U, M)]
    by_old = np.zeros((len(M), len(stood.covariance)))  # of the placed poses by the rig file's
    by_old[:, stood.rows(stayed)] = B
    to_new = np.eye(len(stood.covariance))
    to_new[stood.rows(placed)] = by_old
    covariance = to_new @ stood.covariance @ to_new.T
    covariance[np.ix_(stood.rows(placed), stood.rows(placed))] += noise
    by_gap = by_old - np.eye(len(stood.covariance))[stood.rows(placed)]
    gap_of = dict(zip(placed, gap.reshape(-1, POSE), strict=True))
    poses = tuple(
        perturbed(pose, gap_of[camera_id]) if camera_id in gap_of else pose
        for camera_id, pose in zip(stood.ids, stood.cam_from_frame, strict=True)
    )
    return Placement(
        RelativePoses(stood.ids, poses, covariance),
        stood,
        tuple(placed),
        gap,
        noise + by_gap @ stood.covariance @ by_gap.T,
    )


def misfit(new: RelativePoses, old: RelativePoses, held: Sequence[str]) -> float:
    """Squared Mahalanobis distance of cameras taken to have stayed; 6 per camera beyond the first where they did."""
    anchor, others = held[0], list(held[1:])
    seen, stood = new.of(held).seen_from(anchor), old.of(held).seen_from(anchor)
    rows = seen.rows(others)
    gap = _gaps(seen, stood, others)
    covariance = (seen.covariance + stood.covariance)[np.ix_(rows, rows)]
    return float(times_inverse(gap[None], covariance)[0] @ gap) if others else 0.0


def movement_between(
    new: Pose, old: Pose, gap: Floats, covariance: Floats, lens: Camera, points_in_frame: Floats
) -> Movement:
    """The figures of a perturbation ``gap`` (6,) with its covariance (6, 6), that takes the old pose to the new one.

    Pixels are those of the projection linearised at the new pose, from which the points were seen: a camera that moved
    far would have had them outside its image, where no lens model holds.
    """
    in_cam = new.apply(points_in_frame)
    _, by_point, _ = lens.project_with_jacobians(in_cam)
    shift = np.einsum("nij,nj->ni", by_point, in_cam - old.apply(points_in_frame))
    turned = points_in_frame @ new.rotation.T
    by_pose = np.stack([np.hstack([-J @ cross_matrix(p), J]) for J, p in zip(by_point, turned, strict=True)])
    spread = np.einsum("nij,jk,nik->n", by_pose, covariance, by_pose)
    by_centre = centre_by_pose(new)
    moved_m = new.inverse().translation_m - old.inverse().translation_m
    return Movement(
        float(np.sqrt((shift**2).sum(axis=1).mean())),
        float(np.sqrt(spread.mean())),
        float(np.rad2deg(np.linalg.norm(gap[:3]))),
        float(np.rad2deg(np.sqrt(np.trace(covariance[:3, :3])))),
        float(np.linalg.norm(moved_m)),
        float(np.sqrt(np.trace(by_centre @ covariance @ by_centre.T))),
        float(np.sqrt(times_inverse(gap[None], covariance)[0] @ gap / POSE)),
    )


def _gaps(new: RelativePoses, old: RelativePoses, camera_ids: Sequence[str]) -> Floats:
    """(6n,) perturbations of these cameras."""
    rows = [perturbation(new.pose(camera_id), old.pose(camera_id)) for camera_id in camera_ids]
    return np.concatenate([*rows, np.zeros(0)])
