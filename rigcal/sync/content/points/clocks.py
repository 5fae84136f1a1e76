"""The cameras' clocks while they are solved for: one row per camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigcal.geometry import Floats
from rigcal.sync.content.points.seen import SeenPoints

OFFSET, DRIFT, READOUT = range(3)
"""Columns of a camera's clock parameters."""


@dataclass(frozen=True, slots=True, eq=False)
class Clocks:
    """``t_rig = t_camera + offset + drift (t_camera - at) + readout row`` of every camera."""

    values: Floats
    """(M, 3) offset in seconds, drift as a ratio, readout in seconds."""
    at_s: Floats
    """(M,) camera time of the offset."""

    def frames_in_rig_s(self, camera: int, seen: SeenPoints) -> Floats:
        """(F,) rig time of the middle row of each frame."""
        offset, drift, _ = self.values[camera]
        return np.asarray(seen.t_s + offset + drift * (seen.t_s - self.at_s[camera]))

    def only(self, cameras: list[int]) -> Clocks:
        """The clocks of some of the cameras."""
        return Clocks(self.values[cameras], self.at_s[cameras])
