"""What operators answer to events: acknowledged, false alarm, muted until a time; each with its author.

Answers are appended to ``NAME.answers.jsonl`` beside the recording and never rewritten. Who changes their mind answers
again: of two mutes of one event the later stands, though it may end sooner. ``NAME.alarms.jsonl``, which the run
appends to, says which events there are, so that an answer can be given while the run goes on.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from recognition.alarms.lines import append_line, read_lines
from recognition.alarms.messages import Phase, utc
from recognition.alarms.places import ALARMS_SUFFIX, ANSWERS_SUFFIX, beside
from recognition.errors import AnswerError
from recognition.events import Actor, Event
from rigcal.errors import OutputError

Kind = Literal["acknowledged", "false alarm", "muted"]
LONGEST_MUTE_S = 7 * 86400.0
"""A rule that is to be silent for longer is not wanted, and is taken out of the rule file, where that can be seen."""


@dataclass(frozen=True, slots=True)
class Subject:
    """The event that an answer is about."""

    event_id: str
    rule: str
    actors: tuple[Actor, ...]


@dataclass(frozen=True, slots=True)
class Answer:
    """What somebody said of an event.

    Raises:
        AnswerError: where nobody says it, or a mute does not end within :data:`LONGEST_MUTE_S` after it is said.
    """

    kind: Kind
    subject: Subject
    by: str
    """Who says it."""
    at_ns: int
    """When, in nanoseconds since 1970."""
    until_ns: int | None = None
    """When a mute ends."""
    whole_rule: bool = False
    """Whether a mute is of the rule for everybody, rather than for the actors of the event."""
    note: str = ""

    def __post_init__(self) -> None:
        if not self.by.strip():
            raise AnswerError(
                "an answer needs an author",
                where="--by",
                expected="who answers",
                got=repr(self.by),
                do_next="give a name or a shift's sign with --by",
            )
        if (self.until_ns is None) != (self.kind != "muted"):
            raise ValueError("a mute has an end, and nothing else has one")
        if self.until_ns is not None and not 0 < self.until_ns - self.at_ns <= LONGEST_MUTE_S * 1e9:
            raise AnswerError(
                "a mute cannot end then",
                where="--mute-until",
                expected=f"a time after {utc(self.at_ns)}, by {LONGEST_MUTE_S / 86400:g} days at most",
                got=utc(self.until_ns),
                do_next="give an earlier or later time; what is to be silent for good is taken out of the rule file",
            )

    def mutes(self, event: Event, at_ns: int) -> bool:
        """Whether the event is not to be sent at this time: it is this one, or of the same rule and actors."""
        if self.until_ns is None or at_ns >= self.until_ns:
            return False
        if event.event_id == self.subject.event_id:
            return True
        return event.rule == self.subject.rule and (
            self.whole_rule or _identities(event.actors) == _identities(self.subject.actors)
        )


@dataclass(frozen=True, slots=True)
class Answers:
    """Everything that was answered to the events of a recording."""

    answers: tuple[Answer, ...] = ()
    """In the order in which it was said."""
    unreadable: int = 0
    """Lines that are no answers."""

    def mute_of(self, event: Event, at_ns: int) -> Answer | None:
        """The answer that keeps an event from being sent at this time; None where it is to be sent."""
        mutes = {answer.subject.event_id: answer for answer in self.answers if answer.kind == "muted"}
        return next((answer for answer in mutes.values() if answer.mutes(event, at_ns)), None)


def append_answer(recording: Path, answer: Answer) -> Path:
    """Write an answer down; it is on the disk when this returns.

    Args:
        recording: ``FOLDER/NAME.mcap``.
        answer: The answer.

    Returns:
        The file that it was appended to.

    Raises:
        OutputError: where the file cannot be written.
    """
    path = beside(recording, ANSWERS_SUFFIX)
    try:
        append_line(path, _document(answer))
    except OSError as error:
        raise OutputError(path, got=error.strerror or str(error)) from error
    return path


def read_answers(recording: Path) -> Answers:
    """What was answered so far.

    Raises:
        OSError: where the file is there and cannot be read.
    """
    lines = read_lines(beside(recording, ANSWERS_SUFFIX))
    answers = tuple(answer for document in lines.documents if (answer := _answer(document)) is not None)
    return Answers(answers, lines.damaged + len(lines.documents) - len(answers))


def note_event(recording: Path, event: Event, phase: Phase, at_ns: int, mute: Answer | None) -> None:
    """Write down that an event was raised or has ended, whether or not it is muted.

    Raises:
        OSError: where the disk refuses.
    """
    document = {
        "format": "recognition.raised",
        "version": 1,
        "phase": phase,
        "at_utc": utc(at_ns),
        "severity": event.severity,
        "sentence": event.sentence,
        **_subject_document(Subject(event.event_id, event.rule, event.actors)),
        "muted_by": None if mute is None else mute.by,
        "muted_until_utc": None if mute is None or mute.until_ns is None else utc(mute.until_ns),
    }
    append_line(beside(recording, ALARMS_SUFFIX), document)


def find_subject(recording: Path, event_id: str, others: Iterable[Subject] = ()) -> Subject:
    """The event of this name.

    Args:
        recording: ``FOLDER/NAME.mcap``.
        event_id: Which.
        others: Events that are known from elsewhere, such as the recording itself.

    Raises:
        AnswerError: where the recording has no such event.
    """
    path = beside(recording, ALARMS_SUFFIX)
    try:
        noted = [_subject(document) for document in read_lines(path).documents]
    except OSError as error:
        raise AnswerError(
            "cannot read which events there are",
            where=path,
            expected="a file that can be read",
            got=error.strerror,
            do_next="check its permissions",
        ) from error
    known = {subject.event_id: subject for subject in (*others, *noted) if subject is not None}
    if event_id in known:
        return known[event_id]
    latest = list(known)[-3:]
    raise AnswerError(
        "the recording has no such event",
        where=recording,
        expected=f"the identifier of an event; the latest are {', '.join(latest)}" if latest else "an event",
        got=event_id,
        do_next="take the event_id of the alarm" if latest else "check that this is the recording of the alarm",
    )


def _identities(actors: Iterable[Actor]) -> set[tuple[str, int]]:
    return {(actor.kind, actor.track_id) for actor in actors}


def _subject_document(subject: Subject) -> dict[str, Any]:
    actors = [{"kind": one.kind, "track_id": one.track_id, "role": one.role} for one in subject.actors]
    return {"event_id": subject.event_id, "rule": subject.rule, "actors": actors}


def _document(answer: Answer) -> dict[str, Any]:
    return {
        "format": "recognition.answer",
        "version": 1,
        "answer": answer.kind,
        **_subject_document(answer.subject),
        "by": answer.by,
        "at_utc": utc(answer.at_ns),
        "at_ns": answer.at_ns,
        "until_utc": None if answer.until_ns is None else utc(answer.until_ns),
        "until_ns": answer.until_ns,
        "whole_rule": answer.whole_rule,
        "note": answer.note,
    }


def _subject(document: dict[str, Any]) -> Subject | None:
    try:
        actors = tuple(Actor(str(a["kind"]), int(a["track_id"]), str(a["role"])) for a in document["actors"])
        return Subject(str(document["event_id"]), str(document["rule"]), actors)
    except (KeyError, TypeError, ValueError):  # of another format
        return None


def _answer(document: dict[str, Any]) -> Answer | None:
    subject = _subject(document)
    if subject is None or document.get("answer") not in get_args(Kind):
        return None
    try:
        until_ns = document["until_ns"]
        return Answer(
            kind=document["answer"],
            subject=subject,
            by=str(document["by"]),
            at_ns=int(document["at_ns"]),
            until_ns=None if until_ns is None else int(until_ns),
            whole_rule=bool(document["whole_rule"]),
            note=str(document["note"]),
        )
    except (KeyError, TypeError, ValueError, AnswerError):  # written by hand, or by another version
        return None
