"""The world frame: z up, the floor at 0; what a way of measuring it returns, and what holds for each of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigcal.errors import BelowFloorError
from rigcal.geometry import Floats, Pose
from rigcal.rig import Rig


@dataclass(frozen=True, slots=True)
class Residual:
    """How far one thing that was measured lies from where the world has it."""

    name: str
    """Of a placement of the board, or of a point."""
    off_m: float
    """Distance: from the floor for a placement (signed, up), from its place for a point, from the line for a plumb."""
    tilt_deg: float | None = None
    """Of a placement against the floor; None for points."""


@dataclass(frozen=True, slots=True)
class World:
    """A measured world frame and its evidence."""

    method: str
    """``floor board``, ``points`` or ``plumb line``."""
    world_from_rig: Pose
    """z up, the floor at z = 0."""
    tilt_sigma_deg: float
    """One sigma of the vertical's direction."""
    height_sigma_m: float
    """One sigma of the floor's height at the world's origin."""
    residuals: tuple[Residual, ...]
    scale_percent: float | None = None
    """How much longer measured lengths are than the rig's, where lengths were measured."""
    scale_sigma_percent: float | None = None

    def camera_heights_m(self, rig: Rig) -> dict[str, float]:
        """Height of each camera above the floor."""
        return {
            camera.id: float(self.world_from_rig.apply(centre_of(camera.cam_from_rig))[2]) for camera in rig.cameras
        }

    @property
    def worst(self) -> Residual:
        """The greatest residual."""
        return max(self.residuals, key=lambda residual: abs(residual.off_m))


def centre_of(cam_from_rig: Pose) -> Floats:
    """(3,) centre of a camera in the rig frame."""
    return cam_from_rig.inverse().translation_m


def world_at(up: Floats, origin: Floats, x_towards: Floats) -> Pose:
    """``world_from_rig`` with z along ``up``, its origin at ``origin``, x along ``x_towards``: (3,) each, in the rig.

    What of ``x_towards`` is not horizontal is left out.
    """
    z = up / np.linalg.norm(up)
    x = x_towards - (x_towards @ z) * z
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(z, x), z])
    return Pose(rotation, -rotation @ origin)


def check_above_floor(world: World, rig: Rig, *, do_next: str) -> None:
    """Refuse a world in which a camera lies below the floor.

    Raises:
        BelowFloorError: naming the cameras and their heights.
    """
    below = [(camera, height) for camera, height in world.camera_heights_m(rig).items() if height <= 0]
    if below:
        raise BelowFloorError(below, method=world.method, do_next=do_next)
