"""Points that cameras followed through their frames: what clocks are measured from in video."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigcal.geometry import Floats, freeze


@dataclass(frozen=True, slots=True, eq=False)
class PointTracks:
    """Where one camera saw each of P points, frame by frame; the same index is the same point in every camera."""

    camera_id: str
    t_s: Floats
    """(F,) stamp of each frame by the camera's own clock, ascending: seconds after an epoch that all cameras share."""
    points_px: Floats
    """(F, P, 2) distorted pixels; NaN where a point was not seen."""

    def __post_init__(self) -> None:
        freeze(self, np.float64, t_s=(None,))
        freeze(self, np.float64, points_px=(len(self.t_s), None, 2))
