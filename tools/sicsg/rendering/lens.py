"""The lens: pinhole pictures turned into what a camera with distortion sees."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline
from scipy.spatial.transform import Rotation

from rigcal.camera import MODELS, Camera
from tools.sicsg.mesh import View
from tools.sicsg.scene import SceneCamera

Floats = NDArray[np.float64]

_STEP_PX = 16
"""The lens is inverted on a grid of this pitch with a spline laid through: within 3e-5 px of inverting it for every
pixel (k1 = -0.25, k2 = 0.08 at 1920x1080), in 0.05 s of CPU instead of 1.2 s."""
_MARGIN_PX = 2
_WIDEST = 3.0
"""Of x/z and y/z that a pinhole picture can hold with sense: 143 degrees."""


def camera_of(camera: SceneCamera) -> Camera:
    """Its lens.

    Raises:
        ValueError: for an unknown model or coefficients that are not the model's.
    """
    names = MODELS.get(camera.model, ())
    if set(names) != set(camera.coefficients):
        raise ValueError(
            f"camera {camera.id}: lens model {camera.model!r} has the coefficients {', '.join(names) or '(unknown)'}, "
            f"got {', '.join(camera.coefficients)}; correct the scene file"
        )
    return Camera(camera.model, camera.size_wh, np.array([camera.coefficients[name] for name in names]))


class LensMap:
    """From pictures of a pinhole camera, wide enough to cover what the lens sees, to the distorted picture.

    Args:
        camera: the camera.

    Raises:
        ValueError: when a pixel's ray leaves the camera too obliquely for a pinhole picture, or cannot be found.
    """

    def __init__(self, camera: SceneCamera) -> None:
        lens = camera_of(camera)
        rays = _rays(lens)
        if not np.isfinite(rays).all() or np.abs(rays).max() > _WIDEST:
            raise ValueError(
                f"camera {camera.id}: the lens sees rays beyond {_WIDEST:g} in x/z or y/z, or cannot be inverted "
                f"({lens.coefficients}); choose a longer focal length or less distortion"
            )
        focal = lens.params[:2]
        low = np.floor(rays.min(axis=(0, 1)) * focal) - _MARGIN_PX
        high = np.ceil(rays.max(axis=(0, 1)) * focal) + _MARGIN_PX
        width, height = (high - low + 1).astype(int).tolist()
        matrix = np.array([[focal[0], 0.0, -low[0]], [0.0, focal[1], -low[1]], [0.0, 0.0, 1.0]])
        cam_from_world = np.eye(4)
        cam_from_world[:3, :3] = Rotation.from_quat(np.array(camera.quat_wxyz)[[1, 2, 3, 0]]).as_matrix()
        cam_from_world[:3, 3] = camera.translation_m
        self.view = View((width, height), matrix, cam_from_world)
        """The pinhole camera to render: as sharp as the lens at its centre, and with all that it sees."""
        self._map = (rays * focal - low).astype(np.float32)
        nearest = np.round(self._map).astype(np.int64)
        self._nearest = nearest[..., 1] * width + nearest[..., 0]

    def distort(self, image: NDArray[np.float32]) -> NDArray[np.float32]:
        """What the lens makes of the view's picture (H', W', ...): (H, W, ...), interpolated linearly."""
        source = self._checked(image)
        return np.asarray(cv2.remap(source, self._map, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))

    def distort_nearest(self, image: NDArray[np.generic]) -> NDArray[np.generic]:
        """Likewise without mixing pixels: for ids (H', W') and depths."""
        flat = self._checked(image)
        return flat.reshape(-1, *flat.shape[2:])[self._nearest]

    def _checked(self, image: NDArray[np.generic]) -> NDArray[np.generic]:
        width, height = self.view.size_wh
        if image.shape[:2] != (height, width):
            raise ValueError(
                f"lens: a picture of {width}x{height} pixels is expected, as LensMap.view has it; "
                f"got {image.shape[1]}x{image.shape[0]}"
            )
        return image


def _rays(lens: Camera) -> Floats:
    """(H, W, 2) x/z and y/z of every pixel."""
    width, height = lens.size_wh
    columns = np.arange(-_STEP_PX, width + 2 * _STEP_PX, _STEP_PX, dtype=np.float64)
    rows = np.arange(-_STEP_PX, height + 2 * _STEP_PX, _STEP_PX, dtype=np.float64)
    grid = lens.undistort(np.stack(np.meshgrid(columns, rows), axis=-1))
    if not np.isfinite(grid).all():
        return grid
    dense = [
        RectBivariateSpline(rows, columns, grid[..., axis])(np.arange(height), np.arange(width)) for axis in (0, 1)
    ]
    return np.stack(dense, axis=-1)
