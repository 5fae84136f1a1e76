"""The files beside a rig file: residuals and lenses; and the document that a calibration becomes."""

import json

import numpy as np
import pytest

from rigcal.board import Checkerboard
from rigcal.errors import BrokenFileError, CalibrationError, RigFileSchemaError
from rigcal.evidence import beside, read_evidence, write_evidence
from rigcal.lensfile import lens_document, read_lenses, write_lenses
from rigcal.outcome import document_of, evidence_of
from rigcal.pipeline import CalibrateOptions, calibrate_lenses, calibrate_site, hold_lenses
from rigcal.rigfile import read_rigfile, rig_of, write_rigfile
from rigcal.site import GateLimits
from rigcal.synthetic import arc_rig, board_poses_for_pair, exact_detections, with_noise

BOARD = Checkerboard(9, 6, 0.06)
OPTIONS = CalibrateOptions()


@pytest.fixture(scope="module")
def solved():
    rig = arc_rig(2, arc_deg=50)
    poses = board_poses_for_pair(rig, "cam0", "cam1", BOARD, 14, distance_m=(1.2, 4), seed=1)
    detections = with_noise(exact_detections(rig, BOARD, poses), 0.2, seed=1)
    lenses = calibrate_lenses(detections, None, OPTIONS)
    return detections, lenses, calibrate_site(detections, GateLimits(), lenses, OPTIONS)


def document(result, command="calibrate", utc="2026-11-22T09:30:01Z"):
    return document_of(result, site=None, site_name="s", created_utc=utc, command=command, options={})


def test_residuals_round_trip_and_match_the_rmse(solved, tmp_path):
    detections, _, result = solved
    path = beside(tmp_path / "hall.rig.json", ".residuals.npz")
    assert path.name == "hall.residuals.npz"
    write_evidence(evidence_of(result), path)
    back = read_evidence(path)
    assert len(back.pixels) == sum(len(v.corner_ids) for c in detections.cameras for v in c.views)
    for camera in range(2):
        rows = (back.camera_idx == camera) & back.used
        rmse = np.sqrt((back.residuals_px[rows] ** 2).sum(axis=1).mean())
        assert rmse == pytest.approx(result.rmse[camera].refined, rel=1e-9)
    assert [path.name for path in tmp_path.iterdir()] == ["hall.residuals.npz"]


def test_absent_and_damaged_residuals_are_told_apart(tmp_path):
    assert read_evidence(tmp_path / "none.npz") is None
    path = tmp_path / "bad.npz"
    path.write_bytes(b"not a zip file")
    with pytest.raises(BrokenFileError, match="cannot decode this file"):
        read_evidence(path)


def test_the_rig_file_holds_the_calibration(solved, tmp_path):
    _, _, result = solved
    path = tmp_path / "s.rig.json"
    write_rigfile(document(result), path)
    rig = rig_of(read_rigfile(path))
    assert rig.camera_ids == ("cam0", "cam1")
    for index in range(2):
        assert np.array_equal(rig.cameras[index].camera.params, result.joint.cameras[index].params)
        assert np.allclose(rig.cameras[index].cam_from_rig.matrix, result.joint.cam_from_rig[index].matrix, atol=1e-15)


def test_the_same_input_gives_the_same_geometry_digest(solved, tmp_path):
    detections, _, result = solved
    again = calibrate_site(detections, GateLimits(), calibrate_lenses(detections, None, OPTIONS), OPTIONS)
    first = write_rigfile(document(result), tmp_path / "a.rig.json")
    second = write_rigfile(document(again, utc="2027-01-01T00:00:00Z"), tmp_path / "b.rig.json")
    assert first.geometry_digest == second.geometry_digest
    assert first.digest != second.digest


def test_lenses_round_trip_through_their_file_and_through_a_rig_file(solved, tmp_path):
    detections, lenses, result = solved
    path = tmp_path / "lenses.json"
    write_lenses(lens_document(BOARD.spec, detections.cameras, lenses), path)
    write_rigfile(document(result), tmp_path / "s.rig.json")
    for source, expected in ((path, [lens.camera for lens in lenses]), (tmp_path / "s.rig.json", result.joint.cameras)):
        known = read_lenses(source)
        assert [np.array_equal(known[f"cam{i}"].camera.params, expected[i].params) for i in range(2)] == [True, True]
    held = hold_lenses(detections, read_lenses(path), OPTIONS)
    assert held[0].rmse_px == lenses[0].rmse_px


def test_lenses_that_are_missing_are_named(solved):
    detections, _, _ = solved
    with pytest.raises(CalibrationError) as caught:
        hold_lenses(detections, {}, OPTIONS)
    assert "no lens is known for cam0, cam1" in str(caught.value)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", "not a valid rig file: the file"),
        ('{"format": "rigcal.intrinsics", "version": 1, "board": "b"}', "cameras"),
        (
            json.dumps(
                {
                    "format": "rigcal.intrinsics",
                    "version": 1,
                    "board": "b",
                    "cameras": [
                        {"id": "a", "size_wh": [4, 3], "model": "opencv4", "coefficients": {"fx": 1}, "sigma": {},
                         "rmse_px": {}, "views": {}}
                    ],
                }
            ),
            "the coefficients of each camera's model",
        ),
    ],
)  # fmt: skip
def test_damaged_lens_files_are_refused(tmp_path, content, words):
    path = tmp_path / "lenses.json"
    path.write_text(content)
    with pytest.raises(RigFileSchemaError) as caught:
        read_lenses(path)
    assert words in str(caught.value)
