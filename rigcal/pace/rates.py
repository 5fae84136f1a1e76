"""Cameras that run at a rate of their own beside the others."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from rigcal.pace.results import Pace

_CLOCKS_PPM = 100.0
"""Rates closer than this differ by their clocks alone: crystals differ by 5 to 30 ppm, 29.97 from 30 by 1,000 ppm."""
_SIGMAS = 4.0
"""Rates closer than this many standard deviations of their difference are the same."""


@dataclass(frozen=True, slots=True)
class FreeRunning:
    """A camera whose frames slip against those of the others."""

    camera_id: str
    fps: float
    """What it delivers."""
    expected_fps: float
    """What it would have to deliver."""
    against: Literal["the others", "declared"]
    """Whose rate that is."""
    slip_frames_per_min: float
    """How many frames it falls behind every minute; negative: runs ahead."""
    half_frame_after_s: float
    """How long until its frames lie half a period away from where they should."""


def free_running(paces: Mapping[str, Pace]) -> tuple[FreeRunning, ...]:
    """The cameras that run at another rate than the others, or than they declare.

    The rate that most cameras share is the rig's, where two or more share one; a camera at a multiple of it (60 beside
    30 frames per second) keeps step. Cameras that share no rate are held against what they declare. Cameras whose
    rate is not known, or changes, are left out.
    """
    known = {name: pace for name, pace in paces.items() if pace.delivered_fps is not None and not pace.varies}
    company = {name: sum(_keep_step(pace, other) for other in known.values()) for name, pace in known.items()}
    most = max(company.values(), default=0)
    leader = next((known[name] for name in known if most > 1 and company[name] == most), None)
    found = []
    for name, pace in known.items():
        if leader is not None and not _keep_step(pace, leader):
            found.append(_slip(name, pace, _nearest_multiple(pace, leader), "the others"))
        elif leader is None and pace.declared_fps and not _same(pace, pace.declared_fps, 0.0):
            found.append(_slip(name, pace, pace.declared_fps, "declared"))
    return tuple(found)


def _fps(pace: Pace) -> float:
    return pace.delivered_fps or 0.0


def _nearest_multiple(pace: Pace, leader: Pace) -> float:
    """The rate of the leader, a whole multiple or a whole part of it: the one nearest to a camera's rate."""
    ratio = _fps(pace) / _fps(leader)
    return _fps(leader) * round(ratio) if ratio >= 1 else _fps(leader) / round(1 / ratio)


def _keep_step(pace: Pace, leader: Pace) -> bool:
    expected = _nearest_multiple(pace, leader)
    sigma = (leader.delivered_fps_sigma or 0.0) * expected / _fps(leader)
    return _same(pace, expected, sigma)


def _same(pace: Pace, fps: float, sigma: float) -> bool:
    apart = abs(_fps(pace) - fps)
    spread = math.hypot(pace.delivered_fps_sigma or 0.0, sigma)
    return bool(apart <= max(_CLOCKS_PPM * 1e-6 * fps, _SIGMAS * spread))


def _slip(name: str, pace: Pace, expected: float, against: Literal["the others", "declared"]) -> FreeRunning:
    behind = expected - _fps(pace)
    return FreeRunning(name, _fps(pace), expected, against, 60 * behind, 0.5 / abs(behind))
