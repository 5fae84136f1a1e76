"""Events beside the truth: found in time, too early, too late, missed, or for nothing."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

sys.path.insert(0, str(Path(__file__).parent))
from alarm_fakes import SECOND, T0, event

from recognition.cli import app, demo
from recognition.errors import DatasetError, SourceError
from recognition.evaluation.found import compare_events
from recognition.evaluation.violations import KINDS, Stretch, read_violations

LADDER = KINDS.index("ladder")


def truth(folder, *spans, kind="ladder"):
    violations = [{"kind": kind, "start_s": a, "end_s": b, "workers": ["w"], "things": []} for a, b in spans]
    document = {"format": "sicsg.sequence", "version": 1, "epoch_s": T0 / SECOND, "violations": violations}
    (folder / "truth.json").write_text(json.dumps(document))
    return read_violations(folder)


def raised(name, start_s, end_s, *, after_s=0.3, rule="ladder"):
    made = event(name, t_s=start_s, end_s=end_s, rule=rule)
    return replace(made, raised_ns=made.start_ns + round(after_s * SECOND))


def test_the_truth_is_read_without_its_pixels(tmp_path):
    read = truth(tmp_path, (3.0, 5.0), (4.0, 6.0), (9.0, 9.5))
    assert read.epoch_ns == T0
    assert read.stretches[LADDER] == (Stretch(3.0, 6.0), Stretch(9.0, 9.5))
    (tmp_path / "truth.json").write_text('{"format": "sicsg.sequence", "version": 1}')
    with pytest.raises(DatasetError, match="the truth has another form"):
        read_violations(tmp_path)


@pytest.mark.parametrize(
    ("start_s", "delay_s", "in_time"), [(2.9, 0.2, True), (3.8, 1.1, False), (1.5, -1.2, False), (3.7, 1.0, True)]
)
def test_a_violation_is_found_in_time_within_a_second_of_its_start(tmp_path, start_s, delay_s, in_time):
    found = compare_events(truth(tmp_path, (3.0, 6.0)), [raised("e", start_s, 5.5)])
    (one,) = found.sought
    assert one.delay_s == pytest.approx(delay_s, abs=1e-6)
    assert (found.in_time, found.false) == (int(in_time), ())


def test_of_several_events_the_nearest_counts_and_what_touches_none_is_false(tmp_path):
    events = [raised("late", 5.0, 6.0), raised("near", 3.1, 3.5), raised("far", 8.0, 9.0), raised("lasting", 7.0, None)]
    found = compare_events(truth(tmp_path, (3.0, 6.0)), [*events, raised("other", 0, 9, rule="running")])
    assert found.sought[0].event.event_id == "near"
    assert [one.event_id for one in found.false] == ["far", "lasting"]
    assert [one.event_id for one in found.events] == ["near", "late", "lasting", "far"]


def test_what_nobody_found_is_missed(tmp_path):
    found = compare_events(truth(tmp_path, (3.0, 6.0)), [raised("e", 3.0, 5.0, rule="no_hat")])
    assert (found.sought[0].event, found.sought[0].delay_s, found.in_time) == (None, None, 0)
    assert [one.rule for one in found.false] == ["no_hat"]


def test_the_demo_says_where_its_site_is_not(monkeypatch, tmp_path):
    monkeypatch.setattr(demo, "SITE", tmp_path)
    error = CliRunner().invoke(app, ["demo", "-o", str(tmp_path / "out")]).exception
    assert isinstance(error, SourceError)
    assert "demo.rig.json, work, site.rules.toml, which a checkout of the repository has" in str(error)
    assert not (tmp_path / "out").exists()


def test_the_demo_tells_what_was_found_beside_the_truth(tmp_path):
    events = [raised("near", 3.1, 5.0), raised("far", 8.0, 9.0)]
    told = list(demo._lines(compare_events(truth(tmp_path, (3.0, 6.0), (20.0, 24.0)), events), T0))
    assert told == [
        "1 of 2 violations found within 1 s of their start, 1 false",
        "  ladder, 3.0 s to 6.0 s: raised 0.40 s after its start",
        "  ladder, 20.0 s to 24.0 s: MISSED",
        "  FALSE ladder at 8.0 s (worker 7)",
    ]
