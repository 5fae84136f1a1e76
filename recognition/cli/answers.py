"""``recognition ack``: what an operator says of an event."""

from __future__ import annotations

import time
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from recognition.cli._app import JsonOption, app, print_json
from recognition.errors import AnswerError, EventsError, RecordingError
from rigcal.errors import OptionError

if TYPE_CHECKING:
    from recognition.alarms import Answer, Subject
    from recognition.events import Event


@app.command()
def ack(
    recording: Annotated[
        Path, typer.Argument(metavar="RECORDING", help="NAME.mcap, also while it is recorded; or its folder.")
    ],
    event_id: Annotated[str, typer.Argument(metavar="EVENT_ID", help="The event_id of the alarm.")],
    by: Annotated[str, typer.Option(metavar="NAME", help="Who answers.")],
    false_alarm: Annotated[bool, typer.Option("--false-alarm", help="Nothing was wrong.")] = False,
    mute_until: Annotated[
        str | None,
        typer.Option(metavar="TIME", help="Send no such alarm until 2026-11-22T14:30Z, or for +90min from now."),
    ] = None,
    whole_rule: Annotated[
        bool, typer.Option("--whole-rule", help="Mute the rule for everybody, not only for who is in this event.")
    ] = False,
    note: Annotated[str, typer.Option(metavar="TEXT", help="What else is to be known.")] = "",
    as_json: JsonOption = False,
) -> None:
    """Acknowledge an event, call it a false alarm, or mute its rule for its workers and objects for a while.

    The answer is appended to NAME.answers.jsonl beside the recording, with its author and the time, for good; a run
    that goes on heeds it within seconds. What is muted is not sent, but judged and recorded as ever.

    Exit code 0: written down; 2: no such recording or event, or a bad time.
    """
    from recognition.alarms import Answer, append_answer, find_subject, recording_named

    _require_consistent(false_alarm=false_alarm, mute_until=mute_until, whole_rule=whole_rule)
    now_ns = time.time_ns()
    named = recording_named(recording)
    answer = Answer(
        kind="muted" if mute_until is not None else "false alarm" if false_alarm else "acknowledged",
        subject=find_subject(named, event_id, _recorded(named)),
        by=by,
        at_ns=now_ns,
        until_ns=None if mute_until is None else _time_ns(mute_until, now_ns),
        whole_rule=whole_rule,
        note=note,
    )
    path = append_answer(named, answer)
    if as_json:
        print_json(
            {"event_id": event_id, "answer": answer.kind, "by": by, "until_ns": answer.until_ns, "log": str(path)}
        )
    else:
        typer.echo(f"{event_id} ({answer.subject.rule}): {_words(answer)}, by {by}; written to {path}")


def _recorded(recording: Path) -> list[Subject]:
    """The events that the recording and its events file hold; of one that is still growing nothing can be read."""
    from recognition.alarms import Subject, beside
    from recognition.events import EVENTS_SUFFIX, read_events
    from recognition.recording import recorded_events, recording_files

    found: list[Event] = []
    with suppress(RecordingError, EventsError):
        found += recorded_events(recording_files(recording))
    with suppress(EventsError):
        found += read_events(beside(recording, EVENTS_SUFFIX)).events
    return [Subject(event.event_id, event.rule, event.actors) for event in found]


def _words(answer: Answer) -> str:
    if answer.until_ns is None:
        return answer.kind
    who = "for everybody" if answer.whole_rule else "for those in it"
    until = datetime.fromtimestamp(answer.until_ns * 1e-9).astimezone()
    return f"muted {who} until {until.isoformat(sep=' ', timespec='minutes')}"


def _require_consistent(*, false_alarm: bool, mute_until: str | None, whole_rule: bool) -> None:
    if (false_alarm and mute_until is not None) or (whole_rule and mute_until is None):
        raise AnswerError(
            "these options do not go together",
            where="--false-alarm and --mute-until" if mute_until is not None else "--whole-rule",
            expected="one answer: --false-alarm, or --mute-until TIME with or without --whole-rule, or neither",
            do_next="answer twice to say both; answers do not replace each other",
        )


def _time_ns(text: str, now_ns: int) -> int:
    from recognition.cli._amounts import seconds

    if text.startswith("+"):
        return now_ns + round(seconds("--mute-until", text[1:]) * 1e9)
    expected = "a time with its zone, such as 2026-11-22T14:30Z or 2026-11-22T15:30+01:00, or +90min for from now"
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise OptionError("--mute-until", expected=expected, got=text) from None
    if moment.tzinfo is None:
        raise OptionError("--mute-until", expected=expected, got=text)
    return round(moment.timestamp() * 1e9)
