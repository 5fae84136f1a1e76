"""Events files: read back as they were written, the same bytes for the same events, and refused where they are not."""

import json
import math
import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from alarm_fakes import T0, event

from recognition.errors import EventsError
from recognition.events import (
    Actor,
    EventLog,
    Margin,
    by_start,
    event_document,
    event_of,
    events_text,
    lasts_at,
    marks_at,
    name_of,
    read_events,
    rules_of,
    utc,
    write_events,
)

ENDED, LASTING = event("e1", end_s=4.0), event("e2", t_s=2.0, rule="ladder", worker=3)
LOG = EventLog(
    recording="run.mcap",
    rules_name="site",
    rules_digest="sha256:1",
    rig_digest="sha256:2",
    rig_verdict="PASS",
    association="tracked",
    smoothed=False,
    monitoring={"MONITORED": 90, "NOT MONITORED": 10},
    caveats=("not validated on real people",),
    events=(ENDED, LASTING),
)


def test_a_file_is_read_as_it_was_written(tmp_path):
    write_events(LOG, tmp_path / "new" / "run.events.json")
    again = read_events(tmp_path / "new" / "run.events.json")
    assert repr(again.events) == repr(LOG.events)  # NaN is not equal to itself
    assert replace(again, events=(), monitoring={}) == replace(LOG, events=(), monitoring={})
    assert dict(again.monitoring) == LOG.monitoring
    assert events_text(again) == events_text(LOG)


def test_a_file_is_json_with_an_event_on_each_line_and_no_nan():
    lines = events_text(LOG).splitlines()
    events = [json.loads(line.removesuffix(",")) for line in lines if '"event_id"' in line]
    document = json.loads(events_text(LOG), parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    assert document["events"] == events
    assert (document["format"], document["version"]) == ("recognition.events", 1)
    assert (document["events"][0]["start_utc"], document["events"][1]["end_utc"]) == ("2026-11-18T11:06:40.000Z", None)
    assert document["events"][0]["margins"][0] == [T0, None]
    assert json.loads(events_text(replace(LOG, events=())))["events"] == []


def test_a_capture_without_a_date_has_no_utc():
    assert utc(5_000_000_000) is None
    assert event_document(replace(ENDED, start_ns=10**9))["start_utc"] is None


def test_events_stand_in_order_of_their_start():
    assert by_start([LASTING, ENDED]) == (ENDED, LASTING)


def test_who_takes_part_is_marked_from_the_start_to_the_end():
    both = (ENDED, replace(LASTING, actors=(Actor("worker", 7, "w"), Actor("ladder", 2, "l"))))
    assert marks_at(both, T0 - 1) == {}
    assert marks_at(both, T0) == {("worker", 7): ("no_hat",)}
    marks = marks_at(both, T0 + 3 * 10**9)
    assert marks == {("worker", 7): ("no_hat", "ladder"), ("ladder", 2): ("ladder",)}
    assert (name_of("worker", 7, marks), name_of("worker", 8, marks)) == ("worker 7: no_hat, ladder", "worker 8")
    assert rules_of(marks) == ("ladder", "no_hat")
    assert lasts_at(LASTING, T0 + 10**15)
    assert not lasts_at(ENDED, T0 + 4 * 10**9)


def broken(change):
    document = json.loads(events_text(LOG))
    change(document)
    return json.dumps(document)


@pytest.mark.parametrize(
    ("text", "got"),
    [
        ("{", "no JSON"),
        ("[]", "format None"),
        (broken(lambda d: d.update(version=2)), "version 2"),
        (broken(lambda d: d.pop("rules")), "'rules'"),
        (broken(lambda d: d["events"][0].pop("rule")), "no rule"),
        (broken(lambda d: d["events"][0].update(margins=[[1]])), "margins are no pairs"),
        (broken(lambda d: d["events"][0].update(actors=[3])), "another form"),
        (broken(lambda d: d.update(events=7)), "another form"),
        (broken(lambda d: d.update(monitoring=[])), "another form"),
        (broken(lambda d: d["events"][0].update(start_ns="soon")), "another form"),
    ],
)
def test_what_is_no_events_file_is_refused(tmp_path, text, got):
    path = tmp_path / "e.json"
    path.write_text(text)
    with pytest.raises(EventsError) as caught:
        read_events(path)
    assert got in str(caught.value)
    assert str(path) in str(caught.value)
    assert "recognition replay IN.mcap --rules FILE --events OUT.json" in str(caught.value)


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(EventsError, match="No such file"):
        read_events(tmp_path / "none.json")


def test_margins_that_are_nan_come_back_as_nan():
    (first, second) = event_of(event_document(ENDED)).margins
    assert math.isnan(first.value)
    assert second == Margin(T0 + 4 * 10**9, 0.4)
