"""What was read of each camera before it is judged; every part may be absent."""

from __future__ import annotations

from dataclasses import dataclass

from rigcal.pace import Pace
from rigcal.rig import ClockModel
from rigcal.sync.content.lags import CameraLag
from rigcal.sync.estimator.estimate import HostClock
from rigcal.sync.record import Latency


@dataclass(frozen=True, slots=True)
class HostReading:
    """A camera's host, probed now."""

    name: str
    """The host as the user named it."""
    clock: HostClock | None
    """Its clock; None where it did not answer."""
    silence: str = ""
    """Why it did not answer, in words."""
    confusion: str | None = None
    """A known mistake that its offset betrays, such as TAI taken for UTC."""
    claimed_bound_s: float | None = None
    """How far from UTC the host itself says that it is at most; None where it does not say."""


@dataclass(frozen=True, slots=True)
class StampReading:
    """The stamps of a camera's frames, from a capture or a live source."""

    rule: str
    """Where they come from: ``timestamps.csv``, ``file times``, ``presentation times``, ``producer`` or ``arrival``."""
    pace: Pace
    span_s: float = 0.0
    """From the first stamp to the last."""
    arrived_fps: float | None = None
    """Of a live source: frames per second as they came, whatever their stamps say."""
    trouble: str = ""
    """Why a live source gave nothing, in words; the pace is then that of no frames."""


@dataclass(frozen=True, slots=True)
class CameraReadings:
    """Everything that was read of one camera."""

    camera_id: str
    model: ClockModel | None
    """Its clock in the rig file."""
    latency: Latency | None = None
    host: HostReading | None = None
    stamps: StampReading | None = None
    lag: CameraLag | None = None
    """What its pictures say, after the rig file's clocks were applied to the stamps: 0 where all is well."""
    stamped_s: float | None = None
    """Time of the capture's last frame by its stamps: when a clock is judged that is not of the epoch of UTC."""
    swapped_with: str | None = None
    """The camera whose pictures these are."""
