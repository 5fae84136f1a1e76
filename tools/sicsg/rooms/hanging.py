"""Props that hang: on the wall (origin at the wall, +x into the room) or under the ceiling (origin at its face)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tools.sicsg.mesh import Material, Mesh, build, join
from tools.sicsg.rooms.finish import Finish
from tools.sicsg.shapes import box, cylinder, tube

Size = tuple[float, float, float]


def _sign(finish: Finish) -> Mesh:
    """A sign or paper; its whole texture once."""
    wide, tall = finish.rng.uniform(0.2, 0.8), finish.rng.uniform(0.25, 0.9)
    paper = Material((0.95, 0.95, 0.95), 0.5, texture=finish.texture("poster"), texture_m=1.0)
    corners = np.array([(0.01, -wide / 2, -tall / 2), (0.01, wide / 2, -tall / 2),
                        (0.01, wide / 2, tall / 2), (0.01, -wide / 2, tall / 2)])  # fmt: skip
    uv = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    board = box((0.008, wide, tall), Material((0.6, 0.6, 0.6), 0.6), centre_m=(0.005, 0, 0))
    return join([board, build(corners, faces, paper, uv_m=uv[faces])])


def _conduits(finish: Finish) -> Mesh:
    """Pipes that run up the wall to some height."""
    rng, top = finish.rng, float(finish.rng.uniform(0.2, 1.05))
    pieces, colour = [], ((0.55, 0.55, 0.57), (0.75, 0.75, 0.73), (0.6, 0.28, 0.12))[int(rng.integers(3))]
    material, radius = finish.material(("plastic", "metal")[int(rng.integers(2))], colour), rng.uniform(0.01, 0.05)
    for index in range(int(rng.integers(1, 5))):
        y, low = index * radius * 3.2, rng.uniform(0.0, 1.0) - 1.5
        pieces.append(tube([(radius + 0.02, y, low), (radius + 0.02, y, top)], radius, material))
    return join(pieces)


def _wall_box(finish: Finish) -> Mesh:
    wide, tall, deep = finish.rng.uniform((0.1, 0.15, 0.06), (0.5, 0.7, 0.2))
    case = Material(finish.grey(0.3, 0.9), 0.4)
    door = box((0.01, wide * 0.9, tall * 0.92), Material(finish.grey(0.3, 0.9), 0.4), centre_m=(deep, 0, 0))
    return join([box((deep, wide, tall), case, centre_m=(deep / 2, 0, 0), bevel_m=0.006), door])


def _duct(finish: Finish, room_size_m: Size) -> Mesh:
    """An air duct along y."""
    rng, length = finish.rng, room_size_m[1]
    zinc, drop = finish.material("metal", finish.grey(0.75, 1.0)), 0.06
    if rng.random() < 0.5:
        radius = float(rng.uniform(0.1, 0.2))
        z = -drop - radius
        pieces = [cylinder((0, -length / 2, z), (0, length / 2, z), radius, zinc, sides=20)]
        seam = [(radius * 2.12, 0.03)] * 2
    else:
        wide, tall = float(rng.uniform(0.25, 0.6)), float(rng.uniform(0.15, 0.32))
        z = -drop - tall / 2
        pieces = [box((wide, length, tall), zinc, centre_m=(0, 0, z))]
        seam = [(wide + 0.05, 0.03), (tall + 0.05, 0.03)]
    collar = finish.material("metal", finish.grey(0.5, 0.8))
    for y in np.arange(-length / 2 + 0.6, length / 2 - 0.1, 1.2):
        pieces.append(box((seam[0][0], 0.03, seam[1][0]), collar, centre_m=(0, y, z)))
    return join(pieces)


def _ceiling_pipes(finish: Finish, room_size_m: Size) -> Mesh:
    """Pipes and a tray of cables along y."""
    rng, length, pieces, x = finish.rng, room_size_m[1], [], 0.0
    for _pipe in range(int(rng.integers(2, 6))):
        radius = float(rng.uniform(0.015, 0.06))
        paint = finish.paint() if rng.random() < 0.3 else finish.grey(0.3, 0.9)
        ends = (x, -length / 2, -0.08 - radius), (x, length / 2, -0.08 - radius)
        pieces.append(cylinder(*ends, radius, Material(paint, 0.4, 0.2), sides=10))
        x += radius + float(rng.uniform(0.08, 0.16))
    if rng.random() < 0.5:
        steel = finish.material("metal", finish.grey(0.6, 0.9))
        pieces.append(box((0.25, length, 0.012), steel, centre_m=(x + 0.15, 0, -0.16)))
        pieces += [box((0.012, length, 0.06), steel, centre_m=(x + s, 0, -0.13)) for s in (0.03, 0.27)]
    return join(pieces)


def hanging_cable(finish: Finish) -> Mesh:
    """A cable that hangs down, with a bulb holder or a loop at its end."""
    rng, black = finish.rng, Material(finish.grey(0.03, 0.3), 0.5)
    length, sway = float(rng.uniform(0.3, 1.0)), rng.uniform(-0.1, 0.1, 2)
    path = [(0.0, 0.0, 0.0), (sway[0], sway[1], -length / 2), (*(sway * 0.5), -length)]
    end = np.array(path[-1])
    return join([tube(path, 0.006, black, sides=5), cylinder(end, end - [0, 0, 0.08], 0.022, black)])


ON_WALL: dict[str, Callable[[Finish], Mesh]] = {"sign": _sign, "wall_box": _wall_box, "conduits": _conduits}
BETWEEN_WALLS: dict[str, Callable[[Finish, Size], Mesh]] = {"duct": _duct, "ceiling_pipes": _ceiling_pipes}
ON_WALL_HEIGHT_M = 1.5
"""Height of the origin of what hangs on a wall."""
