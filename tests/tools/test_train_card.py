"""The card says what was measured of the networks beside it, and of no others."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from train_site import make_data, make_exports

from recognition.detectors import load_bundled
from tools.train.__main__ import main
from tools.train.card import NAME, write_card
from tools.train.coco import DataError, Picture, Truth
from tools.train.evaluate import Result, report
from tools.train.facts import MODELS, digests, read_facts, write_facts
from tools.train.gap import compare, gap_facts
from tools.train.joints3d import Distances, joint_facts
from tools.train.measure import bars
from tools.train.package import LIMIT_BYTES, package, read_toml
from tools.train.predict import Found
from tools.train.sequences import SITE_CATEGORIES


@pytest.fixture(scope="module")
def packaged(tmp_path_factory):
    folder = tmp_path_factory.mktemp("packaged")
    package(make_exports(folder / "out"), make_data(folder / "data"), folder / "models")
    return folder / "models"


def results():
    """One picture with one person, found 1 px to the right."""
    box, points = np.array([[100.0, 50.0, 160.0, 250.0]]), np.full((1, 17, 3), 2.0)
    points[..., :2] = 120.0
    truth = Truth(np.zeros(1, int), box, points, np.zeros(1, bool))
    found = Found(truth.classes, np.array([0.9]), box + [1, 0, 1, 0], points + [1, 0, 0], np.zeros((1, 4, 2)))
    return [Result(Picture(None, (1024, 576), "dusk", "cycles", truth), found, 0.5)]


def measured(models):
    parts = [Distances(np.full((1, 17), 0.0421), np.ones((1, 17), bool), 0, 1)]
    one = {"pictures": report(results(), SITE_CATEGORIES), "world": {"all": joint_facts(parts)}}
    rows = [
        {"what": bar.what, "value": bar.value, "bound": bar.bound, "least": bar.least, "met": bar.met}
        for bar in bars(one, one)
    ]
    return {
        "models": digests(models), "split": "test", "sequences": ["00-hat-dusk-cycles"],
        "fp32": one, "int8": one, "bars": rows,
    }  # fmt: skip


def test_what_was_not_measured_the_card_says(packaged, tmp_path):
    text = write_card(packaged, tmp_path).read_text()
    assert [text.count(f"Not measured: `python -m tools.train {name}`") for name in ("measure", "gap")] == [1, 1]
    for name, value in digests(packaged).items():
        assert f"| `{name}` | {(packaged / name).stat().st_size} | `{value}` |" in text
    assert "not validated" in text or "nobody has validated" in text
    assert "--network site --epochs 2" in text


def test_figures_are_those_of_the_files(packaged, tmp_path):
    write_facts(measured(packaged), tmp_path / "measure.json")
    truth = np.column_stack([np.full(17, 100.0), np.linspace(0, 160, 17), np.full(17, 0.9)])[None]
    gap = gap_facts([compare(truth, truth[..., :2] + [6.0, 8.0])])
    facts = {"models": digests(packaged), "capture": "hall", "fp32": gap, "int8": gap}
    write_facts(facts, tmp_path / "gap.json")
    row = {
        "joints": 17, "epochs": 4, "parameters": 555, "bytes": 777, "ms_per_crop": 1.2345, "median_visible": 0.0123,
        "recall_near": 0.987,
    }  # fmt: skip
    write_facts({"crops": 3, "shared_joints": ["nose"], "all": row, "rules": row}, tmp_path / "saving.json")
    assert main(["card", "--models", str(packaged), "--figures", str(tmp_path)]) == 0
    text = (packaged / NAME).read_text()
    assert "| AP50 of person | at least 0.85 | 1.000 | yes |" in text
    assert "| AP50 of ladder | at least 0.85 | - | **no** |" in text
    assert "| int8 | all | 1 | 1.000 | 0.00 | 42 | 42 | 1.000 | 1.000 |" in text
    assert "| light dusk | 1 | 1.000 | 1.000 | 1.000 | 1.000 | 1.000 | 1.0 |" in text
    assert "| int8 | 1 | 1 | 1.000 | 0.00 | 10.0 | 0.062 | 1.000 | 1.000 |" in text
    assert "| 17 joints | 4 | 555 | 777 | 1.234 | 0.0123 | 0.987 |" in text
    assert "Not measured: `python -m tools.train thresholds`" in text
    assert all(line.count("|") == line.count(" | ") + 2 for line in text.splitlines() if line.startswith("|"))


def test_figures_of_other_networks_are_refused(packaged, tmp_path):
    write_facts(measured(packaged) | {"models": {"site.onnx": "0" * 64}}, tmp_path / "measure.json")
    with pytest.raises(DataError, match="the figures are of other networks"):
        write_card(packaged, tmp_path)


def test_without_networks_there_is_no_card(tmp_path, capsys):
    assert main(["card", "--models", str(tmp_path), "--figures", str(tmp_path)]) == 1
    assert "there is no network" in capsys.readouterr().err


def test_facts_survive_and_what_is_no_number_is_null(tmp_path):
    write_facts({"a": float("nan"), "b": [np.float64(0.123456789)], "c": {"d": True}}, tmp_path / "x" / "facts.json")
    assert read_facts(tmp_path / "x" / "facts.json") == {"a": None, "b": [0.12346], "c": {"d": True}}
    assert read_facts(tmp_path / "none.json") is None


# --- what is committed ----------------------------------------------------------------------------------------------

shipped = pytest.mark.skipif(not (MODELS / NAME).is_file(), reason="no networks are packaged yet")


@shipped
def test_the_card_and_the_manifests_are_of_the_networks_beside_them():
    text = (MODELS / NAME).read_text()
    for name, value in digests(MODELS).items():
        assert f"`{value}`" in text
        assert read_toml((MODELS / name).with_suffix(".toml"))["sha256"] == value


@shipped
def test_the_networks_load_and_their_notice_goes_into_every_result():
    for precision in ("int8", "fp32"):
        for info in load_bundled(precision).model_info:
            assert info.notice.startswith("not validated on real people")
            assert info.licence == "MIT"


@shipped
def test_the_networks_are_small_enough_and_know_the_catalogue():
    assert sum(path.stat().st_size for path in MODELS.glob("*.onnx")) <= LIMIT_BYTES
    for name in ("site", "site_int8"):
        manifest = read_toml(MODELS / f"{name}.toml")
        assert manifest["classes"] == [category.name for category in SITE_CATEGORIES]
        assert json.dumps(manifest["score_thresholds"]) != json.dumps(dict.fromkeys(manifest["classes"], 0.5))
