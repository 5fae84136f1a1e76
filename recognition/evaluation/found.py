"""Events beside the truth of a sequence: which violations were found, how soon, and what was found for nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from recognition.evaluation.violations import KINDS, NEAR_S, Stretch, Violations
from recognition.events import Event, by_start

SOON_S = 1.0
"""A violation that is raised so soon after its start, or so little before, is found in time."""


@dataclass(frozen=True, slots=True)
class Sought:
    """A violation that there was, and what was found of it."""

    kind: str
    stretch: Stretch
    """When it lasted, in seconds after the truth's epoch."""
    event: Event | None
    """Of the events that touch it the one raised nearest to its start."""
    delay_s: float | None
    """From its start to the time at which that was raised; negative: before it."""

    @property
    def is_in_time(self) -> bool:
        """Whether it was raised within :data:`SOON_S` of its start."""
        return self.delay_s is not None and abs(self.delay_s) <= SOON_S


@dataclass(frozen=True, slots=True)
class Findings:
    """All violations of a sequence, and the events that are none of them."""

    sought: tuple[Sought, ...]
    """In order of their start."""
    events: tuple[Event, ...]
    """All that were held against them, in order of their start."""
    false: tuple[Event, ...]
    """Events that no violation of their kind touches, give or take half a second."""

    @property
    def in_time(self) -> int:
        """How many violations were found in time."""
        return sum(one.is_in_time for one in self.sought)


def compare_events(truth: Violations, events: Sequence[Event]) -> Findings:
    """Hold events against the truth; events of other rules than the four violations are left out.

    Args:
        truth: Of the sequence.
        events: Of rules that bear the names of the violations.
    """
    own = [event for event in events if event.rule in KINDS]
    sought = [
        _sought(truth, kind, stretch, [event for event in own if event.rule == kind])
        for kind, stretches in zip(KINDS, truth.stretches, strict=True)
        for stretch in stretches
    ]
    return Findings(
        tuple(sorted(sought, key=lambda one: one.stretch)),
        by_start(own),
        tuple(
            event
            for event in own
            if not any(_touches(truth, event, stretch) for stretch in truth.stretches[KINDS.index(event.rule)])
        ),
    )


def _sought(truth: Violations, kind: str, stretch: Stretch, events: Sequence[Event]) -> Sought:
    touching = [event for event in events if _touches(truth, event, stretch)]
    delays = {event.event_id: _after_s(truth, event.raised_ns) - stretch.start_s for event in touching}
    nearest = min(touching, key=lambda event: abs(delays[event.event_id]), default=None)
    return Sought(kind, stretch, nearest, None if nearest is None else delays[nearest.event_id])


def _touches(truth: Violations, event: Event, stretch: Stretch) -> bool:
    if event.end_ns is not None and _after_s(truth, event.end_ns) <= stretch.start_s - NEAR_S:
        return False
    return _after_s(truth, event.start_ns) < stretch.end_s + NEAR_S


def _after_s(truth: Violations, t_ns: int) -> float:
    return (t_ns - truth.epoch_ns) * 1e-9
