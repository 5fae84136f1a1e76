"""The arrangement of a room: size, surfaces, openings, and where props stand."""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.assets import Split, draw, is_sealed
from tools.sicsg.rooms.finish import Finish
from tools.sicsg.rooms.hanging import ON_WALL, ON_WALL_HEIGHT_M
from tools.sicsg.rooms.props import FLAT, STANDING, prop_mesh
from tools.sicsg.rooms.shell import is_door
from tools.sicsg.rooms.walls import WALLS, Wall, WallName, hole
from tools.sicsg.scene import Opening, Prop, Room

Floats = NDArray[np.float64]
MIDDLE_M = 4.2
"""Side of the square in the middle of the floor that no prop enters."""
_WORK_M = 3.2
"""From the middle, along x and y: what is stored further in stands at a wall."""
_STYLES = {  # walls, their colours (low, high grey), floors, ceilings
    "raw": (("concrete",), (0.7, 1.0), ("concrete", "dirt"), ("concrete",)),
    "blocks": (("block",), (0.6, 1.0), ("concrete", "dirt", "plywood"), ("concrete", "osb")),
    "brick": (("brick",), (0.55, 1.0), ("concrete", "dirt", "wood"), ("concrete", "wood", "plaster")),
    "lined": (("drywall",), (0.85, 1.0), ("concrete", "plywood", "osb", "dirt"), ("concrete", "drywall", "plywood")),
    "timber": (("osb", "wood"), (0.7, 1.0), ("osb", "plywood", "concrete"), ("osb", "plywood")),
    "painted": (("plaster", "drywall"), (0.9, 1.0), ("tiles", "wood", "plaster", "dirt"), ("plaster", "concrete")),
}
_TINTS = ((1.0, 1.0, 1.0), (1.0, 0.95, 0.82), (0.8, 0.92, 1.0), (0.85, 1.0, 0.85), (1.0, 0.85, 0.78))
_OVERHEAD_M = 2.2
"""What hangs higher is in nobody's way."""


@lru_cache(maxsize=512)
def room(name: str, split: Split) -> Room:
    """The room of this name.

    Raises:
        ValueError: where the name belongs to the other half of the names than the split does.
    """
    if is_sealed(name) != (split == "test"):
        half = "sealed names (for test alone)" if is_sealed(name) else "open names (not for test)"
        raise ValueError(f"room {name}: split {split!r}, but it is one of the {half}; draw the name with assets.draw")
    finish = Finish.of("room", name)
    rng = finish.rng
    x, y, z = (round(float(v), 2) for v in rng.uniform((7.0, 7.0, 2.6), (14.0, 12.0, 4.5)))
    style = list(_STYLES)[int(rng.integers(len(_STYLES)))]
    walls, greys, floors, ceilings = _STYLES[style]
    tint = _TINTS[int(rng.integers(len(_TINTS)))] if style == "painted" else (1.0, 1.0, 1.0)
    empty = Room(
        name=name,
        size_m=(x, y, z),
        wall_texture=finish.texture(str(rng.choice(walls))),
        floor_texture=finish.texture(str(rng.choice(floors))),
        ceiling_texture=finish.texture(str(rng.choice(ceilings))),
        wall_colour=_rounded(np.array(finish.grey(*greys)) * tint),
        floor_colour=_rounded(np.array(finish.grey(0.6, 1.0))),
        openings=(),
        props=(),
    )
    opened = empty.model_copy(update={"openings": _openings(empty, rng)})
    return opened.model_copy(update={"props": tuple(_Furnisher(opened, finish).furnish())})


def installation(room: Room) -> Opening:
    """The large raw opening where windows are to be mounted: the first."""
    return room.openings[0]


@lru_cache(maxsize=64)
def prop_bounds(room: Room) -> Floats:
    """(P, 2, 3) lowest and highest x, y, z of every prop that is not flat on the floor; read-only."""
    bounds = np.array([_bounds(prop, room) for prop in room.props if prop.kind not in FLAT]).reshape(-1, 2, 3)
    bounds.setflags(write=False)
    return bounds


def prop_footprints(room: Room) -> Floats:
    """(P, 4) x0 y0 x1 y1 of what stands on the floor or hangs lower than 2.2 m; flat things do not count."""
    bounds = prop_bounds(room)
    return bounds[bounds[:, 0, 2] < _OVERHEAD_M][:, :, :2].reshape(-1, 4)


def world_from_prop(prop: Prop) -> Floats:
    """(4, 4) where a prop's mesh stands."""
    matrix = np.eye(4)
    c, s = math.cos(prop.yaw_rad), math.sin(prop.yaw_rad)
    matrix[:2, :2], matrix[:3, 3] = ((c, -s), (s, c)), prop.position_m
    return matrix


def _bounds(prop: Prop, room: Room) -> tuple[Floats, Floats]:
    """Lowest and highest x, y, z of a prop in the world."""
    vertices = prop_mesh(prop.kind, prop.variant, room.size_m).moved(world_from_prop(prop)).vertices_m
    return vertices.min(axis=0).astype(np.float64), vertices.max(axis=0).astype(np.float64)


def _rounded(colour: Floats) -> tuple[float, float, float]:
    r, g, b = np.round(np.clip(colour, 0.0, 1.0), 3).tolist()
    return r, g, b


def _openings(room: Room, rng: np.random.Generator) -> tuple[Opening, ...]:
    """The installation opening first, then windows and doors, with at least 0.3 m of wall between them."""
    order = [WALLS[i] for i in rng.permutation(4)]
    height = room.size_m[2]
    placed: list[Opening] = []

    def add(wall: WallName, width: float, tall: float, sill: float, glazed: bool) -> None:
        reach = Wall.of(room, wall).width_m / 2 - width / 2 - 0.4
        for _ in range(20):
            u = float(rng.uniform(-reach, reach))
            if all(abs(o.centre_m[0] - u) > (o.size_m[0] + width) / 2 + 0.3 for o in placed if o.wall == wall):
                centre = (round(u, 3), round(sill + tall / 2, 3))
                placed.append(
                    Opening(wall=wall, centre_m=centre, size_m=(round(width, 2), round(tall, 2)), glazed=glazed)
                )
                return

    sill = float(rng.uniform(0.3, 0.9))
    add(order[0], float(rng.uniform(1.8, 3.2)), min(float(rng.uniform(1.3, 2.0)), height - sill - 0.35), sill, False)
    for wall, count in zip(order, (rng.integers(0, 3), *rng.integers(0, 3, 3)), strict=True):
        sill, glazed = float(rng.uniform(0.6, 1.1)), bool(rng.random() < 0.65)
        wide, tall = float(rng.uniform(0.7, 2.0)), min(float(rng.uniform(0.9, 1.6)), height - sill - 0.3)
        for _ in range(int(count)):
            add(wall, wide, tall, sill, glazed)
    for wall in order[1 : 2 + int(rng.integers(0, 2))]:
        add(wall, float(rng.choice([0.9, 1.0, 1.7])), 2.08, 0.0, False)
    return tuple(placed)


class _Furnisher:
    """Puts props where nothing stands: in a strip along the walls, on the walls, under the ceiling."""

    def __init__(self, room: Room, finish: Finish) -> None:
        self.room, self.finish, self.rng = room, finish, finish.rng
        self.props: list[Prop] = []
        half = MIDDLE_M / 2
        self.taken = [(-half, -half, half, half), *(_approach(room, opening) for opening in room.openings)]

    def furnish(self) -> list[Prop]:
        rng, kinds = self.rng, list(STANDING)
        fill = rng.uniform(0.3, 0.95)
        for name in WALLS:
            wall = Wall.of(self.room, name)
            for u in np.arange(-wall.width_m / 2 + 0.5, wall.width_m / 2 - 0.4, 0.8):
                if rng.random() < fill:
                    self._at_wall(wall, float(u), str(rng.choice(kinds)))
            for _ in range(int(rng.integers(0, 5))):
                self._on_wall(wall, str(rng.choice(list(ON_WALL))))
            if rng.random() < 0.5:
                self._below_window(wall)
        for _ in range(int(fill * self._spare_m2() / 8.0)):
            self._amid(str(rng.choice(kinds)))
        for _ in range(int(rng.integers(0, 4))):
            self._pillar()
        for _ in range(int(rng.integers(0, 4))):
            self._flat()
        self._under_ceiling()
        return self.props

    def _prop(self, kind: str, variant: str, at: Floats, yaw: float) -> Prop:
        x, y, z = np.round(at, 3).tolist()
        return Prop(kind=kind, variant=variant, position_m=(x, y, z), yaw_rad=round(yaw, 4))

    def _variant(self) -> str:
        return draw("variant", self.finish.split, self.rng)

    def _try(self, prop: Prop, gap_m: float = 0.05) -> None:
        """Keep a prop if it is inside the room and touches nothing."""
        lower, upper = _bounds(prop, self.room)
        half = np.array(self.room.size_m[:2]) / 2
        inside = (lower[:2] > -half - 1e-3).all() and (upper[:2] < half + 1e-3).all()
        free = not any(
            lower[0] < x1 + gap_m and upper[0] > x0 - gap_m and lower[1] < y1 + gap_m and upper[1] > y0 - gap_m
            for x0, y0, x1, y1 in self.taken
        )
        if inside and upper[2] < self.room.size_m[2] + 1e-3 and free:
            self.props.append(prop)
            self.taken.append((lower[0], lower[1], upper[0], upper[1]))

    def _at_wall(self, wall: Wall, u: float, kind: str) -> None:
        variant, yaw = self._variant(), _yaw_inwards(wall)
        back = float(prop_mesh(kind, variant, self.room.size_m).vertices_m[:, 0].min())
        stand_off = 0.03 if kind == "leaning_boards" else float(self.rng.uniform(0.05, 0.25))
        turned = 0.0 if kind in ("leaning_boards", "shelf") else float(self.rng.normal(0, 0.06))
        self._try(self._prop(kind, variant, wall.point(u, 0.0, back - stand_off), yaw + turned))

    def _spare_m2(self) -> float:
        """Floor beyond where work is done."""
        x, y, _ = self.room.size_m
        return x * y - min(x, 2 * _WORK_M) * min(y, 2 * _WORK_M)

    def _amid(self, kind: str) -> None:
        """Put it down away from the walls, where no work is done."""
        if kind == "leaning_boards":
            return
        half = np.array(self.room.size_m[:2]) / 2 - 0.9
        at = self.rng.uniform(-half, half)
        if np.abs(at).max() > _WORK_M + 0.5:
            self._try(
                self._prop(kind, self._variant(), np.append(at, 0.0), float(self.rng.uniform(0, 6.28))), gap_m=0.5
            )

    def _on_wall(self, wall: Wall, kind: str) -> None:
        variant, u = self._variant(), float(self.rng.uniform(-0.5, 0.5) * (wall.width_m - 1.2))
        prop = self._prop(kind, variant, wall.point(u, ON_WALL_HEIGHT_M, 0.0), _yaw_inwards(wall))
        lower, upper = _bounds(prop, self.room)
        holes = [hole(opening) for opening in self.room.openings if opening.wall == wall.name]
        along = 1 - "xy".index(wall.name[1])
        hits = any(lower[along] < h[2] + 0.1 and upper[along] > h[0] - 0.1 for h in holes)
        others = [p for p in self.props if p.kind in ON_WALL and abs(p.yaw_rad - prop.yaw_rad) < 1e-6]
        if not hits and all(np.hypot(*(np.array(p.position_m) - prop.position_m)[:2]) > 0.9 for p in others):
            self.props.append(prop)

    def _below_window(self, wall: Wall) -> None:
        for opening in self.room.openings[1:]:
            if opening.wall == wall.name and not is_door(opening):
                at = wall.point(opening.centre_m[0], 0.0, -0.02)
                self._try(self._prop("radiator", self._variant(), at, _yaw_inwards(wall)))

    def _pillar(self) -> None:
        half = np.array(self.room.size_m[:2]) / 2 - 0.35
        at = np.array([*self.rng.uniform(-half, half), 0.0])
        self._try(self._prop("pillar", self._variant(), at, 0.0), gap_m=0.3)

    def _flat(self) -> None:
        half = np.array(self.room.size_m[:2]) / 2 - 1.3
        at, yaw = np.array([*self.rng.uniform(-half, half), 0.0]), float(self.rng.uniform(0, np.pi))
        flat = self._prop(FLAT[0], self._variant(), at, yaw)
        if all(np.hypot(*(np.array(p.position_m) - at)[:2]) > 2.6 for p in self.props if p.kind in FLAT):
            self.props.append(flat)

    def _under_ceiling(self) -> None:
        """Ducts and pipes along y beside each other; cables anywhere."""
        x, _, z = self.room.size_m
        drop = 0.24 if z > 2.9 else 0.0
        for kind, side in product(("duct", "ceiling_pipes"), (-1.0, 1.0)):
            if self.rng.random() < 0.35 and z > 2.8:
                at = np.array(
                    [side * self.rng.uniform(0.12, 0.4) * x + (0.7 if kind == "duct" else -0.2), 0.0, z - drop]
                )
                self.props.append(self._prop(kind, self._variant(), at, 0.0))
        for _ in range(int(self.rng.integers(0, 4))):
            at = np.array([*(self.rng.uniform(-0.4, 0.4, 2) * self.room.size_m[:2]), z])
            if z > 3.2:
                self.props.append(self._prop("hanging_cable", self._variant(), at, float(self.rng.uniform(0, 6))))


def _yaw_inwards(wall: Wall) -> float:
    x, y, _ = -wall.outward
    return math.atan2(y, x)


def _approach(room: Room, opening: Opening) -> tuple[float, float, float, float]:
    """x0 y0 x1 y1 of the floor before an opening that must stay free; nothing before glazed windows."""
    wall, (u, _) = Wall.of(room, opening.wall), opening.centre_m
    deep = 0.0 if opening.glazed else 1.2
    wide = opening.size_m[0] / 2 + 0.2
    ends = np.array([wall.point(u - wide, 0.0, 0.0), wall.point(u + wide, 0.0, -deep)])
    (x0, y0, _), (x1, y1, _) = ends.min(axis=0).tolist(), ends.max(axis=0).tolist()
    return x0, y0, x1, y1
