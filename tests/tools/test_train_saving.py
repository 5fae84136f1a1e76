"""Two worker networks are compared by the joints that both know, in crops as the runtime makes them."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from train_site import make_data, make_exports

from recognition.detectors.bundled.geometry import WORKER_WH
from tools.train import saving
from tools.train.coco import DataError, read_split
from tools.train.geometry import RULE_JOINTS


@pytest.fixture
def data(tmp_path):
    return read_split(make_data(tmp_path / "data"), "validation")


def exported(folder, joints):
    """A worker network's export that says it knows these joints."""
    worker = make_exports(folder, joints=len(RULE_JOINTS) if joints == "rules" else 17)["worker"]
    summary = json.loads((worker / "export.json").read_text())
    summary["options"]["joints"] = joints
    (worker / "export.json").write_text(json.dumps(summary))
    return worker


def test_crops_show_the_worker_with_the_joints(data):
    crops = saving.crops_of(data)
    assert crops.images.shape == (1, WORKER_WH[1], WORKER_WH[0], 3)
    # the box is 80 px high, hence the crop 100, its middle 5 px above the box's; 1.28 crop pixels per pixel
    assert crops.joints[0, 0] == pytest.approx([(230 - (244 - 37.5)) * 1.28, (50 - (84 - 5 - 50)) * 1.28, 2])


def test_figures_are_of_the_shared_joints(data, tmp_path, monkeypatch):
    monkeypatch.setattr(saving, "_RUNS", 2)
    figures = saving.saving(exported(tmp_path / "a", "all"), exported(tmp_path / "b", "rules"), data, lambda _: None)
    assert figures["shared_joints"] == list(RULE_JOINTS)
    assert (figures["all"]["joints"], figures["rules"]["joints"]) == (17, 11)
    assert figures["all"]["ms_per_crop"] > 0
    # every joint is said to be in the first cell, whose middle is (2, 2)
    crops = saving.crops_of(data)
    true = crops.joints[0, [0, 3, 4, 5, 6, 9, 10, 11, 12, 15, 16], :2]
    expected = np.median(np.linalg.norm(true - 2.0, axis=1)) / WORKER_WH[1]
    assert figures["rules"]["median_visible"] == pytest.approx(expected, rel=1e-6)
    assert figures["all"]["median_visible"] == pytest.approx(expected, rel=1e-6)
    assert figures["all"]["recall_near"] == 0.0


def test_two_networks_of_the_same_joints_and_a_missing_one_are_refused(data, tmp_path):
    worker = exported(tmp_path / "a", "all")
    with pytest.raises(DataError, match="both networks know the same joints"):
        saving.saving(worker, worker, data, lambda _: None)
    with pytest.raises(DataError, match="there is no exported worker network"):
        saving.saving(worker, tmp_path / "none", data, lambda _: None)
