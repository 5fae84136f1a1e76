"""The stage: a room, what stands in it, and where there is still space."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tools.sicsg.assets import Split, draw
from tools.sicsg.catalog import item
from tools.sicsg.catalog_types import Item
from tools.sicsg.rooms import prop_footprints
from tools.sicsg.scene import Attachment, Keyframe, Room, Thing, Worker
from tools.sicsg.story.script import Script

Floats = NDArray[np.float64]
_TRIES = 300
_WALL_CLEAR_M = 0.7


class StageFullError(Exception):
    """No space is left; the story is written anew with the next numbers."""


@dataclass(slots=True)
class Stage:
    """What a story has put into its room so far."""

    rng: np.random.Generator
    split: Split
    room: Room
    duration_s: float
    things: list[Thing] = field(default_factory=list)
    workers: list[Worker] = field(default_factory=list)
    blocked: list[tuple[float, float, float, float]] = field(default_factory=list)
    """x0, y0, x1, y1 of what stands or happens somewhere."""
    reach_m: float = 2.6
    """How far from the middle, along x and y, things happen."""

    def __post_init__(self) -> None:
        self.blocked += [tuple(row) for row in prop_footprints(self.room).tolist()]

    @property
    def half(self) -> tuple[float, float]:
        """How far workers may go from the middle along x and y."""
        x, y, _ = self.room.size_m
        return min(x / 2 - 0.9, self.reach_m), min(y / 2 - 0.9, self.reach_m)

    def spot(self, radius_m: float) -> tuple[float, float]:
        """The middle of a free square, which is then taken."""
        half_x, half_y = self.half
        for _ in range(_TRIES):
            x = float(self.rng.uniform(-1, 1) * max(half_x - radius_m * 0.5, 0.1))
            y = float(self.rng.uniform(-1, 1) * max(half_y - radius_m * 0.5, 0.1))
            if self.is_free(x, y, radius_m):
                self.block(x, y, radius_m)
                return x, y
        raise StageFullError

    def near(self, at: tuple[float, float], distance_m: tuple[float, float], radius_m: float) -> tuple[float, float]:
        """A free place at this distance from a point; it is not taken."""
        half_x, half_y = self.half
        for _ in range(_TRIES):
            angle, far = self.rng.uniform(0, 2 * np.pi), self.rng.uniform(*distance_m)
            x, y = float(at[0] + far * np.cos(angle)), float(at[1] + far * np.sin(angle))
            if abs(x) < half_x + 0.5 and abs(y) < half_y + 0.5 and self.is_free(x, y, radius_m):
                return x, y
        raise StageFullError

    def is_free(self, x: float, y: float, radius_m: float) -> bool:
        """Whether a square around a point touches nothing."""
        return not any(
            x0 - radius_m < x < x1 + radius_m and y0 - radius_m < y < y1 + radius_m for x0, y0, x1, y1 in self.blocked
        )

    def block(self, x: float, y: float, radius_m: float) -> None:
        """Take a square."""
        self.blocked.append((x - radius_m, y - radius_m, x + radius_m, y + radius_m))

    def clear_way(self, start: tuple[float, float], end: tuple[float, float]) -> bool:
        """Whether one can walk straight from a place to another."""
        steps = np.linspace(start, end, 12)[2:-2]
        return all(self.is_free(float(x), float(y), 0.25) for x, y in steps)

    def wall(self, width_m: float) -> tuple[float, float, float]:
        """x, y of a free place at the foot of a wall and the direction (radians) into the room."""
        size_x, size_y, _ = self.room.size_m
        for _ in range(_TRIES):
            wall = ("-x", "+x", "-y", "+y")[int(self.rng.integers(4))]
            sign = -1.0 if wall[0] == "-" else 1.0
            along_x = wall[1] == "y"
            length = size_x if along_x else size_y
            along = float(self.rng.uniform(-1, 1) * max(length / 2 - width_m - 0.3, 0.0))
            if any(
                opening.wall == wall and abs(opening.centre_m[0] - along) < (opening.size_m[0] + width_m) / 2 + 0.1
                for opening in self.room.openings
            ):
                continue
            x, y = (along, sign * size_y / 2) if along_x else (sign * size_x / 2, along)
            inward = np.array([0.0, -sign]) if along_x else np.array([-sign, 0.0])
            middle = np.array([x, y]) + inward * _WALL_CLEAR_M
            if self.is_free(float(middle[0]), float(middle[1]), max(width_m / 2, 0.4)):
                self.block(float(middle[0]), float(middle[1]), max(width_m / 2, 0.4))
                return x, y, float(np.arctan2(inward[1], inward[0]))
        raise StageFullError

    def item(self, category: str) -> tuple[str, Item]:
        """A variant of a category that the split may use."""
        variant = draw("variant", self.split, self.rng)
        return variant, item(category, variant)

    def put(
        self, category: str, variant: str, path: tuple[Keyframe, ...], attached: tuple[Attachment, ...] = ()
    ) -> Thing:
        """Add an object; its id counts its category's objects."""
        count = sum(thing.category == category for thing in self.things)
        thing = Thing(id=f"{category}-{count}", category=category, variant=variant, path=path, attached=attached)
        self.things.append(thing)
        return thing

    def script(self, at: tuple[float, float], yaw_rad: float) -> Script:
        """A new worker's script; :meth:`enter` makes the worker of it."""
        return Script(f"worker-{len(self.workers)}", at, yaw_rad, self.duration_s)

    def enter(self, script: Script) -> Worker:
        """Add the worker whose script is finished."""
        names = {kind: draw(kind, self.split, self.rng) for kind in ("body", "clothes", "motion")}
        worker = Worker(id=script.worker, actions=script.finished(), **names)
        self.workers.append(worker)
        return worker

    def name_of_next(self, offset: int = 0) -> str:
        """Id of the worker that enters next, or ``offset`` later."""
        return f"worker-{len(self.workers) + offset}"


def upright(x: float, y: float, yaw_rad: float, z: float = 0.0, t_s: float = 0.0) -> Keyframe:
    """An upright pose."""
    return keyframe_of(t_s, np.array([x, y, z]), Rotation.from_euler("z", yaw_rad))


def keyframe_of(t_s: float, position_m: Floats, rotation: Rotation) -> Keyframe:
    """A keyframe of a position and a rotation."""
    x, y, z, w = rotation.as_quat().tolist()
    return Keyframe(t_s=t_s, position_m=tuple(np.round(position_m, 4).tolist()), quat_wxyz=(w, x, y, z))


def keyframe_of_matrix(matrix: Floats, t_s: float = 0.0) -> Keyframe:
    """A keyframe of a (4, 4) pose."""
    return keyframe_of(t_s, matrix[:3, 3], Rotation.from_matrix(matrix[:3, :3]))
