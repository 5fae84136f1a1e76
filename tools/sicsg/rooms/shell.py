"""Floor, walls and ceiling of a room, and what closes its openings."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from tools.sicsg.mesh import Material, Mesh, box_uv, build, join
from tools.sicsg.rooms.finish import Finish, surface
from tools.sicsg.rooms.walls import WALLS, Wall, cut, hole, quad, reveals
from tools.sicsg.scene import Opening, Room
from tools.sicsg.shapes import box

THICKNESS_M = 0.22
CAVITY_M = 0.1
"""Between the boards and the body of a lined wall: the depth of its studs."""
_BAY_M, _STUD_M = 1.2, 0.045
_SHEET_M = (1.22, 2.44)
_GLASS = Material((0.93, 0.96, 0.95), roughness=0.02, transmission=1.0)
_FILM = Material((0.96, 0.97, 0.97), roughness=0.2, transmission=1.0)
_UP = np.array([0.0, 0.0, 1.0])


def is_door(opening: Opening) -> bool:
    """Whether the opening reaches the floor."""
    return opening.centre_m[1] - opening.size_m[1] / 2 < 0.02


def shell(room: Room) -> Mesh:
    """Everything of the room that is built in: entity 0."""
    finish = Finish.of("room/shell", room.name)
    depth = CAVITY_M if room.wall_texture.startswith("drywall/") else 0.0
    outer = depth + THICKNESS_M
    pieces = [_floor(room, outer, finish), *_ceiling(room, outer, finish)]
    inside, lintel = surface(room.wall_texture, room.wall_colour), finish.material("concrete", finish.grey(0.5, 0.9))
    body = finish.material(("block", "concrete", "osb")[int(finish.rng.integers(3))], finish.grey(0.6, 0.9))
    for name in WALLS:
        wall = Wall.of(room, name)
        openings = [opening for opening in room.openings if opening.wall == name]
        holes = [hole(opening) for opening in openings]
        half = wall.width_m / 2
        around = (-half - outer, 0.0, half + outer, wall.height_m)
        if depth:
            pieces += _lining(wall, holes, inside, finish)
            whole = (-half - depth, 0.0, half + depth, wall.height_m)
            pieces += [wall.quad(part, depth, body) for part in cut(whole, holes)]
        else:
            whole = (-half, 0.0, half, wall.height_m)
            pieces += [wall.quad(part, 0.0, inside) for part in cut(whole, holes)]
        pieces += [wall.quad(part, outer, lintel, facing_in=False) for part in cut(around, holes)]
        for opening, area in zip(openings, holes, strict=True):
            pieces.append(reveals(wall, area, (0.0, outer), lintel))
            pieces += _closed(wall, opening, outer, finish)
    return join(pieces)


def _floor(room: Room, outer: float, finish: Finish) -> Mesh:
    """The slab under the room and its covering; boards of plywood lie side by side."""
    x, y, _ = room.size_m
    material = surface(room.floor_texture, room.floor_colour)
    slab = box((x + 2 * outer, y + 2 * outer, 0.25), material, centre_m=(0, 0, -0.125))
    if not room.floor_texture.startswith(("plywood/", "osb/")):
        return slab
    sheets = [slab.moved(np.eye(4) + np.outer([0, 0, 1, 0], [0, 0, 0, -0.002]))]
    for x0 in np.arange(-x / 2, x / 2, _SHEET_M[0]):
        for y0 in np.arange(-y / 2, y / 2, _SHEET_M[1]):
            x1, y1 = min(x0 + _SHEET_M[0] - 0.005, x / 2), min(y0 + _SHEET_M[1] - 0.005, y / 2)
            shade = finish.rng.choice([0.88, 0.94, 1.0])
            sheets.append(
                _sheet((x0, y0, x1, y1), surface(room.floor_texture, _scaled(room.floor_colour, shade)), finish)
            )
    return join(sheets)


def _sheet(area: tuple[float, float, float, float], material: Material, finish: Finish) -> Mesh:
    x0, y0, x1, y1 = area
    corners, faces = (
        np.array([(x0, y0, 0), (x1, y0, 0), (x1, y1, 0), (x0, y1, 0)], np.float32),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    return build(corners, faces, material, uv_m=box_uv(corners, faces) + finish.rng.uniform(0, 2, 2))


def _scaled(colour: tuple[float, float, float], share: float) -> tuple[float, float, float]:
    return (colour[0] * share, colour[1] * share, colour[2] * share)


def _ceiling(room: Room, outer: float, finish: Finish) -> list[Mesh]:
    """The slab above; wooden ones lie on joists, others sometimes on beams."""
    x, y, height = room.size_m
    material = surface(room.ceiling_texture, finish.grey(0.75, 1.0))
    pieces = [box((x + 2 * outer, y + 2 * outer, 0.25), material, centre_m=(0, 0, height + 0.125))]
    if room.ceiling_texture.startswith(("plywood/", "osb/", "wood/")):
        wood = finish.material("wood", (0.9, 0.85, 0.8))
        places, size = np.arange(-x / 2 + 0.3, x / 2, 0.6), (0.05, y, 0.2)
    else:
        wood = finish.material("concrete", finish.grey(0.6, 0.9))
        places, size = np.linspace(-x / 2, x / 2, int(finish.rng.integers(2, 5)))[1:-1], (0.25, y, 0.22)
    return pieces + [box(size, wood, centre_m=(place, 0, height - size[2] / 2)) for place in places]


def _lining(wall: Wall, holes: list[tuple[float, float, float, float]], board: Material, finish: Finish) -> list[Mesh]:
    """Boards on studs; some bays still show the studs, some of these their insulation."""
    rng, half, height = finish.rng, wall.width_m / 2, wall.height_m
    steel = finish.material(("metal", "wood")[int(rng.integers(2))], finish.grey(0.7, 0.95))
    wool, done, insulated = finish.material("insulation"), rng.uniform(0.3, 1.0), rng.uniform(0.0, 0.8)
    pieces = []
    for u0 in np.arange(-half, half - 1e-6, _BAY_M):
        bay = (u0, 0.0, min(u0 + _BAY_M, half), height)
        if rng.random() < done:
            pieces += [wall.quad(part, 0.0, board) for part in cut(bay, holes)]
            continue
        bars = [(u, 0.0, min(u + _STUD_M, half), height) for u in np.arange(u0, bay[2] - 0.02, _BAY_M / 2)]
        bars += [(u0, 0.0, bay[2], 0.04), (u0, height - 0.04, bay[2], height)]
        pieces += [wall.block(part, (0.0, CAVITY_M), steel) for bar in bars for part in cut(bar, holes)]
        if rng.random() < insulated:
            pieces += [wall.quad(part, 0.03, wool) for part in cut(bay, holes)]
    return pieces


def _closed(wall: Wall, opening: Opening, outer: float, finish: Finish) -> list[Mesh]:
    """A door with its leaf or a dark corridor behind it, a window with frame and pane, or the film before a raw one."""
    if is_door(opening):
        return _door(wall, opening, outer, finish)
    u0, z0, u1, z1 = area = hole(opening)
    if not opening.glazed:
        batten, edge = finish.material("wood", (0.8, 0.75, 0.7)), 0.04
        frame = cut(area, [(u0 + edge, z0 + edge, u1 - edge, z1 - edge)])
        pieces = [wall.block(part, (outer - 0.03, outer - 0.01), batten) for part in frame]
        return [*pieces, wall.quad(area, outer - 0.02, _FILM)]
    frame_material = Material(
        ((0.8, 0.8, 0.78), (0.12, 0.1, 0.09), (0.45, 0.46, 0.47))[int(finish.rng.integers(3))], 0.4
    )
    edge, middle = 0.06, outer * 0.55
    panes = int(np.clip(round((u1 - u0) / finish.rng.uniform(0.7, 1.6)), 1, 3))
    sides = np.linspace(u0 + edge / 2, u1 - edge / 2, panes + 1)
    gaps = [(a + edge / 2, z0 + edge, b - edge / 2, z1 - edge) for a, b in pairwise(sides)]
    pieces = [wall.block(part, (middle - 0.035, middle + 0.035), frame_material) for part in cut(area, gaps)]
    pieces.append(wall.block((u0 - 0.05, z0 - 0.03, u1 + 0.05, z0), (-0.08, middle), frame_material))
    return [*pieces, wall.quad((u0 + 0.02, z0 + 0.02, u1 - 0.02, z1 - 0.02), middle, _GLASS)]


def _door(wall: Wall, opening: Opening, outer: float, finish: Finish) -> list[Mesh]:
    u0, z0, u1, z1 = area = hole(opening)
    jamb = cut((u0 - 0.06, z0, u1 + 0.06, z1 + 0.06), [area])
    case = finish.material(("wood", "metal")[int(finish.rng.integers(2))], finish.grey(0.5, 1.0))
    pieces = [wall.block(part, (-0.015, 0.0), case) for part in jamb]
    if finish.rng.random() < 0.6:
        leaf = finish.material(("wood", "metal", "plywood")[int(finish.rng.integers(3))], finish.grey(0.4, 1.0))
        knob = (u1 - 0.14, 1.0, u1 - 0.03, 1.03)
        return [*pieces, wall.block((u0, 0.005, u1, z1), (0.05, 0.09), leaf), wall.block(knob, (0.0, 0.05), case)]
    back = finish.material("plaster", finish.grey(0.6, 1.0))
    far, (a, b, top) = outer + 1.8, (u0 - 0.5, u1 + 0.5, z1 + 0.3)
    pieces.append(wall.quad((a, 0.0, b, top), far, back))
    for z, up in ((0.0, _UP), (top, -_UP)):
        corners = [wall.point(u, z, d) for u, d in ((a, outer), (b, outer), (b, far), (a, far))]
        pieces.append(quad(np.array(corners), up, back))
    for u, sign in ((a, 1.0), (b, -1.0)):
        corners = [wall.point(u, z, d) for z, d in ((0, outer), (top, outer), (top, far), (0, far))]
        inwards = wall.point(u + sign, 0, 0) - wall.point(u, 0, 0)
        pieces.append(quad(np.array(corners), inwards, back))
    return pieces
