"""Footsteps: where each foot stands from when to when, and how it swings between.

A foot is either planted, and then its ball does not move at all, or in the air. Footsteps of all actions of a worker
are laid out one after the other by :class:`Footwork`, so that a planted foot stays planted across actions.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from tools.sicsg.workers.ik import smooth, wrapped
from tools.sicsg.workers.motion_rig import SIGN, Rig

_STEP_S = 0.33
"""Time of one step on the spot."""
_TURN_RAD, _REACH_M = 1.6, 0.5
"""How far one step on the spot turns or moves a foot at the most."""
_SAME_RAD = 0.14
"""A stance that is turned by less than this against how one stands needs no step."""


class Sole(NamedTuple):
    """Where the ball of a foot is, in the world, the way the foot points, and what it stands on."""

    x: float
    y: float
    z: float
    yaw: float
    on: str


class Footing(NamedTuple):
    """A foot at one time."""

    sole: Sole
    """``on`` is empty in the air."""
    pitch: float
    """Radians that the foot is tipped about its ball, toes down positive."""
    swing: float
    """Part of the swing that is over, 0..1; 0 when planted."""


class Instant(NamedTuple):
    """A time and where the feet are then, left and right."""

    t_s: float
    feet: tuple[Footing, Footing]


class Stance(NamedTuple):
    """Where somebody stands: a point below the pelvis, the way they face, what they stand on."""

    x: float
    y: float
    z: float
    yaw: float
    on: str


class Swing(NamedTuple):
    """A foot in the air."""

    start_s: float
    end_s: float
    source: Sole
    target: Sole
    lift_m: float
    back_m: float
    """How far it swings backwards on its way, around the nose of a step."""


def stance_soles(
    rig: Rig, stance: Stance, width_m: float, toe_out_rad: float, stride_m: float = 0.0
) -> tuple[Sole, Sole]:
    """Left and right sole of somebody who stands, ``width_m`` between the feet, the left foot ``stride_m`` ahead."""
    c, s = math.cos(stance.yaw), math.sin(stance.yaw)
    soles = []
    for sign in SIGN:
        forward, left = 0.05 * rig.height + sign * stride_m / 2, sign * width_m / 2
        x, y = stance.x + c * forward - s * left, stance.y + s * forward + c * left
        soles.append(Sole(x, y, stance.z, stance.yaw + sign * toe_out_rad, stance.on))
    return soles[0], soles[1]


@dataclass(slots=True)
class Footwork:
    """The steps of a worker, as they are laid out. Swings of a foot must be added in the order of time."""

    soles: list[Sole]
    """Left and right, where they will be after all swings so far."""
    swings: tuple[list[Swing], list[Swing]] = field(default_factory=lambda: ([], []))
    first: tuple[Sole, Sole] = field(init=False)
    _starts: tuple[list[float], list[float]] = field(default_factory=lambda: ([], []))

    def __post_init__(self) -> None:
        self.first = (self.soles[0], self.soles[1])

    def step(self, side: int, start_s: float, end_s: float, target: Sole, lift_m: float, back_m: float = 0.0) -> None:
        """Let a foot swing to a new place."""
        before = self.swings[side][-1].end_s if self.swings[side] else -math.inf
        start_s = max(start_s, before)
        end_s = max(end_s, start_s + 1e-3)
        source = self.soles[side]
        target = target._replace(yaw=source.yaw + wrapped(target.yaw - source.yaw))
        self.swings[side].append(Swing(start_s, end_s, source, target, lift_m, back_m))
        self._starts[side].append(start_s)
        self.soles[side] = target

    def step_to(self, soles: tuple[Sole, Sole], start_s: float, limit_s: float, slack_m: float = 0.04) -> float:
        """Turn and shift on the spot until one stands on the soles; when that is done.

        ``limit_s`` is how long it may take, steps are quicker where that is short; ``slack_m`` is how far off the feet
        may be without a step.
        """
        turns = [wrapped(new.yaw - old.yaw) for new, old in zip(soles, self.soles, strict=True)]
        moves = [math.dist(new[:3], old[:3]) for new, old in zip(soles, self.soles, strict=True)]
        if max(map(abs, turns)) < _SAME_RAD and max(moves) < slack_m and soles[0].on == self.soles[0].on:
            return start_s
        rounds = math.ceil(max(max(map(abs, turns)) / _TURN_RAD, max(moves) / _REACH_M, 1e-6))
        sources = list(self.soles)
        first = 0 if sum(turns) >= 0 else 1
        if abs(sum(turns)) < 0.3:
            first = 0 if _leftward(sources, soles) else 1
        step_s = min(_STEP_S, limit_s / (2 * rounds))
        for number in range(2 * rounds):
            side = first if number % 2 == 0 else 1 - first
            share = (number // 2 + 1) / rounds
            target = _part_way(sources[side], soles[side], turns[side], share)
            begin = start_s + number * step_s
            self.step(side, begin, begin + 0.9 * step_s, target, 0.05)
        return start_s + 2 * rounds * step_s

    def follow(
        self,
        soles_at: Callable[[float], tuple[Sole, Sole]],
        time_at: Callable[[float], float],
        length_m: float,
        step_m: float,
        lift_m: float,
    ) -> None:
        """Walk along a way.

        Args:
            soles_at: Left and right sole of somebody standing at this distance along the way, metres.
            time_at: When the body is at this distance.
            length_m: Of the way.
            step_m: About how long a step is.
            lift_m: How high a foot is lifted.

        Sideways the leading foot goes ahead by a step and the other closes up, so that legs do not cross.
        """
        aside = _sideways(soles_at, 0.0, length_m)
        count = max(1, round(length_m / (step_m * (1.0 - 0.45 * abs(aside)))))
        stride = length_m / count
        side = 0 if _leftward(self.soles, soles_at(min(stride, length_m))) else 1
        lands = [time_at((k - 0.5) * stride) for k in range(1, count + 1)] + [time_at(length_m)]
        begins = [time_at(0.0)] + lands[:-1]
        for k, (begin, land) in enumerate(zip(begins, lands, strict=True), start=1):
            aside = _sideways(soles_at, min((k - 1) * stride, length_m - 0.02), min(k * stride, length_m))
            distance = (k + 0.5 * aside * SIGN[side]) * stride if k <= count else length_m
            target = soles_at(min(distance, length_m))[side]
            double = 0.18 * (land - begin) if k > 1 else 0.0
            self.step(side, begin + double, land, target, lift_m)
            side = 1 - side

    def at(self, t_s: float) -> Instant:
        """Both feet at a time."""
        return Instant(t_s, (self.foot(0, t_s), self.foot(1, t_s)))

    def foot(self, side: int, t_s: float) -> Footing:
        """A foot at a time."""
        number = bisect.bisect_right(self._starts[side], t_s) - 1
        if number < 0:
            return Footing(self.first[side], 0.0, 0.0)
        swing = self.swings[side][number]
        if t_s >= swing.end_s:
            return Footing(swing.target, 0.0, 0.0)
        return _in_the_air(swing, (t_s - swing.start_s) / (swing.end_s - swing.start_s))


def _in_the_air(swing: Swing, u: float) -> Footing:
    one, two = swing.source, swing.target
    rise = two.z - one.z
    level = smooth(u)
    height = smooth(1.35 * u) if rise > 0.08 else smooth((u - 0.26) / 0.74) if rise < -0.08 else level
    across = smooth((u - 0.15) / 0.85) if rise > 0.08 else smooth(u / 0.85) if rise < -0.08 else level
    hump = math.sin(math.pi * u)
    yaw = one.yaw + (two.yaw - one.yaw) * level
    back = swing.back_m * hump
    travelled = math.hypot(two.x - one.x, two.y - one.y)
    tip = min(travelled, 1.2) * (0.45 if u < 0.5 else 0.22) * math.sin(2 * math.pi * u)
    if abs(rise) > 0.08:
        tip = 0.25 * hump**2
    sole = Sole(
        one.x + (two.x - one.x) * across - back * math.cos(yaw),
        one.y + (two.y - one.y) * across - back * math.sin(yaw),
        one.z + rise * height + swing.lift_m * hump,
        yaw,
        "",
    )
    return Footing(sole, tip, u)


def _part_way(source: Sole, target: Sole, turn: float, share: float) -> Sole:
    if share >= 1.0:
        return target
    x, y, z = (a + (b - a) * share for a, b in zip(source[:3], target[:3], strict=True))
    return Sole(x, y, z, source.yaw + turn * share, target.on)


def _sideways(soles_at: Callable[[float], tuple[Sole, Sole]], start_m: float, end_m: float) -> float:
    """How much of the way between two distances leads to the left (1) or the right (-1) of somebody on it."""
    (old, _), (new, _) = soles_at(start_m), soles_at(end_m)
    dx, dy = new.x - old.x, new.y - old.y
    yaw = old.yaw + wrapped(new.yaw - old.yaw) / 2
    share = (dy * math.cos(yaw) - dx * math.sin(yaw)) / (math.hypot(dx, dy) + 1e-9)
    return math.copysign(max(abs(share) - 0.3, 0.0) / 0.7, share)


def _leftward(sources: list[Sole], targets: tuple[Sole, Sole]) -> bool:
    """Whether going from one pair of soles to another is better begun with the left foot."""
    yaw = sources[0].yaw + wrapped(sources[1].yaw - sources[0].yaw) / 2
    left = np.array([-math.sin(yaw), math.cos(yaw)])
    ahead = np.array([math.cos(yaw), math.sin(yaw)])
    old, new = (np.array([[s.x, s.y] for s in pair]) for pair in (sources, targets))
    sideways = float((new - old).mean(axis=0) @ left)
    if abs(sideways) > 0.05:
        return sideways > 0
    return float((old[1] - old[0]) @ ahead) > 0.0
