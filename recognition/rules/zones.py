"""Places of a site that a rule file declares: zones on the floor, and openings for windows."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from recognition.rules.extents import Board, Plan, inside_m


@dataclass(frozen=True, slots=True)
class Zone:
    """A polygon on the floor with a range of heights; metres in the world frame."""

    name: str
    corners_m: Plan
    low_m: float = -inf
    high_m: float = inf

    def inside_m(self, x: float, y: float, z: float) -> float:
        """How far inside a point is; negative outside, where it is the distance to the nearest border."""
        level = min(z - self.low_m, self.high_m - z)
        return min(inside_m(self.corners_m, x, y), level)

    def distance_m(self, x: float, y: float) -> float:
        """How far a point is from the polygon on the plan; 0 inside."""
        return max(0.0, -inside_m(self.corners_m, x, y))


@dataclass(frozen=True, slots=True)
class Opening:
    """An upright rectangle in a wall, where a window is mounted; metres in the world frame."""

    name: str
    from_m: tuple[float, float]
    to_m: tuple[float, float]
    """Ends of its lower edge on the plan."""
    low_m: float
    high_m: float

    @property
    def board(self) -> Board:
        """The rectangle."""
        (ax, ay), (bx, by) = self.from_m, self.to_m
        low, high = self.low_m, self.high_m
        board = Board.through([(ax, ay, low), (bx, by, low), (bx, by, high), (ax, ay, high)])
        if board is None:
            raise ValueError(f"opening {self.name}: expected an extent, got {self}")
        return board
