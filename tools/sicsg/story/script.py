"""A worker's script: actions one after the other, each starting where and when the one before ends."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

from tools.sicsg.scene import Action, Vector3

_PACE_M_PER_S = 1.15


class Script:
    """Collects a worker's actions. Times are seconds from the scene's start."""

    def __init__(self, worker: str, at: tuple[float, float], yaw_rad: float, duration_s: float) -> None:
        self.worker = worker
        self.at, self.yaw_rad, self.t_s, self.duration_s = at, yaw_rad, 0.0, duration_s
        self._actions: list[Action] = []

    def _add(self, verb: str, until_s: float, **entries: Any) -> None:
        if until_s > self.t_s + 1e-6:
            self._actions.append(Action(verb=verb, start_s=self.t_s, end_s=until_s, **entries))
            self.t_s = until_s

    def _place(self) -> Vector3:
        return (self.at[0], self.at[1], 0.0)

    def still(self, verb: str, until_s: float, look_m: Vector3 | None = None, yaw_rad: float | None = None) -> Script:
        """Stand, crouch or work where one is."""
        if yaw_rad is not None:
            self.yaw_rad = yaw_rad
        elif look_m is not None:
            self.yaw_rad = math.atan2(look_m[1] - self.at[1], look_m[0] - self.at[0])
        self._add(verb, until_s, at_m=self._place(), yaw_rad=self.yaw_rad, look_m=look_m)
        return self

    def walk(self, *points: tuple[float, float], pace_m_per_s: float = _PACE_M_PER_S) -> Script:
        """Walk along points."""
        path = [self.at, *points]
        length = sum(math.dist(one, two) for one, two in pairwise(path))
        if length < 0.05:
            return self
        self._add("walk", self.t_s + max(length / pace_m_per_s, 0.4), path_m=tuple((x, y, 0.0) for x, y in path))
        self.at = points[-1]
        self.yaw_rad = math.atan2(path[-1][1] - path[-2][1], path[-1][0] - path[-2][0])
        return self

    def walk_time(self, *points: tuple[float, float], pace_m_per_s: float = _PACE_M_PER_S) -> float:
        """How long :meth:`walk` would take."""
        path = [self.at, *points]
        length = sum(math.dist(one, two) for one, two in pairwise(path))
        return 0.0 if length < 0.05 else max(length / pace_m_per_s, 0.4)

    def use(
        self, verb: str, thing: str, until_s: float, at: tuple[float, float], yaw_rad: float, **entries: Any
    ) -> Script:
        """Climb, hold, carry or mount a thing; afterwards one is at ``at``."""
        self._add(verb, until_s, thing=thing, **entries)
        self.at, self.yaw_rad = at, yaw_rad
        return self

    def finished(self) -> tuple[Action, ...]:
        """The actions until the scene's end."""
        if self.t_s < self.duration_s:
            self.still("stand", self.duration_s)
        return tuple(self._actions)
