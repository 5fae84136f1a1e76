"""What the stamps of a camera say of its pace: the result of :func:`rigcal.pace.judge_pace`, with its evidence."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from rigcal.errors import OptionError
from rigcal.geometry import Ints, freeze

Source: TypeAlias = Literal["sensor", "arrival", "unknown"]


@dataclass(frozen=True, slots=True)
class PaceOptions:
    """What counts as a sensor's stamp, and as too little to judge."""

    least_frames: int = 30
    """Fewer do not tell a sensor's stamps from arrival times: the rms of 30 residuals is known to 13 %."""
    sensor_jitter_s: float = 0.25e-3
    """Stamps of a sensor sit on their grid within 20-100 us; this leaves room for a clock that is disciplined."""
    arrival_jitter_s: float = 0.5e-3
    """Arrival times scatter more than this: 1.1 to 1.4 ms for webcams on a desktop, and a range of 4.7 ms over
    RTSP on loopback."""

    def __post_init__(self) -> None:
        if self.least_frames < 8:
            raise OptionError("least_frames", expected="at least 8", got=self.least_frames)
        if not 0 < self.sensor_jitter_s <= self.arrival_jitter_s:
            raise OptionError("sensor_jitter_s", expected="above 0, up to arrival_jitter_s", got=self.sensor_jitter_s)


@dataclass(frozen=True, slots=True)
class Gap:
    """Frames that never came."""

    after: int
    """Index of the last frame before them."""
    count: int
    """How many are missing."""


@dataclass(frozen=True, slots=True)
class Step:
    """The grid of the stamps jumped and stayed: the clock was stepped, or the camera restarted."""

    at: int
    """Index of the first frame by the new time."""
    jump_s: float
    """How much later its stamp is than the old grid has it, if no frame is missing there; negative: it ran back."""


@dataclass(frozen=True, slots=True, eq=False)
class Pace:
    """The pace of one camera's frames, in the order in which they came.

    Rate and jitter are by the clock that made the stamps; a clock that runs wrong makes the rate look wrong.
    """

    frames: int
    period_s: float | None
    """Time between frames that follow each other, whatever is missing; None where fewer than three frames tell."""
    period_sigma_s: float | None
    """One standard deviation of the period, wander of the clock included; None as for the period."""
    declared_fps: float | None
    """What the camera or the file declares, where known."""
    jitter_s: float
    """Robust rms of the stamps around their grid, less their rounding."""
    worst_s: float
    """The farthest that a stamp lies from the grid, rounding included."""
    quantum_s: float
    """What the stamps are rounded to; 0 where no rounding shows."""
    exact: bool
    """Whether the stamps are as regular as their rounding allows. Muxers write such ones at 1/fps: where that may be,
    they say nothing of when frames were taken."""
    varies: bool
    """Whether the frame rate changes on the way (auto exposure in the dark); such changes are no missing frames."""
    rates_fps: tuple[float, float] | None
    """Lowest and highest rate over a second; None where the rate is steady."""
    late: int
    """How many stamps came late, or early, and were followed by ones that are back on the grid."""
    missing: tuple[Gap, ...]
    repeated: Ints
    """(r,) indices of the frames whose stamp came already; also of frames that came twice under two arrival times."""
    backwards: Ints
    """(b,) indices of the frames whose stamp lies before the one that came before."""
    steps: tuple[Step, ...]
    source: Source
    """``sensor``: they sit on a grid within tens of microseconds; ``arrival``: they are late by milliseconds and catch
    up. Exact stamps look like a sensor's: see ``exact``."""
    reason: str
    """Why the source is what it is, in words."""

    def __post_init__(self) -> None:
        freeze(self, np.int64, repeated=(None,), backwards=(None,))

    @property
    def delivered_fps(self) -> float | None:
        """Frames per second of the cadence; missing frames do not lower it."""
        return 1 / self.period_s if self.period_s else None

    @property
    def delivered_fps_sigma(self) -> float | None:
        """One standard deviation of ``delivered_fps``."""
        if not self.period_s or self.period_sigma_s is None:
            return None
        return self.period_sigma_s / self.period_s**2

    @property
    def off_ppm(self) -> float | None:
        """Delivered against declared rate, in millionths; None where either is not known."""
        if self.delivered_fps is None or not self.declared_fps:
            return None
        return (self.delivered_fps / self.declared_fps - 1) * 1e6

    @property
    def missing_frames(self) -> int:
        """How many frames are missing in all."""
        return sum(gap.count for gap in self.missing)

    @property
    def missing_percent(self) -> float:
        """Missing frames among those that should have come, in per cent."""
        return 100 * self.missing_frames / max(self.frames + self.missing_frames, 1)
