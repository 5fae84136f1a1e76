"""What a camera sees, as rays from it: along its middle row, and around the border of its image."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from rigcal.camera import Camera
from rigcal.geometry import Floats

INVERTED_PX = 0.5
"""Distance from its pixel at which a ray's projection shows that the lens model was not inverted there."""
MIDDLE_ROW_SAMPLES = 13
"""Rays of a wedge: its far side looks round."""
SIDE_SAMPLES = 5
"""Rays along each side of an image: the border of a wide lens looks round."""


def horizontal_fov_deg(camera: Camera) -> float:
    """Angle that the image's middle row spans, edge to edge."""
    rays = middle_row_rays(camera)
    sines, cosines = np.linalg.norm(np.cross(rays[:-1], rays[1:]), axis=1), (rays[:-1] * rays[1:]).sum(axis=1)
    return float(np.rad2deg(np.arctan2(sines, cosines).sum()))


def middle_row_rays(camera: Camera) -> Floats:
    """(n, 3) unit rays in the camera frame of pixels along the middle row, edge to edge."""
    width, height = camera.size_wh
    columns = np.linspace(-0.5, width - 0.5, MIDDLE_ROW_SAMPLES)
    return _rays(camera, np.stack([columns, np.full_like(columns, (height - 1) / 2)], axis=1))


def border_rays(camera: Camera) -> Floats:
    """(4 n, 3) unit rays in the camera frame of pixels around the image; every n-th is that of a corner."""
    along = np.linspace(0, 1, SIDE_SAMPLES)[:-1, None]
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]])
    sides = [one + along * (two - one) for one, two in pairwise(corners)]
    return _rays(camera, np.concatenate(sides) * camera.size_wh - 0.5)


def _rays(camera: Camera, pixels: Floats) -> Floats:
    """Where the lens model cannot be inverted, the ray is that of the same lens without distortion.

    (Its polynomial turns back before the edge, or the ray lies beside the camera.)
    """
    rays = camera.rays(pixels)
    gap_px = np.linalg.norm(camera.project(rays) - pixels, axis=1)
    inverted = np.nan_to_num(gap_px, nan=np.inf) < INVERTED_PX
    return np.where(inverted[:, None], rays, _undistorted_rays(camera, pixels))


def _undistorted_rays(camera: Camera, pixels: Floats) -> Floats:
    xy = (pixels - camera.params[2:4]) / camera.params[:2]
    if camera.is_fisheye:  # equidistant: the distance from the centre is the angle
        angle = np.linalg.norm(xy, axis=1, keepdims=True)
        return np.concatenate([xy * np.sinc(angle / np.pi), np.cos(angle)], axis=1)
    rays = np.concatenate([xy, np.ones((len(xy), 1))], axis=1)
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))
