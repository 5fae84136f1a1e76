"""rigcal through its command line: the main path on rendered images, and a message for every bad input."""

import json
import re
import shutil
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from conftest import REAL, command

from rigcal.rigfile import digest, read_rigfile, rig_of

real = pytest.mark.skipif(not REAL.exists(), reason="the real captures are not here")


def test_a_rendered_site_is_calibrated_to_its_truth(site, calibrated):
    """Positions within 3 sigma or 15 mm of the truth; rig, residuals and report are written."""
    assert calibrated.done.code == 0, calibrated.done.err
    found = rig_of(read_rigfile(calibrated.path))
    sigmas = [camera["sigma"]["position_m"] for camera in calibrated.done.json["cameras"]]
    for one, true, sigma in zip(found.cameras, site.rig.cameras, sigmas, strict=True):
        gap = one.cam_from_rig.inverse().translation_m - true.cam_from_rig.inverse().translation_m
        assert np.linalg.norm(gap) <= max(3 * sigma, 0.015)
        assert np.abs(one.camera.params[:2] / true.camera.params[:2] - 1).max() < 0.01
    assert calibrated.done.json["verdict"] == "PASS"
    names = {path.name for path in site.folder.iterdir()}
    assert {"site.rig.json", "site.residuals.npz", "site.report.html"} <= names
    assert not [name for name in names if name.endswith(".part") or name.startswith(".")]


def test_the_same_capture_gives_the_same_geometry(site, calibrated, tmp_path):
    again = command("rigcal", "calibrate", site.capture, "--board", site.board, "-o", tmp_path / "b.rig.json", "--json")
    fresh = command(
        "rigcal", "calibrate", site.capture, "--board", site.board, "-o", tmp_path / "c.rig.json", "--json",
        "--no-cache",
    )  # fmt: skip
    assert again.json["geometry_digest"] == calibrated.done.json["geometry_digest"] == fresh.json["geometry_digest"]


def test_the_digest_is_what_the_interface_says(calibrated):
    content = json.loads(calibrated.path.read_text())
    assert digest(content) == content["digest"]


def test_validate_passes_and_prints_a_table(calibrated):
    done = command("rigcal", "validate", calibrated.path)
    assert done.code == 0
    assert "PASS" in done.out
    assert "cam2" in done.out
    shown = command("rigcal", "validate", calibrated.path, "--json")
    assert shown.json["verdict"] == "PASS"
    assert shown.json["failed_gates"] == []


def test_report_writes_one_page(calibrated, tmp_path):
    done = command("rigcal", "report", calibrated.path, "-o", tmp_path / "deep" / "r.html")
    assert done.code == 0
    page = (tmp_path / "deep" / "r.html").read_text()
    assert "cam1" in page
    assert "<svg" in page


def test_lenses_alone_and_then_extrinsics(site, tmp_path):
    lenses = tmp_path / "lenses.json"
    done = command("rigcal", "intrinsics", site.capture, "--board", site.board, "-o", lenses, "--json")
    assert done.code == 0
    for entry, true in zip(done.json["cameras"], site.rig.cameras, strict=True):
        assert entry["coefficients"]["fx"] == pytest.approx(true.camera.params[0], rel=0.01)
    output = tmp_path / "e.rig.json"
    placed = command(
        "rigcal", "extrinsics", site.capture, "--board", site.board, "--intrinsics", lenses, "-o", output, "--json"
    )  # fmt: skip
    assert placed.code == 0, placed.err
    known = {entry["id"]: entry["coefficients"] for entry in done.json["cameras"]}
    assert {camera["id"]: camera["coefficients"] for camera in placed.json["cameras"]} == known


@pytest.mark.parametrize("to", ["anipose", "colmap"])
def test_export_and_import_keep_the_geometry(calibrated, tmp_path, to):
    middle, back = tmp_path / f"a.{to}", tmp_path / "b.rig.json"
    assert command("rigcal", "export", calibrated.path, "--to", to, "-o", middle).code == 0
    done = command("rigcal", "import", middle, "--from", to, "-o", back)
    assert done.code == 0, done.err
    first, second = rig_of(read_rigfile(calibrated.path)), rig_of(read_rigfile(back))
    point = np.array([0.3, -0.2, 3.5])
    for one, two in zip(first.cameras, second.cameras, strict=True):
        gap = one.camera.project(one.cam_from_rig.apply(point)) - two.camera.project(two.cam_from_rig.apply(point))
        assert np.abs(gap).max() < 1e-9
    assert command("rigcal", "validate", back).code == 0


def test_kalibr_refuses_a_coefficient_that_it_cannot_hold(calibrated, tmp_path):
    done = command("rigcal", "export", calibrated.path, "--to", "kalibr", "-o", tmp_path / "k.yaml")
    assert done.code == 2
    assert "kalibr radtan cannot hold every coefficient of camera cam0" in done.err
    assert "k3" in done.err
    assert not (tmp_path / "k.yaml").exists()


def test_a_site_file_sets_order_serials_and_limits(site, tmp_path):
    path = tmp_path / "s.site.toml"
    cameras = "".join(f'[[cameras]]\nid = "cam{i}"\nserial = "S{i}"\nsize_wh = [800, 600]\n' for i in (1, 0, 2))
    path.write_text(f'site = "hall"\nboard = "{site.board}"\n{cameras}[gates]\nviews = 999\n')
    done = command("rigcal", "calibrate", site.capture, "--site", path, "-o", tmp_path / "s.rig.json", "--json")
    assert done.code == 1
    assert done.json["verdict"] == "RECAPTURE"
    assert done.json["site"] == "hall"
    assert [(c["id"], c["serial"]) for c in done.json["cameras"]] == [("cam1", "S1"), ("cam0", "S0"), ("cam2", "S2")]
    failed = [gate for gate in done.json["gates"] if not gate["passed"]]
    assert {gate["name"] for gate in failed} == {"views"}
    assert failed[0]["advice"].startswith("show cam1 the board all over its image, ")
    assert failed[0]["advice"].endswith("tilted by 20-45 degrees to all sides, in 20 or more positions")
    assert command("rigcal", "validate", tmp_path / "s.rig.json").code == 1


def test_a_single_camera_is_a_rig_of_one(site, tmp_path):
    shutil.copytree(site.capture / "cam1", tmp_path / "one" / "cam1")
    done = command(
        "rigcal", "calibrate", tmp_path / "one", "--board", site.board, "-o", tmp_path / "o.rig.json", "--json"
    )
    assert done.code == 0, done.err
    assert done.json["covariance"] is None
    assert done.json["pairs"] == []
    assert done.json["cameras"][0]["rmse_px"]["pairwise"] is None
    assert command("rigcal", "validate", tmp_path / "o.rig.json").code == 0


# --- bad input ------------------------------------------------------------------------------------------------------


def refused(*arguments, output):
    """Run calibrate on bad input: exit 2, one message, nothing written."""
    done = command("rigcal", "calibrate", *arguments, "-o", output)
    assert done.code == 2, (done.out, done.err)
    assert done.err.startswith("error: ")
    assert "do next:" in done.err
    assert not output.exists()
    return re.sub(r"\s+", " ", done.err)


def test_wrong_columns_and_rows_name_the_board_that_is_there(site, tmp_path):
    capture = tmp_path / "few"
    for camera in ("cam0", "cam1"):
        (capture / camera).mkdir(parents=True)
        for number in range(1, 4):
            shutil.copy(site.capture / camera / f"{number:03d}.png", capture / camera)
    for wrong in ("8x6", "6x5"):
        message = refused(capture, "--board", f"checkerboard:{wrong}:120mm", output=tmp_path / "x.rig.json")
        assert f"the board is not checkerboard:{wrong}:120mm" in message
        assert f"checkerboard:{wrong}:120mm in 0 of 6 images; checkerboard:7x6:120mm in 6 of 6 images" in message
        assert "run again with --board checkerboard:7x6:120mm" in message


def test_a_camera_without_a_board_is_named(site, tmp_path):
    capture = tmp_path / "boards"
    shutil.copytree(site.capture, capture)
    grey = cv2.imread(str(next(capture.glob("cam2/*.png"))))
    for path in capture.glob("cam2/*.png"):
        cv2.imwrite(str(path), np.full_like(grey, 90))
    message = refused(capture, "--board", site.board, output=tmp_path / "x.rig.json")
    assert "no board found in camera cam2" in message


@pytest.mark.parametrize(
    ("spec", "words"), [("checkerboard:7x6:12in", "unknown unit"), ("checkerboard:7x6:120", "no unit")]
)
def test_an_unknown_unit_is_refused(site, tmp_path, spec, words):
    assert words in refused(site.capture, "--board", spec, output=tmp_path / "x.rig.json")


def test_no_board_at_all_is_refused(site, tmp_path):
    assert "no board was given" in refused(site.capture, output=tmp_path / "x.rig.json")


def test_lenses_of_another_image_size_are_refused(site, calibrated, tmp_path):
    capture = tmp_path / "half"
    for camera in site.rig.camera_ids:
        (capture / camera).mkdir(parents=True)
        for path in (site.capture / camera).glob("*.png"):
            cv2.imwrite(str(capture / camera / path.name), cv2.resize(cv2.imread(str(path), 0), None, fx=0.75, fy=0.75))
    message = refused(capture, "--board", site.board, "--intrinsics", calibrated.path, output=tmp_path / "x.rig.json")
    assert "camera cam0 has images of another size" in message
    assert "800x600" in message
    assert "600x450" in message


def test_unconnected_cameras_are_named_with_the_capture_that_would_join_them(site, tmp_path):
    capture = tmp_path / "apart"
    for camera in site.rig.camera_ids:
        (capture / camera).mkdir(parents=True)
        for path in sorted((site.capture / camera).glob("*.png")):
            number = int(path.stem) + (500 if camera == "cam2" else 0)  # never at the same time as the others
            shutil.copy(path, capture / camera / f"{number:03d}.png")
    message = refused(capture, "--board", site.board, output=tmp_path / "x.rig.json")
    assert "cameras are not connected to cam0" in message
    assert "{cam0, cam1}; {cam2}" in message
    assert "show the board to cam1 and cam2 at the same time" in message


def test_a_broken_image_is_named(site, tmp_path):
    capture = tmp_path / "boards"
    shutil.copytree(site.capture, capture)
    (capture / "cam1" / "003.png").write_bytes(b"\x89PNG broken")
    message = refused(capture, "--board", site.board, output=tmp_path / "x.rig.json")
    assert "cannot decode this file" in message
    assert "003.png" in message


def test_a_missing_capture_is_told(tmp_path):
    message = refused(tmp_path / "nothing", "--board", "checkerboard:9x6:25mm", output=tmp_path / "x.rig.json")
    assert "no camera images or videos here" in message


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda d: d["cameras"][1]["coefficients"].update(fx=d["cameras"][1]["coefficients"]["fx"] + 1),
            "changed after",
        ),
        (lambda d: d.update(version=2), "format version 2, this rigcal reads version 1"),
        (lambda d: d["cameras"][0].update(colour="red"), "cameras[0].colour"),
        (lambda d: d.update(format="other"), "not a valid rig file"),
    ],
)
def test_rig_files_that_must_not_be_used_are_refused(calibrated, tmp_path, change, words):
    content = json.loads(calibrated.path.read_text())
    change(content)
    path = tmp_path / "edited.rig.json"
    path.write_text(json.dumps(content))
    done = command("rigcal", "validate", path, "--json")
    assert done.code == 2
    assert words in done.err
    assert done.json["valid"] is False
    assert done.json["error"]["do_next"]


def test_an_output_that_cannot_be_written_is_told(calibrated, tmp_path):
    (tmp_path / "file").write_text("x")
    done = command("rigcal", "report", calibrated.path, "-o", tmp_path / "file" / "r.html")
    assert done.code == 2
    assert "cannot write this file" in done.err


# --- real captures --------------------------------------------------------------------------------------------------


@real
def test_the_opencv_stereo_capture(tmp_path):
    capture = REAL / "calibration" / "opencv_stereo_chess"
    done = command(
        "rigcal", "calibrate", capture, "--board", "checkerboard:9x6:25mm", "-o", tmp_path / "s.rig.json", "--json"
    )
    assert done.code == 0, done.err
    rig = rig_of(read_rigfile(tmp_path / "s.rig.json"))
    for camera in done.json["cameras"]:
        assert camera["rmse_px"]["intrinsic"] <= 0.26
        assert camera["rmse_px"]["refined"] <= 0.28
    with np.load(tmp_path / "s.residuals.npz") as data:
        assert data["used"].mean() >= 0.98
        assert len(data["used"]) >= 0.99 * 2 * 13 * 54  # a corner that a shadow's edge crosses is left out
    baseline_m = np.linalg.norm(rig.cameras[1].cam_from_rig.inverse().translation_m)
    assert abs(baseline_m - 0.0829) <= 0.0005


@real
def test_the_caliscope_capture(tmp_path):
    capture = REAL / "calibration" / "caliscope_charuco_calibration" / "calibration" / "extrinsic"
    board = "charuco:4x5:54mm:marker=0.75:dict=DICT_4X4_1000:inverted"
    done = command("rigcal", "calibrate", capture, "--board", board, "-o", tmp_path / "c.rig.json", "--json")
    assert done.code in (0, 1), done.err
    rig = rig_of(read_rigfile(tmp_path / "c.rig.json"))
    centres = [camera.cam_from_rig.inverse().translation_m for camera in rig.cameras]
    found = [np.linalg.norm(centres[i] - centres[j]) for i in range(4) for j in range(i + 1, 4)]
    expected = [1.132, 0.550, 0.426, 0.918, 1.433, 0.626]  # camera_array.toml of the capture
    assert np.abs(np.array(found) / expected - 1).max() <= 0.03
    apart = [camera["rmse_px"]["refined"] for camera in done.json["cameras"]]

    clocked = tmp_path / "clocks.rig.json"
    told = command("rigcal", "sync", "video", capture, "--rig", tmp_path / "c.rig.json", "-o", clocked, "--json")
    decided = [camera["id"] for camera in told.json["cameras"] if camera["confident"]]
    assert decided == ["cam_0", "cam_1", "cam_2"]  # cam_3 saw the board move for 2.8 s only
    again = command(
        *(
            "rigcal",
            "calibrate",
            capture,
            "--board",
            board,
            "--clocks",
            clocked,
            "-o",
            tmp_path / "d.rig.json",
            "--json",
        )
    )
    together = [camera["rmse_px"]["refined"] for camera in again.json["cameras"]]
    assert all(new < 0.75 * old for new, old in zip(together, apart, strict=True))  # measured: 0.29-0.40
    assert read_rigfile(tmp_path / "d.rig.json").cameras[1].clock.method == "video"


@real
def test_the_stereopi_capture_with_its_turned_views(tmp_path):
    capture = REAL / "calibration" / "stereopi_pairs" / "pairs"
    done = command(
        "rigcal", "calibrate", capture, "--board", "checkerboard:9x6:25mm", "-o", tmp_path / "p.rig.json", "--json"
    )
    assert done.code in (0, 1), done.err
    assert max(camera["rmse_px"]["refined"] for camera in done.json["cameras"]) <= 0.22
    rig = rig_of(read_rigfile(tmp_path / "p.rig.json"))
    assert abs(np.linalg.norm(rig.cameras[1].cam_from_rig.inverse().translation_m) - 0.0575) <= 0.0005


@real
def test_the_pose2sim_lenses(tmp_path):
    capture = REAL / "calibration" / "pose2sim_singleperson" / "calibration" / "intrinsics"
    done = command("rigcal", "intrinsics", capture, "--board", "checkerboard:4x7:60mm", "--json")
    assert done.code == 0, done.err
    qualisys_px = [1681.2, 1673.7, 1681.6, 1675.2]
    for entry, expected in list(zip(done.json["cameras"], qualisys_px, strict=True))[:3]:
        assert entry["coefficients"]["fx"] == pytest.approx(expected, rel=0.01)
        assert entry["coefficients"]["fy"] == pytest.approx(expected, rel=0.01)
