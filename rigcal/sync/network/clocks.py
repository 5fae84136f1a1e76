"""The two clocks of a machine: realtime, which may be stepped, and monotonic, which never is."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import Protocol

_CLOSE_NS, _TRIES = 20_000, 3
"""Two clocks are read within 20 us of each other, or once more: a busy machine may stop a program in between."""


class Clock(Protocol):
    """What a responder tells the time by."""

    def realtime_ns(self) -> int:
        """Nanoseconds since the Unix epoch."""
        ...

    def monotonic_ns(self) -> int:
        """Nanoseconds since some instant of its own; never stepped."""
        ...

    def realtime_at_ns(self, system_ns: int) -> int:
        """What this clock read when the system's realtime clock, which the kernel stamps packets by, read that."""
        ...


@dataclass(frozen=True, slots=True)
class SystemClock:
    """The clocks of this machine."""

    def realtime_ns(self) -> int:
        """Nanoseconds since the Unix epoch."""
        return time.time_ns()

    def monotonic_ns(self) -> int:
        """Nanoseconds since the machine came up."""
        return time.monotonic_ns()

    def realtime_at_ns(self, system_ns: int) -> int:
        """The same: this clock is the system's."""
        return system_ns


SYSTEM = SystemClock()


@dataclass(frozen=True, slots=True)
class SimulatedClock:
    """A wrong clock of known wrongness, on top of this machine's: for tests, and to try a site out."""

    offset_s: float = 0.0
    """How far it is ahead of the system's realtime clock at ``start_ns``."""
    skew_ppm: float = 0.0
    """How much faster it runs, both its clocks."""
    step_s: float = 0.0
    """How far its realtime clock, and that alone, jumps ahead."""
    step_after_s: float = math.inf
    """When it jumps, in seconds of the system's clock after ``start_ns``."""
    start_ns: int = field(default_factory=time.time_ns)
    """By the system's realtime clock."""
    start_monotonic_ns: int = field(default_factory=time.monotonic_ns)
    """By the system's monotonic clock."""

    def realtime_ns(self) -> int:
        """Nanoseconds since the Unix epoch, wrong as told."""
        return self.realtime_at_ns(time.time_ns())

    def monotonic_ns(self) -> int:
        """Nanoseconds since the machine came up, at the wrong rate."""
        now_ns = time.monotonic_ns()
        return now_ns + round((now_ns - self.start_monotonic_ns) * self.skew_ppm * 1e-6)

    def realtime_at_ns(self, system_ns: int) -> int:
        """What this clock read when the system's read that."""
        return system_ns + round(self.ahead_s(system_ns) * 1e9)

    def ahead_s(self, system_ns: int) -> float:
        """How far it is ahead of the system's clock when that reads so; the truth that a probe should find."""
        elapsed_s = (system_ns - self.start_ns) * 1e-9
        stepped = self.step_s if elapsed_s >= self.step_after_s else 0.0
        return self.offset_s + elapsed_s * self.skew_ppm * 1e-6 + stepped


def read_both_ns(clock: Clock) -> tuple[int, int]:
    """Realtime and monotonic of one instant: the first is read between two readings of the second."""
    for _ in range(_TRIES):
        before_ns, realtime_ns, after_ns = clock.monotonic_ns(), clock.realtime_ns(), clock.monotonic_ns()
        if after_ns - before_ns < _CLOSE_NS:
            break
    return realtime_ns, (before_ns + after_ns) // 2
