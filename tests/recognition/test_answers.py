"""Operators' answers: appended with author and time, never rewritten, and heeded; workers are nobody beyond a shift."""

from __future__ import annotations

import json
import sys
import time
from datetime import UTC, datetime
from datetime import time as day_time
from pathlib import Path
from zoneinfo import ZoneInfo

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from alarm_fakes import SECOND, T0, event

from recognition.alarms import Answer, ShiftNames, Subject, append_answer, find_subject, read_answers, recording_named
from recognition.alarms.answers import note_event
from recognition.cli import main
from recognition.errors import AnswerError, RecordingError
from recognition.events import Actor
from recognition.recording.naming import recording_stem
from rigcal.errors import OutputError

SUBJECT = Subject("e1", "no_hat", event().actors)


@pytest.fixture
def recording(tmp_path):
    """A run that goes on and has raised ``e1``."""
    (tmp_path / "run.mcap.part").touch()
    path = tmp_path / "run.mcap"
    note_event(path, event("e0"), "raised", T0, None)
    note_event(path, event("e1"), "raised", T0, None)
    return path


def ack(monkeypatch, *arguments) -> int:
    monkeypatch.setattr(sys, "argv", ["recognition", "ack", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code


def test_an_answer_is_written_down_with_author_and_time(monkeypatch, capsys, recording):
    before_ns = time.time_ns()
    assert ack(monkeypatch, recording, "e1", "--by", "Kim, gate 2", "--note", "hat was brown") == 0
    assert capsys.readouterr().out.startswith("e1 (no_hat): acknowledged, by Kim, gate 2; written to ")
    (answer,) = read_answers(recording).answers
    assert before_ns <= answer.at_ns <= time.time_ns()
    assert (answer.kind, answer.subject, answer.by, answer.note) == (
        "acknowledged", SUBJECT, "Kim, gate 2", "hat was brown"
    )  # fmt: skip


def test_answers_are_added_and_never_rewritten(monkeypatch, recording):
    assert ack(monkeypatch, recording, "e1", "--by", "kim") == 0
    log = recording.with_name("run.answers.jsonl")
    first = log.read_bytes()
    assert ack(monkeypatch, recording.parent, "e1", "--by", "lee", "--false-alarm") == 0
    assert log.read_bytes().startswith(first)
    assert [answer.kind for answer in read_answers(recording).answers] == ["acknowledged", "false alarm"]


def test_a_line_that_was_torn_costs_itself_alone(recording):
    answer = Answer("acknowledged", SUBJECT, "kim", T0)
    log = append_answer(recording, answer)
    with log.open("ab") as stream:
        stream.write(b'{"format": "recogn')
    assert read_answers(recording).unreadable == 0, "somebody may be writing it"
    append_answer(recording, answer)
    found = read_answers(recording)
    assert (found.answers, found.unreadable) == ((answer, answer), 1)


def test_lines_of_others_are_counted_and_passed_over(recording):
    log = append_answer(recording, Answer("acknowledged", SUBJECT, "kim", T0))
    good = json.loads(log.read_text())
    bad = [{}, {**good, "answer": "hm"}, {**good, "at_ns": "x"}, {**good, "actors": [1]}, {**good, "until_ns": 1}, []]
    with log.open("a") as stream:
        stream.writelines(json.dumps(one) + "\n" for one in bad)
    found = read_answers(recording)
    assert (len(found.answers), found.unreadable) == (1, len(bad))


def test_a_mute_ends_at_its_time_or_after_its_length(monkeypatch, capsys, recording):
    now_ns = time.time_ns()
    assert ack(monkeypatch, recording, "e1", "--by", "kim", "--mute-until", "+90min", "--json") == 0
    until_ns = json.loads(capsys.readouterr().out)["until_ns"]
    assert 0 <= until_ns - now_ns - 5400 * SECOND < 30 * SECOND
    moment = datetime.fromtimestamp(round(now_ns / SECOND) + 3600, UTC)
    assert ack(monkeypatch, recording, "e1", "--by", "kim", "--whole-rule", "--mute-until", moment.isoformat()) == 0
    assert capsys.readouterr().out.startswith("e1 (no_hat): muted for everybody until ")
    answer = read_answers(recording).answers[-1]
    assert answer.until_ns == moment.timestamp() * SECOND
    assert answer.whole_rule


def mute(name="e1", *, until_s, whole_rule=False, worker=7) -> Answer:
    subject = Subject(name, "no_hat", (Actor("worker", worker, "w"),))
    return Answer("muted", subject, "kim", T0, T0 + round(until_s * SECOND), whole_rule=whole_rule)


def test_a_mute_is_of_the_rule_and_those_who_were_in_it(recording):
    append_answer(recording, mute(until_s=60))
    answers = read_answers(recording)
    at_ns = T0 + 30 * SECOND
    assert answers.mute_of(event("later"), at_ns)
    assert not answers.mute_of(event("later", worker=8), at_ns)
    assert not answers.mute_of(event("later", rule="ladder"), at_ns)
    assert answers.mute_of(event("e1", worker=8), at_ns), "the event itself, whoever joined it"
    assert not answers.mute_of(event("later"), T0 + 60 * SECOND)


def test_of_two_mutes_of_an_event_the_later_stands(recording):
    for answer in (mute(until_s=600), mute("e0", until_s=60, worker=8), mute(until_s=1)):
        append_answer(recording, answer)
    answers, at_ns = read_answers(recording), T0 + 30 * SECOND
    assert not answers.mute_of(event("later"), at_ns)
    assert answers.mute_of(event("later", worker=8), at_ns)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["e7", "--by", "kim"], "the recording has no such event"),
        (["e1", "--by", " "], "an answer needs an author"),
        (["e1", "--by", "kim", "--mute-until", "14:30"], "option --mute-until is out of range"),
        (["e1", "--by", "kim", "--mute-until", "2026-11-22T14:30"], "a time with its zone"),
        (["e1", "--by", "kim", "--mute-until", "+90"], "option --mute-until is out of range"),
        (["e1", "--by", "kim", "--mute-until", "2020-01-01T00:00Z"], "a mute cannot end then"),
        (["e1", "--by", "kim", "--mute-until", "+200h"], "by 7 days at most"),
        (["e1", "--by", "kim", "--whole-rule"], "these options do not go together"),
        (["e1", "--by", "kim", "--false-alarm", "--mute-until", "+1h"], "these options do not go together"),
    ],
)
def test_what_is_no_answer_is_refused_and_not_written(monkeypatch, capsys, recording, arguments, said):
    assert ack(monkeypatch, recording, *arguments) == 2
    assert said in capsys.readouterr().err
    assert not recording.with_name("run.answers.jsonl").exists()


def test_an_unknown_event_is_told_with_those_that_there_are(recording):
    with pytest.raises(AnswerError, match="the latest are e0, e1"):
        find_subject(recording, "e7")
    assert find_subject(recording, "e7", [Subject("e7", "ladder", ())]).rule == "ladder"


def test_answers_that_cannot_be_written_are_an_error(recording):
    recording.with_name("run.answers.jsonl").mkdir()
    with pytest.raises(OutputError):
        append_answer(recording, Answer("acknowledged", SUBJECT, "kim", T0))


def test_recordings_are_found_by_any_of_their_names(tmp_path):
    for name in ("a.000.mcap", "a.001.mcap.part", "b.mcap", "c.mcap.part", "a.rig.json"):
        (tmp_path / name).touch()
    for name, whole in (("a.mcap", "a"), ("a.001.mcap", "a"), ("b.mcap", "b"), ("c.mcap", "c"), ("c.mcap.part", "c")):
        assert recording_named(tmp_path / name) == tmp_path / f"{whole}.mcap"
    stems = {
        ".part": None,
        ".mcap": None,
        "000.mcap": "000",
        "a.00.mcap": "a.00",
        "a.1234.mcap.part": "a",
        "a.txt": None,
    }
    assert {name: recording_stem(tmp_path / name) for name in stems} == stems
    for path in (tmp_path, tmp_path / "d.mcap", tmp_path / "a.rig.json"):
        with pytest.raises(RecordingError):
            recording_named(path)


def worker(track_id: int) -> Actor:
    return Actor("worker", track_id, "w")


def at(text: str) -> int:
    return round(datetime.fromisoformat(text).timestamp()) * SECOND


def test_workers_are_numbered_anew_in_each_shift():
    names = ShiftNames([day_time(6), day_time(14), day_time(22)], ZoneInfo("Europe/Berlin"))
    morning, noon, night = at("2026-11-22T07:00+01:00"), at("2026-11-22T14:00+01:00"), at("2026-11-23T03:00+01:00")
    assert [names.name(worker(track), morning) for track in (41, 17, 41)] == ["worker 1", "worker 2", "worker 1"]
    assert [names.name(worker(track), noon) for track in (17, 41)] == ["worker 1", "worker 2"]
    assert names.name(worker(17), morning) == "worker 2", "what began before still ends under its name"
    assert names.name(worker(99), night) == "worker 1"
    assert [names.shift(t) for t in (morning, noon, night)] == [
        "2026-11-22 06:00", "2026-11-22 14:00", "2026-11-22 22:00"
    ]  # fmt: skip


def test_objects_keep_their_class_and_number():
    assert ShiftNames().name(Actor("ladder", 3, "l"), T0) == "ladder 3"
