"""The sealed half: committed rules only, every run written down; and what the networks saw is computed once."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

sys.path.insert(0, str(Path(__file__).parent))
from violation_scenes import BARE_S, OURS, PAPER, observed_sequence, violation, write_truth

from recognition.cli import _violations as command
from recognition.cli import app
from recognition.detectors.protocol import ModelInfo
from recognition.errors import DatasetError
from recognition.evaluation import violations
from recognition.evaluation.violations import Failure, find_sequences, observe, require_committed, write_clips
from recognition.evaluation.violations import sealed as sealed_module
from recognition.observations import ViewDetections
from recognition.synthetic import semicircle_rig, walking
from rigcal.errors import OptionError
from rigcal.rigfile import document_of_rig, write_rigfile

needs_git = pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")


class Detector:
    """Sees one person in the middle of every picture, and counts how often it was asked."""

    def __init__(self, sha256="ab"):
        self.calls, self.model_info = 0, (ModelInfo("fake.onnx", sha256, "fake", "none"),)

    def detect(self, image_bgr):
        self.calls += 1
        joints = walking(np.zeros((1, 2)))[0][None, :, 1:] * [8, -8] + [32, 40]
        return ViewDetections(joints, np.ones((1, 17)), (), np.zeros((0, 4)), np.zeros(0))


def git(folder, *arguments):
    name = ("-c", "user.name=x", "-c", "user.email=x@example.com", "-c", "commit.gpgsign=false")
    subprocess.run(["git", "-C", str(folder), *name, *arguments], check=True, capture_output=True)


@pytest.fixture
def repository(tmp_path):
    folder = tmp_path / "repository"
    folder.mkdir()
    (folder / "site.rules.toml").write_text(OURS)
    (folder / "paper.rules.toml").write_text(PAPER)
    if shutil.which("git"):
        git(folder, "init", "-q")
        git(folder, "add", ".")
        git(folder, "commit", "-q", "-m", "rules")
    return folder


@pytest.fixture
def capture(tmp_path):
    """Three instants of two cameras as images, with their truth."""
    folder = write_truth(tmp_path / "made" / "one", violations=[violation("no_hat", 0.1, 0.5)], frames=3)
    rig = semicircle_rig(2, size_wh=(64, 48))
    write_rigfile(
        document_of_rig(rig, created_utc="2026-01-01T00:00:00Z", inputs_sha256="0" * 64), folder / "s.rig.json"
    )
    rows = ["cam_id,frame_time"]
    for camera in ("cam0", "cam1"):
        (folder / camera).mkdir()
        for n in range(3):
            cv2.imwrite(str(folder / camera / f"{n:03d}.png"), np.full((48, 64, 3), 60 * n, np.uint8))
            rows.append(f"{camera},{100 + 0.2 * n:.6f}")
    (folder / "timestamps.csv").write_text("\n".join(rows) + "\n")
    return folder


@needs_git
def test_committed_rules_are_let_through_with_the_codes_version(repository):
    code = require_committed([repository / "site.rules.toml", repository / "paper.rules.toml"])
    assert len(code.commit) == 40
    assert not code.is_modified


@needs_git
def test_rules_that_are_not_the_committed_ones_are_refused(repository):
    path = repository / "site.rules.toml"
    path.write_text(OURS.replace("0.14 H", "0.15 H"))
    with pytest.raises(DatasetError, match="it differs from the one in the commit") as caught:
        require_committed([path])
    assert "the sealed half is judged by committed rules only" in str(caught.value)
    assert "--split validation" in caught.value.do_next
    new = repository / "new.rules.toml"
    new.write_text(OURS)
    with pytest.raises(DatasetError, match="not in the commit that is checked out"):
        require_committed([new])
    git(repository, "add", "new.rules.toml")
    with pytest.raises(DatasetError, match="not in the commit that is checked out"):
        require_committed([new])


@needs_git
def test_outside_of_a_repository_nothing_is_committed(tmp_path, monkeypatch):
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path))
    path = tmp_path / "site.rules.toml"
    path.write_text(OURS)
    with pytest.raises(DatasetError, match="not in the commit that is checked out"):
        require_committed([path])


def test_without_git_the_sealed_half_stays_closed(repository, monkeypatch):
    def absent(*_, **__):
        raise FileNotFoundError("git")

    monkeypatch.setattr(sealed_module.subprocess, "run", absent)
    with pytest.raises(DatasetError, match="not installed"):
        require_committed([repository / "site.rules.toml"])


def test_a_sequence_of_the_other_half_is_refused(capture, tmp_path):
    with pytest.raises(DatasetError, match="this sequence is of the half validation"):
        observe(capture, "test", Detector(), tmp_path / "cache")
    assert not (tmp_path / "cache").exists()


def test_networks_look_once_and_again_only_where_something_changed(capture, tmp_path):
    detector, cache = Detector(), tmp_path / "cache"
    first = observe(capture, "validation", detector, cache)
    assert detector.calls == 6
    again = observe(capture, "validation", detector, cache)
    assert detector.calls == 6
    assert first.recording == again.recording
    assert len(again.instants) == 3
    assert np.array_equal(again.instants[1].views[0].people_px, first.instants[1].views[0].people_px)
    assert again.instants[1].frame_set.t_ns == again.truth.t_ns[1]
    assert observe(capture, "validation", Detector("cd"), cache).recording != first.recording
    cv2.imwrite(str(capture / "cam0" / "000.png"), np.full((48, 64, 3), 7, np.uint8))
    assert observe(capture, "validation", detector, cache).recording != first.recording
    assert detector.calls == 12


def test_an_interrupted_look_is_begun_again(capture, tmp_path):
    detector, cache = Detector(), tmp_path / "cache"
    path = observe(capture, "validation", detector, cache).recording
    path.rename(path.with_name(f"{path.name}.part"))
    assert observe(capture, "validation", detector, cache).recording == path
    assert detector.calls == 12


def test_a_sequence_has_one_rig_file(capture, tmp_path):
    (capture / "other.rig.json").write_bytes((capture / "s.rig.json").read_bytes())
    with pytest.raises(DatasetError, match="which rig saw this sequence is not clear"):
        observe(capture, "validation", Detector(), tmp_path / "cache")


def test_failures_become_clips(capture, tmp_path):
    recording = observe(capture, "validation", Detector(), tmp_path / "cache").recording
    failure = Failure("one", "no_hat", 0.2, 0.4, "false alarm")
    (path,) = write_clips([failure], {"one": recording}.__getitem__, (True, True), tmp_path / "clips", codec="mpeg4")
    assert path.name == "000-one-no_hat-false-alarm.mp4"
    video = cv2.VideoCapture(str(path))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 3
    video.release()


@pytest.fixture
def simulated(tmp_path, monkeypatch):
    """Sequences of which each name is a folder, and which are simulated instead of looked at."""
    folder = tmp_path / "sequences"
    for split in ("validation", "test"):
        for name in ("a", "b"):
            write_truth(folder / split / name, violations=[violation("no_hat", *BARE_S)], frames=30, split=split)

    def simulate(path, split, detector, cache):
        own = observed_sequence(name=path.name)
        return replace(own, truth=replace(own.truth, split=split))

    monkeypatch.setattr(violations, "observe", simulate)
    monkeypatch.setattr(command, "detector_of", lambda *_, **__: Detector())
    return folder


def evaluate(*arguments):
    return CliRunner().invoke(app, ["evaluate", *map(str, arguments)])


def test_people_read_tables_of_every_row(simulated, repository):
    done = evaluate(simulated, "--rules", repository / "site.rules.toml", "--views", "cam1,cam2")
    assert done.exit_code == 0, done.output
    lines = done.stdout.splitlines()
    assert "2 sequences of validation, 12 s" in lines[0]
    assert "more than 0.5 s from a start or an end" in lines[4]
    assert any(line.startswith("ours, 2 views ") for line in lines)
    assert any(line.startswith("the paper's accuracies (other data, not comparable)") for line in lines)
    assert not (repository / "evaluations.jsonl").exists()


@needs_git
def test_each_run_on_the_sealed_half_is_written_down(simulated, repository):
    for runs in (1, 2):
        asked = ("--split", "test", "--rules", repository / "site.rules.toml", "--views", "cam0,cam2", "--json")
        done = evaluate(simulated, *asked)
        assert done.exit_code == 0, done.output
        entries = [json.loads(line) for line in (repository / "evaluations.jsonl").read_text().splitlines()]
        assert len(entries) == runs
    document, entry = json.loads(done.stdout), entries[-1]
    assert (document["split"], entry["sequences"], entry["views"]) == ("test", ["a", "b"], ["cam0", "cam2"])
    assert entry["rules"] == document["rules"]
    assert entry["networks"] == {"fake.onnx": "ab"}
    assert len(entry["code"]["commit"]) == 40
    row = document["rows"][2]
    assert entry["figures"][row["name"]]["raw"]["no_hat"]["f1"] == row["raw"]["no_hat"]["f1"]


@needs_git
def test_the_sealed_half_stays_closed_to_changed_rules(simulated, repository, monkeypatch):
    monkeypatch.setattr(violations, "observe", lambda *_: pytest.fail("the sealed half was opened"))
    (repository / "paper.rules.toml").write_text(PAPER + "\n")
    done = evaluate(simulated, "--split", "test", "--rules", repository / "site.rules.toml")
    assert isinstance(done.exception, DatasetError)
    assert "paper.rules.toml" in str(done.exception)


def test_options_that_say_nothing_about_violations_are_refused(simulated, repository):
    done = evaluate(simulated, "--rules", repository / "site.rules.toml", "--interpolate")
    assert isinstance(done.exception, OptionError)


def test_a_folder_of_sequences_is_known_and_a_data_set_with_joints_is_another_thing(simulated, tmp_path):
    assert command.holds_sequences(simulated)
    assert command.holds_sequences(simulated / "test")
    assert not command.holds_sequences(simulated / "test" / "a")
    assert not command.holds_sequences(tmp_path / "nothing")
    assert find_sequences(simulated / "test", "test")
