"""Carrying a window, and standing on a platform's way up."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.catalog_types import Item
from tools.sicsg.scene import Thing
from tools.sicsg.workers.gait import Instant, Stance
from tools.sicsg.workers.motion_arms import hanging
from tools.sicsg.workers.motion_ladder import Climbing
from tools.sicsg.workers.motion_posture import Reach, Trunk, Upper
from tools.sicsg.workers.motion_rig import SIGN, Rig
from tools.sicsg.workers.motion_still import forward_of_left, looking
from tools.sicsg.workers.motion_style import Style
from tools.sicsg.workers.stations import CarrySide, carry_grips, carry_stations

Floats = NDArray[np.float64]

_SAMPLE_S = 1 / 60
_STILL_M_PER_S = 0.015
_TURN_M = 0.35
"""What a turn of one radian counts as, in metres of way."""


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """How a carrier moves, sampled over the action."""

    times_s: Floats
    """(N,)."""
    places: Floats
    """(N, 3) x, y and yaw (without jumps) of the carrier."""
    lengths_m: Floats
    """(N,) how far they have come, turns included."""

    def at(self, t_s: float) -> Stance:
        """The carrier's place at a time."""
        x, y, yaw = (float(np.interp(t_s, self.times_s, self.places[:, i])) for i in range(3))
        return Stance(x, y, 0.0, yaw, "floor")

    def stretches(self) -> list[tuple[int, int]]:
        """First and last sample of each stretch on which the carrier moves."""
        moving = np.diff(self.lengths_m) > _STILL_M_PER_S * _SAMPLE_S
        edges = np.flatnonzero(np.diff(np.concatenate([[False], moving, [False]]).astype(int)))
        return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def way_of(thing: Thing, item: Item, side: CarrySide, span_s: tuple[float, float], yaw_rad: float) -> Way:
    """The way on which a carrier goes with a thing; at its start they face ``yaw_rad``, whole turns included."""
    times = np.linspace(*span_s, max(2, math.ceil((span_s[1] - span_s[0]) / _SAMPLE_S)))
    stations = [carry_stations(item, thing.pose(float(t)), side) for t in times]
    places = np.array([[at[0], at[1], yaw] for at, yaw in stations])
    places[:, 2] = np.unwrap(places[:, 2])
    places[:, 2] += yaw_rad - places[0, 2]
    steps = np.diff(places, axis=0)
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(np.hypot(steps[:, 0], steps[:, 1]), _TURN_M * steps[:, 2]))])
    return Way(times, places, lengths)


@dataclass(frozen=True, slots=True, eq=False)
class Carrying:
    """Goes with a window, both hands on it."""

    free_hands: ClassVar[bool] = False

    rig: Rig
    style: Style
    way: Way
    thing: Thing
    grips: Floats
    """(2, 3) for the left and the right hand, in the thing's frame."""
    look_over: bool
    """Whether the carrier looks past the window (alone) instead of to the other end."""

    @classmethod
    def of(cls, rig: Rig, style: Style, way: Way, thing: Thing, item: Item, side: CarrySide) -> Carrying:
        """The carrier of one side."""
        return cls(rig, style, way, thing, carry_grips(item, side), side == "alone")

    def points(self, t_s: float) -> Floats:
        """(2, 3) where the hands belong."""
        pose = self.thing.pose(t_s)
        return self.grips @ pose[:3, :3].T + pose[:3, 3]

    def trunk(self, now: Instant) -> Trunk:
        """Upright where the grips are high, bent and with bent knees where they are low."""
        place, style, h = self.way.at(now.t_s), self.style, self.rig.height
        low = max(0.58 - float(self.points(now.t_s)[:, 2].min()) / h, 0.0)
        sway = 0.010 * h * (math.sin(math.pi * now.feet[1].swing) - math.sin(math.pi * now.feet[0].swing))
        sway += 0.003 * h * style.wave(0, now.t_s, 5.0)
        c, s = math.cos(place.yaw), math.sin(place.yaw)
        lean = 0.05 + 1.7 * low
        back = 0.25 * low * h
        trunk = Trunk(
            place.x - s * sway - c * back, place.y + c * sway - s * back,
            self.rig.pelvis - (0.012 + 0.35 * low) * h, place.yaw, pitch=0.45 * lean, roll=0.5 * sway / h,
            bend=0.55 * lean, side=-0.5 * sway / h, hips=-0.2 * forward_of_left(now.feet, place.yaw) / h,
        )  # fmt: skip
        return looking(trunk, self.rig, None, now.t_s, style)

    def hands(self, upper: Upper) -> tuple[Reach, Reach]:
        """On the grips."""
        left, right = (
            Reach(point, upper.direction(side, -0.4, 0.45, -0.8), self.thing.id, 0.3)
            for side, point in enumerate(self.points(upper.now.t_s))
        )
        return left, right


@dataclass(frozen=True, slots=True, eq=False)
class Mounting:
    """Between the floor and a deck: the trunk goes with the feet, the hands help where there are posts."""

    climbing: Climbing
    deck_z: float
    holds: bool
    """Whether the way up is tall enough to be climbed with the hands."""

    @property
    def free_hands(self) -> bool:
        """Whether the hands are not needed on the way up."""
        return not self.holds

    def trunk(self, now: Instant) -> Trunk:
        """Over the feet; before the steps on the way up."""
        rig, style = self.climbing.rig, self.climbing.style
        h = rig.height
        x, y, z = self.climbing.ascent.at(now.t_s)
        yaw = 0.5 * (now.feet[0].sole.yaw + now.feet[1].sole.yaw)
        climbed = min(max(z / self.deck_z, 0.0), 1.0)
        midway = math.sin(math.pi * climbed)
        back = (0.05 + 0.05 * midway) * h
        sway = 0.012 * h * (math.sin(math.pi * now.feet[1].swing) - math.sin(math.pi * now.feet[0].swing))
        c, s = math.cos(yaw), math.sin(yaw)
        lean = style.stoop * 0.6 + 0.35 * midway
        trunk = Trunk(
            x - c * back - s * sway, y - s * back + c * sway, z + rig.pelvis - 0.02 * h, yaw,
            pitch=0.4 * lean, bend=0.6 * lean, roll=0.5 * sway / h,
        )  # fmt: skip
        return looking(trunk, rig, None, now.t_s, style)._replace(gaze_pitch=0.15 + 0.4 * midway)

    def hands(self, upper: Upper) -> tuple[Reach, Reach]:
        """On the posts, or a little ahead for balance."""
        if self.holds:
            return self.climbing.hands(upper)
        style, h = self.climbing.style, self.climbing.rig.height
        swing = 0.5 * style.arm_swing * forward_of_left(upper.now.feet, upper.yaw) / (0.4 * h)
        left, right = (
            hanging(upper, side, 0.25 - SIGN[side] * swing, style.arms_out + 0.1, style.elbow + 0.35)
            for side in range(2)
        )
        return left, right
