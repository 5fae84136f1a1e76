"""A batch is a row for each recording, whatever is wrong with some, and computes nothing twice."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

sys.path.insert(0, str(Path(__file__).parent))
from batch_recordings import FLOOR_RULE, RULES, Site, content, judged

from recognition.batch import Found, Orders, Results, find_recordings, require_apart
from recognition.batch.judged import Task, judge_recording
from recognition.batch.rows import row_of, table
from recognition.cli import app
from recognition.crews import Crew, dask_workers
from recognition.errors import BatchError
from recognition.recording import Recorder
from recognition.replay import recorded_options, replay
from recognition.sources.recording import open_recording
from rigcal.errors import OutputError
from rigcal.rigdocument import RigDocument
from rigcal.rigfile import read_rigfile, rig_of, write_rigfile

ORDERS = Orders(RULES, "walks.rules.toml")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    return Site(tmp_path_factory.mktemp("site"), 60)


@pytest.fixture(scope="module")
def day(site, tmp_path_factory):
    """Three recordings, one of them of segments, with their rows in order of the paths."""
    folder = tmp_path_factory.mktemp("day")
    site.record(folder / "a.mcap", 0, 16)
    site.record(folder / "b.mcap", 20, 16, segment_s=0.5)
    site.record(folder / "c.mcap", 40, 16, rules_toml=RULES.encode())
    return folder


@pytest.fixture
def here():
    """A crew of this very process."""
    with ThreadPoolExecutor(1) as executor:
        yield Crew(lambda: executor, 2, ())


# --- which recordings --------------------------------------------------------------------------------------------


def names(*inputs) -> list[str]:
    return [one.name for one in find_recordings([str(given) for given in inputs])]


def test_files_segments_folders_and_patterns_stand_for_each_recording_once(day):
    assert names(day) == ["a", "b", "c"]
    assert names(day / "c.mcap", day) == ["c", "a", "b"]
    assert names(day / "b.001.mcap", day / "b.mcap", day / "b.000.mcap") == ["b"]
    assert names(f"{day}/*.mcap") == names(f"{day.parent}/{day.name}/**/*") == ["a", "b", "c"]
    assert find_recordings([str(day / "b.mcap")])[0].path == day / "b.mcap"


def test_names_that_several_folders_have_are_told_apart_by_the_folders(tmp_path):
    for path in ("x/run.mcap", "y/run.mcap", "y/other.mcap", "z/y/run.mcap"):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).touch()
    assert names(tmp_path) == ["x/run", "other", f"{tmp_path.name}/y/run", "z/y/run"]
    assert names(tmp_path / "x") == ["run"]


def test_a_date_in_a_name_makes_no_segment_and_unfinished_recordings_count(site, day, tmp_path):
    for date in ("20261121", "20261122"):
        (tmp_path / f"hall.{date}.mcap").write_bytes((day / "a.mcap").read_bytes())
    assert names(tmp_path) == ["hall.20261121", "hall.20261122"]
    (tmp_path / "cut.mcap.part").touch()
    (tmp_path / "long.000.mcap.part").touch()
    assert names(tmp_path) == ["cut", "hall.20261121", "hall.20261122", "long"]


def test_names_that_stand_for_nothing_are_refused_in_words(tmp_path):
    with pytest.raises(BatchError) as caught:
        names(tmp_path)
    assert str(caught.value) == (
        "there is no recording here\n"
        f"  where:    {tmp_path}\n"
        "  expected: recordings, NAME.mcap, a folder that holds some, or a pattern that some match\n"
        "  got:      a folder without any\n"
        "  do next:  check the path"
    )
    for absent in (tmp_path / "absent.mcap", tmp_path / "*.mcap"):
        with pytest.raises(BatchError, match="nothing of this name"):
            names(absent)


# --- rows --------------------------------------------------------------------------------------------------------


def test_a_row_says_what_the_replay_of_the_recording_says(day, here, tmp_path):
    result = judged([day], tmp_path / "out", ORDERS, here)
    assert [row.name for row in result.rows] == ["a", "b", "c"]
    counts = []
    for row in result.rows:
        opened = open_recording(Path(row.recording))
        again = replay(opened, recorded_options(opened))
        assert (row.status, row.error, row.warnings) == ("ok", None, ())
        assert (row.instants, row.workers) == (again.instants, len(again.worker_instants)) == (16, 2)
        assert row.seconds == 1.5
        assert (row.monitored_share, row.degraded_share) == (1.0, 0.0)
        arguments = ["replay", row.recording, "--rules", str(tmp_path / "walks.rules.toml")]
        (tmp_path / "walks.rules.toml").write_text(RULES)
        done = CliRunner().invoke(app, [*arguments, "--events", str(tmp_path / "events.json")])
        assert done.exit_code == 0, done.output
        told = (tmp_path / "events.json").read_bytes()
        assert (tmp_path / f"out/{row.name}.events.json").read_bytes() == told
        rules = [event["rule"] for event in json.loads(told)["events"]]
        counts.append({rule: rules.count(rule) for rule in ("hurry", "together")})
        assert row.events == counts[-1]
    assert len({tuple(count.items()) for count in counts}) > 1
    lines = (tmp_path / "out/batch.jsonl").read_bytes().splitlines()
    assert [row_of(line) for line in lines] == list(result.rows)


def test_the_table_has_a_column_for_each_rule(day, here, tmp_path):
    rows = judged([day / "a.mcap", day / "c.mcap"], tmp_path, ORDERS, here).rows
    failed = replace(rows[1], status="failed", error='no "rig", or none\nat all', events=None, seconds=None)
    read = list(csv.DictReader(io.StringIO(table([rows[0], failed]))))
    assert read[0]["events.hurry"] == str(rows[0].events["hurry"])
    assert (read[1]["events.hurry"], read[1]["seconds"], read[1]["error"]) == ("", "", failed.error)
    assert (read[0]["recording"], read[0]["digest"]) == (str(day / "a.mcap"), rows[0].digest)


def test_without_a_rule_file_each_recording_is_judged_by_its_own(day, here, tmp_path):
    rows = judged([day], tmp_path, Orders(), here).rows
    assert [row.events for row in rows[:2]] == [{}, {}]
    assert [row.rules_digest for row in rows[:2]] == [None, None]
    by_given = judge_recording(Task(Found(day / "c.mcap", "c"), ORDERS, None)).row
    assert rows[2].events == by_given.events
    assert rows[2].rules_digest == by_given.rules_digest
    assert sorted(content(tmp_path)) == ["batch.csv", "batch.jsonl", "c.events.json"]


def test_the_digest_is_that_of_the_bytes_of_all_segments(day, tmp_path):
    whole = tmp_path / "whole"
    whole.write_bytes(b"".join(file.read_bytes() for file in sorted(day.glob("b.*.mcap"))))
    row = judge_recording(Task(Found(day / "b.mcap", "b"), ORDERS, None)).row
    assert row.digest == f"sha256:{hashlib.sha256(whole.read_bytes()).hexdigest()}"


def test_what_cannot_be_judged_is_a_row_that_says_why_and_not_the_end(site, day, here, tmp_path):
    folder = tmp_path / "in"
    good = site.record(folder / "a.mcap", 0, 16)
    (folder / "cut.mcap").write_bytes(good.read_bytes()[:-100])
    (folder / "text.mcap").write_text("no recording")
    (folder / "part.mcap.part").write_bytes(good.read_bytes()[:-100])
    with Recorder(folder / "void.mcap", rig=site.rig, rig_json=site.rig_path.read_bytes(), metadata={}) as recorder:
        recorder.log("info", "nothing seen", 1)
    (folder / "gone.mcap").symlink_to(tmp_path / "nowhere")
    result = judged([folder], tmp_path / "out", ORDERS, here)
    assert {row.name: row.status for row in result.rows} == {
        "a": "ok", "cut": "failed", "gone": "failed", "part": "failed", "text": "failed", "void": "failed",
    }  # fmt: skip
    assert (result.failed, result.left) == (5, 0)
    errors = {row.name: row.error for row in result.rows}
    assert errors["void"].startswith("the recording holds no detections to replay; where: ")
    assert errors["cut"].startswith("the recording is unfinished or damaged; ")
    assert f"do next: run `recognition recover {folder / 'cut.mcap'} -o" in errors["cut"]
    assert errors["part"].startswith("the recording is not finished; ")
    assert errors["gone"].startswith("the system refuses it: [Errno 2] No such file or directory")
    assert all(error is None or "\n" not in error for error in errors.values())
    assert sorted(content(tmp_path / "out")) == ["a.events.json", "batch.csv", "batch.jsonl"]


def test_rules_that_a_rig_cannot_be_judged_by_are_a_row(site, tmp_path):
    flat = Site.__new__(Site)
    flat.rig_path, flat.views = tmp_path / "flat.rig.json", site.views
    document = json.loads(site.rig_path.read_text())
    assert document["world_from_rig"] is not None
    write_rigfile(RigDocument.model_validate(document | {"world_from_rig": None}), flat.rig_path)
    flat.rig = rig_of(read_rigfile(flat.rig_path))
    path = flat.record(tmp_path / "flat.mcap", 0, 16)
    row = judge_recording(Task(Found(path, "flat"), Orders(RULES + FLOOR_RULE), None)).row
    assert row.status == "failed"
    assert row.digest is not None
    assert "rigcal world" in row.error


def test_a_worker_of_another_version_judges_nothing(day):
    row = judge_recording(Task(Found(day / "a.mcap", "a"), replace(ORDERS, version="9.9"), None)).row
    assert (row.status, row.version) == ("failed", "9.9")
    assert row.error.startswith("the worker has another version of the program than the batch; expected: 9.9; got: ")


def test_a_mistake_of_the_program_is_a_row_too(day, here, tmp_path, monkeypatch):
    def broken(_task):
        raise IndexError("list index out of range")

    monkeypatch.setattr("recognition.batch.running.judge_recording", broken)
    result = judged([day], tmp_path, ORDERS, here)
    assert result.failed == 3
    assert result.rows[0].error == ("a mistake of the program, please report it: IndexError: list index out of range")


# --- again -------------------------------------------------------------------------------------------------------


@pytest.fixture
def done(day, here, tmp_path):
    """A batch that is done: its inputs, its folder, and what is in it."""
    inputs = tmp_path / "in"
    inputs.mkdir()
    for file in day.iterdir():
        (inputs / file.name).write_bytes(file.read_bytes())
    judged([inputs], tmp_path / "out", ORDERS, here)
    return inputs, tmp_path / "out", content(tmp_path / "out")


def computed(inputs, output, orders, crew) -> set[str]:
    """Which recordings a batch computes."""
    seen = set()

    class Spy(ThreadPoolExecutor):
        def submit(self, work, task):
            def noted(task):
                judged = work(task)
                if not judged.is_earlier:
                    seen.add(task.found.name)
                return judged

            return super().submit(noted, task)

    with Spy(1) as executor:
        result = judged([inputs], output, orders, Crew(lambda: executor, 1, ()))
    assert result.reused == len(result.rows) - len(seen)
    return seen


def test_the_same_batch_again_computes_nothing_and_leaves_the_same_bytes(done, here):
    inputs, output, before = done
    assert computed(inputs, output, ORDERS, here) == set()
    assert content(output) == before


def test_what_has_changed_is_computed_again_and_nothing_else(site, done, here):
    inputs, output, before = done
    site.record(inputs / "a2.mcap", 3, 16)
    (inputs / "a.mcap").unlink()
    (inputs / "a2.mcap").rename(inputs / "a.mcap")
    assert computed(inputs, output, ORDERS, here) == {"a"}
    assert content(output)["b.events.json"] == before["b.events.json"]
    assert content(output)["a.events.json"] != before["a.events.json"]
    (output / "b.events.json").write_bytes(before["b.events.json"][:-1])
    (output / "c.events.json").unlink()
    assert computed(inputs, output, ORDERS, here) == {"b", "c"}
    assert content(output)["b.events.json"] == before["b.events.json"]
    assert computed(inputs, output, replace(ORDERS, smooth=True), here) == {"a", "b", "c"}
    assert computed(inputs, output, Orders(RULES.replace("0.55", "0.56")), here) == {"a", "b", "c"}


def test_what_failed_is_tried_again(done, here):
    inputs, output, before = done
    whole = (inputs / "a.mcap").read_bytes()
    (inputs / "a.mcap").write_bytes(whole[:-10])
    result = judged([inputs], output, ORDERS, here)
    assert (result.rows[0].status, result.reused) == ("failed", 2)
    assert "a.events.json" not in content(output)
    (inputs / "a.mcap").write_bytes(whole)
    assert computed(inputs, output, ORDERS, here) == {"a"}
    assert content(output) == before


def test_a_killed_batch_goes_on_from_its_whole_rows(done, here):
    inputs, output, before = done
    rows = before["batch.jsonl"].splitlines(keepends=True)
    (output / "batch.jsonl").unlink()
    (output / "batch.csv").unlink()
    (output / "batch.jsonl.part").write_bytes(rows[2] + rows[0][: len(rows[0]) // 2])
    (output / "a.events.json.writing").write_bytes(before["a.events.json"][:10])
    assert computed(inputs, output, ORDERS, here) == {"a", "b"}
    assert content(output) == before


def test_a_batch_that_is_stopped_keeps_what_is_done_and_no_table(day, here, tmp_path):
    done = []
    result = judged(
        [day], tmp_path / "out", ORDERS, here, on_row=lambda row, _: done.append(row), stop=lambda: bool(done)
    )
    assert (len(result.rows), result.left) == (1, 2)
    assert sorted(content(tmp_path / "out")) == ["a.events.json", "batch.jsonl.part"]
    assert judged([day], tmp_path / "out", ORDERS, here).reused == 1
    judged([day], tmp_path / "whole", ORDERS, here)
    assert content(tmp_path / "out") == content(tmp_path / "whole")


def test_rows_of_recordings_that_are_not_asked_for_go_and_it_is_said(done, here):
    inputs, output, before = done
    result = judged([inputs / "a.mcap"], output, ORDERS, here)
    assert result.left_out == ("b", "c")
    assert (output / "batch.jsonl").read_bytes() == before["batch.jsonl"].splitlines(keepends=True)[0]


def test_a_line_that_was_cut_or_is_of_another_version_is_no_row(done):
    line = done[2]["batch.jsonl"].splitlines()[0]
    document = json.loads(line)
    assert row_of(line) is not None
    for other in (line[:-1], b"", b"[]", b"\xff", json.dumps(document | {"new": 1}).encode()):
        assert row_of(other) is None
    del document["digest"]
    assert row_of(json.dumps(document).encode()) is None


# --- refused -----------------------------------------------------------------------------------------------------


def test_two_batches_do_not_write_to_one_folder(tmp_path):
    with Results(tmp_path), pytest.raises(BatchError) as caught:
        Results(tmp_path)
    assert str(caught.value) == (
        "another batch is writing here\n"
        f"  where:    {tmp_path}\n"
        "  expected: a folder that no batch is writing to\n"
        "  got:      a process that writes batch.jsonl.part\n"
        "  do next:  give another one with -o, or wait for that batch"
    )


def test_results_do_not_go_where_the_events_of_the_runs_are(day, tmp_path):
    with pytest.raises(BatchError) as caught:
        require_apart(day, find_recordings([str(day)]))
    assert str(caught.value) == (
        "results would stand among the recordings, where the events of their runs are\n"
        f"  where:    {day}\n"
        "  expected: a folder of its own\n"
        f"  got:      the folder of {day / 'a.mcap'}\n"
        f"  do next:  give another one: -o {day / 'batch'}"
    )
    require_apart(tmp_path, find_recordings([str(day)]))


def test_a_folder_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OutputError):
        Results(tmp_path / "file")


def test_without_dask_its_options_say_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(BatchError) as caught, dask_workers(2):
        pass
    assert str(caught.value).splitlines()[0] == "Dask is not installed"
    assert "pip install rigcal[dask]" in str(caught.value)


# --- the command -------------------------------------------------------------------------------------------------


def invoke(*arguments):
    return CliRunner().invoke(app, ["batch", *map(str, arguments)])


@pytest.fixture
def in_this_process(here, monkeypatch):
    """``--jobs`` without processes."""
    asked = []

    @contextmanager
    def pool(jobs):
        asked.append(jobs)
        yield here

    monkeypatch.setattr("recognition.crews.process_pool", pool)
    return asked


def test_the_command_tells_of_each_recording_and_where_the_rows_are(day, in_this_process, tmp_path):
    (tmp_path / "walks.rules.toml").write_text(RULES)
    said = invoke(day, "-o", tmp_path / "out", "--rules", tmp_path / "walks.rules.toml", "--jobs", 3)
    assert (said.exit_code, in_this_process) == (0, [3]), said.output
    assert said.stdout.splitlines()[0] == "3 recordings: 3 ok, 0 failed"
    assert said.stdout.splitlines()[-2:] == [
        f"rows      {tmp_path / 'out/batch.jsonl'}",
        f"table     {tmp_path / 'out/batch.csv'}",
    ]
    assert said.stderr.splitlines()[0].startswith("1/3  ok      a: 1.5 s, ")
    again = invoke(day, "-o", tmp_path / "out", "--rules", tmp_path / "walks.rules.toml", "--json")
    told = json.loads(again.stdout)
    assert (told["recordings"], told["ok"], told["reused"], told["stopped"]) == (3, 3, 3, None)
    assert [row["name"] for row in told["rows"]] == ["a", "b", "c"]


def test_the_exit_code_says_whether_some_failed(day, in_this_process, tmp_path):
    (tmp_path / "cut.mcap").write_bytes((day / "a.mcap").read_bytes()[:-100])
    said = invoke(tmp_path / "cut.mcap", day / "a.mcap", "-o", tmp_path / "out")
    assert said.exit_code == 1
    assert said.stdout.startswith("2 recordings: 1 ok, 1 failed")
    assert "failed  cut: the recording is unfinished or damaged" in said.stderr


def test_options_that_exclude_each_other_and_wrong_rules_stop_a_batch_before_it_begins(day, tmp_path):
    said = invoke(day, "-o", tmp_path / "out", "--jobs", 2, "--dask-workers", 2)
    assert "got:      --dask-workers 2, --jobs 2\n  do next:  leave one of them out" in str(said.exception)
    (tmp_path / "wrong.rules.toml").write_text(RULES.replace("speed", "sped"))
    said = invoke(day, "-o", tmp_path / "out", "--rules", tmp_path / "wrong.rules.toml")
    assert "wrong.rules.toml:" in str(said.exception)
    assert not (tmp_path / "out").exists()
