"""Poses and the conventions that every module keeps.

- A pose is named ``target_from_source`` and maps points: ``x_target = R @ x_source + t``. In a chain the inner
  names cancel: ``cam1_from_rig @ rig_from_cam0`` is ``cam1_from_cam0``.
- Camera axes: x right, y down, z forward. The rig frame is the frame of the reference camera.
- Pixel (0, 0) is the centre of the top-left pixel. Lengths are metres, angles radians inside.
- Quaternions are ``wxyz``. A perturbation of a pose is a left one, ``(exp(w) R, t + v)`` up to first order with
  ``w`` in radians and ``v`` in metres, in the target's frame; covariances are stated in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

Floats: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int64]
Bools: TypeAlias = NDArray[np.bool_]


def freeze(instance: object, dtype: Any, **shapes: tuple[int | None, ...]) -> None:
    """Replace the named fields of a frozen dataclass by read-only copies: for its ``__post_init__``.

    Raises:
        ValueError: where a field does not have its shape (None: any length on that axis).
    """
    for name, shape in shapes.items():
        array = np.array(getattr(instance, name), dtype=dtype)
        if array.ndim != len(shape) or any(w not in (None, n) for w, n in zip(shape, array.shape, strict=True)):
            raise ValueError(f"{name}: expected shape {shape}, got {array.shape}")
        array.setflags(write=False)
        object.__setattr__(instance, name, array)


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """A rigid transform ``x_target = rotation @ x_source + translation_m``.

    Raises:
        ValueError: where ``rotation`` is no rotation (orthonormal, determinant +1 within 1e-6), or a value is
            not finite.
    """

    rotation: Floats
    """(3, 3) rotation matrix."""
    translation_m: Floats
    """(3,) metres, in the target's frame."""

    def __post_init__(self) -> None:
        freeze(self, np.float64, rotation=(3, 3), translation_m=(3,))
        if not (np.isfinite(self.rotation).all() and np.isfinite(self.translation_m).all()):
            raise ValueError("a pose must be finite")
        if np.abs(self.rotation @ self.rotation.T - np.eye(3)).max() > 1e-6 or np.linalg.det(self.rotation) < 0:
            raise ValueError(f"not a rotation matrix: {self.rotation.tolist()}")

    @classmethod
    def identity(cls) -> Pose:
        """The pose that changes nothing."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_rvec(cls, rvec_rad: ArrayLike, translation_m: ArrayLike) -> Pose:
        """From a rotation vector (3,) in radians and a translation (3,) in metres, as OpenCV has them."""
        rotation = Rotation.from_rotvec(np.asarray(rvec_rad, dtype=np.float64).reshape(3)).as_matrix()
        return cls(rotation, np.asarray(translation_m, dtype=np.float64).reshape(3))

    @classmethod
    def from_quat_wxyz(cls, quat_wxyz: ArrayLike, translation_m: ArrayLike) -> Pose:
        """From a quaternion (4,) scalar first, normalised here, and a translation (3,) in metres."""
        rotation = Rotation.from_quat(np.asarray(quat_wxyz, dtype=np.float64), scalar_first=True).as_matrix()
        return cls(rotation, np.asarray(translation_m, dtype=np.float64))

    @property
    def rvec_rad(self) -> Floats:
        """(3,) rotation vector in radians."""
        return np.asarray(Rotation.from_matrix(self.rotation).as_rotvec())

    @property
    def quat_wxyz(self) -> Floats:
        """(4,) unit quaternion, scalar first and not negative."""
        return np.asarray(Rotation.from_matrix(self.rotation).as_quat(scalar_first=True, canonical=True))

    @property
    def matrix(self) -> Floats:
        """(4, 4) homogeneous matrix."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.rotation, self.translation_m
        return matrix

    @property
    def angle_rad(self) -> float:
        """Rotation angle in radians, 0 to pi."""
        return float(Rotation.from_matrix(self.rotation).magnitude())

    def inverse(self) -> Pose:
        """``source_from_target``."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation_m)

    def __matmul__(self, other: Pose) -> Pose:
        rotation = self.rotation @ other.rotation
        return Pose(rotation, self.rotation @ other.translation_m + self.translation_m)

    def apply(self, points_in_source: ArrayLike) -> Floats:
        """Map points (..., 3) in metres from the source frame to the target frame; NaN stays NaN."""
        return np.asarray(points_in_source, dtype=np.float64) @ self.rotation.T + self.translation_m

    def perturbed(self, rotation_rad: ArrayLike, translation_m: ArrayLike) -> Pose:
        """The pose after the left perturbation ``(exp(rotation_rad) R, t + translation_m)``."""
        delta = Rotation.from_rotvec(np.asarray(rotation_rad, dtype=np.float64)).as_matrix()
        return Pose(delta @ self.rotation, self.translation_m + np.asarray(translation_m, dtype=np.float64))
