"""How the clocks and frames of a recording behaved over time: what the page of ``rigcal sync report`` shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigcal.geometry import Floats, freeze


@dataclass(frozen=True, slots=True, eq=False)
class OffsetSeries:
    """A clock's offset over time, with its bound."""

    method: str
    """``probe``, ``video`` or ``rig file``: where it comes from."""
    t_s: Floats
    """(n,) rig time in seconds since the epoch, or since the first frame where the capture knows no epoch."""
    offset_s: Floats
    """(n,) rig minus camera, in seconds."""
    bound_s: Floats
    """(n,) half-width of the interval that holds the true offset."""

    def __post_init__(self) -> None:
        count = len(self.t_s)
        freeze(self, np.float64, t_s=(count,), offset_s=(count,), bound_s=(count,))


@dataclass(frozen=True, slots=True, eq=False)
class CameraHistory:
    """One camera over a recording."""

    camera_id: str
    frame_t_s: Floats
    """(F,) time of each frame, on the same axis as the offsets."""
    missing_t_s: Floats
    """(d,) times at which frames are missing."""
    repeated_t_s: Floats
    """(r,) times at which a stamp came twice, or went backwards."""
    steps_t_s: Floats
    """(s,) times at which the clock was stepped."""
    offsets: tuple[OffsetSeries, ...]
    """What is known of its clock, by method."""
    remarks: tuple[str, ...]
    """What a user should know, in words."""

    def __post_init__(self) -> None:
        freeze(self, np.float64, frame_t_s=(None,), missing_t_s=(None,), repeated_t_s=(None,), steps_t_s=(None,))


@dataclass(frozen=True, slots=True)
class SyncHistory:
    """Every camera over a recording."""

    title: str
    """What was recorded: the capture's or the recording's name."""
    epoch: bool
    """Whether times count from the Unix epoch (UTC); otherwise from the first frame."""
    cameras: tuple[CameraHistory, ...]
    fastest_motion_m_per_s: float
    """What offsets are turned into millimetres with."""
    clock_error_m: float
    """The limit of the gate that they are held against."""
