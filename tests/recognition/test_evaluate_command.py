"""``recognition evaluate`` on a simulated data set: the table, the JSON, and a message for what cannot be evaluated."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from recognition.cli import app
from recognition.errors import DatasetError, RigRefusedError
from recognition.observations import JOINTS, ViewDetections
from recognition.sources.detections_file import write_detections
from recognition.synthetic import semicircle_rig, simulate
from recognition.synthetic_views import observe
from rigcal.rigfile import document_of_rig, write_rigfile

FRAMES, FPS = 60, 30.0


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Two workers, seen without noise for two seconds; the truth is of every frame from the tenth on."""
    folder = tmp_path_factory.mktemp("dataset")
    rig = semicircle_rig()
    document = document_of_rig(rig, created_utc="2026-01-01T00:00:00Z", inputs_sha256="0" * 64)
    write_rigfile(document, folder / "s.rig.json")
    site = simulate(rig, workers=2, frames=FRAMES, fps=FPS, seed=1)
    views = [[view.detections for view in observe(site, frame)] for frame in range(FRAMES)]
    write_detections(folder / "data.npz", views, time_s=(site.t_ns * 1e-9).tolist())
    frame, person = (each.ravel() for each in np.meshgrid(np.arange(10, FRAMES), [0, 1], indexing="ij"))
    with np.load(folder / "data.npz") as data:
        arrays = dict(data)
    truth = {"gt_frame": frame, "gt_person": person, "gt_joints": site.joints_in_world_m[frame, person]}
    np.savez(folder / "data.npz", **arrays, **truth)
    (folder / "dataset.json").write_text(json.dumps({"gt_joints": JOINTS}))
    return folder


def evaluate(*arguments):
    return CliRunner().invoke(app, ["evaluate", *map(str, arguments)])


@pytest.mark.parametrize("association", ["paper", "tracked"])
def test_exact_detections_score_nearly_full_marks(dataset, association):
    done = evaluate(dataset, "--association", association, "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert (found["association"], found["views"]) == (association, ["cam0", "cam1", "cam2", "cam3"])
    assert (found["instants"], found["truth_instants"]) == (FRAMES, FRAMES - 10)
    assert found["pcp3d_percent"] == found["recall_percent"] == found["precision_percent"] == 100.0
    assert (found["idf1_percent"], found["mota_percent"], found["joints_found_percent"]) == (100.0, 100.0, 100.0)
    assert found["mpjpe_mm"] < 3.0
    assert (found["switches"], found["switches_per_worker_minute"]) == (0, 0.0)
    assert set(found["pcp3d_parts_percent"].values()) == {100.0}
    assert [(worker["worker"], worker["instants"]) for worker in found["workers"]] == [(0, 50), (1, 50)]


def test_people_read_a_table(dataset):
    done = evaluate(dataset, "--association", "paper")
    assert done.exit_code == 0, done.output
    lines = done.stdout.splitlines()
    assert lines[1] == "60 instants, 60 of them in 3D; the truth knows 50"
    assert lines[2].split() == ["worker", "instants", "PCP3D", "%", "recall", "%", "MPJPE", "mm", "switches"]
    assert lines[3].split()[:4] == ["0", "50", "100.0", "100.0"]
    assert lines[5].split()[:4] == ["all", "100", "100.0", "100.0"]
    assert "IDF1 100.0 %" in done.stdout
    assert lines[-3].startswith("PCP3D: parts with (|s - s'| + |e - e'|) / 2 <= 0.5 |s - e|")


def test_joints_that_are_not_scored_are_told(dataset, tmp_path):
    with np.load(dataset / "data.npz") as data:
        arrays = dict(data)
    names = ["neck", *JOINTS[5:]]
    joints = arrays["gt_joints"]
    arrays["gt_joints"] = np.concatenate([joints[:, 5:7].mean(axis=1, keepdims=True), joints[:, 5:]], axis=1)
    np.savez(tmp_path / "data.npz", **arrays)
    (tmp_path / "dataset.json").write_text(json.dumps({"gt_joints": names}))
    done = evaluate(tmp_path, "--rig", dataset / "s.rig.json", "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert found["warnings"] == [
        "1 of the 13 joints of the truth have no name of COCO-17 and are not scored: neck",
        "the truth does not know these parts, and PCP3D is without them: head",
    ]
    assert found["pcp3d_percent"] == 100.0
    assert found["protocol"]["PCP3D"].endswith("(Belagiannis et al. 2014)")


def test_one_view_places_nobody_and_what_is_not_known_is_null(dataset):
    done = evaluate(dataset, "--views", "cam1", "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert (found["scenes"], found["recall_percent"], found["mpjpe_mm"], found["precision_percent"]) == (
        0,
        0,
        None,
        None,
    )
    assert "-" in evaluate(dataset, "--views", "cam1").stdout


def test_other_detections_and_another_rig_file_are_taken(dataset, tmp_path):
    rig, nobody = tmp_path / "other.rig.json", tmp_path / "nobody.npz"
    rig.write_bytes((dataset / "s.rig.json").read_bytes())
    write_detections(nobody, [[ViewDetections.empty()] * 4] * FRAMES, time_s=(np.arange(FRAMES) / FPS).tolist())
    done = evaluate(dataset, "--rig", rig, "--detections", nobody, "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert (found["rig"], found["recall_percent"], found["idf1_percent"]) == (str(rig), 0.0, 0.0)


def test_a_data_set_without_truth_names_the_keys(dataset, tmp_path):
    with np.load(dataset / "data.npz") as data:
        np.savez(tmp_path / "data.npz", **{name: data[name] for name in data.files if not name.startswith("gt_")})
    done = evaluate(tmp_path)
    assert isinstance(done.exception, DatasetError)
    assert str(done.exception) == (
        f"this data set holds no 3D truth\n  where:    {tmp_path}/data.npz\n"
        "  expected: integers gt_frame (G,) and gt_person (G,), floats gt_joints (G, J, 3) in data.npz, or "
        "joints_m, t_s in truth.npz\n"
        "  got:      no array gt_...\n"
        "  do next:  write the truth in one of the two forms; recognition run places workers without one"
    )


def test_cameras_that_the_rig_does_not_have_are_refused(dataset):
    assert isinstance(evaluate(dataset, "--views", "cam9").exception, RigRefusedError)
