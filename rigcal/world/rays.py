"""Points in the rig from the pixels at which cameras see them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rigcal.errors import WorldPointError
from rigcal.geometry import Floats
from rigcal.rig import Rig

CLICK_SIGMA_PX = 1.0
"""Noise per axis of a pixel that a person points out, in an image of 1,920 columns; assumed where few say otherwise."""
_OFF_SHARE = 0.01
"""Distance from the other cameras' pixels, as a share of the image's diagonal, from which a pixel is refused."""
_BLIND_M = 0.3
"""Uncertainty along the view from which a point is refused."""
_ITERATIONS = 20
_CHECK_ROWS = (
    "check the rows of {name}: the same spot in each camera, u to the right, v down, in pixels of the images that "
    "calibrated the rig"
)


@dataclass(frozen=True, slots=True, eq=False)
class SeenPoint:
    """A named point where the cameras that see it have it."""

    name: str
    in_rig: Floats
    """(3,) metres."""
    covariance: Floats
    """(3, 3) for :data:`CLICK_SIGMA_PX`, in m^2; the rig's own uncertainty is not in it."""
    rmse_px: float


def triangulate(rig: Rig, name: str, pixels: Mapping[str, Floats], *, where: object) -> SeenPoint:
    """The point with the least reprojection error.

    Args:
        rig: The cameras.
        name: For messages.
        pixels: Per camera identifier (2,) distorted pixels.
        where: The table, for messages.

    Raises:
        WorldPointError: for fewer than two cameras, nearly parallel rays, or pixels that contradict each other.
    """
    if len(pixels) < 2:
        raise WorldPointError(
            f"point {name} is seen by too few cameras",
            where=where,
            expected="its pixel in two or more cameras",
            got=f"{len(pixels)} ({', '.join(pixels) or 'none'})",
            do_next=f"add rows with the pixel of {name} in another camera, or remove the point",
        )
    point = _nearest_to_rays(rig, pixels)
    for _ in range(_ITERATIONS):
        _check_in_front(rig, name, point, pixels, where)
        residuals, J = _linearised(rig, point, pixels)
        step = np.linalg.lstsq(J, residuals, rcond=None)[0]
        point = point + step
        if np.linalg.norm(step) < 1e-12 * max(float(np.linalg.norm(point)), 1.0):
            break
    _check_in_front(rig, name, point, pixels, where)
    residuals, J = _linearised(rig, point, pixels)
    off = np.linalg.norm(residuals.reshape(-1, 2), axis=1)
    limits = np.array([_OFF_SHARE * np.hypot(*rig.camera(camera_id).camera.size_wh) for camera_id in pixels])
    if (off > limits).any():
        raise _contradiction(name, pixels, off, limits, where)
    covariance = np.asarray(CLICK_SIGMA_PX**2 * np.linalg.inv(J.T @ J), dtype=np.float64)
    if (depth_sigma_m := float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))) > _BLIND_M:
        raise WorldPointError(
            f"point {name} cannot be placed: its cameras see it from nearly the same direction",
            where=where,
            expected=f"known within {_BLIND_M:g} m along the view for a pixel's error",
            got=f"{depth_sigma_m:.2f} m from {', '.join(pixels)}",
            do_next=f"add the pixel of {name} in a camera that looks from another side, or choose a nearer point",
        )
    return SeenPoint(name, point, covariance, float(np.sqrt((off**2).mean())))


def _check_in_front(rig: Rig, name: str, point: Floats, pixels: Mapping[str, Floats], where: object) -> None:
    behind = [camera_id for camera_id in pixels if rig.camera(camera_id).cam_from_rig.apply(point)[2] <= 0]
    if behind:
        raise WorldPointError(
            f"the pixels of point {name} do not belong to one place",
            where=where,
            expected="rays that meet in front of the cameras",
            got=f"they meet behind {', '.join(behind)}",
            do_next=_CHECK_ROWS.format(name=name),
        )


def _contradiction(
    name: str, pixels: Mapping[str, Floats], off: Floats, limits: Floats, where: object
) -> WorldPointError:
    return WorldPointError(
        f"the pixels of point {name} do not belong to one place",
        where=where,
        expected=f"every pixel within {limits.min():.0f} px of where the cameras together see the point",
        got=", ".join(f"{camera} {distance:.0f} px off" for camera, distance in zip(pixels, off, strict=True)),
        do_next=_CHECK_ROWS.format(name=name),
    )


def _nearest_to_rays(rig: Rig, pixels: Mapping[str, Floats]) -> Floats:
    """The point nearest to all rays: where the iteration starts."""
    normal, right = 1e-12 * np.eye(3), np.zeros(3)
    for camera_id, pixel in pixels.items():
        camera = rig.camera(camera_id)
        rig_from_cam = camera.cam_from_rig.inverse()
        ray = rig_from_cam.rotation @ camera.camera.rays(pixel)
        across = np.eye(3) - np.outer(ray, ray)
        normal += across
        right += across @ rig_from_cam.translation_m
    return np.asarray(np.linalg.solve(normal, right), dtype=np.float64)


def _linearised(rig: Rig, point: Floats, pixels: Mapping[str, Floats]) -> tuple[Floats, Floats]:
    """Residuals (2n,) in pixels and the derivative (2n, 3) of the projections by the point."""
    residuals, rows = [], []
    for camera_id, pixel in pixels.items():
        camera = rig.camera(camera_id)
        projected, by_point, _ = camera.camera.project_with_jacobians(camera.cam_from_rig.apply(point)[None])
        residuals.append(pixel - projected[0])
        rows.append(by_point[0] @ camera.cam_from_rig.rotation)
    return np.concatenate(residuals), np.concatenate(rows)
