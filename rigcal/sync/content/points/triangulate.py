"""Points from several undistorted views at once, and what a view's pixels say beyond where the point is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigcal.geometry import Floats

_NEAREST_M = 0.05
_RIDGE = 1e-9  # of the mean curvature: rays that are parallel leave a point undetermined, not the arithmetic


@dataclass(frozen=True, slots=True, eq=False)
class Triangulated:
    """N points seen by M cameras, each near its least-squares place."""

    points_in_rig: Floats
    """(N, 3) metres."""
    residual_px: Floats
    """(N, M, 2) observed minus projected; 0 where not seen."""
    weight: Floats
    """(N, M) of each view; 0 where not seen."""
    px_from_point: Floats
    """(N, M, 2, 3) derivative of the projection, in px/m; 0 where not seen."""
    covariance: Floats
    """(N, 3, 3) inverse of each point's normal matrix."""


def triangulate(px: Floats, px_from_rig: Floats, weight: Floats, start: Floats | None = None) -> Triangulated:
    """Place every point that two cameras see: the linear solution or a start, and one Gauss-Newton step.

    Args:
        px: (N, M, 2) undistorted pixels, NaN where not seen.
        px_from_rig: (M, 3, 4) projections.
        weight: (N, M) relative weights of the views.
        start: (N, 3) places to start from.

    Returns:
        Points that fewer than two cameras see, or that come to lie behind one of them, have weights of 0.
    """
    seen = np.isfinite(px).all(axis=-1)
    weight = np.where(seen & (seen.sum(axis=1, keepdims=True) > 1), weight, 0.0)
    known = np.where(weight[..., None] > 0, px, 0.0)
    points = _linear(known, px_from_rig, weight) if start is None else start
    residual, slope, weight = _project(points, known, px_from_rig, weight)
    points = points + _place(slope, weight, residual, _covariance(slope, weight))
    residual, slope, weight = _project(points, known, px_from_rig, weight)
    return Triangulated(points, residual, weight, slope, _covariance(slope, weight))


def _linear(px: Floats, px_from_rig: Floats, weight: Floats) -> Floats:
    """(N, 3) points of least algebraic error (Hartley and Zisserman, section 12.2, inhomogeneous)."""
    rows = px[..., None] * px_from_rig[:, 2:] - px_from_rig[:, :2]
    return -_place(rows[..., :3], weight, rows[..., 3], _covariance(rows[..., :3], weight))


def _project(points: Floats, px: Floats, px_from_rig: Floats, weight: Floats) -> tuple[Floats, Floats, Floats]:
    """Residuals and derivatives of the projections, and the weights without points that lie behind a camera."""
    in_camera = points @ np.swapaxes(px_from_rig[..., :3], 1, 2) + px_from_rig[:, None, :, 3]  # (M, N, 3)
    in_camera = np.swapaxes(in_camera, 0, 1)
    behind = ((in_camera[..., 2] < _NEAREST_M) & (weight > 0)).any(axis=1, keepdims=True)
    weight = np.where(behind, 0.0, weight)
    depth = np.maximum(in_camera[..., 2:], _NEAREST_M)
    projected = in_camera[..., :2] / depth
    used = weight[..., None] > 0
    slope = (px_from_rig[:, :2, :3] - projected[..., None] * px_from_rig[:, 2:, :3]) / depth[..., None]
    return np.where(used, px - projected, 0.0), np.where(used[..., None], slope, 0.0), weight


def _covariance(slope: Floats, weight: Floats) -> Floats:
    """(N, 3, 3) inverse of the normal matrix of (N, M, 2, 3) rows, with enough on its diagonal to have one."""
    rows = slope.reshape(len(slope), -1, 3)
    normal = np.swapaxes(rows * np.repeat(weight, 2, axis=1)[..., None], 1, 2) @ rows
    ridge = _RIDGE * np.trace(normal, axis1=1, axis2=2) + 1e-12
    return np.asarray(np.linalg.inv(normal + ridge[:, None, None] * np.eye(3)))


def _place(slope: Floats, weight: Floats, residual: Floats, covariance: Floats) -> Floats:
    """(N, 3) least-squares solution of the rows for their right sides (N, M, 2)."""
    rows = slope.reshape(len(slope), -1, 3)
    right = (residual * weight[..., None]).reshape(len(slope), 1, -1) @ rows
    return np.asarray((right @ covariance)[:, 0])
