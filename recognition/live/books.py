"""Counts of a live run at a moment, and the rates up to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace


@dataclass(frozen=True, slots=True)
class Books:
    """Counts at a moment; times are seconds of a clock that does not step."""

    start_s: float
    """When the run began."""
    at_s: float
    """The moment."""
    reported_s: float
    """When skipped sets were last put down."""
    received: Sequence[int]
    """Packets per camera."""
    fps: Sequence[float]
    """Packets per second and camera over the period that ended at the moment."""
    looked_at: int = 0
    """Frame sets that were looked at."""
    sets_per_s: float = 0.0
    """The same per second over that period."""
    sets: int = 0
    """Frame sets that there were when they were last put down."""
    skipped: int = 0
    """Those that were skipped, likewise."""

    @classmethod
    def opened(cls, now_s: float, cameras: int) -> Books:
        """The books of a run that begins."""
        return cls(now_s, now_s, now_s, (0,) * cameras, (0.0,) * cameras)

    def turned(self, now_s: float, looked_at: int, received: Sequence[int]) -> Books:
        """The books of the next period, with the rates of the one that ends."""
        span_s = now_s - self.at_s
        fps = [(new - old) / span_s for new, old in zip(received, self.received, strict=True)]
        sets_per_s = (looked_at - self.looked_at) / span_s
        return replace(self, at_s=now_s, received=received, looked_at=looked_at, fps=fps, sets_per_s=sets_per_s)
