"""On ladders: climbing hand over hand, working up there, and holding one for somebody else."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.workers.gait import Instant, Sole, Stance, stance_soles
from tools.sicsg.workers.ik import EXACT_REACH, smooth
from tools.sicsg.workers.motion_arms import hanging, working_arms
from tools.sicsg.workers.motion_posture import Reach, Trunk, Upper, mixed_reach
from tools.sicsg.workers.motion_rig import SIGN, Rig
from tools.sicsg.workers.motion_still import looking
from tools.sicsg.workers.motion_style import Style
from tools.sicsg.workers.stations import Ladder

Floats = NDArray[np.float64]

_GRIP, _GRIP_LEAST = 0.66, 0.44
"""Height of the hands on the rails over the soles, relative to the body height: where they go, and at the lowest."""
_RAIL_END_M = 0.06
_BODY_M = 0.32
"""From the plane of the rungs to the pelvis."""
_PELVIS_OVER_SOLE = 0.52
"""Of the body height: where the pelvis is over the rungs that one stands on."""


@dataclass(frozen=True, slots=True, eq=False)
class Ascent:
    """The point that the body stands over: between the balls of the feet, at the level of the one that bears."""

    times_s: Floats
    """(N,)."""
    points_m: Floats
    """(N, 3)."""

    def at(self, t_s: float) -> tuple[float, float, float]:
        """The point at a time."""
        x, y, z = (float(np.interp(t_s, self.times_s, self.points_m[:, axis])) for axis in range(3))
        return x, y, z


class Grip(NamedTuple):
    """From when on a hand moves to a height on its rail, and when it is there; no height: it lets go."""

    start_s: float
    end_s: float
    z: float | None


Grips = tuple[list[Grip], list[Grip]]
Path = list[tuple[Sole, Sole]]


def rung_soles(rig: Rig, ladder: Ladder, thing: str) -> Path:
    """Left and right sole on each step, from below."""
    left = np.array([ladder.out[1], -ladder.out[0], 0.0])
    pairs = []
    for low, high in zip(ladder.right, ladder.left, strict=True):
        middle = (low + high) / 2
        half = min(0.055 * rig.height, float(np.linalg.norm(high - low)) / 2 - 0.05)
        soles = []
        for sign in SIGN:
            x, y, z = (middle + sign * half * left).tolist()
            soles.append(Sole(x, y, z, ladder.yaw, thing))
        pairs.append((soles[0], soles[1]))
    return pairs


def base_soles(rig: Rig, at_m: Floats, yaw_rad: float) -> tuple[Sole, Sole]:
    """Left and right sole on the floor before a ladder."""
    return stance_soles(rig, Stance(float(at_m[0]), float(at_m[1]), 0.0, yaw_rad, "floor"), 0.11 * rig.height, 0.05)


def nearest_level(levels: Path, height_m: float) -> int:
    """The level whose soles are nearest to a height."""
    return int(np.argmin([abs(pair[0].z - height_m) for pair in levels]))


def foot_order(start: int, end: int) -> list[tuple[int, int]]:
    """The steps from one level to another as (side, level): foot over foot, at the end side by side."""
    if start == end:
        return []
    way = 1 if end > start else -1
    count = abs(end - start)
    order = [(k % 2, start + way * (k + 1)) for k in range(count)]
    return [*order, (count % 2, end)]


def middle_of(soles: tuple[Sole, Sole]) -> Floats:
    """(3,) the point between two soles."""
    return (np.array(soles[0][:3]) + np.array(soles[1][:3])) / 2


def grip_height(rig: Rig, ladder: Ladder, sole_z: float, side: int) -> float | None:
    """Where a hand holds the rail when the soles are at a height; None where the rail ends too low."""
    z = sole_z + (_GRIP + 0.03 * SIGN[side]) * rig.height
    z = min(z, ladder.top_z - _RAIL_END_M)
    return z if z - sole_z >= _GRIP_LEAST * rig.height else None


@dataclass(frozen=True, slots=True, eq=False)
class Climbing:
    """Up, down or up there on a ladder: the trunk goes with the feet, close to the rungs and leaning with them."""

    free_hands: ClassVar[bool] = False

    rig: Rig
    style: Style
    ladder: Ladder
    thing: str
    ascent: Ascent
    grips: Grips
    look_m: Floats | None
    yaw: float
    """The direction of the ladder, whole turns included."""
    works: bool
    """Whether the leading hand works at ``look_m``."""

    @property
    def slope(self) -> float:
        """How far the ladder recedes from the climber per metre of height."""
        first, last = self.ladder.middles[0], self.ladder.middles[-1]
        rise = float(last[2] - first[2])
        return 0.0 if rise < 1e-6 else float((first - last) @ self.ladder.out) / rise

    def trunk(self, now: Instant) -> Trunk:
        """Over the feet, and as far before the rungs as arms and knees need."""
        rig, h, style = self.rig, self.rig.height, self.style
        x, y, z = self.ascent.at(now.t_s)
        up = smooth(z / 0.5)
        away = 0.05 * h + up * max(_BODY_M - self.slope * _PELVIS_OVER_SOLE * h - 0.05 * h, 0.0)
        out = self.ladder.out
        shift = 0.03 * h * (math.sin(math.pi * now.feet[1].swing) - math.sin(math.pi * now.feet[0].swing))
        shift += 0.006 * h * style.wave(0, now.t_s, 5.0)
        lean = math.atan(self.slope) + 0.06 + self._lean_to_end(z)
        trunk = Trunk(
            float(x + away * out[0] + shift * out[1]), float(y + away * out[1] - shift * out[0]),
            z + rig.pelvis - 0.02 * h, self.yaw, pitch=0.4 * lean, roll=-0.8 * shift / h, bend=0.6 * lean,
            splay=0.12 + 0.4 * up,
        )  # fmt: skip
        look = self.look_m
        if look is None:
            direction = 0.55 * math.sin(math.pi * max(now.feet[0].swing, now.feet[1].swing))
            look = np.array([x, y, z + (1.0 - 0.3 * direction) * h]) - 0.9 * out
        return looking(trunk, rig, look, now.t_s, style)

    def _lean_to_end(self, sole_z: float) -> float:
        """How far to lean so that the hands reach the rails where these end low."""
        end = (self.ladder.top_z - _RAIL_END_M - sole_z) / self.rig.height
        return 2.4 * max(0.59 - end, 0.0) * smooth((end - _GRIP_LEAST + 0.08) / 0.08)

    def hands(self, upper: Upper) -> tuple[Reach, Reach]:
        """On the rails, or one at work."""
        arms = [self._on_rail(side, upper.now.t_s, upper) for side in range(2)]
        if self.works and self.look_m is not None:
            hand = self.style.hand
            arms[hand] = working_arms(upper, self.style, upper.now.t_s, self.look_m)[hand]
        return arms[0], arms[1]

    def _on_rail(self, side: int, t_s: float, upper: Upper) -> Reach:
        entries = self.grips[side]
        number = max(sum(entry.start_s <= t_s for entry in entries) - 1, 0)
        reach = self._reach(side, entries[number].z, upper)
        entry = entries[number]
        if number == 0 or t_s >= entry.end_s:
            return reach
        share = (t_s - entry.start_s) / (entry.end_s - entry.start_s)
        moving = mixed_reach(upper, side, (self._reach(side, entries[number - 1].z, upper), reach), smooth(share))
        return moving._replace(palm=moving.palm + 0.05 * math.sin(math.pi * share) * self.ladder.out)

    def _reach(self, side: int, z: float | None, upper: Upper) -> Reach:
        if z is None:
            return hanging(upper, side, 0.35, self.style.arms_out, 0.9)
        return Reach(self.ladder.rail(side, z), upper.direction(side, -0.35, 0.75, -0.6), self.thing, 0.2)


@dataclass(frozen=True, slots=True, eq=False)
class Holding:
    """Stands on the floor with both hands on a ladder."""

    free_hands: ClassVar[bool] = False

    rig: Rig
    style: Style
    stance: Stance
    points: tuple[Floats, Floats]
    """Where the left and the right hand are."""
    thing: str
    lean: float
    look_m: Floats

    def trunk(self, now: Instant) -> Trunk:
        """Leaning a little into it."""
        style, h = self.style, self.rig.height
        shift = style.sway * 0.006 * h * style.wave(0, now.t_s, 6.0)
        c, s = math.cos(self.stance.yaw), math.sin(self.stance.yaw)
        trunk = Trunk(
            self.stance.x - s * shift, self.stance.y + c * shift, self.stance.z + self.rig.pelvis - 0.012 * h,
            self.stance.yaw, pitch=0.4 * self.lean, roll=-0.8 * shift / h, bend=0.6 * self.lean,
        )  # fmt: skip
        return looking(trunk, self.rig, self.look_m, now.t_s, style)._replace(twist=0.0)

    def hands(self, upper: Upper) -> tuple[Reach, Reach]:
        """On the rails."""
        left, right = (
            Reach(point, upper.direction(side, -0.3, 0.5, -0.8), self.thing, 0.2)
            for side, point in enumerate(self.points)
        )
        return left, right


def near_and_far(points: Floats, stance: Stance) -> tuple[Floats, Floats]:
    """Of two points (2, 3) the one for the left and the one for the right hand."""
    left = np.array([-math.sin(stance.yaw), math.cos(stance.yaw), 0.0])
    order = np.argsort(-(points @ left))
    return points[order[0]], points[order[1]]


def reachable(upper: Upper, points: tuple[Floats, Floats]) -> bool:
    """Whether the arms reach the points."""
    limit = EXACT_REACH * sum(upper.rig.arm)
    return all(float(np.linalg.norm(point - upper.shoulders[side])) < limit for side, point in enumerate(points))
