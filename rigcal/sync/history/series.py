"""How the clocks and frames of a recording behaved over time: what the page of ``rigcal sync report`` shows."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from rigcal.geometry import Floats, freeze

Method: TypeAlias = Literal["probe", "video", "rig file"]
RATE_TOLERANCE_PERCENT = 0.05
"""Clocks of cameras are up to some 100 ppm off; a rate that is farther from the declared one is another rate."""


@dataclass(frozen=True, slots=True, eq=False)
class OffsetSeries:
    """A clock's offset over time, with its bound."""

    method: Method
    """Where it comes from; ``rig file`` is the clock model that the frames are placed with."""
    t_s: Floats
    """(n,) rig time, ascending, in seconds since the epoch, or since the first frame where the capture knows no
    epoch."""
    offset_s: Floats
    """(n,) rig minus camera, in seconds; NaN where it is not known."""
    bound_s: Floats
    """(n,) half-width of the interval that holds the true offset; NaN where the offset is."""

    def __post_init__(self) -> None:
        count = len(self.t_s)
        freeze(self, np.float64, t_s=(count,), offset_s=(count,), bound_s=(count,))

    @property
    def known(self) -> bool:
        """Whether there is any time at which the offset is known."""
        return bool(np.isfinite(self.offset_s).any())

    @property
    def greatest_s(self) -> float | None:
        """The greatest offset that the bound allows at any time, without its sign; None where nothing is known."""
        return float(np.nanmax(np.abs(self.offset_s) + self.bound_s)) if self.known else None

    @property
    def drift_ppm(self) -> float | None:
        """Slope of the line through the offsets, parts per million; None where they span no time."""
        known = np.isfinite(self.offset_s)
        t_s = self.t_s[known] - self.t_s[known].mean() if known.any() else np.zeros(1)
        power = float(t_s @ t_s)
        return float(t_s @ self.offset_s[known]) / power * 1e6 if power > 0 else None


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
    declared_fps: float | None = None
    """Frame rate that the camera or the site file states."""
    delivered_fps: float | None = None
    """Frame rate of its cadence, as its stamps show it; None where there are too few frames to tell."""
    arrival_stamps: bool = False
    """Whether the stamps look like times of arrival: then no clock says when its frames were taken."""
    latency_unknown: bool = False
    """Whether only the clock of its host is known, and not how long after exposure the camera stamps a frame."""

    def __post_init__(self) -> None:
        freeze(self, np.float64, frame_t_s=(None,), missing_t_s=(None,), repeated_t_s=(None,), steps_t_s=(None,))

    @property
    def rate_off_percent(self) -> float | None:
        """Delivered against declared frame rate; None where either is not known, or the difference is a clock's."""
        if not self.declared_fps or self.delivered_fps is None:
            return None
        off = 100 * (self.delivered_fps / self.declared_fps - 1)
        return off if abs(off) > RATE_TOLERANCE_PERCENT else None

    @property
    def model(self) -> OffsetSeries | None:
        """The clock model that the frames are placed with; None where nothing corrects the stamps."""
        return next((series for series in self.offsets if series.method == "rig file" and series.known), None)

    @property
    def measured(self) -> tuple[OffsetSeries, ...]:
        """What was measured of this recording itself: by probes through it, or from its pictures."""
        return tuple(series for series in self.offsets if series.method != "rig file" and series.known)

    @property
    def clock(self) -> OffsetSeries | None:
        """What is known best of its clock: what was measured, else the rig file's model; None where nothing is."""
        return (*self.measured, self.model)[0]

    @property
    def misplaced(self) -> tuple[OffsetSeries, ...]:
        """How far from their true time its frames are placed: what was measured, less what the rig file corrects.

        Where nothing was measured, the model itself: no known departure, within the bound that it claims.
        """
        model = self.model
        if model is None:
            return self.measured
        if not self.measured:
            return (OffsetSeries(model.method, model.t_s, np.zeros(len(model.t_s)), model.bound_s),)
        return tuple(
            OffsetSeries(s.method, s.t_s, s.offset_s - np.interp(s.t_s, model.t_s, model.offset_s), s.bound_s)
            for s in self.measured
        )

    @property
    def greatest_error_s(self) -> float | None:
        """The greatest error of a frame's time that any measurement allows; None where nothing is known."""
        return max((g for series in self.misplaced if (g := series.greatest_s) is not None), default=None)


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
    remarks: tuple[str, ...] = field(default=())
    """What holds for every camera, in words."""

    @property
    def span_s(self) -> tuple[float, float]:
        """Time of the first and of the last frame of any camera."""
        known = [camera.frame_t_s for camera in self.cameras if len(camera.frame_t_s)]
        return min(float(t.min()) for t in known), max(float(t.max()) for t in known)

    @property
    def limit_s(self) -> float:
        """The clock error that uses up the limit at the fastest motion."""
        return self.clock_error_m / self.fastest_motion_m_per_s

    def error_m(self, camera: CameraHistory) -> float | None:
        """How far a camera's clock may misplace a point at the fastest motion; None where nothing is known."""
        error_s = camera.greatest_error_s
        return None if error_s is None else error_s * self.fastest_motion_m_per_s
