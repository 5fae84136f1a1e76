"""The state of a worker at any time: bones, joints, and exactly what feet and hands touch.

Decision. Actions are not clips that are cut together: footsteps of all actions are laid out once (``motion_plan``), a
planted foot never moves, and the body is solved over the feet at the time asked for. So contacts are exact at any time
and any rate; the cost is that momentum is only suggested (the trunk follows places, not forces).

A foot touches what it is planted on, from the moment its swing ends to the moment the next begins. A hand touches a
thing when its palm is within 2 cm of where it belongs on it, until the next action has moved it away.
"""

from __future__ import annotations

import bisect
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.scene import Scene, Thing, Worker
from tools.sicsg.skeleton import coco_joints
from tools.sicsg.workers.gait import Instant
from tools.sicsg.workers.ik import smooth
from tools.sicsg.workers.motion_hat import hat_work
from tools.sicsg.workers.motion_plan import Plan, plan_of
from tools.sicsg.workers.motion_posture import Reach, Trunk, Upper, mixed, mixed_reach, solve, yielding

Floats = NDArray[np.float64]

_TOUCH_M = 0.02
"""How near a palm is to its place on a thing to hold it."""


@dataclass(frozen=True, slots=True, eq=False)
class WorkerState:
    """A worker at one time."""

    bones: Floats
    """(B, 4, 4) ``world_from_rest`` of each bone, as ``skeleton.bone_matrices`` gives them."""
    joints_m: Floats
    """(17, 3) COCO joints in the world."""
    feet_on: tuple[str, str]
    """What the left and the right foot stand on: ``"floor"``, a thing's id, or ``""`` in the air."""
    hands_on: tuple[str, str]
    """What the left and the right hand hold: a thing's id or ``""``."""


def worker_state(scene: Scene, worker: Worker, t_s: float) -> WorkerState:
    """The worker at a time; before the first and after the last action as at its border.

    Raises:
        MotionError: An action lacks an entry, names no thing of the scene, or cannot be done where it is.
    """
    plan = plan_of(worker, _things_of(scene, worker))
    t = min(max(t_s, worker.actions[0].start_s), worker.actions[-1].end_s)
    number = max(bisect.bisect_right([planned.start_s for planned in plan.parts], t) - 1, 0)
    now = plan.feet.at(t)
    places: list[tuple[int, Reach]] = []

    def hands(upper: Upper) -> tuple[Reach, Reach]:
        return _hands(plan, number, upper, places)

    solved = solve(plan.rig, _trunk(plan, number, now), now, hands)
    touched = ["", ""]
    for side, reach in places:
        if not touched[side] and float(np.linalg.norm(solved.palms[side] - reach.palm)) <= _TOUCH_M:
            touched[side] = reach.thing
    return WorkerState(
        bones=solved.bones,
        joints_m=coco_joints(plan.rig.body, solved.bones),
        feet_on=(now.feet[0].sole.on, now.feet[1].sole.on),
        hands_on=(touched[0], touched[1]),
    )


def _things_of(scene: Scene, worker: Worker) -> tuple[Thing, ...]:
    """What the worker's actions name, and what is attached to the worker."""
    named = {action.thing for action in worker.actions}
    return tuple(
        thing
        for thing in scene.things
        if thing.id in named or any(attachment.worker == worker.id for attachment in thing.attached)
    )


def _trunk(plan: Plan, number: int, now: Instant) -> Trunk:
    """The trunk of an action, which comes from that of the action before."""
    planned = plan.parts[number]
    trunk = planned.part.trunk(now)
    share = (now.t_s - planned.start_s) / planned.trunk_s
    if number == 0 or share >= 1.0:
        return trunk
    return mixed(_trunk(plan, number - 1, now), trunk, smooth(share))


def _hands(plan: Plan, number: int, upper: Upper, places: list[tuple[int, Reach]]) -> tuple[Reach, Reach]:
    """The hands of an action, which come from those of the action before; ``places`` gathers where they hold things."""
    planned = plan.parts[number]
    reaches = planned.part.hands(upper)
    places += [(side, reach) for side, reach in enumerate(reaches) if reach.thing]
    if planned.part.free_hands:
        hat = hat_work(plan.worker, plan.things, upper.now.t_s)
        reaches = (hat.reach(0, upper, reaches[0]), hat.reach(1, upper, reaches[1]))
    left, right = yielding(upper, 0, reaches[0]), yielding(upper, 1, reaches[1])
    share = (upper.now.t_s - planned.start_s) / planned.hands_s
    if number == 0 or share >= 1.0:
        return left, right
    before = _hands(plan, number - 1, upper, places)
    released = _released(plan, number)
    left, right = (
        mixed_reach(upper, side, (old if local is None else local.on(upper, side), new), smooth(share))
        for side, (old, new, local) in enumerate(zip(before, (left, right), released, strict=True))
    )
    return left, right


@dataclass(frozen=True, slots=True, eq=False)
class _Released:
    """Where a hand was when it let go, in the upright frame of the chest: it moves on with the body."""

    palm: Floats
    pole: Floats
    pronation: float

    def on(self, upper: Upper, side: int) -> Reach:
        palm = upper.shoulders[side] + upper.heading @ self.palm
        return Reach(palm, upper.heading @ self.pole, "", self.pronation)


@lru_cache(maxsize=4096)
def _released(plan: Plan, number: int) -> tuple[_Released | None, _Released | None]:
    """What each hand lets go of when an action begins; None where it held nothing, or goes on holding the same."""
    now = plan.feet.at(plan.parts[number].start_s)
    found: list[_Released | None] = []

    def hands(upper: Upper) -> tuple[Reach, Reach]:
        old, new = (plan.parts[which].part.hands(upper) for which in (number - 1, number))
        at = _hands(plan, number - 1, upper, [])
        for side in range(2):
            lets_go = old[side].thing and old[side].thing != new[side].thing
            palm = (at[side].palm - upper.shoulders[side]) @ upper.heading
            found.append(_Released(palm, at[side].pole @ upper.heading, at[side].pronation) if lets_go else None)
        return at

    solve(plan.rig, _trunk(plan, number - 1, now), now, hands)
    return found[0], found[1]
