"""Times from capture to track, in memory that does not grow."""

from __future__ import annotations

import numpy as np

_BIN_S, _BINS = 0.001, 10_000
"""Milliseconds up to ten seconds; what takes longer counts as ten."""


class Latency:
    """A histogram of latencies."""

    def __init__(self) -> None:
        self._counts = np.zeros(_BINS, dtype=np.int64)

    def add(self, latency_s: float) -> None:
        """Count one; one below 0, of stamps that are ahead of the clock, counts as 0."""
        self._counts[min(max(int(latency_s / _BIN_S), 0), _BINS - 1)] += 1

    def quantile_s(self, share: float) -> float | None:
        """The latency that a share of 0..1 of them does not exceed, to a millisecond; None where there is none."""
        total = int(self._counts.sum())
        if not total:
            return None
        reached = np.cumsum(self._counts) >= share * total
        return float((np.argmax(reached) + 1) * _BIN_S)
