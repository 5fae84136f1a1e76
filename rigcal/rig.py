"""The calibrated rig: what the rig file means, as immutable values. Recognition consumes this."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime

import numpy as np

from rigcal.camera import Camera
from rigcal.geometry import Floats, Pose, freeze


@dataclass(frozen=True, slots=True)
class ClockModel:
    """From a camera's clock to rig time: ``t_rig = t_cam + offset_s + drift_ppm * 1e-6 * (t_cam - at)``."""

    offset_s: float
    drift_ppm: float
    at_utc: str
    """When the offset was measured, ISO 8601 UTC."""
    bound_s: float
    """Half-width of the interval that holds the true offset, at ``at_utc``."""
    drift_bound_ppm: float
    """How fast the bound grows away from ``at_utc``."""
    method: str
    """``probe``, ``video`` or ``declared``."""

    @property
    def at_s(self) -> float:
        """``at_utc`` in seconds since the epoch."""
        return datetime.fromisoformat(self.at_utc).timestamp()

    def rig_time_s(self, t_cam_s: float) -> float:
        """Rig time in seconds since the epoch of a camera time in seconds since the epoch."""
        return t_cam_s + self.offset_s + self.drift_ppm * 1e-6 * (t_cam_s - self.at_s)

    def rig_time_ns(self, t_cam_ns: int) -> int:
        """Rig time in nanoseconds of a camera time in nanoseconds, without losing digits of the stamp."""
        correction_s = self.offset_s + self.drift_ppm * 1e-6 * (t_cam_ns * 1e-9 - self.at_s)
        return t_cam_ns + round(correction_s * 1e9)

    def camera_time_s(self, t_rig_s: float) -> float:
        """Camera time in seconds since the epoch of a rig time: the inverse of :meth:`rig_time_s`."""
        rate = self.drift_ppm * 1e-6
        return t_rig_s - (self.offset_s + rate * (t_rig_s - self.offset_s - self.at_s) / (1 + rate))

    def bound_at_s(self, t_cam_s: float) -> float:
        """Half-width of the interval that holds the true offset at a camera time, in seconds."""
        return self.bound_s + self.drift_bound_ppm * 1e-6 * abs(t_cam_s - self.at_s)


@dataclass(frozen=True, slots=True)
class RigCamera:
    """One camera of a rig."""

    id: str
    camera: Camera
    cam_from_rig: Pose
    serial: str | None = None
    clock: ClockModel | None = None
    """None until measured."""
    pose_covariance: Floats | None = field(default=None, compare=False)
    """(6, 6) of ``cam_from_rig``, rotation (rad) then translation (m), for left perturbations; None where not known."""

    def __post_init__(self) -> None:
        if self.pose_covariance is not None:
            freeze(self, np.float64, pose_covariance=(6, 6))


@dataclass(frozen=True, slots=True)
class Rig:
    """Cameras in a common frame: the rig frame is the reference camera's, stated as an identity pose.

    Raises:
        ValueError: where identifiers repeat, or the reference camera is absent or not at the identity.
    """

    site: str
    cameras: tuple[RigCamera, ...]
    reference: str
    verdict: str
    """``PASS``, ``RECAPTURE`` or ``IMPORTED``."""
    world_from_rig: Pose | None = None
    """World frame with z up and the floor at 0, or None until measured."""
    digest: str = ""
    """Digest of the rig file that this came from."""

    def __post_init__(self) -> None:
        if len(set(self.camera_ids)) != len(self.cameras):
            raise ValueError(f"camera identifiers repeat: {', '.join(self.camera_ids)}")
        if self.reference not in self.camera_ids:
            raise ValueError(f"the reference {self.reference} is not one of {', '.join(self.camera_ids)}")
        if not np.allclose(self.camera(self.reference).cam_from_rig.matrix, np.eye(4), atol=1e-12):
            raise ValueError(f"the reference {self.reference} is not at the identity")

    @property
    def camera_ids(self) -> tuple[str, ...]:
        """Identifiers in rig order."""
        return tuple(camera.id for camera in self.cameras)

    def camera(self, camera_id: str) -> RigCamera:
        """The camera of that identifier; KeyError where there is none."""
        for camera in self.cameras:
            if camera.id == camera_id:
                return camera
        raise KeyError(camera_id)
