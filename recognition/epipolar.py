"""The rig as matching and triangulation need it: poses, focal lengths and fundamental matrices in arrays.

All pixels here are undistorted: where a lens without distortion but with the same camera matrix would have put
them (:meth:`rigcal.camera.Camera.undistorted_px`). Lines are straight only in them.

Equation 3 of the Safe-Construct paper, ``|p_j^T F p_i| + |p_i^T F p_j|``, is the algebraic residual: it has no unit
and grows with the scale that F happens to have. The distance here is the geometric one, from the point to the
epipolar line in pixels, averaged over the two directions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from recognition.observations import ViewDetections
from rigcal.camera import Camera
from rigcal.geometry import Floats, freeze
from rigcal.rig import Rig

MIN_BASELINE_M = 1e-3
"""Cameras nearer than this have no epipolar geometry worth the name: a pixel at 5 m spans 3 mm (f = 1680 px)."""


@dataclass(frozen=True, slots=True, eq=False)
class RigGeometry:
    """Cameras in rig order with everything that the stages compute from them once; built by :meth:`of`."""

    cameras: tuple[Camera, ...]
    """(V,) intrinsics."""
    rotation: Floats
    """(V, 3, 3) rotations of ``cam_from_rig``."""
    translation_m: Floats
    """(V, 3) translations of ``cam_from_rig``."""
    focal_px: Floats
    """(V, 2) focal lengths fx and fy."""
    fundamental: Floats
    """(V, V, 3, 3): ``fundamental[i, j] @ (x, y, 1)`` is the line in camera j of a pixel of camera i. NaN where i is
    j, or where two cameras stand in one place."""

    def __post_init__(self) -> None:
        count = len(self.cameras)
        freeze(self, np.float64, rotation=(count, 3, 3), translation_m=(count, 3), focal_px=(count, 2))
        freeze(self, np.float64, fundamental=(count, count, 3, 3))

    @classmethod
    def of(cls, rig: Rig) -> RigGeometry:
        """The geometry of a rig."""
        cameras = tuple(entry.camera for entry in rig.cameras)
        rotation = np.array([entry.cam_from_rig.rotation for entry in rig.cameras])
        translation_m = np.array([entry.cam_from_rig.translation_m for entry in rig.cameras])
        return cls(
            cameras=cameras,
            rotation=rotation,
            translation_m=translation_m,
            focal_px=np.array([camera.params[:2] for camera in cameras]),
            fundamental=_fundamental(np.array([c.matrix for c in cameras]), rotation, translation_m),
        )

    def check_views(self, views: Sequence[ViewDetections]) -> None:
        """Refuse another number of views than the rig has cameras.

        Raises:
            ValueError: where the counts differ.
        """
        if len(views) != len(self.cameras):
            raise ValueError(f"views: expected {len(self.cameras)}, one per camera of the rig, got {len(views)}")

    def line_distances_px(self, points_px: ArrayLike, view: ArrayLike) -> Floats:
        """Symmetric distances between the points of every two detections and each other's epipolar lines.

        Half of (distance of p_b from the line of p_a in b's image + the same with a and b exchanged): equation 3
        of the paper in pixels.

        Args:
            points_px: (N, J, 2) undistorted pixels of N detections with J points each; NaN: not seen.
            view: (N,) camera index of each detection.

        Returns:
            (N, N, J) pixels, symmetric in the first two axes; NaN where either point is not seen or both
            detections are of one camera.
        """
        points, cameras = np.asarray(points_px, dtype=np.float64), np.asarray(view, dtype=np.intp)
        homogeneous = np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)
        matrices = self.fundamental[cameras[:, None], cameras[None, :]]
        lines = homogeneous[:, None] @ np.swapaxes(matrices, -1, -2)
        residual = np.abs(np.einsum("abjk,bjk->abj", lines, homogeneous))
        one_way = residual / np.hypot(lines[..., 0], lines[..., 1])
        return np.asarray((one_way + np.swapaxes(one_way, 0, 1)) / 2)


def _fundamental(matrices: Floats, rotation: Floats, translation_m: Floats) -> Floats:
    """Fundamental matrices (V, V, 3, 3) from camera matrices (V, 3, 3) and ``cam_from_rig``."""
    inverse = np.linalg.inv(matrices)
    relative_rotation = rotation[None, :] @ np.swapaxes(rotation, -1, -2)[:, None]  # camJ_from_camI at [i, j]
    relative_m = translation_m[None, :] - np.einsum("ijab,ib->ija", relative_rotation, translation_m)
    cross = np.cross(np.eye(3), relative_m[..., None, :], axis=-1).swapaxes(-1, -2)
    fundamental = np.swapaxes(inverse, -1, -2)[None, :] @ cross @ relative_rotation @ inverse[:, None]
    fundamental[np.linalg.norm(relative_m, axis=-1) < MIN_BASELINE_M] = np.nan
    return np.asarray(fundamental)
