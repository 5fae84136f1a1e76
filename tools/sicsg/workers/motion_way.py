"""A walk along ground points: corners rounded, speed constant but for the start and the end, turning on the way."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.workers.gait import Stance
from tools.sicsg.workers.ik import smooth, wrapped

Floats = NDArray[np.float64]

_CORNER_M = 0.35
"""How much of each leg a rounded corner takes at the most."""
_SPACING_M, _TURNING = 0.02, 30
"""Between points of the way, and over how many of them the walker turns round a corner."""
_TURN_RAD_PER_S = 4.0
"""How fast the walker turns into the way at the most; on a short way back, this leaves them walking backwards."""
_EASE_S = 0.35
"""How long it takes to come to full speed, and to stop."""


@dataclass(frozen=True, slots=True, eq=False)
class Walk:
    """A way with a time table."""

    points_m: Floats
    """(N, 2) points close together."""
    lengths_m: Floats
    """(N,) along the way."""
    headings: Floats
    """(N,) direction of the way, without jumps."""
    start_s: float
    end_s: float
    turn_rad: float
    """By how much the walker faces aside of the way at its start."""
    turned_m: float
    """After how much of the way the walker faces along it."""
    z: float
    on: str

    @property
    def length_m(self) -> float:
        """Of the whole way."""
        return float(self.lengths_m[-1])

    @property
    def _ease_s(self) -> float:
        return min(_EASE_S, 0.3 * (self.end_s - self.start_s))

    @property
    def speed_m_per_s(self) -> float:
        """Between start and stop."""
        return self.length_m / (self.end_s - self.start_s - self._ease_s)

    def distance_at(self, t_s: float) -> float:
        """How far the walker has come."""
        ease, speed = self._ease_s, self.speed_m_per_s
        t = min(max(t_s, self.start_s), self.end_s) - self.start_s
        left = self.end_s - self.start_s - t
        if t < ease:
            return speed * t * t / (2 * ease)
        if left < ease:
            return self.length_m - speed * left * left / (2 * ease)
        return speed * (t - ease / 2)

    def time_at(self, distance_m: float) -> float:
        """When the walker has come so far."""
        ease, speed, length = self._ease_s, self.speed_m_per_s, self.length_m
        d = min(max(distance_m, 0.0), length)
        eased = speed * ease / 2
        if d < eased:
            return self.start_s + math.sqrt(2 * ease * d / speed)
        if length - d < eased:
            return self.end_s - math.sqrt(2 * ease * (length - d) / speed)
        return self.start_s + d / speed + ease / 2

    def place(self, distance_m: float) -> Stance:
        """Where the walker is and faces at a distance."""
        x, y, heading = (
            float(np.interp(distance_m, self.lengths_m, values))
            for values in (self.points_m[:, 0], self.points_m[:, 1], self.headings)
        )
        yaw = heading + self.turn_rad * (1.0 - smooth(distance_m / self.turned_m))
        return Stance(x, y, self.z, yaw, self.on)

    def place_at(self, t_s: float) -> Stance:
        """Where the walker is at a time."""
        return self.place(self.distance_at(t_s))


def walk_of(
    path_m: Floats, start_s: float, end_s: float, yaw_rad: float | None, z: float = 0.0, on: str = "floor"
) -> Walk:
    """A walk along a polyline (K, 2), of somebody who faces ``yaw_rad`` at its start (None: along the way)."""
    lengths, points = _rounded(path_m)
    steps = np.diff(points, axis=0)
    directions = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    width = 2 * (min(_TURNING, len(directions)) // 2) + 1
    padded = np.pad(directions, width // 2, mode="edge")
    headings = np.convolve(padded, np.full(width, 1 / width), mode="valid")
    headings = np.append(headings, headings[-1])
    turn = 0.0 if yaw_rad is None else wrapped(yaw_rad - float(headings[0]))
    if yaw_rad is not None:
        headings = headings + (yaw_rad - turn - float(headings[0]))
    speed = float(lengths[-1]) / (end_s - start_s)
    turned = max(0.45 + 0.22 * abs(turn), 1.5 * abs(turn) * speed / _TURN_RAD_PER_S)
    return Walk(points, lengths, headings, start_s, end_s, turn, turned, z, on)


def _rounded(path_m: Floats) -> tuple[Floats, Floats]:
    """Lengths (N,) and points (N, 2), evenly spaced, along a polyline whose corners are replaced by parabolas."""
    path = path_m[np.append(True, np.linalg.norm(np.diff(path_m, axis=0), axis=1) > 1e-6)]
    pieces = [path[:1]]
    for before, corner, after in zip(path[:-2], path[1:-1], path[2:], strict=True):
        first, last = (
            corner + (end - corner) * min(_CORNER_M / np.linalg.norm(end - corner), 0.5) for end in (before, after)
        )
        u = np.linspace(0.0, 1.0, 24)[:, None]
        pieces.append((1 - u) ** 2 * first + 2 * u * (1 - u) * corner + u**2 * last)
    points = np.concatenate([*pieces, path[-1:]])
    lengths = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    even = np.linspace(0.0, lengths[-1], max(2, math.ceil(lengths[-1] / _SPACING_M)))
    return even, np.stack([np.interp(even, lengths, points[:, axis]) for axis in range(2)], axis=1)
