"""What free arms do: hang and swing, rest in gestures, point, work, reach for the hat."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.workers.ik import smooth, unit
from tools.sicsg.workers.motion_posture import Reach, Upper, mixed_reach
from tools.sicsg.workers.motion_rig import SIGN
from tools.sicsg.workers.motion_style import Style

Floats = NDArray[np.float64]

_REACH = 0.93
"""Part of an arm's length that a free hand uses at the most."""


_KEEP_M = 0.03
"""Over what distance a limit of the reach sets in."""


def hanging(upper: Upper, side: int, flex: float, out: float, elbow: float) -> Reach:
    """An arm that hangs: ``flex`` forward and ``out`` from the body at the shoulder, ``elbow`` bent; radians."""
    sf, cf, so, co = math.sin(flex), math.cos(flex), math.sin(out), math.cos(out)
    down = np.array([sf * co, SIGN[side] * so, -cf * co])
    ahead = np.array([cf, -SIGN[side] * 0.25, sf])
    ahead = unit(ahead - float(ahead @ down) * down)
    first, second = upper.rig.arm
    palm = first * down + second * (math.cos(elbow) * down + math.sin(elbow) * ahead)
    heading = upper.heading
    return Reach(upper.shoulders[side] + heading @ palm, heading @ -ahead, "", 0.2)


def gesture(name: str, side: int, upper: Upper, style: Style, look_m: Floats | None) -> Reach:
    """One arm of a gesture of ``motion_style.GESTURES``."""
    leading = side == style.hand
    down_and_out = upper.direction(side, -0.3, 0.6, -0.7)
    if name == "hips":
        offset = upper.heading @ (upper.rig.height * np.array([0.035, SIGN[side] * 0.112, 0.05]))
        return Reach(upper.hips + offset, upper.direction(side, -0.55, 0.8, 0.0), "", 0.9)
    if name == "crossed":
        return Reach(
            upper.from_shoulder(side, 0.125 + 0.02 * leading, -0.17, -0.155 + 0.03 * leading), down_and_out, "", 0.5
        )
    if name == "phone" and leading:
        return Reach(upper.from_shoulder(side, 0.16, -0.08, -0.09), down_and_out, "", -0.9)
    if name == "clipboard":
        reach = (0.17, -0.09, -0.12) if leading else (0.17, -0.06, -0.165)
        return Reach(upper.from_shoulder(side, *reach), down_and_out, "", 0.4 if leading else -0.9)
    if name == "point" and leading:
        return pointing(upper, side, look_m)
    if name == "chin" and leading:
        return Reach(upper.from_shoulder(side, 0.085, -0.085, 0.045), down_and_out, "", -0.3)
    if name == "chin":
        return Reach(upper.from_shoulder(side, 0.1, -0.17, -0.15), down_and_out, "", 0.3)
    return hanging(upper, side, 0.02, style.arms_out, style.elbow)


def pointing(upper: Upper, side: int, look_m: Floats | None) -> Reach:
    """An arm that points to a place, or ahead."""
    ahead = upper.direction(side, 1.0, 0.2, -0.05)
    direction = ahead if look_m is None else unit(look_m - upper.shoulders[side]) + 0.35 * ahead
    palm = upper.shoulders[side] + unit(direction) * (_REACH * sum(upper.rig.arm))
    return Reach(palm, upper.direction(side, -0.2, 0.5, -0.8), "", 0.6)


def standing_arms(upper: Upper, style: Style, t_s: float, look_m: Floats | None) -> tuple[Reach, Reach]:
    """Both arms of somebody who stands about."""
    before, now, share = style.gesture(t_s)
    arms = []
    for side in range(2):
        first = gesture(before, side, upper, style, look_m)
        second = gesture(now, side, upper, style, look_m)
        reach = mixed_reach(upper, side, (first, second), smooth(share))
        drift = 0.008 * upper.rig.height * style.wave(side + 1, t_s, 3.1)
        arms.append(reach._replace(palm=reach.palm + drift * upper.heading[:, 0]))
    return arms[0], arms[1]


def within_reach(upper: Upper, side: int, point_m: Floats) -> Floats:
    """(3,) the point, or one near it that is before the worker and that the arm reaches."""
    h = upper.rig.height
    ahead, left, up = (upper.heading.T @ (point_m - upper.shoulders[side])).tolist()
    ahead, out = _at_least(ahead, 0.13 * h), _at_least(SIGN[side] * left, -0.15 * h)
    way = upper.heading @ np.array([ahead, SIGN[side] * out, up])
    distance = math.sqrt(float(way @ way))
    limit = _REACH * sum(upper.rig.arm)
    near = 0.9 * limit
    if distance > near:
        way = way * ((near + (limit - near) * -math.expm1(-(distance - near) / (limit - near))) / distance)
    return upper.shoulders[side] + way


def _at_least(value_m: float, limit_m: float) -> float:
    """The value, smoothly kept above a limit."""
    return limit_m + _KEEP_M * float(np.logaddexp(0.0, (value_m - limit_m) / _KEEP_M))


def working_arms(upper: Upper, style: Style, t_s: float, look_m: Floats) -> tuple[Reach, Reach]:
    """One or both hands move about a point."""
    hand = style.hand
    ahead, left, up = upper.heading.T
    if style.work == "drill":
        push = 0.03 * (0.5 + 0.5 * style.wave(2, t_s, 2.4))
        point = look_m - (0.16 - push) * ahead + 0.08 * style.wave(3, t_s, 9.0) * left
        other = point - 0.06 * up + 0.10 * SIGN[1 - hand] * left - 0.03 * ahead
    else:
        wide, high, period = (0.05, 0.24, 3.6) if style.work == "seal" else (0.2, 0.14, 1.9)
        point = (
            look_m + wide * style.wave(2, t_s, period) * left + high * style.wave(3, t_s, period) * up - 0.05 * ahead
        )
        other = None
    arms: list[Reach] = [hanging(upper, side, 0.1, style.arms_out, 0.5 + style.elbow) for side in range(2)]
    elbow = upper.direction(hand, -0.25, 0.6, -0.75)
    arms[hand] = Reach(within_reach(upper, hand, point), elbow, "", 0.5)
    if other is not None:
        elbow = upper.direction(1 - hand, -0.25, 0.6, -0.75)
        arms[1 - hand] = Reach(within_reach(upper, 1 - hand, other), elbow, "", 0.5)
    return arms[0], arms[1]


def floor_arms(upper: Upper, style: Style, t_s: float, point_m: Floats) -> tuple[Reach, Reach]:
    """Both hands work at a point near the floor."""
    arms = []
    _, left, _ = upper.heading.T
    for side in range(2):
        busy = 0.05 * style.wave(side + 2, t_s, 1.7 + 0.6 * side)
        offset = SIGN[side] * (0.1 + busy) * left + np.array([0.0, 0.0, 0.03 + 0.03 * style.wave(side + 4, t_s, 1.9)])
        palm = within_reach(upper, side, point_m + offset)
        arms.append(Reach(palm, upper.direction(side, -0.4, 0.8, 0.1), "", 0.8))
    return arms[0], arms[1]


def holding_hat(upper: Upper, side: int) -> Reach:
    """An arm that carries a hat before the belly."""
    return Reach(upper.from_shoulder(side, 0.12, 0.0, -0.20), upper.direction(side, -0.5, 0.4, -0.75), "", 0.2)


def at_crown(upper: Upper, side: int) -> Reach:
    """A hand on the crown of the head."""
    palm = upper.crown + upper.direction(side, 0.03, 0.05, 0.02) * 1.0
    return Reach(palm, upper.direction(side, 0.35, 1.0, -0.2), "", 0.4)
