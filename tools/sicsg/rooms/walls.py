"""Walls with openings cut out: where a wall lies, its rectangles, their meshes.

A place on a wall is (u, z, depth): u the world's coordinate along it, z the height, depth metres outwards from its
inner face.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.mesh import Material, Mesh, build, join
from tools.sicsg.scene import Opening, Room
from tools.sicsg.shapes import box

Floats = NDArray[np.float64]
WallName = Literal["-x", "+x", "-y", "+y"]
WALLS: tuple[WallName, ...] = get_args(WallName)
_AXES: Floats = np.eye(3)
_SLIVER_M = 1e-6
Rectangle = tuple[float, float, float, float]
"""u0, z0, u1, z1 on a wall."""


@dataclass(frozen=True, slots=True)
class Wall:
    """One wall of a room."""

    name: WallName
    half_m: float
    """Distance of its inner face from the middle of the room."""
    width_m: float
    height_m: float

    @classmethod
    def of(cls, room: Room, name: WallName) -> Wall:
        """The wall of a room."""
        x, y, height = room.size_m
        return cls(name, x / 2, y, height) if name[1] == "x" else cls(name, y / 2, x, height)

    @property
    def outward(self) -> Floats:
        """(3,) unit vector out of the room."""
        return np.asarray(_AXES["xy".index(self.name[1])] * (1.0 if self.name[0] == "+" else -1.0))

    def point(self, u: float, z: float, depth: float) -> Floats:
        """(3,) a place in the world."""
        along = _AXES[1 - "xy".index(self.name[1])]
        return np.asarray(along * u + self.outward * (self.half_m + depth) + _AXES[2] * z)

    def quad(self, area: Rectangle, depth: float, material: Material, *, facing_in: bool = True) -> Mesh:
        """An upright rectangle, seen from inside or from outside."""
        u0, z0, u1, z1 = area
        corners = [self.point(u, z, depth) for u, z in ((u0, z0), (u1, z0), (u1, z1), (u0, z1))]
        return quad(corners, -self.outward if facing_in else self.outward, material)

    def block(self, area: Rectangle, depths: tuple[float, float], material: Material) -> Mesh:
        """A box on or in the wall."""
        ends = np.array([self.point(*area[:2], depths[0]), self.point(*area[2:], depths[1])])
        return box(np.abs(ends[1] - ends[0]), material, centre_m=ends.mean(axis=0))


def quad(corners_m: Sequence[Floats] | Floats, facing: Floats, material: Material) -> Mesh:
    """A plane quadrilateral (4, 3) that is seen from the side ``facing`` points to."""
    corners = np.asarray(corners_m, dtype=np.float64)
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    order = [0, 1, 2, 0, 2, 3] if normal @ facing > 0 else [0, 2, 1, 0, 3, 2]
    return build(corners, order, material)


def hole(opening: Opening) -> Rectangle:
    """What an opening cuts out of its wall."""
    (u, z), (width, height) = opening.centre_m, opening.size_m
    return u - width / 2, z - height / 2, u + width / 2, z + height / 2


def cut(area: Rectangle, holes: Sequence[Rectangle]) -> list[Rectangle]:
    """The rest of a rectangle without the holes, as rectangles that share whole edges or none.

    What is narrower than :data:`_SLIVER_M` is left out: edges that meet but for rounding enclose no volume.
    """
    u0, z0, u1, z1 = area
    columns = sorted({u0, u1, *(float(np.clip(v, u0, u1)) for h in holes for v in (h[0], h[2]))})
    rows = sorted({z0, z1, *(float(np.clip(v, z0, z1)) for h in holes for v in (h[1], h[3]))})
    return [
        (a, low, b, high)
        for a, b in pairwise(columns)
        for low, high in pairwise(rows)
        if min(b - a, high - low) > _SLIVER_M
        and not any(h[0] < (a + b) / 2 < h[2] and h[1] < (low + high) / 2 < h[3] for h in holes)
    ]


def reveals(wall: Wall, area: Rectangle, depths: tuple[float, float], material: Material) -> Mesh:
    """The four inner faces of an opening between two depths."""
    u0, z0, u1, z1 = area
    middle = wall.point((u0 + u1) / 2, (z0 + z1) / 2, sum(depths) / 2)
    edges = (((u0, z0), (u1, z0)), ((u1, z0), (u1, z1)), ((u1, z1), (u0, z1)), ((u0, z1), (u0, z0)))
    (near, far), sides = depths, []
    for start, end in edges:
        places = ((*start, near), (*end, near), (*end, far), (*start, far))
        corners = np.array([wall.point(*place) for place in places])
        sides.append(quad(corners, middle - corners.mean(axis=0), material))
    return join(sides)
