"""``NAME.events.json``: what the rules found in a recording, and how well it was watched.

One object: ``format`` and ``version``, the recording's name, the rules and the rig by their digests, the method that
placed, at how many instants the site was MONITORED, DEGRADED or NOT MONITORED (without which an empty list of events
would say nothing), the caveats of all events, and ``events`` in order of their start, each on a line of its own. It
holds no time of writing: the same rules over the same recording give the same bytes.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, get_args

from recognition.errors import EventsError
from recognition.events.event import Event
from recognition.events.form import event_document, event_of
from recognition.observations import Status
from rigcal.errors import writing

FORMAT, VERSION = "recognition.events", 1
EVENTS_SUFFIX = ".events.json"
"""Of the name beside a recording by which other commands find its events."""


@dataclass(frozen=True, slots=True)
class EventLog:
    """The events of a run or of a replay."""

    recording: str
    """Name of the recording, without folders."""
    rules_name: str
    rules_digest: str
    rig_digest: str
    """The rig file's ``geometry_digest``."""
    rig_verdict: str
    """``PASS`` or ``IMPORTED``."""
    association: str
    """The method that placed: track numbers are its own."""
    smoothed: bool
    """Whether tracks were smoothed by what came after."""
    monitoring: Mapping[Status, int]
    """How many instants there were of each status."""
    caveats: tuple[str, ...]
    """What the word of every event is not worth."""
    events: tuple[Event, ...]
    """In order of their start."""


def by_start(events: Iterable[Event]) -> tuple[Event, ...]:
    """Events in the order of their start, those that begin together by name."""
    return tuple(sorted(events, key=lambda event: (event.start_ns, event.rule, event.event_id)))


def events_text(log: EventLog) -> str:
    """The content of an events file."""
    head = json.dumps(_head(log), ensure_ascii=False, indent=1)
    lines = (f"  {json.dumps(event_document(event), ensure_ascii=False, allow_nan=False)}" for event in log.events)
    return ",\n".join([head[:-2], ' "events": [\n' + ",\n".join(lines)]) + "\n ]\n}\n"


def write_events(log: EventLog, path: Path) -> None:
    """Write an events file.

    Raises:
        OutputError: where the file cannot be written.
    """
    with writing(path):
        path.write_text(events_text(log), encoding="utf-8")


def read_events(path: Path) -> EventLog:
    """Read an events file.

    Raises:
        EventsError: where it cannot be read, or is no such file.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise _error(path, error.strerror or str(error)) from error
    except (ValueError, RecursionError) as error:
        raise _error(path, f"no JSON: {error}") from error
    form = (document.get("format"), document.get("version")) if isinstance(document, dict) else (None, None)
    if form != (FORMAT, VERSION):
        raise _error(path, f"format {form[0]}, version {form[1]}")
    try:
        return _log(document)
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise _error(path, f"something that is missing or of another form: {error}") from error


def _head(log: EventLog) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "version": VERSION,
        "recording": log.recording,
        "rules": {"name": log.rules_name, "digest": log.rules_digest},
        "rig": {"geometry_digest": log.rig_digest, "verdict": log.rig_verdict},
        "association": log.association,
        "smoothed": log.smoothed,
        "monitoring": dict(sorted(log.monitoring.items())),
        "caveats": list(log.caveats),
    }


def _log(document: Mapping[str, Any]) -> EventLog:
    rules, rig = document["rules"], document["rig"]
    events: Sequence[dict[str, Any]] = document["events"]
    return EventLog(
        recording=str(document["recording"]),
        rules_name=str(rules["name"]),
        rules_digest=str(rules["digest"]),
        rig_digest=str(rig["geometry_digest"]),
        rig_verdict=str(rig["verdict"]),
        association=str(document["association"]),
        smoothed=bool(document["smoothed"]),
        monitoring=MappingProxyType(_monitoring(document["monitoring"])),
        caveats=tuple(map(str, document["caveats"])),
        events=tuple(event_of(event) for event in events),
    )


def _monitoring(counts: Mapping[str, Any]) -> dict[Status, int]:
    known: tuple[Status, ...] = get_args(Status)
    given = dict(counts.items())
    return {status: int(given[status]) for status in known if status in given}


def _error(path: Path, got: str) -> EventsError:
    return EventsError(
        "not an events file",
        where=path,
        expected=f"a file of {FORMAT}, version {VERSION}, as `recognition run --events` and `replay --events` write",
        got=got,
        do_next="judge the recording again: recognition replay IN.mcap --rules FILE --events OUT.json",
    )
