"""One violation, from its start to its end; immutable, so that an event that goes on is followed by a newer one.

Times are rig time in nanoseconds. Identities are track numbers, which mean nothing beyond the run that gave them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from recognition.rules import Actor

__all__ = ["Actor", "Event", "Margin"]


class Margin(NamedTuple):
    """By how much a condition held at an instant."""

    t_ns: int
    value: float
    """Share of the limit: 0 at the limit, positive in violation, negative outside; NaN where it was unknown."""


@dataclass(frozen=True, slots=True)
class Event:
    """A violation of a rule."""

    event_id: str
    """Unique, and the same when the same recording is judged by the same rules again."""
    rule: str
    """Name of the rule."""
    sentence: str
    """What is wrong, for people."""
    severity: str
    """``info``, ``warning`` or ``alarm``."""
    start_ns: int
    """When the condition began to hold."""
    raised_ns: int
    """When it had held for as long as the rule asks."""
    end_ns: int | None
    """When it ceased to hold; None while it lasts, or where the recording ended first."""
    actors: tuple[Actor, ...]
    margins: tuple[Margin, ...]
    """One per instant judged, in order of time."""
    cameras: tuple[str, ...]
    """Cameras that saw the actors while it lasted."""
    confidence: float
    """0..1: share of the instants since the start at which the condition was determined and held."""
    status: str
    """The worst of ``MONITORED``, ``DEGRADED`` and ``NOT MONITORED`` while it lasted."""
    rules_digest: str
    """SHA-256 of the rule file."""
    rig_digest: str
    """The rig file's ``geometry_digest``."""
    rig_verdict: str
    """``PASS`` or ``IMPORTED``."""
    caveats: tuple[str, ...] = ()
    """What the word is not worth: ``not validated on real people`` and the like."""
