"""A worker's plan: the steps of all actions laid out in time, and what the body does above them during each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

from tools.sicsg.scene import Thing, Worker
from tools.sicsg.workers import motion_verbs, motion_verbs_up
from tools.sicsg.workers.gait import Footwork
from tools.sicsg.workers.motion_rig import Rig
from tools.sicsg.workers.motion_style import Style
from tools.sicsg.workers.motion_writer import Planned, Writer
from tools.sicsg.workers.stations import StationError

_VERBS: dict[str, Callable[[Writer], None]] = {
    "stand": motion_verbs.stand,
    "work": motion_verbs.work,
    "crouch": motion_verbs.crouch,
    "walk": motion_verbs.walk,
    "hold": motion_verbs.hold,
    "carry": motion_verbs.carry,
    "climb": motion_verbs_up.climb,
    "mount": motion_verbs_up.mount,
}


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """All that a worker's states follow from."""

    worker: str
    """Id."""
    things: tuple[Thing, ...]
    """What the worker's actions name, and what is attached to the worker."""
    rig: Rig
    style: Style
    feet: Footwork
    parts: tuple[Planned, ...]


@lru_cache(maxsize=256)
def plan_of(worker: Worker, things: tuple[Thing, ...]) -> Plan:
    """The plan of a worker, given the things that their actions name and those attached to them.

    Raises:
        MotionError: An action lacks an entry, names no thing, or cannot be done where it is.
    """
    writer = Writer(worker, {thing.id: thing for thing in things})
    for action in worker.actions:
        writer.begin(action)
        grips = writer.grips
        try:
            _VERBS[action.verb](writer)
        except StationError as error:
            raise writer.error(str(error)) from error
        if writer.grips is grips:
            writer.grips = ("", (None, None))
    return Plan(worker.id, things, writer.rig, writer.style, writer.feet, tuple(writer.parts))
