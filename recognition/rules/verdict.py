"""What is said of an instant: every rule, for those whom it speaks about."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from recognition.observations import Status


class Actor(NamedTuple):
    """A worker or object that takes part."""

    kind: str
    """``worker``, or the class of the object."""
    track_id: int
    role: str
    """The name that the rule gives it."""


class Verdict(NamedTuple):
    """A rule, for those whom its ``each`` names: a binding."""

    rule: str
    """Name of the rule."""
    number: int
    """Of the binding: the same as long as something is remembered of it, also under new track numbers; -1 where
    nothing is, because the condition is not true and no violation lasts."""
    actors: tuple[Actor, ...]
    """Those whom ``each`` names, then those who make the condition true, as they did when it was true last."""
    truth: bool | None
    """Of the condition at this instant; None: unknown."""
    margin: float
    """Share of the limit, -1 to 1: positive where it is true, negative where it is false, NaN where it is unknown."""
    is_active: bool
    """Whether the violation lasts."""
    since_ns: int | None
    """When the condition began to hold, while it does or is taken to; also before the violation is raised."""
    ended_ns: int | None
    """At the instant at which the violation is ended: when the condition ceased to hold; where that was not seen
    (``truth`` is None) the instant itself."""


@dataclass(frozen=True, slots=True)
class Judgement:
    """All rules at one instant."""

    t_ns: int
    status: Status
    verdicts: tuple[Verdict, ...]
    """By rule as they stand in the file, then by binding; none of those who are not in the scene and of whom nothing
    is remembered."""
