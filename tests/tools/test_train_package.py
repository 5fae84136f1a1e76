"""What is shipped is what was exported; manifests say how it came about, thresholds are chosen on validation."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from train_site import CLASSES, COARSE, HAT, PERSON, SCORES, WORKER_HAT, make_data, make_exports

from recognition.detectors import load_bundled
from tools.train.__main__ import main
from tools.train.coco import DataError, read_split
from tools.train.facts import digests, read_facts
from tools.train.package import package, read_toml
from tools.train.predict import SiteAlone, crops_alone, load_networks, open_thresholds


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    return make_data(folder / "data"), make_exports(folder / "out")


@pytest.fixture
def models(made, tmp_path):
    data, exported = made
    package(exported, data, tmp_path / "models")
    return tmp_path / "models"


def test_the_runtime_loads_what_is_packaged_and_its_notice_says_what_it_is_not(models):
    for precision in ("int8", "fp32"):
        infos = load_bundled(precision, folder=models).model_info
        assert [info.licence for info in infos] == ["MIT", "MIT"]
        assert all(info.notice.startswith("not validated on real people") for info in infos)
    assert digests(models)["site.onnx"] == read_toml(models / "site.toml")["sha256"]


def test_the_manifest_tells_how_the_network_came_about(models):
    site, worker = (read_toml(models / f"{name}_int8.toml") for name in ("site", "worker"))
    assert site["classes"] == list(CLASSES)
    assert site["keypoints"] == {"hard_hat": 1, "ladder": 4}
    assert len(worker["joints"]) == 17
    assert "1 images of 1 scenes in 1 rooms for training (100 % gl)" in site["trained"]["data"]
    assert "gl seeds 100000 to 100000" in site["trained"]["data"]
    assert "--network worker --joints all --epochs 2 --batch 8 --rate 0.002 --seed 5" in worker["trained"]["command"]
    assert ", from epoch 1 on with --epochs 3; python -m tools.train export" in worker["trained"]["command"]


def test_networks_that_are_too_large_are_refused_and_nothing_is_written(made, tmp_path):
    data, exported = made
    with pytest.raises(
        DataError, match=r"too large to be shipped; expected 1000 bytes or fewer together, got site.onnx"
    ):
        package(exported, data, tmp_path / "models", limit=1000)
    assert not (tmp_path / "models").exists()


def test_a_network_that_was_changed_after_its_export_is_refused(made, tmp_path):
    exported = make_exports(tmp_path / "out")
    with (exported["worker"] / "worker.onnx").open("ab") as file:
        file.write(b"\x6a\x00")
    with pytest.raises(DataError, match="not the one that was exported"):
        package(exported, made[0], tmp_path / "models")


def test_the_other_networks_export_is_refused(made, tmp_path):
    data, exported = made
    with pytest.raises(DataError, match="there is no exported site network"):
        package({"site": exported["worker"], "worker": exported["worker"]}, data, tmp_path / "models")


def test_networks_can_be_asked_alone(models):
    image = np.full((288, 512, 3), 90, np.uint8)
    found = SiteAlone(models / "site.onnx").find(image)
    assert found.classes.tolist() == [0, 1, 2]
    assert found.scores == pytest.approx(list(SCORES.values()))
    assert found.boxes[:2] == pytest.approx(np.stack([PERSON, HAT]), abs=1e-3)
    assert found.joints[0, :, :2] == pytest.approx(COARSE + [2.0, 0.0], abs=1e-3)
    found = load_networks(models, "fp32", crops_alone(models, "fp32")).find(image)
    assert found.scores[found.classes == 1] == pytest.approx([WORKER_HAT])
    assert found.boxes[found.classes == 1][0] == pytest.approx(HAT, abs=1e-3)
    assert np.ptp(found.joints[0, :, :2], axis=0) == pytest.approx(0, abs=1e-6)


def test_open_thresholds_leave_who_gives_a_joint_to_the_manifest(models):
    assert open_thresholds(models, "int8").worker_joint == read_toml(models / "worker_int8.toml")["joint_score"] == 0.5


def test_thresholds_are_chosen_and_written_into_the_manifests(made, models, tmp_path):
    assert main(["thresholds", "--data", str(made[0]), "--models", str(models), "--figures", str(tmp_path)]) == 0
    site, worker = read_toml(models / "site.toml"), read_toml(models / "worker.toml")
    assert site["score_thresholds"] == pytest.approx(SCORES | {"ladder": 0.5}, abs=1e-4)  # no ladder to be found
    assert site["joint_score"] == pytest.approx(1 / (1 + np.exp(-2.0)), abs=1e-4)
    assert worker["hat_score"] == pytest.approx(WORKER_HAT, abs=1e-4)
    assert worker["joint_score"] == 0.5  # none of its joints is right
    facts = read_facts(tmp_path / "thresholds.json")
    assert facts["models"] == digests(models)
    assert facts["fp32"]["classes"]["person"]["f1"] == 1.0
    load_bundled(folder=models)


def test_exports_can_be_measured_before_they_are_packaged(made, tmp_path, capsys):
    data, exported = made
    places = [f"--{name}={folder}" for name, folder in exported.items()]
    assert main(["evaluate", *places, "--data", str(data), "--json", str(tmp_path / "figures.json")]) == 0
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert figures["all"]["classes"]["hard_hat"]["ap50"] == 1.0
    assert figures["all"]["classes"]["ladder"]["ap50"] is None
    assert "hard_hat" in capsys.readouterr().out


def test_a_site_network_can_be_measured_alone(made, tmp_path, capsys):
    data, exported = made
    asked = ["--data", str(data), "--precision", "fp32", "--json", str(tmp_path / "figures.json")]
    assert main(["evaluate", "--site", str(exported["site"]), *asked]) == 0
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert figures["all"]["joints"]["visible"]["median_px"] == pytest.approx(2.0, abs=1e-4)
    assert main(["evaluate", "--site", str(data), "--data", str(data)]) == 1
    assert "there is no network" in capsys.readouterr().err


def test_data_without_validation_is_refused(tmp_path):
    with pytest.raises(DataError, match="there is no data file"):
        read_split(tmp_path, "validation")
