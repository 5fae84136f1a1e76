"""The rig in an upright frame: x to the right, y ahead, z up, in which the plan and the picture in 3D are drawn.

"Up" is the world's z axis where the rig file knows a world. Else it is against the mean "down" axis of the cameras,
which is near the vertical where cameras are mounted upright; the figures say which.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigcal.geometry import Floats
from rigcal.rig import Rig
from rigcal.rigdocument import RigDocument

DEGENERATE = 0.2
"""Length of a mean of unit vectors below which they point in no common direction."""


@dataclass(frozen=True, slots=True, eq=False)
class Upright:
    """The change of frame: ``rows @ point_in_rig + offset_m``."""

    rows: Floats
    """(3, 3) right, ahead and up, as unit vectors in the rig frame."""
    offset_m: Floats
    """(3,)"""
    above: str
    """What "from above" means here, in words."""

    def __call__(self, points_in_rig: Floats) -> Floats:
        """Points (..., 3) of the rig frame in the upright frame, in metres."""
        return np.asarray(points_in_rig @ self.rows.T + self.offset_m)


def upright_frame(rig: Rig) -> Upright:
    """The upright frame of a rig."""
    if rig.world_from_rig is not None:
        above = "along the world's z axis: x to the right, y up the page"
        return Upright(rig.world_from_rig.rotation, rig.world_from_rig.translation_m, above)
    reference = rig.camera(rig.reference)
    down = np.mean([camera.cam_from_rig.rotation[1] for camera in rig.cameras], axis=0)
    above = "along the mean down axis of the cameras, as the vertical is not known"
    if np.linalg.norm(down) < DEGENERATE:
        down = reference.cam_from_rig.rotation[1]
        above = f"along the down axis of {reference.id}, as the vertical is not known and the cameras' down axes differ"
    up = -down / np.linalg.norm(down)
    forwards = (axis - (axis @ up) * up for axis in reference.cam_from_rig.rotation[[2, 1, 0]])
    forward = next(axis for axis in forwards if np.linalg.norm(axis) > DEGENERATE)
    ahead = forward / np.linalg.norm(forward)
    return Upright(np.stack([np.cross(ahead, up), ahead, up]), np.zeros(3), above)


def position_covariances(document: RigDocument, upright: Upright) -> dict[str, Floats]:
    """(3, 3) covariance in m^2 of each camera's position in the upright frame, where the file has one.

    With ``c = -R^T t`` and the left perturbation ``(exp(w) R, t + v)``: ``dc = -R^T [t]x w - R^T v``.
    """
    if document.covariance is None:
        return {}
    matrix, found = np.array(document.covariance.matrix), {}
    ids = [name.rpartition(".")[0] for name in document.covariance.order[::2]]
    poses = {camera.id: camera.cam_from_rig.pose for camera in document.cameras}
    for index, camera_id in enumerate(ids):
        R, t = poses[camera_id].rotation, poses[camera_id].translation_m
        by_pose = upright.rows @ np.hstack([-np.cross(R.T, t), -R.T])
        rows = slice(6 * index, 6 * index + 6)
        found[camera_id] = by_pose @ matrix[rows, rows] @ by_pose.T
    return found


def greatest_sigma_m(covariances: dict[str, Floats]) -> float:
    """The longest half axis of all one-sigma ellipsoids; 0 where there are none."""
    return max((float(np.sqrt(max(np.linalg.eigvalsh(c)[-1], 0.0))) for c in covariances.values()), default=0.0)
