"""A truth at times of its own, where a run's instants are at others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from recognition.metrics import Truth
from rigcal.geometry import Floats, Ints, freeze


@dataclass(frozen=True, slots=True, eq=False)
class TimedTruth:
    """Where W workers are at F times."""

    t_ns: Ints
    """(F,) rig time, ascending."""
    joints_m: Floats
    """(F, W, 17, 3) in the world; NaN where not known."""

    def __post_init__(self) -> None:
        freeze(self, np.int64, t_ns=(None,))
        freeze(self, np.float64, joints_m=(len(self.t_ns), None, 17, 3))

    def at(self, number: Ints, t_ns: Ints) -> Truth:
        """The truth at instants (I,) of these numbers and rig times: on straight lines between its own times, and
        nothing before the first and after the last of them."""
        inside = (t_ns >= self.t_ns[0]) & (t_ns <= self.t_ns[-1])
        asked_ns, numbers = t_ns[inside], number[inside]
        after = np.searchsorted(self.t_ns, asked_ns)  # the first that is not earlier
        before = np.where(self.t_ns[after] == asked_ns, after, after - 1)
        span_ns = np.maximum(self.t_ns[after] - self.t_ns[before], 1)
        part = ((asked_ns - self.t_ns[before]) / span_ns)[:, None, None, None]
        truth = Truth.of((1 - part) * self.joints_m[before] + part * self.joints_m[after])
        return Truth(numbers[truth.frame], truth.person, truth.joints_m)
