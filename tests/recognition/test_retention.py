"""What was kept for long enough is deleted with everything about it, and nothing else is."""

from __future__ import annotations

import fcntl
import json
import os
import sys
import time

import pytest

from recognition.cli import main
from recognition.recording.container import MAGIC
from recognition.retention import delete, plan_retention
from rigcal.errors import OptionError

DAY_S = 86400.0


def place(folder, name: str, *, days: float, data: bytes = MAGIC) -> None:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    os.utime(path, (time.time() - days * DAY_S,) * 2)


def names(folder) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file() or path.is_symlink()}


def retain(monkeypatch, folder, *arguments) -> int:
    monkeypatch.setattr(sys, "argv", ["recognition", "retain", str(folder), *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code


def test_old_recordings_go_with_their_evidence_and_logs_and_young_ones_stay(tmp_path, monkeypatch, capsys):
    for name in ("old.mcap", "old.alarms.jsonl", "old.answers.jsonl", "old.events.json", "old.evidence/e1/mosaic.mp4"):
        place(tmp_path, name, days=31)
    for name in ("young.mcap", "young.answers.jsonl", "young.evidence/e1.png"):
        place(tmp_path, name, days=29)
    assert retain(monkeypatch, tmp_path, "--days", "30") == 0
    assert names(tmp_path) == {"young.mcap", "young.answers.jsonl", "young.evidence/e1.png"}
    assert not (tmp_path / "old.evidence").exists()
    told = capsys.readouterr().out.splitlines()
    assert len(told) == 6
    assert told[0].startswith(f"deleted  {tmp_path / 'old.mcap'}  0.0 MB, 31.0 days old")
    assert told[-1] == "deleted 5 files, 0.0 MB; recordings kept: 1"


def test_a_dry_run_says_the_same_and_deletes_nothing(tmp_path, monkeypatch, capsys):
    place(tmp_path, "old.mcap", days=31)
    assert retain(monkeypatch, tmp_path, "--days", "30", "--dry-run") == 0
    assert names(tmp_path) == {"old.mcap"}
    assert capsys.readouterr().out.startswith("would delete  ")


def test_what_begins_like_a_recording_and_is_not_its_own_stays(tmp_path, monkeypatch, capsys):
    place(tmp_path, "hall.mcap", days=31)
    place(tmp_path, "hall.b.mcap", days=1)
    for name in ("hall.rig.json", "hall.b.answers.jsonl", "hall.b.evidence/e.png", "hallway.json", "other.txt"):
        place(tmp_path, name, days=99)
    assert retain(monkeypatch, tmp_path, "--days", "30", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert {one["path"] for one in told["files"]} == {
        str(tmp_path / "hall.mcap"),
        str(tmp_path / "hall.b.evidence/e.png"),
    }
    assert told["left"] == [str(tmp_path / "hall.rig.json")]
    assert names(tmp_path) == {"hall.b.mcap", "hall.rig.json", "hall.b.answers.jsonl", "hallway.json", "other.txt"}


def test_a_recording_of_segments_loses_the_old_ones_while_it_goes_on(tmp_path):
    place(tmp_path, "run.000.mcap", days=40)
    place(tmp_path, "run.001.mcap", days=10)
    place(tmp_path, "run.answers.jsonl", days=40)
    place(tmp_path, "run.evidence/old.png", days=40)
    place(tmp_path, "run.evidence/new.png", days=10)
    plan = plan_retention(tmp_path, days=30, now_s=time.time())
    assert [one.path.name for one in plan.doomed] == ["run.000.mcap", "old.png"]
    assert plan.kept == 1


def test_evidence_goes_with_the_last_of_its_recording_however_late_it_was_made(tmp_path):
    place(tmp_path, "run.mcap", days=40)
    place(tmp_path, "run.evidence/late.png", days=1)
    assert all(why is None for _, why in delete(plan_retention(tmp_path, days=30, now_s=time.time())))
    assert names(tmp_path) == set()


def test_an_unfinished_recording_goes_unless_somebody_writes_it(tmp_path):
    place(tmp_path, "dead.mcap.part", days=31)
    place(tmp_path, "alive.mcap.part", days=31)
    with (tmp_path / "alive.mcap.part").open("rb") as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)
        plan = plan_retention(tmp_path, days=30, now_s=time.time())
    assert [one.path.name for one in plan.doomed] == ["dead.mcap.part"]


def test_links_are_not_followed(tmp_path):
    elsewhere = tmp_path / "elsewhere"
    place(elsewhere, "precious.png", days=99)
    folder = tmp_path / "folder"
    place(folder, "run.mcap", days=31)
    place(folder, "run.evidence/e.png", days=31)
    (folder / "run.evidence" / "link").symlink_to(elsewhere)
    place(folder, "b.mcap", days=31)
    (folder / "b.evidence").symlink_to(elsewhere)
    list(delete(plan_retention(folder, days=30, now_s=time.time())))
    assert names(elsewhere) == {"precious.png"}
    assert names(folder) == {"run.evidence/link", "b.evidence"}


@pytest.mark.parametrize("kind", ["absent", "empty", "photos", "not MCAP", "file"])
def test_a_folder_without_recordings_is_refused(tmp_path, monkeypatch, capsys, kind):
    folder = tmp_path / "folder"
    if kind != "absent":
        folder.mkdir()
    if kind == "photos":
        place(folder, "holiday.jpg", days=99)
    if kind == "not MCAP":
        place(folder, "notes.mcap", days=99, data=b"shopping list")
    if kind == "file":
        place(tmp_path, "run.mcap", days=99)
        folder = tmp_path / "run.mcap"
    before = names(tmp_path)
    assert retain(monkeypatch, folder, "--days", "1") == 2
    assert ("holds no recordings" if kind not in ("absent", "file") else "no such folder") in capsys.readouterr().err
    assert names(tmp_path) == before


def test_what_cannot_be_deleted_is_said(tmp_path, monkeypatch, capsys):
    place(tmp_path, "run.mcap", days=31)
    plan = plan_retention(tmp_path, days=30, now_s=time.time())
    (tmp_path / "run.mcap").unlink()
    (tmp_path / "run.mcap").mkdir()
    ((_, why),) = delete(plan)
    assert why == "Is a directory"


@pytest.mark.parametrize("days", [0, -1, float("nan")])
def test_no_days_are_refused(tmp_path, days):
    place(tmp_path, "run.mcap", days=31)
    with pytest.raises(OptionError, match="days"):
        plan_retention(tmp_path, days=days, now_s=time.time())
