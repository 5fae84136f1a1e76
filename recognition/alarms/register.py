"""Which events were told, and which are muted: what is to be said of each, and when."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from recognition.alarms.answers import Answer, Answers
from recognition.alarms.messages import Phase
from recognition.events import Event


@dataclass(frozen=True, slots=True)
class Word:
    """Something that has happened to an event."""

    event: Event
    phase: Phase
    at_ns: int
    mute: Answer | None
    """The answer that mutes it now."""
    is_told: bool
    """Whether it is to be sent; else it is only noted."""
    is_new: bool = True
    """Whether it happened now; else it happened earlier, was muted and is told late."""


class Register:
    """The events of a run that have not ended; an event is raised once and ends once."""

    def __init__(self) -> None:
        self._muted: dict[str, Event] = {}
        """Those that nobody was told of, as they were when they last changed."""
        self._told: set[str] = set()

    def see(self, event: Event, answers: Answers) -> Iterator[Word]:
        """What is to be said of an event that was raised, has changed or ended. One whose mute ends together with it is
        past, and is not told."""
        at_ns = event.margins[-1].t_ns if event.margins else event.raised_ns
        mute = answers.mute_of(event, at_ns)
        if event.event_id not in self._told and event.event_id not in self._muted:
            yield Word(event, "raised", at_ns, mute, is_told=mute is None)
            if mute is None:
                self._told.add(event.event_id)
        if event.event_id not in self._told:
            self._muted[event.event_id] = event
        if event.end_ns is not None:
            yield Word(event, "ended", at_ns, mute, is_told=event.event_id in self._told)
            self._told.discard(event.event_id)
            self._muted.pop(event.event_id, None)

    def due(self, at_ns: int, answers: Answers) -> Iterator[Word]:
        """Events that go on and whose mute is over."""
        for event in [one for one in self._muted.values() if answers.mute_of(one, at_ns) is None]:
            del self._muted[event.event_id]
            self._told.add(event.event_id)
            yield Word(event, "raised", at_ns, None, is_told=True, is_new=False)
