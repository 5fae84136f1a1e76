"""What commands share that judge by rules: their options, the events file, and what is told of events."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rigcal.errors import OptionsError

if TYPE_CHECKING:
    from recognition.events import Event
    from recognition.observations import Status
    from recognition.rules import RuleSet
    from recognition.sources.recording import RecordedRun
    from rigcal.rig import Rig


def require_rules(rules: Path | None, **given: object) -> None:
    """Refuse options that say something about events where no rules find any.

    Raises:
        OptionsError: where one is given without rules.
    """
    for name, value in given.items():
        if value and rules is None:
            raise OptionsError(
                f"--{name}",
                expected="--rules FILE beside it, which says what must not be",
                got="no --rules",
                do_next=f"add --rules FILE, or leave --{name} out",
            )


def write_log(
    path: Path,
    *,
    recording: Path,
    rules: RuleSet,
    rig: Rig,
    geometry_digest: str,
    metadata: Mapping[str, str],
    association: str,
    smoothed: bool,
    monitoring: Mapping[Status, int],
    events: Sequence[Event],
) -> None:
    """Write the events file of a run or a replay."""
    from recognition.events import EventLog, write_events
    from recognition.judging import caveats_of

    log = EventLog(
        recording=recording.name,
        rules_name=rules.name,
        rules_digest=rules.digest,
        rig_digest=geometry_digest,
        rig_verdict=rig.verdict,
        association=association,
        smoothed=smoothed,
        monitoring=monitoring,
        caveats=caveats_of(metadata),
        events=tuple(events),
    )
    write_events(log, path)


def events_of(opened: RecordedRun, path: Path | None) -> tuple[Event, ...]:
    """The events of a file, else those in the recording.

    Raises:
        EventsError: where the file is none, or of other tracks than the recording's.
    """
    from recognition.errors import EventsError
    from recognition.events import read_events
    from recognition.recording import recorded_events
    from recognition.replay import recorded_options

    if path is None:
        return recorded_events(opened.files)
    log, options = read_events(path), recorded_options(opened)
    rig_digest, method = opened.geometry_digest, None if options is None else options.method
    if (log.rig_digest, log.association) != (rig_digest, method):
        raise EventsError(
            "the events are of another recording, or of other tracks",
            where=path,
            expected=f"rig {rig_digest}, tracks placed by the method {method}",
            got=f"rig {log.rig_digest}, {log.association}, for {log.recording}",
            do_next="make them of this recording: recognition replay IN.mcap --rules FILE --events OUT.json",
        )
    return log.events


def event_lines(events: Sequence[Event], rules: RuleSet, first_ns: int | None) -> Iterator[str]:
    """What was found, for people; times are after the first instant."""
    caveats = dict.fromkeys(caveat for event in events for caveat in event.caveats)
    yield f"{len(events)} violation{'' if len(events) == 1 else 's'} of {rules.name} ({rules.digest[:19]}...)"
    for event in events:
        yield f"  {_line(event, event.start_ns if first_ns is None else first_ns)}"
    yield from (f"  every word on them: {caveat}" for caveat in caveats)


def _line(event: Event, first_ns: int) -> str:
    from recognition.events import actors_text

    start_s = (event.start_ns - first_ns) * 1e-9
    end = "the end" if event.end_ns is None else f"{(event.end_ns - first_ns) * 1e-9:.1f} s"
    status = "" if event.status == "MONITORED" else f", {event.status}"
    return (
        f"{event.rule}: {event.sentence} ({actors_text(event)}), {start_s:.1f} s to {end}, confidence "
        f"{event.confidence:.2f}{status}; {event.event_id}"
    )
