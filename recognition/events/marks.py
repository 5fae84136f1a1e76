"""Who is in violation of what, for pictures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TypeAlias

from recognition.events.event import Actor, Event
from recognition.rules import Judgement

Marks: TypeAlias = Mapping[tuple[str, int], tuple[str, ...]]
"""By ``worker`` or class and track number, the names of the rules that are violated."""
NO_MARKS: Marks = {}


def marks_of(judgement: Judgement) -> Marks:
    """Those who take part in a violation that lasts at the instant of a judgement."""
    return _marks((verdict.rule, verdict.actors) for verdict in judgement.verdicts if verdict.is_active)


def marks_at(events: Iterable[Event], t_ns: int) -> Marks:
    """Those who take part in an event at a time, from its start on."""
    return _marks((event.rule, event.actors) for event in events if lasts_at(event, t_ns))


def lasts_at(event: Event, t_ns: int) -> bool:
    """Whether the event is going on at a time; one whose end the recording did not see goes on."""
    return event.start_ns <= t_ns and (event.end_ns is None or t_ns < event.end_ns)


def name_of(kind: str, track_id: int, marks: Marks) -> str:
    """What stands beside a worker or object: ``worker 3``, and what it violates: ``worker 3: no_hat, ladder``."""
    rules = marks.get((kind, track_id))
    return f"{kind} {track_id}: {', '.join(rules)}" if rules else f"{kind} {track_id}"


def rules_of(marks: Marks) -> tuple[str, ...]:
    """The rules that are violated by anybody, by name."""
    return tuple(sorted({rule for rules in marks.values() for rule in rules}))


def _marks(violations: Iterable[tuple[str, tuple[Actor, ...]]]) -> Marks:
    marks: dict[tuple[str, int], tuple[str, ...]] = {}
    for rule, actors in violations:
        for actor in actors:
            rules = marks.get((actor.kind, actor.track_id), ())
            if rule not in rules:
                marks[actor.kind, actor.track_id] = (*rules, rule)
    return marks
