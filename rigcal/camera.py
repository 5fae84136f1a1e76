"""Camera models: from points to pixels and back, with derivatives.

A model is data: a name and an ordered tuple of coefficient names in OpenCV's terms. All share one class. The
arithmetic is OpenCV's own (``cv2.projectPoints`` and ``cv2.fisheye``), so that other tools agree to the last digit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import cv2
import numpy as np
from numpy.typing import ArrayLike

from rigcal.geometry import Floats, freeze

FOCAL_AND_CENTRE = ("fx", "fy", "cx", "cy")
MODELS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "opencv4": (*FOCAL_AND_CENTRE, "k1", "k2", "p1", "p2"),
        "opencv5": (*FOCAL_AND_CENTRE, "k1", "k2", "p1", "p2", "k3"),
        "opencv8": (*FOCAL_AND_CENTRE, "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
        "fisheye4": (*FOCAL_AND_CENTRE, "k1", "k2", "k3", "k4"),
    }
)
"""Coefficient names of each lens model, in the order of :attr:`Camera.params`."""

_UNDISTORT = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-12)


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """The intrinsics of one camera.

    Raises:
        ValueError: for an unknown model, a wrong number of parameters, a value that is not finite, or a focal
            length that is not positive.
    """

    model: str
    """One of :data:`MODELS`."""
    size_wh: tuple[int, int]
    """Image width and height in pixels."""
    params: Floats
    """(P,) coefficients in the order of ``MODELS[model]``; fx, fy, cx, cy in pixels."""

    def __post_init__(self) -> None:
        if self.model not in MODELS:
            raise ValueError(f"unknown lens model {self.model!r}: one of {', '.join(MODELS)}")
        freeze(self, np.float64, params=(len(MODELS[self.model]),))
        if not np.isfinite(self.params).all() or self.params[0] <= 0 or self.params[1] <= 0:
            raise ValueError(f"lens coefficients must be finite and focal lengths positive: {self.params.tolist()}")
        object.__setattr__(self, "size_wh", (int(self.size_wh[0]), int(self.size_wh[1])))

    @classmethod
    def from_matrix(cls, model: str, size_wh: tuple[int, int], matrix: ArrayLike, distortion: ArrayLike) -> Camera:
        """From OpenCV's camera matrix (3, 3) and distortion vector; missing trailing coefficients are 0."""
        K, given = np.asarray(matrix, dtype=np.float64), np.ravel(np.asarray(distortion, dtype=np.float64))
        full = np.zeros(len(MODELS[model]) - 4)
        if np.any(given[full.size :]):
            raise ValueError(f"{model} has {full.size} distortion coefficients, got {given.size}")
        full[: min(given.size, full.size)] = given[: full.size]
        return cls(model, size_wh, np.concatenate([[K[0, 0], K[1, 1], K[0, 2], K[1, 2]], full]))

    @property
    def names(self) -> tuple[str, ...]:
        """Coefficient names, in the order of ``params``."""
        return MODELS[self.model]

    @property
    def is_fisheye(self) -> bool:
        """Whether the lens follows the equidistant model of Kannala and Brandt."""
        return self.model == "fisheye4"

    @property
    def matrix(self) -> Floats:
        """(3, 3) camera matrix K."""
        fx, fy, cx, cy = self.params[:4]
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def distortion(self) -> Floats:
        """(D,) distortion coefficients in OpenCV's order."""
        return self.params[4:].copy()

    @property
    def coefficients(self) -> dict[str, float]:
        """Coefficients by name."""
        return dict(zip(self.names, self.params.tolist(), strict=True))

    def with_params(self, params: ArrayLike) -> Camera:
        """The same camera with other coefficients (P,)."""
        return Camera(self.model, self.size_wh, np.asarray(params, dtype=np.float64))

    def project(self, points_in_cam: ArrayLike) -> Floats:
        """Pixels (..., 2) of points (..., 3) in metres; NaN for points that are NaN or not in front (z <= 0).

        A fisheye lens may see points beside and behind it; its equidistant model has z > 0 only in OpenCV's
        arithmetic, so the same rule holds.
        """
        points = np.asarray(points_in_cam, dtype=np.float64)
        flat = points.reshape(-1, 3)
        seen = np.isfinite(flat).all(axis=1) & (np.nan_to_num(flat[:, 2], nan=-1.0) > 0)
        pixels = np.full((len(flat), 2), np.nan)
        if seen.any():
            pixels[seen] = self._project(flat[seen])[0]
        return pixels.reshape(*points.shape[:-1], 2)

    def project_with_jacobians(self, points_in_cam: Floats) -> tuple[Floats, Floats, Floats]:
        """Pixels (N, 2) of points (N, 3) in front of the camera, with derivatives.

        Returns:
            pixels (N, 2); d pixel / d point (N, 2, 3) in px/m; d pixel / d params (N, 2, P).
        """
        pixels, jacobian = self._project(points_in_cam)
        rows = jacobian.reshape(len(points_in_cam), 2, -1)
        if self.is_fisheye:  # columns: f(2) c(2) k(4) rotation(3) translation(3) alpha
            return pixels, rows[:, :, 11:14], rows[:, :, :8]
        count = len(self.params)  # columns: rotation(3) translation(3) f(2) c(2) distortion
        return pixels, rows[:, :, 3:6], rows[:, :, 6 : 6 + count]

    def _project(self, points: Floats) -> tuple[Floats, Floats]:
        zero = np.zeros(3)
        flat = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 1, 3)
        if self.is_fisheye:
            pixels, jacobian = cv2.fisheye.projectPoints(flat, zero, zero, self.matrix, self.distortion)
        else:
            pixels, jacobian = cv2.projectPoints(flat, zero, zero, self.matrix, self.distortion)
        return np.asarray(pixels, dtype=np.float64).reshape(-1, 2), np.asarray(jacobian, dtype=np.float64)

    def undistort(self, pixels: ArrayLike) -> Floats:
        """Normalised coordinates x/z, y/z (..., 2) of pixels (..., 2): the lens model inverted; NaN stays NaN."""
        px = np.asarray(pixels, dtype=np.float64)
        flat = px.reshape(-1, 2)
        known = np.isfinite(flat).all(axis=1)
        xy = np.full(flat.shape, np.nan)
        if known.any():
            source = np.ascontiguousarray(flat[known]).reshape(-1, 1, 2)
            if self.is_fisheye:
                found = cv2.fisheye.undistortPoints(source, self.matrix, self.distortion, criteria=_UNDISTORT)
            else:
                found = cv2.undistortPoints(source, self.matrix, self.distortion, criteria=_UNDISTORT)
            xy[known] = np.asarray(found, dtype=np.float64).reshape(-1, 2)
        return xy.reshape(px.shape)

    def undistorted_px(self, pixels: ArrayLike) -> Floats:
        """Pixels (..., 2) that a lens without distortion but the same matrix would give."""
        return self.undistort(pixels) * self.params[:2] + self.params[2:4]

    def rays(self, pixels: ArrayLike) -> Floats:
        """Unit directions (..., 3) in the camera frame of pixels (..., 2)."""
        xy = self.undistort(pixels)
        directions = np.concatenate([xy, np.ones((*xy.shape[:-1], 1))], axis=-1)
        return np.asarray(directions / np.linalg.norm(directions, axis=-1, keepdims=True))
