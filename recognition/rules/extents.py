"""What objects occupy: oriented rectangles through keypoints, axes of ladders, and polygons on the floor.

Plain floats throughout: a rule asks for a few distances at an instant, for which arrays are slower than arithmetic.
Points are ``(x, y, z)`` in metres, z up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, inf, isnan, sqrt
from typing import TypeAlias

from recognition.rules.vocabulary import Shape

Point: TypeAlias = tuple[float, float, float]
Plan: TypeAlias = tuple[tuple[float, float], ...]
"""Corners of a polygon on the floor, in turn."""

_IN_TURN = {"ladder": (0, 1, 3, 2), "deck": (0, 1, 2, 3), "pane": (0, 1, 2, 3)}
_LEAST_M = 0.02
"""Keypoints nearer to each other than this do not span a rectangle."""


@dataclass(frozen=True, slots=True)
class Board:
    """A flat rectangle in space."""

    centre: Point
    along: Point
    across: Point
    """Unit vectors of its sides, at right angles."""
    half_along_m: float
    half_across_m: float

    def distance_m(self, x: float, y: float, z: float) -> float:
        """How far a point is from it; 0 on it."""
        cx, cy, cz = self.centre
        x, y, z = x - cx, y - cy, z - cz
        ax, ay, az = self.along
        bx, by, bz = self.across
        a, b = ax * x + ay * y + az * z, bx * x + by * y + bz * z
        off = x * x + y * y + z * z - a * a - b * b
        a = abs(a) - self.half_along_m
        b = abs(b) - self.half_across_m
        if a > 0.0:
            off += a * a
        if b > 0.0:
            off += b * b
        return sqrt(off) if off > 0.0 else 0.0

    @classmethod
    def through(cls, corners: Sequence[Point]) -> Board | None:
        """The rectangle nearest to four corners in turn; None where they do not span one."""
        (ax, ay, az), (bx, by, bz), (cx, cy, cz), (dx, dy, dz) = corners
        ux, uy, uz = bx - ax + cx - dx, by - ay + cy - dy, bz - az + cz - dz
        vx, vy, vz = dx - ax + cx - bx, dy - ay + cy - by, dz - az + cz - bz
        u = sqrt(ux * ux + uy * uy + uz * uz)
        if u < 4 * _LEAST_M:
            return None
        ux, uy, uz = ux / u, uy / u, uz / u
        skew = vx * ux + vy * uy + vz * uz
        vx, vy, vz = vx - skew * ux, vy - skew * uy, vz - skew * uz
        v = sqrt(vx * vx + vy * vy + vz * vz)
        if v < 4 * _LEAST_M:
            return None
        centre = ((ax + bx + cx + dx) / 4, (ay + by + cy + dy) / 4, (az + bz + cz + dz) / 4)
        return cls(centre, (ux, uy, uz), (vx / v, vy / v, vz / v), u / 4, v / 4)


@dataclass(frozen=True, slots=True)
class Axis:
    """A ladder's middle line, from between its feet to between its tops."""

    foot: Point
    top: Point

    def distance_m(self, x: float, y: float, z: float) -> float:
        """How far a point is from it."""
        (fx, fy, fz), (tx, ty, tz) = self.foot, self.top
        ux, uy, uz = tx - fx, ty - fy, tz - fz
        square = ux * ux + uy * uy + uz * uz
        along = ((x - fx) * ux + (y - fy) * uy + (z - fz) * uz) / square if square > 0.0 else 0.0
        along = min(max(along, 0.0), 1.0)
        return sqrt((x - fx - along * ux) ** 2 + (y - fy - along * uy) ** 2 + (z - fz - along * uz) ** 2)

    def level_distance_m(self, x: float, y: float, z: float) -> float:
        """How far a point is from it on the point's own level; from its nearer end, above and below."""
        (fx, fy, fz), (tx, ty, tz) = self.foot, self.top
        along = (z - fz) / (tz - fz) if tz - fz > _LEAST_M else 0.0
        along = min(max(along, 0.0), 1.0)
        return hypot(x - fx - along * (tx - fx), y - fy - along * (ty - fy))


class Body:
    """All that keypoints tell of an object; its parts are made when they are asked for.

    Args:
        shape: Of its class.
        corners: Four keypoints in turn.
    """

    __slots__ = ("_board", "_footprint", "axis", "bottom", "corners", "top_m")

    def __init__(self, shape: Shape, corners: Sequence[Point]) -> None:
        self.corners = corners
        self._board: Board | None = None
        self._footprint: Board | None = None
        self.axis: Axis | None = None
        """Of ladders."""
        if shape == "ladder":
            self.axis = Axis(_middle(corners[0], corners[1]), _middle(corners[2], corners[3]))
        self.top_m = (corners[0][2] + corners[1][2] + corners[2][2] + corners[3][2]) / 4
        """Of decks: height of what one stands on."""
        first, second = sorted(corners, key=_height)[:2]
        x, y, _ = _middle(first, second)
        self.bottom: Point = (x, y, first[2])
        """Middle of its lower edge."""

    @property
    def board(self) -> Board | None:
        """The rectangle; None where the keypoints do not span one."""
        if self._board is None:
            self._board = Board.through(self.corners)
        return self._board

    @property
    def footprint(self) -> Board | None:
        """What a deck covers of the floor, at height 0; None where the keypoints do not span it."""
        if self._footprint is None:
            self._footprint = Board.through([(x, y, 0.0) for x, y, _ in self.corners])
        return self._footprint

    @classmethod
    def of(cls, shape: Shape, keypoints: Sequence[Sequence[float]]) -> Body | None:
        """From four keypoints in the order of its class, one of which may be NaN; None where more are."""
        corners = _completed([_point(keypoints[index]) for index in _IN_TURN[shape]])
        return None if corners is None else cls(shape, corners)


def _point(values: Sequence[float]) -> Point:
    x, y, z = values
    return x, y, z


def _height(point: Point) -> float:
    return point[2]


def _middle(a: Point, b: Point) -> Point:
    return (a[0] + b[0]) / 2, (a[1] + b[1]) / 2, (a[2] + b[2]) / 2


def _completed(corners: list[Point]) -> list[Point] | None:
    """Four corners in turn, one of which may follow from the others: a rectangle's diagonals share their middle."""
    missing = [index for index, corner in enumerate(corners) if isnan(corner[0])]
    if len(missing) > 1:
        return None
    if missing:
        at = missing[0]
        a, b, c = corners[at - 3], corners[at - 2], corners[at - 1]
        corners[at] = (a[0] + c[0] - b[0], a[1] + c[1] - b[1], a[2] + c[2] - b[2])
    return corners


def inside_m(plan: Plan, x: float, y: float) -> float:
    """How far inside a polygon a point is; negative outside of it, by how far."""
    nearest, is_inside = inf, False
    ax, ay = plan[-1]
    for bx, by in plan:
        ux, uy = bx - ax, by - ay
        along = min(max(((x - ax) * ux + (y - ay) * uy) / (ux * ux + uy * uy), 0.0), 1.0)
        nearest = min(nearest, hypot(x - ax - along * ux, y - ay - along * uy))
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * ux:
            is_inside = not is_inside
        ax, ay = bx, by
    return nearest if is_inside else -nearest
