"""``recognition commission`` with cameras: the walk is recorded, kept to, and judged from its recording."""

import json
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

sys.path.insert(0, str(Path(__file__).parent))
from rule_scenes import HEADER

from recognition import live
from recognition.cli import app
from recognition.commissioning import Step, Walk, load_walk, read_record, walk_text
from recognition.errors import RecordingError
from recognition.feeds import FeedOptions
from recognition.recording import check_recording
from recognition.synthetic import semicircle_rig
from rigcal.errors import OptionError, RigcalError
from rigcal.rigfile import document_of_rig, write_rigfile

START_NS = 1_775_986_200_000_000_000
SIZE_WH, FRAMES, FPS = (128, 96), 18, 10
RULE = (
    '[[rules]]\nname = "no_hat"\nsentence = "x"\nwhen = "each w: not exists hard_hat o of w: dist(w.head, o) < 0.1 H"\n'
)
LIVE = ("--source", "rtsp://127.0.0.1:1/a", "--source", "rtsp://127.0.0.1:1/b")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Two cameras, nearly two seconds of an empty scene, a rule, and a walk of a second in which all is safe."""
    folder = tmp_path_factory.mktemp("site")
    document = document_of_rig(
        semicircle_rig(2, size_wh=SIZE_WH), created_utc="2026-01-01T00:00:00Z", inputs_sha256="0" * 64
    )
    write_rigfile(document, folder / "s.rig.json")
    image = cv2.imencode(".jpg", np.full((SIZE_WH[1], SIZE_WH[0], 3), 90, np.uint8))[1].tobytes()
    for camera in ("cam0", "cam1"):
        for number in range(FRAMES):
            path = folder / "capture" / camera / f"{START_NS + number * 10**9 // FPS}.jpg"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(image)
    (folder / "r.rules.toml").write_text(HEADER + RULE)
    (folder / "w.walk.toml").write_text(walk_text(Walk("w", (Step("stand", ("no_hat",), (), 0.3, 1.0),))))
    return folder


def commission(site, *more):
    own = (site / "s.rig.json", "--rules", site / "r.rules.toml", "--script", site / "w.walk.toml", "--by", "N.")
    done = CliRunner().invoke(app, ["commission", *map(str, (*own, *more))])
    if isinstance(done.exception, RigcalError):
        raise done.exception
    return done


def test_a_capture_of_a_walk_is_recorded_and_judged(site, tmp_path):
    done = commission(site, "--source", site / "capture", "-o", tmp_path / "x.commission.json", "--json")
    assert done.exit_code == 1, done.output
    assert check_recording(tmp_path / "x.commission.mcap").ok
    record = read_record(tmp_path / "x.commission.json")
    assert [(step.outcome, rule.verdict) for rule in record.results for step in rule.steps] == [("cannot tell", "FAIL")]
    assert {network.family for network in record.networks} == {"rigcal_site", "rigcal_worker"}
    assert json.loads(done.stdout)["people"] == "real"


def test_live_cameras_are_recorded_until_the_walk_is_over_and_it_can_be_judged_again(site, tmp_path, monkeypatch):
    def paced(rig, addresses):
        assert sorted(addresses) == [0, 1]
        return live.paced_capture(site / "capture", rig, FeedOptions((True, True), FPS))

    monkeypatch.setattr(live, "live_cameras", paced)
    done = commission(site, *LIVE, "--clock", "-o", tmp_path / "x.commission.json")
    assert done.exit_code == 1, done.output
    assert "step 1 of 1: stand" in done.stderr
    assert "step 1: cannot tell (stand)" in done.stdout
    record, again = read_record(tmp_path / "x.commission.json"), load_walk(tmp_path / "x.commission.walk.toml")
    assert record.walk[0].end_s - record.walk[0].start_s == pytest.approx(1.0, abs=0.3)
    assert again.steps[0].seconds == pytest.approx(record.walk[0].end_s - record.walk[0].start_s, abs=2e-3)
    more = ("--recording", tmp_path / "x.commission.mcap", "--script", tmp_path / "x.commission.walk.toml")
    assert commission(site, *more, "-o", tmp_path / "y.commission.json").exit_code == 1
    assert read_record(tmp_path / "y.commission.json").results == record.results


def test_what_cannot_be_walked_is_refused_before_anybody_walks(site, tmp_path):
    output = ("-o", tmp_path / "x.commission.json")
    with pytest.raises(OptionError, match="--source"):
        commission(site, *output)
    with pytest.raises(OptionError, match="--recording"):
        commission(site, "--recording", tmp_path / "a.mcap", "--source", site / "capture", *output)
    (tmp_path / "x.commission.mcap").write_bytes(b"of yesterday")
    with pytest.raises(RecordingError, match="a recording of this name is there already"):
        commission(site, *LIVE, *output)
