"""Vignettes: one or two workers and the object that a rule is about, with or without a violation.

``share`` is the part of the time that the violation should take: 0 makes a scene that looks like one and is none (a
boundary negative). The truth is not taken from here: ``violations.timeline`` works it out from what is touched.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.catalog import leaning_pose, wall_distance_m
from tools.sicsg.catalog_types import Item
from tools.sicsg.scene import Attachment, Keyframe, Thing, Vector3
from tools.sicsg.skeleton import body
from tools.sicsg.story.script import Script
from tools.sicsg.story.stage import Stage, StageFullError, keyframe_of_matrix, upright
from tools.sicsg.workers.stations import (
    carry_height_m,
    carry_stations,
    climb_base,
    hold_station,
    mount_base,
)

Floats = NDArray[np.float64]
_CLIMB_M_PER_S = 0.45
_MOUNT_S = 3.0
_ALWAYS = 1e6


def _violating(stage: Stage, share: float) -> tuple[float, float]:
    """Start and end of the part of the time that a violation takes."""
    length = share * stage.duration_s
    start = float(stage.rng.uniform(0.0, stage.duration_s - length))
    if stage.rng.random() < 0.35:  # from the start or until the end
        start = 0.0 if stage.rng.random() < 0.5 else stage.duration_s - length
    return start, start + length


def hats_on(stage: Stage, worker: str, intervals: tuple[tuple[float, float], ...] = ()) -> Thing:
    """A hat for a worker, worn but for the intervals (start, end), when it is in the left or the right hand."""
    variant, _ = stage.item("hard_hat")
    hand = ("left_hand", "right_hand")[int(stage.rng.integers(2))]
    worn, since = [], -_ALWAYS
    for start, end in intervals:
        if start > since:
            worn.append(Attachment(start_s=since, end_s=start, worker=worker, bone="head"))
        worn.append(Attachment(start_s=start, end_s=end, worker=worker, bone=hand))
        since = end
    if since < _ALWAYS:
        worn.append(Attachment(start_s=since, end_s=_ALWAYS, worker=worker, bone="head"))
    return stage.put("hard_hat", variant, (Keyframe(t_s=0.0, position_m=(0.0, 0.0, -9.0)),), tuple(worn))


def hat(stage: Stage, share: float) -> None:
    """Somebody takes the hat off and puts it on again; without violation a second hat is carried in the hand."""
    at = stage.spot(0.5)
    script = stage.script(at, float(stage.rng.uniform(-np.pi, np.pi)))
    if share > 0:
        hats_on(stage, script.worker, (_open_ended(stage, _violating(stage, share)),))
    else:
        hats_on(stage, script.worker)
        variant, _ = stage.item("hard_hat")
        spare = Attachment(start_s=-_ALWAYS, end_s=_ALWAYS, worker=script.worker, bone="right_hand")
        stage.put("hard_hat", variant, (Keyframe(t_s=0.0, position_m=(0.0, 0.0, -9.0)),), (spare,))
    walk_until = stage.rng.uniform(0.3, 0.6) * stage.duration_s
    script.still("stand", float(stage.rng.uniform(0.2, 0.4)) * stage.duration_s, look_m=_somewhere(stage))
    goal = stage.near(at, (0.8, 2.0), 0.35)
    if stage.clear_way(at, goal) and script.t_s < walk_until:
        script.walk(goal)
        stage.block(*goal, 0.35)
    script.still("stand", stage.duration_s, look_m=_somewhere(stage))
    stage.enter(script)


def _open_ended(stage: Stage, interval: tuple[float, float]) -> tuple[float, float]:
    """An interval that touches the scene's start or end goes on beyond it."""
    start, end = interval
    return (-_ALWAYS if start <= 0 else start), (_ALWAYS if end >= stage.duration_s - 1e-6 else end)


def _somewhere(stage: Stage) -> tuple[float, float, float]:
    x, y = (float(stage.rng.uniform(-half, half)) for half in stage.half)
    return x, y, float(stage.rng.uniform(0.6, 1.8))


@dataclass(frozen=True, slots=True)
class _Use:
    """Somebody's hands on a thing, from a place on the floor."""

    verb: str
    thing: Thing
    side: str
    at: tuple[float, float]
    yaw_rad: float

    @classmethod
    def of(cls, verb: str, thing: Thing, side: str, station: tuple[Floats, float]) -> _Use:
        (x, y, _), yaw = station
        return cls(verb, thing, side, (float(x), float(y)), yaw)

    def by(self, script: Script, until_s: float) -> Script:
        """The script with this use at its end."""
        return script.use(self.verb, self.thing.id, until_s, self.at, self.yaw_rad, side=self.side)


def _leaves_between(
    stage: Stage, use: _Use, aside: tuple[float, float], look_m: Vector3, interval: tuple[float, float]
) -> Script:
    """A script that uses a thing except during an interval, when the worker is at ``aside`` and looks on."""
    start, end = interval
    there = use.by(stage.script(use.at, use.yaw_rad), start)
    script = stage.script(aside, 0.0) if start <= 0 else there.walk(aside)
    if end >= stage.duration_s:
        return script.still("stand", stage.duration_s, look_m=look_m)
    script.still("stand", max(end - script.walk_time(use.at), script.t_s), look_m=look_m)
    return use.by(script.walk(use.at), stage.duration_s)


def _ladder_in_place(stage: Stage) -> tuple[Thing, Item, Floats]:
    if stage.rng.random() < 0.3:
        variant, what = stage.item("ladder")
        x, y, yaw = stage.wall(1.0)
        lean = np.deg2rad(stage.rng.uniform(13, 18))
        away = wall_distance_m(what, lean) + 0.01
        foot = np.array([x + away * np.cos(yaw), y + away * np.sin(yaw), 0.0])
        stage.block(float(foot[0]), float(foot[1]), 0.5)
        thing = stage.put("ladder", variant, (keyframe_of_matrix(leaning_pose(what, foot, yaw, lean)),))
    else:
        variant, what = stage.item("step_ladder")
        x, y = stage.spot(0.95)
        thing = stage.put("step_ladder", variant, (upright(x, y, float(stage.rng.uniform(-np.pi, np.pi))),))
    return thing, what, thing.pose(0.0)


def ladder(stage: Stage, share: float) -> None:
    """One climbs, one holds for the rest of the time; without violation always, or a bystander and nobody up."""
    thing, what, pose = _ladder_in_place(stage)
    heights = (pose @ np.append(what.steps_m.mean(axis=1), np.ones((len(what.steps_m), 1)), axis=1).T)[2]
    usable = heights[(heights > 0.4) & (heights < min(1.5, heights.max() - 0.55))]
    height = float(stage.rng.choice(usable)) if len(usable) else float(heights[min(1, len(heights) - 1)])
    base, yaw = climb_base(what, pose)
    foot = (float(base[0]), float(base[1]))
    climber = stage.script(foot, yaw)
    kind = stage.rng.random()
    bystander_only = share <= 0 and kind < 0.3
    never_held = share > 0 and kind < 0.45
    climbing_s = height / _CLIMB_M_PER_S
    if bystander_only:
        climber.still("stand", stage.duration_s, yaw_rad=yaw)
    elif never_held:
        start, end = _violating(stage, share)
        climber.still("stand", max(start, 0.0), yaw_rad=yaw)
        climber.use("climb", thing.id, climber.t_s + climbing_s, foot, yaw, height_m=(0.0, height))
        climber.use("climb", thing.id, max(end - climbing_s, climber.t_s + 0.3), foot, yaw, height_m=(height, height))
        climber.use("climb", thing.id, climber.t_s + climbing_s, foot, yaw, height_m=(height, 0.0))
        if climber.t_s > stage.duration_s:
            raise StageFullError
    else:
        climber.use("climb", thing.id, stage.duration_s, foot, yaw, height_m=(height, height))
    stage.enter(climber)
    hats_on(stage, climber.worker)
    sides = ("left", "right", "front") if thing.category == "ladder" else ("left", "right")
    side = sides[int(stage.rng.integers(len(sides)))]
    use = _Use.of("hold", thing, side, hold_station(what, pose, side))
    _second_at_ladder(stage, use, share, bystander_only or never_held)


def _second_at_ladder(stage: Stage, use: _Use, share: float, stands_by: bool) -> None:
    aside = stage.near(use.at, (0.75, 1.6), 0.2)
    x, y, _ = use.thing.path[0].position_m
    towards = (x, y, 1.2)
    if stands_by:
        second = stage.script(aside, 0.0).still("stand", stage.duration_s, look_m=towards)
    elif share <= 0:
        second = use.by(stage.script(use.at, use.yaw_rad), stage.duration_s)
    else:
        second = _leaves_between(stage, use, aside, towards, _violating(stage, share))
    stage.enter(second)
    hats_on(stage, second.worker)
    stage.block(*aside, 0.3)


def window(stage: Stage, share: float) -> None:
    """A large window, carried by two; or by one alone until the other comes, or after the other has left."""
    variant, what = stage.item("large_window")
    x, y = stage.spot(1.25)
    turn = float(stage.rng.uniform(-np.pi, np.pi))
    names = [stage.name_of_next(0), stage.name_of_next(1)]
    height = min(carry_height_m(what, body("0000")), 0.55)
    both = share <= 0
    direction = np.array([-np.sin(turn), np.cos(turn)])
    moved = float(stage.rng.uniform(0.5, 1.2)) if both else float(stage.rng.uniform(0.0, 0.4))
    away = np.array([x, y]) + direction * moved
    set_off, arrive = 0.15 * stage.duration_s, 0.85 * stage.duration_s
    path = (upright(x, y, turn, height), upright(x, y, turn, height, set_off)) + (
        (upright(float(away[0]), float(away[1]), turn, height, arrive),) if both and moved > 0 else ()
    )
    thing = stage.put("large_window", variant, path)
    sides = ("left", "right") if both else ("alone", "right" if stage.rng.random() < 0.5 else "left")
    first, second = (_Use.of("carry", thing, side, carry_stations(what, thing.pose(0.0), side)) for side in sides)
    stage.enter(first.by(stage.script(first.at, first.yaw_rad), stage.duration_s))
    if both:
        partner = second.by(stage.script(second.at, second.yaw_rad), stage.duration_s)
    else:
        outward = np.array(second.at) - (x, y)
        aside = np.array(second.at) + outward / np.linalg.norm(outward) * stage.rng.uniform(0.7, 1.3)
        partner = _leaves_between(stage, second, tuple(aside.tolist()), (x, y, 1.2), _violating(stage, share))
    stage.enter(partner)
    for name in names:
        hats_on(stage, name)


def platform(stage: Stage, share: float) -> None:
    """One stands on a platform, a second joins for a while; without violation the second stays beside it."""
    variant, what = stage.item("platform")
    x, y = stage.spot(1.1)
    turn = float(stage.rng.uniform(-np.pi, np.pi))
    thing = stage.put("platform", variant, (upright(x, y, turn),))
    pose = thing.pose(0.0)
    deck = what.deck_m @ pose[:3, :3].T + pose[:3, 3]
    middle, top = deck.mean(axis=0), float(deck[:, 2].mean())
    long = (
        deck[1] - deck[0]
        if np.linalg.norm(deck[1] - deck[0]) > np.linalg.norm(deck[2] - deck[1])
        else deck[2] - deck[1]
    )
    along = long / np.linalg.norm(long)
    reach = max(np.linalg.norm(long) / 2 - 0.28, 0.2)
    spots = [middle + along * reach, middle - along * reach]
    (bx, by, _), yaw = mount_base(what, pose, spots[0])
    first = stage.script((float(bx), float(by)), yaw)
    first.use("mount", thing.id, stage.duration_s, first.at, yaw, at_m=_point(spots[0]), height_m=(top, top))
    stage.enter(first)
    hats_on(stage, first.worker)
    (bx, by, _), yaw = mount_base(what, pose, spots[1])
    base = (float(bx), float(by))
    second = stage.script(base, yaw)
    look = (float(middle[0]), float(middle[1]), 1.4)
    if share <= 0:
        second.still("stand", stage.duration_s, look_m=look)
    else:
        start, end = _violating(stage, share)
        on = {"at_m": _point(spots[1])}
        if start > 0:
            second.still("stand", max(start - _MOUNT_S, 0.0), look_m=look)
            second.use("mount", thing.id, second.t_s + _MOUNT_S, base, yaw, height_m=(0.0, top), **on)
        second.use("mount", thing.id, end, base, yaw, height_m=(top, top), **on)
        if end < stage.duration_s:
            second.use("mount", thing.id, min(end + _MOUNT_S, stage.duration_s), base, yaw, height_m=(top, 0.0), **on)
    stage.enter(second)
    hats_on(stage, second.worker)


def _point(point: Floats) -> tuple[float, float, float]:
    return tuple(float(value) for value in np.round(point, 4))
