"""Epipolar errors of undistorted pixels in two cameras of a known rig."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import Floats
from rigcal.rig import RigCamera


def projection(member: RigCamera) -> Floats:
    """(3, 4) from metres in the rig frame to the pixels that a lens without distortion would give."""
    pose = member.cam_from_rig
    return np.asarray(member.camera.matrix @ np.column_stack([pose.rotation, pose.translation_m]))


def fundamental(first: Floats, second: Floats) -> Floats:
    """(3, 3) ``F`` with ``second^T F first = 0`` from two projections (3, 4) (Hartley and Zisserman, equation 9.1)."""
    across = second[:, :3] @ np.linalg.inv(first[:, :3])
    epipole = second[:, 3] - across @ first[:, 3]
    return np.asarray(np.cross(epipole, np.eye(3)).T @ across)


def sampson_px(first: NDArray[Any], second: NDArray[Any], matrix: Floats) -> Floats:
    """(...) signed first-order distance of matches (..., 2) from the constraint (Hartley and Zisserman, eq. 11.9)."""
    line = first @ matrix[:, :2].T + matrix[:, 2]
    back = second @ matrix[:2, :2] + matrix[2, :2]
    algebraic = (second * line[..., :2]).sum(axis=-1) + line[..., 2]
    return np.asarray(algebraic / np.sqrt((line[..., :2] ** 2).sum(axis=-1) + (back**2).sum(axis=-1)))
