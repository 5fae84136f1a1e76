"""What every format's reader returns and writer needs."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rigcal.camera import Camera
from rigcal.errors import ForeignNameError, LossyExportError
from rigcal.geometry import Pose
from rigcal.rig import Rig, RigCamera

METRES_PER_UNIT: Mapping[str, float] = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
GL_FROM_CV = Pose(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
"""OpenGL's camera axes (x right, y up, z back) from OpenCV's; its own inverse."""
_UPRIGHT_FROM_RIG = Pose(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]), np.zeros(3))
"""z up, y forward from the axes of the reference camera, which is taken to stand level."""


@dataclass(frozen=True, slots=True)
class ForeignCamera:
    """A camera as another tool's file has it."""

    id: str
    camera: Camera
    cam_from_common: Pose
    """From the file's common frame, in the file's unit of length."""


@dataclass(frozen=True, slots=True)
class ForeignRig:
    """A rig as another tool's file has it."""

    cameras: tuple[ForeignCamera, ...]
    """At least one; the first becomes the reference."""
    unit: str | None
    """``m``, ``cm`` or ``mm`` where the file or its format says so."""
    site: str | None = None
    """Name of the site or data set, where the file has one."""
    common_is_world: bool = False
    """Whether the common frame is defined with z up and the floor at 0."""
    extensions: Mapping[str, Any] = field(default_factory=dict)
    """What the file holds beside the rig and is worth keeping."""

    def rig(self, *, site: str, metres_per_unit: float) -> Rig:
        """The rig in metres, its frame that of the first camera.

        Raises:
            ValueError: where camera identifiers repeat.
        """
        cams_from_common = [_scaled(camera.cam_from_common, metres_per_unit) for camera in self.cameras]
        common_from_rig = cams_from_common[0].inverse()
        cams_from_rig = [Pose.identity(), *(pose @ common_from_rig for pose in cams_from_common[1:])]
        return Rig(
            site=self.site or site,
            cameras=tuple(
                RigCamera(camera.id, camera.camera, cam_from_rig)
                for camera, cam_from_rig in zip(self.cameras, cams_from_rig, strict=True)
            ),
            reference=self.cameras[0].id,
            verdict="IMPORTED",
            world_from_rig=common_from_rig if self.common_is_world else None,
        )


def _scaled(pose: Pose, metres_per_unit: float) -> Pose:
    return Pose(pose.rotation, pose.translation_m * metres_per_unit)


@dataclass(frozen=True, slots=True)
class Written:
    """An exported rig."""

    content: str | Mapping[str, str]
    """The whole file; or the texts of a folder's files by their names."""
    conventions: tuple[str, ...]
    """What the numbers in it mean, one line each, for the user to compare with what reads the file."""


def cams_from_common(rig: Rig) -> tuple[list[Pose], str]:
    """Poses for a format with a common frame, and that frame's name: the world where the rig has one."""
    if rig.world_from_rig is None:
        return [camera.cam_from_rig for camera in rig.cameras], f"camera {rig.reference} (the rig has no world yet)"
    rig_from_world = rig.world_from_rig.inverse()
    return [camera.cam_from_rig @ rig_from_world for camera in rig.cameras], "the world: z up, the floor at 0"


def cams_from_upright(rig: Rig) -> tuple[list[Pose], str]:
    """Like :func:`cams_from_common`, for a format whose scene has z up: without a world the rig frame is turned."""
    poses, frame = cams_from_common(rig)
    if rig.world_from_rig is not None:
        return poses, frame
    return [pose @ _UPRIGHT_FROM_RIG.inverse() for pose in poses], f"{frame}, turned so that z is up"


def refuse_loss(camera: RigCamera, *, held: Collection[str], to: str, do_next: str) -> None:
    """Refuse to drop a lens coefficient that is not zero.

    Raises:
        LossyExportError: naming the camera, and each coefficient outside ``held`` with its value.
    """
    lost = [f"{name} = {value:.6g}" for name, value in camera.camera.coefficients.items() if name not in held and value]
    if lost:
        model = camera.camera.model
        raise LossyExportError(camera_id=camera.id, model=model, to=to, coefficients=lost, do_next=do_next)


def refuse_fisheye(camera: RigCamera, *, to: str) -> None:
    """Refuse a fisheye lens for a format that has none.

    Raises:
        LossyExportError: naming the camera and its coefficients.
    """
    if camera.camera.is_fisheye:
        named = [f"fisheye {name} = {value:.6g}" for name, value in list(camera.camera.coefficients.items())[4:]]
        do_next = "export to colmap, anipose, foxglove, ros or kalibr, which hold a fisheye lens"
        raise LossyExportError(
            camera_id=camera.id, model=camera.camera.model, to=to, coefficients=named, do_next=do_next
        )


def refuse_names(rig: Rig, allowed: str, *, to: str, expected: str) -> None:
    """Refuse camera names that do not match the pattern ``allowed``, or that differ in capitals only.

    Raises:
        ForeignNameError: naming the first such camera, and what ``expected`` says of names.
    """
    taken: set[str] = set()
    for camera_id in rig.camera_ids:
        if re.fullmatch(allowed, camera_id) is None:
            raise ForeignNameError(camera_id, to=to, expected=expected)
        if camera_id.casefold() in taken:
            raise ForeignNameError(camera_id, to=to, expected="names that differ in more than capitals")
        taken.add(camera_id.casefold())


def coefficients_of(lens: Camera, names: Sequence[str]) -> list[float]:
    """Coefficients of a lens by name; 0 for those that its model does not have."""
    return [lens.coefficients.get(name, 0.0) for name in names]


def largest_distance_m(rig: Rig) -> float:
    """Between two cameras of the rig, in metres."""
    positions = np.array([camera.cam_from_rig.inverse().translation_m for camera in rig.cameras])
    return float(np.linalg.norm(positions[:, None] - positions[None], axis=-1).max())
