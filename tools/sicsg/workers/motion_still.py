"""Standing, working at a wall, crouching and walking: what the body does over its feet."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.workers.gait import Footing, Instant, Stance
from tools.sicsg.workers.ik import smooth, wrapped
from tools.sicsg.workers.motion_arms import floor_arms, hanging, standing_arms, working_arms
from tools.sicsg.workers.motion_posture import Reach, Trunk, Upper
from tools.sicsg.workers.motion_rig import SIGN, Rig
from tools.sicsg.workers.motion_style import Style

Floats = NDArray[np.float64]
Feet = tuple[Footing, Footing]

_GAZE_RAD = (1.15, 0.75)
"""How far the head turns aside, and up or down, at the most."""
_STRAIGHT = 0.004
"""How much lower than at rest the pelvis of somebody who stands is, relative to the body height."""


class Part(Protocol):
    """What a worker does during one action, above the feet; may be asked for times beyond the action's borders."""

    @property
    def free_hands(self) -> bool:
        """Whether a hand can carry a hat, or reach for it."""

    def trunk(self, now: Instant) -> Trunk:
        """The trunk over these feet."""

    def hands(self, upper: Upper) -> tuple[Reach, Reach]:
        """Left and right hand."""


def looking(trunk: Trunk, rig: Rig, look_m: Floats | None, t_s: float, style: Style) -> Trunk:
    """The trunk with its head turned to a point, or idly about."""
    if look_m is None:
        yaw, pitch = 0.35 * style.wave(5, t_s, 6.3), 0.06 + 0.1 * style.wave(6, t_s, 5.1)
    else:
        away = look_m - np.array([trunk.x, trunk.y, trunk.z + 0.37 * rig.height])
        yaw = wrapped(math.atan2(away[1], away[0]) - trunk.yaw) + 0.05 * style.wave(5, t_s, 4.3)
        pitch = -math.atan2(away[2], max(math.hypot(away[0], away[1]), 0.25)) + 0.04 * style.wave(6, t_s, 3.7)
    side, up = _GAZE_RAD
    yaw = side * math.tanh(yaw / side) if abs(yaw) < math.pi - 0.6 else yaw * (math.pi - abs(yaw)) / 0.6 * 0.45
    pitch = up * math.tanh(pitch / up)
    return trunk._replace(gaze_yaw=yaw, gaze_pitch=pitch, twist=trunk.twist + 0.25 * yaw)


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """Stands about, or works at a point."""

    free_hands: ClassVar[bool] = True

    rig: Rig
    style: Style
    stance: Stance
    look_m: Floats | None
    works: bool

    def trunk(self, now: Instant) -> Trunk:
        """Weight shifts slowly from foot to foot."""
        style, h = self.style, self.rig.height
        shift, fore = (
            style.sway * 0.013 * h * style.wave(0, now.t_s, 7.1),
            style.sway * 0.004 * h * style.wave(1, now.t_s, 3.3),
        )
        lean, ahead = style.stoop * 0.6, 0.0
        if self.works and self.look_m is not None:
            far = math.hypot(self.look_m[0] - self.stance.x, self.look_m[1] - self.stance.y)
            low = max(0.75 * h - float(self.look_m[2] - self.stance.z), 0.0)
            lean += 0.18 * smooth((far - 0.35) / 0.4) + 0.5 * smooth(low / (0.5 * h))
            ahead = -0.04 * h * smooth(low / (0.5 * h))
        c, s = math.cos(self.stance.yaw), math.sin(self.stance.yaw)
        x, y = self.stance.x + c * (fore + ahead) - s * shift, self.stance.y + s * (fore + ahead) + c * shift
        lower = (
            max(0.75 * h - float(self.look_m[2] - self.stance.z), 0.0) * 0.25
            if self.works and self.look_m is not None
            else 0.0
        )
        z = self.stance.z + self.rig.pelvis - _STRAIGHT * h - lower
        roll = -1.1 * shift / h
        trunk = Trunk(
            x, y, z, self.stance.yaw, pitch=0.3 * lean, roll=roll, bend=0.7 * lean, side=-1.5 * roll,
            twist=0.06 * style.wave(2, now.t_s, 8.0), tilt=0.04 * style.wave(3, now.t_s, 6.0),
        )  # fmt: skip
        return looking(trunk, self.rig, self.look_m, now.t_s, style)

    def hands(self, upper: Upper) -> tuple[Reach, Reach]:
        """Gestures, or work."""
        if self.works and self.look_m is not None:
            return working_arms(upper, self.style, upper.now.t_s, self.look_m)
        return standing_arms(upper, self.style, upper.now.t_s, self.look_m)


@dataclass(frozen=True, slots=True, eq=False)
class Crouching:
    """Squats or kneels, both hands at a point before the feet."""

    free_hands: ClassVar[bool] = True

    rig: Rig
    style: Style
    stance: Stance
    point_m: Floats

    def trunk(self, now: Instant) -> Trunk:
        """Low, the upper body leant forward."""
        style, h = self.style, self.rig.height
        sway = style.sway * 0.006 * h * style.wave(0, now.t_s, 5.0)
        c, s = math.cos(self.stance.yaw), math.sin(self.stance.yaw)
        back, height, lean, heels = (
            (-0.02 * h, 0.315 * h, 0.62, (0.0, 1.2)) if style.kneels else (-0.07 * h, 0.23 * h, 0.75, (0.35, 0.5))
        )
        x, y = self.stance.x + c * back - s * sway, self.stance.y + s * back + c * sway
        bob = 0.008 * h * style.wave(3, now.t_s, 4.0)
        trunk = Trunk(
            x, y, self.stance.z + height + bob, self.stance.yaw, pitch=0.35 * lean, bend=0.65 * lean,
            heel_left=heels[0], heel_right=heels[1], splay=0.1 if style.kneels else 0.4,
        )  # fmt: skip
        return looking(trunk, self.rig, self.point_m, now.t_s, style)

    def hands(self, upper: Upper) -> tuple[Reach, Reach]:
        """Busy near the floor."""
        return floor_arms(upper, self.style, upper.now.t_s, self.point_m)


@dataclass(frozen=True, slots=True, eq=False)
class Walking:
    """Goes along a way, arms and trunk swinging against the legs."""

    free_hands: ClassVar[bool] = True

    rig: Rig
    style: Style
    place_at: Callable[[float], Stance]
    """Where the body is at a time."""
    briskness: float
    """Speed relative to 1.2 m/s."""

    def trunk(self, now: Instant) -> Trunk:
        """Over the way, sunk by the legs' reach at each step."""
        place, style, h = self.place_at(now.t_s), self.style, self.rig.height
        stride = forward_of_left(now.feet, place.yaw) / h
        sway = 0.012 * h * (math.sin(math.pi * now.feet[1].swing) - math.sin(math.pi * now.feet[0].swing))
        c, s = math.cos(place.yaw), math.sin(place.yaw)
        lean = style.stoop + 0.05 * self.briskness
        trunk = Trunk(
            place.x - s * sway, place.y + c * sway, place.z + self.rig.pelvis - 0.008 * h, place.yaw,
            pitch=0.4 * lean, roll=0.6 * sway / h, bend=0.6 * lean, side=-0.5 * sway / h,
            hips=-0.25 * stride, twist=0.5 * stride,
        )  # fmt: skip
        return looking(trunk, self.rig, None, now.t_s, style)._replace(
            gaze_pitch=0.12 + 0.05 * style.wave(6, now.t_s, 5.1)
        )

    def hands(self, upper: Upper) -> tuple[Reach, Reach]:
        """Each swings with the other side's foot."""
        style = self.style
        swing = 0.9 * style.arm_swing * forward_of_left(upper.now.feet, upper.yaw) / (0.4 * self.rig.height)
        bent = style.elbow + 0.12 * self.briskness
        left, right = (hanging(upper, side, 0.05 - SIGN[side] * swing, style.arms_out, bent) for side in range(2))
        return left, right


def forward_of_left(feet: Feet, yaw: float) -> float:
    """How far the left foot is ahead of the right one, metres."""
    left, right = feet[0].sole, feet[1].sole
    return (left.x - right.x) * math.cos(yaw) + (left.y - right.y) * math.sin(yaw)
