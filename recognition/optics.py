"""The rig as numbers that the tracked method computes once: lenses, projections and normal equations.

An instant has a few hundred observations, for which the calls to NumPy cost more than the arithmetic. Points are
therefore projected into all views by one matrix product, and the normal equations of all points come from another.

The linear equations of a point X seen at ``(x, y)`` by a camera ``[R | t]`` with rows ``R0 R1 R2`` are
``(R0 - x R2) X = x t2 - t0`` and ``(R1 - y R2) X = y t2 - t1`` (direct linear transform). Their 3x3 normal matrix
and right-hand side are linear in ``(1, x, y, x^2 + y^2)``, with coefficients of the camera alone:
:attr:`Optics.normal_basis`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from math import sqrt

import cv2
import numpy as np

from rigcal.camera import Camera
from rigcal.geometry import Bools, Floats, Ints, freeze
from rigcal.rig import ClockModel, Rig

NEAREST_M = 0.1
"""Depths below this are taken as this; nothing is observed there."""
POINTS_AT_ONCE = 16_000
"""As many are compared in one go, so that an array of them stays below 128 KiB, above which the C library may ask the
system for fresh memory every time: 20 workers before 16 cameras then claim their detections in 1.4 ms, else in 1.4 to
7 (CPU time)."""
MIN_PARALLAX_RAD = 0.05
"""Two rays that meet at a smaller angle (2.9 degrees) place nothing: along them an error is 20 times as large."""
ITERATIONS = (5, 10, 20, 40, 100)
"""Of the inverse of a lens model, of which the fewest are taken that are exact."""
EPOCH_S = 1e9
"""Rig times below this (2001) count from the start of a capture, not from the epoch."""
EXACT_PX = 0.01
"""How far from the inverse with most iterations that is, at the worst of 81 pixels spread over the image."""


@dataclass(frozen=True, slots=True, eq=False)
class Lens:
    """A camera's lens model as OpenCV wants it."""

    matrix: Floats
    distortion: Floats
    is_fisheye: bool
    iterations: int
    """Of OpenCV's inverse of the model: as many as the image's worst pixel needs."""

    @classmethod
    def of(cls, camera: Camera) -> Lens:
        """Of a camera."""
        lens = cls(camera.matrix, camera.distortion, camera.is_fisheye, ITERATIONS[-1])
        across, down = (np.linspace(-0.5, size - 0.5, 9) for size in camera.size_wh)
        grid = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
        exact = lens.undistorted(grid)
        for iterations in ITERATIONS[:-1]:
            quicker = replace(lens, iterations=iterations)
            if np.abs(quicker.undistorted(grid) - exact).max() * camera.params[:2].max() < EXACT_PX:
                return quicker
        return lens

    def undistorted(self, pixels: Floats) -> Floats:
        """Normalised coordinates x/z, y/z (N, 2) of finite pixels (N, 2)."""
        source, criteria = pixels.reshape(-1, 1, 2), (cv2.TERM_CRITERIA_COUNT, self.iterations, 0.0)
        if self.is_fisheye:
            found = cv2.fisheye.undistortPoints(source, self.matrix, self.distortion, criteria=criteria)
        else:
            found = cv2.undistortPoints(source, self.matrix, self.distortion, criteria=criteria)
        return np.asarray(found, dtype=np.float64).reshape(-1, 2)


@dataclass(frozen=True, slots=True, eq=False)
class Optics:
    """V cameras; built by :meth:`of`."""

    lenses: tuple[Lens, ...]
    rotation: Floats
    """(V, 3, 3) of ``cam_from_rig``."""
    translation_m: Floats
    """(V, 3) of ``cam_from_rig``."""
    centre_m: Floats
    """(V, 3) cameras' places in the rig frame."""
    pixel_rad: Floats
    """(V,) angle of a pixel at the image's middle."""
    stacked: Floats
    """(3 V, 3) rows of the rotations: first those of x in every camera, then y, then z."""
    shift_m: Floats
    """(3, V, 1) translations in the same order."""
    clocks: tuple[ClockModel | None, ...]
    """(V,)"""
    pose_doubt: Floats | None
    """(10, V): times ``(xx, xy, xz, yy, yz, zz, x, y, z, 1)`` of a point it is the variance, m^2, with which each
    camera sees it elsewhere since its own pose is not exact; None where no covariance is known."""
    border: Floats
    """(4, V) least and largest x, least and largest y, normalised, of a rectangle that each image holds."""
    normal_basis: Floats
    """(9, 4 V): times ``(1, x, y, x^2 + y^2)`` of every view, with weights, it is the normal matrix's entries 00 01 02
    11 12 22 and the right-hand side, summed over views."""

    def __post_init__(self) -> None:
        views = len(self.lenses)
        freeze(self, np.float64, rotation=(views, 3, 3), translation_m=(views, 3), centre_m=(views, 3))
        freeze(self, np.float64, pixel_rad=(views,), stacked=(3 * views, 3), shift_m=(3, views, 1))
        freeze(self, np.float64, normal_basis=(9, 4 * views), border=(4, views))

    @classmethod
    def of(cls, rig: Rig) -> Optics:
        """Of a rig's cameras, in its order."""
        rotation = np.array([entry.cam_from_rig.rotation for entry in rig.cameras])
        translation_m = np.array([entry.cam_from_rig.translation_m for entry in rig.cameras])
        cameras = [entry.camera for entry in rig.cameras]
        lenses = tuple(Lens.of(camera) for camera in cameras)
        return cls(
            lenses=lenses,
            rotation=rotation,
            translation_m=translation_m,
            centre_m=-np.einsum("vji,vj->vi", rotation, translation_m),
            pixel_rad=np.array([1.0 / sqrt(camera.params[0] * camera.params[1]) for camera in cameras]),
            stacked=rotation.transpose(1, 0, 2).reshape(-1, 3),
            shift_m=translation_m.T[:, :, None],
            clocks=tuple(entry.clock for entry in rig.cameras),
            pose_doubt=_pose_doubt(rig),
            border=np.array([_border(*one) for one in zip(lenses, cameras, strict=True)]).T,
            normal_basis=_normal_basis(rotation, translation_m),
        )

    @property
    def views(self) -> int:
        """V."""
        return len(self.lenses)

    def clock_bounds_s(self, t_ns: int) -> Floats:
        """(V,) half-width of the interval that holds each camera's true offset at a rig time; 0 without a clock.

        Times that count from the start of a capture say nothing about the age of a clock's measurement.
        """
        t_s = t_ns * 1e-9
        return np.array([0.0 if c is None else c.bound_at_s(t_s) if t_s > EPOCH_S else c.bound_s for c in self.clocks])

    def in_cameras(self, points_m: Floats) -> Floats:
        """(3, V, N) coordinates of points (N, 3) in every camera's frame."""
        return np.asarray((self.stacked @ points_m.T).reshape(3, self.views, len(points_m)) + self.shift_m)

    def in_images(self, points_m: Floats, margin_m: float) -> Bools:
        """(V, N) whether each image holds points (N, 3), and what is this near to them on all sides."""
        x, y, depth = self.in_cameras(points_m)
        left, right, top, bottom = self.border[:, :, None] * np.maximum(depth, NEAREST_M)
        inside = (np.minimum(x - left, right - x) > margin_m) & (np.minimum(y - top, bottom - y) > margin_m)
        return np.asarray(inside & (depth > NEAREST_M))

    def turned(self, vectors: Floats) -> Floats:
        """(3, V, N) vectors (N, 3) of the rig frame in every camera's frame."""
        return np.asarray((self.stacked @ vectors.T).reshape(3, self.views, len(vectors)))

    def rays(self, xy: Floats, view: Ints) -> Floats:
        """(N, J, 3) unit vectors in the rig frame of normalised coordinates (N, J, 2) seen by cameras (N,)."""
        turned = self.rotation[view]
        rays = xy @ turned[:, :2] + turned[:, None, 2]
        return np.asarray(rays / np.sqrt((rays * rays).sum(axis=-1, keepdims=True)))


@lru_cache(maxsize=32)
def pairs(count: int) -> tuple[Ints, Ints]:
    """The first and the second of every two of so many, ascending; read-only, since they are kept."""
    first, second = np.triu_indices(count, 1)
    first.setflags(write=False)
    second.setflags(write=False)
    return first, second


def midpoints(first_m: Floats, first_ray: Floats, second_m: Floats, second_ray: Floats) -> tuple[Floats, Floats]:
    """The points nearest to two rays each, and the sines of the angles at which they meet.

    Args:
        first_m, second_m: (..., 3) where the rays start.
        first_ray, second_ray: (..., 3) unit vectors.

    Returns:
        (..., 3), and (...); parallel rays meet far away.
    """
    between = second_m - first_m
    cosine = (first_ray * second_ray).sum(axis=-1)
    along_first, along_second = (first_ray * between).sum(axis=-1), (second_ray * between).sum(axis=-1)
    square = np.maximum(1.0 - cosine * cosine, 1e-12)
    from_first = (along_first - cosine * along_second) / square
    from_second = (cosine * along_first - along_second) / square
    ends = first_m + from_first[..., None] * first_ray, second_m + from_second[..., None] * second_ray
    return np.asarray((ends[0] + ends[1]) / 2), np.asarray(np.sqrt(square))


def _border(lens: Lens, camera: Camera) -> tuple[float, float, float, float]:
    """Least and largest x, least and largest y of a rectangle that the image holds, its border being curved."""
    width, height = camera.size_wh
    across, down = np.linspace(-0.5, width - 0.5, 9), np.linspace(-0.5, height - 0.5, 9)
    grid = lens.undistorted(np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)).reshape(9, 9, 2)
    (left, right), (top, bottom) = grid[:, [0, -1], 0].T, grid[[0, -1], :, 1]
    return float(left.max()), float(right.min()), float(top.max()), float(bottom.min())


def _normal_basis(rotation: Floats, translation_m: Floats) -> Floats:
    """(9, 4 V) from rotations (V, 3, 3) and translations (V, 3); factors in the order 1, x, y, x^2 + y^2."""
    both = np.concatenate([rotation, -translation_m[:, :, None]], axis=2)  # rows of [R | -t]: (R0 - x R2) X = ...
    first, second, third = both[:, 0], both[:, 1], both[:, 2]

    def outer(left: Floats, right: Floats) -> Floats:
        return left[:, :, None] * right[:, None, :]

    ones = outer(first, first) + outer(second, second)
    along_x = -outer(first, third) - outer(third, first)
    along_y = -outer(second, third) - outer(third, second)
    square = outer(third, third)
    full = np.stack([ones, along_x, along_y, square])  # (4, V, 4, 4)
    entries = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2), (0, 3), (1, 3), (2, 3)]
    return np.array([full[:, :, i, j] for i, j in entries]).reshape(9, -1)


def _pose_doubt(rig: Rig) -> Floats | None:
    """(10, V). A pose error ``(w, v)`` moves a point ``x = R X + t`` by ``w x (R X) + v``; half of its mean square is
    the variance along each of the two directions across the ray."""
    if not any(entry.pose_covariance is not None for entry in rig.cameras):
        return None
    columns = np.zeros((10, len(rig.cameras)))
    for column, entry in zip(columns.T, rig.cameras, strict=True):
        if entry.pose_covariance is not None:
            sure = entry.pose_covariance
            turn, cross, shift = sure[:3, :3], sure[:3, 3:], sure[3:, 3:]
            rotation = entry.cam_from_rig.rotation
            square = rotation.T @ (np.trace(turn) * np.eye(3) - turn) @ rotation
            line = np.array([cross[2, 1] - cross[1, 2], cross[0, 2] - cross[2, 0], cross[1, 0] - cross[0, 1]])
            column[:6] = square[np.triu_indices(3)] * np.array([1, 2, 2, 1, 2, 1])
            column[6:9] = 2 * rotation.T @ line
            column[9] = np.trace(shift)
    return columns / 2
