"""What lays out a worker's actions in time: entries of the action at hand, footsteps so far, parts so far."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.catalog import item
from tools.sicsg.catalog_types import Item
from tools.sicsg.scene import Action, Thing, Worker
from tools.sicsg.workers.gait import Footwork, Sole, Stance, stance_soles
from tools.sicsg.workers.ik import wrapped
from tools.sicsg.workers.motion_rig import Rig, rig
from tools.sicsg.workers.motion_still import Part
from tools.sicsg.workers.motion_style import Style, style

Floats = NDArray[np.float64]

_TRUNK_S, _HANDS_S = 0.4, 0.45
"""How long trunk and hands take into a new action, where no steps take longer."""
_APART_M = 1.6
"""Farther than this from where the action before ends, no action can begin."""


class MotionError(ValueError):
    """A worker cannot do what an action says."""

    def __init__(self, worker: str, number: int, action: Action, problem: str) -> None:
        super().__init__(
            f"worker {worker!r}, action {number} ({action.verb}, {action.start_s:g} to {action.end_s:g} s): {problem}"
        )


@dataclass(frozen=True, slots=True, eq=False)
class Planned:
    """An action of the plan."""

    part: Part
    start_s: float
    trunk_s: float
    """How long the trunk takes from the action before into this one."""
    hands_s: float


@dataclass(slots=True)
class Writer:
    """Lays out one action after the other; verbs are functions of it."""

    worker: Worker
    things: dict[str, Thing]
    rig: Rig = field(init=False)
    style: Style = field(init=False)
    feet: Footwork = field(init=False)
    action: Action = field(init=False)
    number: int = -1
    parts: list[Planned] = field(default_factory=list)
    grips: tuple[str, tuple[float | None, float | None]] = ("", (None, None))
    """The ladder on whose rails the action before left the hands, and at which heights."""

    def __post_init__(self) -> None:
        self.rig, self.style = rig(self.worker.body), style(self.worker.motion)

    def begin(self, action: Action) -> None:
        """Turn to the next action."""
        self.number += 1
        self.action = action

    @property
    def first(self) -> bool:
        """Whether this is the worker's first action, which begins where it is."""
        return self.number == 0

    @property
    def length_s(self) -> float:
        """Of the action."""
        return self.action.end_s - self.action.start_s

    @property
    def yaw(self) -> float:
        """The direction between the feet after all steps so far."""
        left, right = self.feet.soles
        return left.yaw + wrapped(right.yaw - left.yaw) / 2

    def nearest(self, yaw_rad: float) -> float:
        """The direction, with the whole turns that make it nearest to the feet's; so that yaws never jump."""
        return yaw_rad if self.first else self.yaw + wrapped(yaw_rad - self.yaw)

    def error(self, problem: str) -> MotionError:
        """An error that names worker and action."""
        return MotionError(self.worker.id, self.number, self.action, problem)

    def need(self, entry: str) -> Any:
        """An entry of the action.

        Raises:
            MotionError: It is missing.
        """
        value = getattr(self.action, entry)
        if value is None or value == ():
            raise self.error(f"needs the entry {entry}, which is missing; add it to the action")
        return value

    def thing(self) -> tuple[Thing, Item, Floats]:
        """The action's thing, what it is, and its pose at the action's start.

        Raises:
            MotionError: The scene has no such thing.
        """
        name = str(self.need("thing"))
        if name not in self.things:
            raise self.error(f"thing {name!r} is not in the scene; add it there or name one that is")
        thing = self.things[name]
        return thing, item(thing.category, thing.variant), thing.pose(self.action.start_s)

    def look(self) -> Floats | None:
        """Where the action looks to."""
        return None if self.action.look_m is None else np.array(self.action.look_m)

    def assume(self, soles: tuple[Sole, Sole], share: float = 0.8, slack_m: float = 0.04) -> float:
        """Step onto soles at the action's start, within this share of it, unless nearer; when that is done.

        Raises:
            MotionError: They are too far away.
        """
        if self.first:
            self.feet = Footwork(list(soles))
            return self.action.start_s
        self.check_near(np.mean([sole[:3] for sole in soles], axis=0))
        return self.feet.step_to(soles, self.action.start_s, share * self.length_s, slack_m)

    def check_near(self, place_m: Floats) -> None:
        """Refuse an action that begins too far from where the one before ends; ``place_m`` is (2,) or (3,)."""
        before = np.mean([sole[: len(place_m)] for sole in self.feet.soles], axis=0)
        gap = float(np.linalg.norm(place_m - before))
        if gap > _APART_M:
            raise self.error(
                f"begins {gap:.2f} m from where the action before ends, more than {_APART_M:g} m; "
                "let the worker walk there in between"
            )

    def stride(
        self,
        place: Callable[[float], Stance],
        time_at: Callable[[float], float],
        length_m: float,
        briskness: float,
    ) -> None:
        """Walk along a way whose place follows from the distance; see :meth:`Footwork.follow`."""
        step = self.style.step * self.rig.height * math.sqrt(min(max(briskness, 0.15), 1.6))
        lift = (0.6 + 0.4 * min(briskness, 1.5)) * self.style.lift * self.rig.height
        self.feet.follow(lambda distance: self.walking_soles(place(distance)), time_at, length_m, step, lift)

    def walking_soles(self, place: Stance) -> tuple[Sole, Sole]:
        """The soles of somebody who walks and is at a place."""
        return stance_soles(self.rig, place, 0.085 * self.rig.height, 0.6 * self.style.toe_out)

    def plan(self, part: Part, stepped_s: float | None = None) -> None:
        """Add what the body does; ``stepped_s`` is when the steps into it are done."""
        start = self.action.start_s
        stepping = 0.0 if stepped_s is None else stepped_s - start + 0.15
        self.parts.append(Planned(part, start, max(_TRUNK_S, stepping), _HANDS_S))
