"""Events of a recording: ``foxglove.Event`` on ``/events`` for programs, lines of ``/log`` for people.

An event is told when it is raised, when who takes part in it or who sees it changes, and when it ends; one that lasts
when the run ends is told once more, as ``lasting``. Its keys and values are in words, and ``document`` is the whole
of it as JSON (:mod:`recognition.events.form`). Margins are in its last message alone: each of a violation that lasts
an hour would repeat them all.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from foxglove_schemas_protobuf.Event_pb2 import Event as EventMessage
from foxglove_schemas_protobuf.KeyValuePair_pb2 import KeyValuePair
from foxglove_schemas_protobuf.Log_pb2 import Log

from recognition.errors import EventsError
from recognition.events import Event, actors_text, by_start, event_document, event_of
from recognition.recording.messages import log_message, stamp
from recognition.recording.reader import iter_messages

EVENTS = "/events"
"""Topic."""
SPEAKER = "recognition.rules"
"""Whose lines of the log they are."""
Phase = Literal["raised", "changed", "ended", "lasting"]
Level = Literal["info", "warning", "error"]
_LEVELS: dict[str, Level] = {"info": "info", "warning": "warning", "alarm": "error"}
_LAST: tuple[Phase, ...] = ("ended", "lasting")


def event_message(event: Event, phase: Phase) -> EventMessage:
    """The event as it is now."""
    told = event if phase in _LAST else replace(event, margins=())
    pairs = {
        "event_id": event.event_id,
        "phase": phase,
        "rule": event.rule,
        "sentence": event.sentence,
        "severity": event.severity,
        "actors": ", ".join(f"{one.role} = {one.kind} {one.track_id}" for one in event.actors),
        "cameras": ", ".join(event.cameras),
        "confidence": f"{event.confidence:.3f}",
        "status": event.status,
        "rules_digest": event.rules_digest,
        "rig_digest": event.rig_digest,
        "rig_verdict": event.rig_verdict,
        "caveats": "; ".join(event.caveats),
        "document": json.dumps(event_document(told), ensure_ascii=False, allow_nan=False),
    }
    return EventMessage(
        start_time=stamp(event.start_ns),
        end_time=None if event.end_ns is None else stamp(event.end_ns),
        metadata=[KeyValuePair(key=key, value=value) for key, value in pairs.items()],
    )


def event_words(event: Event, phase: Phase) -> tuple[Level, str] | None:
    """What is said of it at once, as a level of the log and words; nothing where it has only changed."""
    who = actors_text(event)
    if phase == "changed":
        return None
    if phase == "raised":
        return _LEVELS[event.severity], f"{event.rule}: {event.sentence} ({who}); {event.event_id}"
    if event.end_ns is None:
        return "info", f"{event.rule} ({who}) lasts at the end of the run; {event.event_id}"
    lasted_s = (event.end_ns - event.start_ns) * 1e-9
    return "info", f"{event.rule} ({who}) has ended after {lasted_s:.1f} s; {event.event_id}"


def event_line(event: Event, phase: Phase, t_ns: int) -> Log | None:
    """:func:`event_words` as a line of the log."""
    words = event_words(event, phase)
    return None if words is None else log_message(*words, t_ns, speaker=SPEAKER)


def iter_events(path: Path) -> Iterator[Event]:
    """Every word on every event of a finished file, in order of time.

    Raises:
        RecordingError: where the file is absent, unfinished or damaged.
        EventsError: where an event is of another form.
    """
    for recorded in iter_messages(path, [EVENTS]):
        message: Any = recorded.message
        text = next((pair.value for pair in message.metadata if pair.key == "document"), "")
        try:
            yield event_of(json.loads(text))
        except (ValueError, RecursionError, AttributeError) as error:
            raise EventsError(
                "the recording holds an event that cannot be read",
                where=path,
                expected=f"messages of {EVENTS} as `recognition run --rules` writes them",
                got=str(error),
                do_next="judge the recording again: recognition replay IN.mcap --events OUT.json",
            ) from error


def recorded_events(files: tuple[Path, ...]) -> tuple[Event, ...]:
    """The events of a recording's files, as each was told last, in order of their start.

    Raises:
        RecordingError: where a file is absent, unfinished or damaged.
        EventsError: where an event is of another form.
    """
    return by_start({event.event_id: event for file in files for event in iter_events(file)}.values())
