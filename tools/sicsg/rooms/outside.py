"""What one sees through the openings: ground, buildings, trees, a fence. The sky is the renderers'."""

from __future__ import annotations

import numpy as np

from tools.sicsg.mesh import Material, Mesh, join
from tools.sicsg.rooms.finish import Finish
from tools.sicsg.rooms.shell import is_door
from tools.sicsg.rooms.walls import Wall, quad
from tools.sicsg.scene import Room
from tools.sicsg.shapes import cylinder, ellipsoid

_FAR_M = 70.0
_STOREY_M = 3.1


def outside(room: Room) -> Mesh:
    """The surroundings on the sides that have windows; the room lies on some storey."""
    finish = Finish.of("room/outside", room.name)
    ground = -0.3 - _STOREY_M * int(finish.rng.choice([0, 0, 0, 1, 2, 4]))
    earth = Material(((0.2, 0.19, 0.17), (0.1, 0.17, 0.05), (0.3, 0.26, 0.2))[int(finish.rng.integers(3))], 0.95)
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * _FAR_M + [0, 0, ground]
    pieces = [quad(corners, np.array([0.0, 0.0, 1.0]), earth)]
    for name in sorted({opening.wall for opening in room.openings if not is_door(opening)}):
        pieces += _street(Wall.of(room, name), ground, finish)
    return join(pieces)


def _street(wall: Wall, ground: float, finish: Finish) -> list[Mesh]:
    rng = finish.rng
    pieces, u = [], -float(rng.uniform(12, 25))
    while u < 15:
        width = float(rng.uniform(7, 16))
        if rng.random() < 0.75:
            near = float(rng.uniform(9, 28))
            pieces += _building(wall, (u, u + width), near, ground, finish)
        u += width + float(rng.uniform(0.5, 8))
    if ground > -4:
        for _ in range(int(rng.integers(0, 4))):
            pieces += _tree(wall.point(float(rng.uniform(-12, 12)), ground, float(rng.uniform(4, 9))), finish)
    if ground > -1 and rng.random() < 0.5:
        near, paint = float(rng.uniform(3, 7)), Material(finish.paint(), 0.6)
        pieces.append(
            wall.block((-14, ground + 0.1, 14, ground + float(rng.uniform(0.9, 2.0))), (near, near + 0.04), paint)
        )
    return pieces


def _building(wall: Wall, along: tuple[float, float], near: float, ground: float, finish: Finish) -> list[Mesh]:
    """A block with rows of windows."""
    rng, (u0, u1) = finish.rng, along
    storeys = int(rng.integers(1, 8))
    kind = ("plaster", "brick", "concrete", "block")[int(rng.integers(4))]
    facade = finish.material(kind, finish.grey(0.4, 0.95))
    pieces = [wall.block((u0, ground, u1, ground + storeys * _STOREY_M + 0.6), (near, near + 9), facade)]
    glass = Material((0.05, 0.06, 0.08), 0.1)
    pitch, width, height = rng.uniform(1.8, 3.2), rng.uniform(0.8, 1.6), rng.uniform(1.1, 1.9)
    for storey in range(storeys):
        for u in np.arange(u0 + 0.9, u1 - width - 0.5, pitch):
            z = ground + storey * _STOREY_M + 0.9
            pieces.append(wall.quad((u, z, u + width, z + height), near - 0.02, glass))
    return pieces


def _tree(foot_m: np.ndarray, finish: Finish) -> list[Mesh]:
    rng, height = finish.rng, float(finish.rng.uniform(2.5, 6))
    leaves = Material((0.05 * rng.uniform(0.6, 2), 0.14 * rng.uniform(0.6, 1.5), 0.03), 0.95)
    bark = Material((0.1, 0.07, 0.05), 0.95)
    pieces = [cylinder(foot_m, foot_m + [0, 0, height * 0.6], 0.12, bark, sides=6)]
    for _ in range(3):
        centre = foot_m + [*rng.uniform(-0.7, 0.7, 2), height * rng.uniform(0.55, 0.95)]
        pieces.append(ellipsoid(rng.uniform(0.7, 1.4, 3), leaves, centre_m=centre, sides=10))
    return pieces
