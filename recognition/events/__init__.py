"""Violations as events: who, what, from when to when, by how much, and what the word is worth."""

from recognition.events.event import Actor, Event, Margin
from recognition.events.form import actors_text, event_document, event_of, utc
from recognition.events.keeper import EventKeeper
from recognition.events.log import EVENTS_SUFFIX, EventLog, by_start, events_text, read_events, write_events
from recognition.events.marks import NO_MARKS, Marks, lasts_at, marks_at, marks_of, name_of, rules_of
from recognition.events.watch import Watch

__all__ = [
    "EVENTS_SUFFIX",
    "NO_MARKS",
    "Actor",
    "Event",
    "EventKeeper",
    "EventLog",
    "Margin",
    "Marks",
    "Watch",
    "actors_text",
    "by_start",
    "event_document",
    "event_of",
    "events_text",
    "lasts_at",
    "marks_at",
    "marks_of",
    "name_of",
    "read_events",
    "rules_of",
    "utc",
    "write_events",
]
