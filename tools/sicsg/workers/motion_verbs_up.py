"""How the verbs that leave the floor are laid out: climbing a ladder and mounting a platform."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.scene import Thing
from tools.sicsg.workers.gait import Stance, stance_soles
from tools.sicsg.workers.motion_carry import Mounting
from tools.sicsg.workers.motion_ladder import (
    Ascent,
    Climbing,
    Grip,
    Grips,
    Path,
    base_soles,
    foot_order,
    grip_height,
    middle_of,
    nearest_level,
    rung_soles,
)
from tools.sicsg.workers.motion_still import Standing
from tools.sicsg.workers.motion_way import walk_of
from tools.sicsg.workers.motion_writer import Writer
from tools.sicsg.workers.stations import Ladder, climb_base, deck_entry, ladder_of, mount_base

Floats = NDArray[np.float64]

Knot = tuple[float, Floats]
"""A time and the point (3,) that the body stands over then."""

_LEAD_S = 0.25
"""How long hands go to the rails before the first foot leaves the floor."""
_STEP_S, _DECK_M_PER_S, _TURN_M = 0.7, 0.9, 0.4
"""How the time of mounting is shared out: for a step up, for the way on the deck, and a radian of turning as way."""


def climb(writer: Writer) -> None:
    """Climb, or stay up there and work."""
    thing, what, pose = writer.thing()
    low, high = writer.need("height_m")
    ladder = ladder_of(what, pose)
    levels = [base_soles(writer.rig, *climb_base(what, pose)), *rung_soles(writer.rig, ladder, thing.id)]
    start, end = nearest_level(levels, low), nearest_level(levels, high)
    yaw = writer.nearest(ladder.yaw)
    begin = writer.assume(levels[start], 0.3, 0.13 if start != end else 0.04)
    grips = _first_grips(writer, ladder, thing, levels[start][0].z)
    knots = [(begin, middle_of(levels[start]))]
    if start != end:
        lead = min(_LEAD_S, 0.15 * writer.length_s) if start == 0 else 0.0
        knots += _steps(writer, ladder, levels, (start, end), (begin + lead, writer.action.end_s), grips)
    writer.grips = (thing.id, (grips[0][-1].z, grips[1][-1].z))
    works = start == end and start > 0
    look = writer.look()
    if look is None and works:
        top = ladder.middles[-1]
        look = np.array([top[0], top[1], levels[end][0].z + 0.84 * writer.rig.height]) - 0.1 * ladder.out
    writer.plan(Climbing(writer.rig, writer.style, ladder, thing.id, _ascent(knots), grips, look, yaw, works), begin)


def _first_grips(writer: Writer, ladder: Ladder, thing: Thing, sole_z: float) -> Grips:
    """Where the hands hold at first: where they are if they are on this ladder already."""
    start = writer.action.start_s
    on, heights = writer.grips
    if on != thing.id:
        heights = (grip_height(writer.rig, ladder, sole_z, 0), grip_height(writer.rig, ladder, sole_z, 1))
    return [Grip(start, start, heights[0])], [Grip(start, start, heights[1])]


def _steps(
    writer: Writer, ladder: Ladder, levels: Path, way: tuple[int, int], span_s: tuple[float, float], grips: Grips
) -> list[Knot]:
    """Add the steps from one level to another, evenly over the time, and the hands that move with the other feet.

    The body goes up on the foot that stands higher, and down while the lower foot reaches for its step: going up it
    stays during the first step, going down during the last.
    """
    order = foot_order(*way)
    start, end = span_s
    slot = (end - start) / len(order)
    heights = [sole.z for sole in writer.feet.soles]
    for number, (side, level) in enumerate(order):
        begin = start + number * slot
        target = levels[level][side]
        back = 0.07 if abs(target.z - writer.feet.soles[side].z) > 0.05 else 0.0
        writer.feet.step(side, begin + 0.1 * slot, begin + 0.95 * slot, target, 0.03, back)
        heights[side] = target.z
        hand = 1 - side
        z = grip_height(writer.rig, ladder, sum(heights) / 2, hand)
        before = grips[hand][-1].z
        if z is None or before is None or abs(z - before) > 0.02:
            grips[hand].append(Grip(begin + 0.1 * slot, begin + 0.8 * slot, z))
    up = way[1] > way[0]
    passed = range(way[0], way[1] + 1) if up else range(way[0], way[1] - 1, -1)
    first = start + slot if up else start
    return [(first + number * slot, middle_of(levels[level])) for number, level in enumerate(passed)]


def _ascent(knots: list[Knot]) -> Ascent:
    times, points = zip(*knots, strict=True)
    return Ascent(np.maximum.accumulate(np.array(times)), np.array(points))


def mount(writer: Writer) -> None:
    """Onto a deck and to a point on it, or down, or stand and work up there."""
    thing, what, pose = writer.thing()
    point = np.array(writer.need("at_m"))
    low, high = writer.need("height_m")
    entry, out = deck_entry(what, pose, point)
    yaw_in = writer.nearest(math.atan2(-out[1], -out[0]))
    spot = Stance(float(point[0]), float(point[1]), float(entry[2]), yaw_in, thing.id)
    middle = float(entry[2]) / 2
    if (low > middle) == (high > middle) and low > middle:
        _stay(writer, spot)
        return
    base, _ = mount_base(what, pose, point)
    steps = rung_soles(writer.rig, ladder_of(what, pose), thing.id) if len(what.steps_m) else []
    edge = stance_soles(writer.rig, spot._replace(x=float(entry[0]), y=float(entry[1])), 0.1 * writer.rig.height, 0.05)
    levels = [base_soles(writer.rig, base, yaw_in), *steps, edge]
    ladder = ladder_of(what, pose) if len(what.steps_m) else None
    if ladder is None:
        ladder = Ladder(entry[None], entry[None], out, float(entry[2]))
    if high > middle:
        _up(writer, thing, ladder, levels, entry, spot)
    else:
        _down(writer, thing, ladder, levels, entry, spot)


def _stay(writer: Writer, spot: Stance) -> None:
    look = writer.look()
    if look is not None:
        spot = spot._replace(yaw=writer.nearest(math.atan2(look[1] - spot.y, look[0] - spot.x)))
    elif not writer.first:
        spot = spot._replace(yaw=writer.yaw)
    done = writer.assume(stance_soles(writer.rig, spot, 0.1 * writer.rig.height, writer.style.toe_out))
    writer.plan(Standing(writer.rig, writer.style, spot, look, look is not None), done)


def _shares(levels: Path, way_m: float) -> float:
    """The part of the action that the steps take, the rest is for the way on the deck."""
    steps, deck = _STEP_S * len(levels), way_m / _DECK_M_PER_S
    return steps / (steps + deck)


def _up(writer: Writer, thing: Thing, ladder: Ladder, levels: Path, entry: Floats, spot: Stance) -> None:
    begin = writer.assume(levels[0], 0.25, 0.13)
    way_m = math.hypot(spot.x - entry[0], spot.y - entry[1])
    grips = _first_grips(writer, ladder, thing, 0.0)
    there = begin + _shares(levels, way_m) * (writer.action.end_s - begin)
    knots = [(begin, middle_of(levels[0]))]
    knots += _steps(writer, ladder, levels, (0, len(levels) - 1), (begin, there), grips)
    if way_m > 0.05:
        knots += _over_deck(writer, entry[:2], np.array([spot.x, spot.y]), there, spot)
    _plan_mounting(writer, ladder, _ascent(knots), grips, spot, begin)


def _down(writer: Writer, thing: Thing, ladder: Ladder, levels: Path, entry: Floats, spot: Stance) -> None:
    top = len(levels) - 1
    way_m = math.hypot(spot.x - entry[0], spot.y - entry[1])
    begin = writer.action.start_s
    if writer.first:
        writer.assume(stance_soles(writer.rig, spot, 0.1 * writer.rig.height, writer.style.toe_out))
    knots = [(begin, middle_of((writer.feet.soles[0], writer.feet.soles[1])))]
    way_m += _TURN_M * abs(levels[top][0].yaw - writer.yaw)
    there = writer.action.end_s - _shares(levels, way_m) * writer.length_s
    there = max(writer.feet.step_to(levels[top], begin, there - begin), there)
    grips = _first_grips(writer, ladder, thing, spot.z)
    knots += _steps(writer, ladder, levels, (top, 0), (there, writer.action.end_s), grips)
    _plan_mounting(writer, ladder, _ascent(knots), grips, spot, there)


def _over_deck(writer: Writer, start_m: Floats, end_m: Floats, start_s: float, spot: Stance) -> list[Knot]:
    """Walk on the deck to a spot until the action ends."""
    end_s = writer.action.end_s
    way = walk_of(np.stack([start_m, end_m]), start_s, end_s, writer.yaw, spot.z, spot.on)
    writer.stride(way.place, way.time_at, way.length_m, 0.6 * way.speed_m_per_s / 1.2)
    times = np.linspace(start_s, end_s, 16)[1:].tolist()
    return [(t, middle_of(writer.walking_soles(way.place_at(t)))) for t in times]


def _plan_mounting(writer: Writer, ladder: Ladder, ascent: Ascent, grips: Grips, spot: Stance, done_s: float) -> None:
    climbing = Climbing(writer.rig, writer.style, ladder, spot.on, ascent, grips, None, spot.yaw, False)
    tall = len(ladder.left) >= 3 and any(entry.z is not None for hand in grips for entry in hand)
    writer.plan(Mounting(climbing, spot.z, tall), done_s)
