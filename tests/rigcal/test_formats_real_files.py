"""Claims about files that other tools wrote: distances between cameras agree with what those captures document."""

import itertools
import json
from pathlib import Path

import numpy as np
import pytest

from rigcal.errors import FormatEntryError
from rigcal.formats import import_rig
from rigcal.rigfile import read_rigfile, rig_of, write_rigfile

DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data"
CALISCOPE = "calibration/caliscope_charuco_calibration"
POSE2SIM = "calibration/pose2sim_singleperson/_expected_eca0229/Calib_scene.toml"
QUALISYS = "calibration/pose2sim_singleperson/calibration/Calib.qca.txt"
STEREO = "calibration/opencv_stereo_chess"
UTC = "2026-11-22T09:30:01Z"

QUALISYS_M = (2.854, 6.249, 5.242, 6.009, 6.689, 3.693)
CALISCOPE_M = (1.132, 0.550, 0.426, 0.918, 1.433, 0.626)
POSE2SIM_M = (2.954, 6.295, 5.266, 6.088, 6.796, 3.701)
"""Pairs 01 02 03 12 13 23, from the README beside each file (rounded there to millimetres)."""

pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="the folder shared/data is not beside this checkout")


def load(name):
    return import_rig(DATA / name, from_format=None, created_utc=UTC)


def distances_m(document):
    positions = [camera.cam_from_rig.inverse().translation_m for camera in rig_of(document).cameras]
    return [float(np.linalg.norm(a - b)) for a, b in itertools.combinations(positions, 2)]


@pytest.mark.parametrize(
    ("name", "expected_m", "ids"),
    [
        (f"{CALISCOPE}/camera_array.toml", CALISCOPE_M, [f"cam_{i}" for i in range(4)]),
        (f"{CALISCOPE}/config.toml", CALISCOPE_M, [f"cam_{i}" for i in range(4)]),
        (QUALISYS, QUALISYS_M, [f"cam0{i}" for i in range(1, 5)]),
        (POSE2SIM, POSE2SIM_M, [f"int_cam0{i}_img" for i in range(1, 5)]),
        ("recognition/pose2sim_single/dataset.json", QUALISYS_M, [f"cam0{i}" for i in range(1, 5)]),
        ("recognition/pose2sim_multi/dataset.json", QUALISYS_M, [f"cam0{i}" for i in range(1, 5)]),
    ],
)
def test_a_recognised_file_gives_the_documented_distances(tmp_path, name, expected_m, ids):
    document = load(name)
    assert list(document.camera_ids) == ids
    np.testing.assert_allclose(distances_m(document), expected_m, atol=0.0006)
    path = tmp_path / "a.rig.json"
    assert write_rigfile(document, path).cameras == document.cameras
    assert read_rigfile(path).cameras == document.cameras


def test_lenses_keep_the_count_of_coefficients_that_the_tool_wrote():
    assert {camera.model for camera in load(f"{CALISCOPE}/camera_array.toml").cameras} == {"opencv5"}
    pose2sim = load(POSE2SIM)
    assert {(camera.model, camera.size_wh) for camera in pose2sim.cameras} == {("opencv4", (1088, 1920))}
    assert pose2sim.world_from_rig is None


def test_both_caliscope_files_describe_one_rig():
    ours, theirs = (load(f"{CALISCOPE}/{name}.toml") for name in ("camera_array", "config"))
    assert ours.cameras == theirs.cameras


@pytest.mark.parametrize("name", ["pose2sim_single", "pose2sim_multi"])
def test_the_world_of_a_data_set_becomes_the_world_of_the_rig(name):
    path = DATA / "recognition" / name / "dataset.json"
    document = load(f"recognition/{name}/dataset.json")
    rig = rig_of(document)
    assert (document.verdict, document.site, document.extensions) == ("IMPORTED", name, {"rigcal": {"fps": 60}})
    rig_from_world = rig.world_from_rig.inverse()
    for camera, stored in zip(rig.cameras, json.loads(path.read_text(encoding="utf-8"))["cameras"], strict=True):
        cam_from_world = camera.cam_from_rig @ rig_from_world
        np.testing.assert_allclose(cam_from_world.rotation, stored["R"], atol=1e-12)
        np.testing.assert_allclose(cam_from_world.translation_m, stored["t"], atol=1e-12)
        height_m = cam_from_world.inverse().translation_m[2]
        assert 0.3 < height_m < 3


def test_qualisys_agrees_with_the_data_set_of_the_same_cameras():
    """That data set holds the same calibration in OpenCV's terms, with a world of z up; it was made apart from here."""
    document = import_rig(DATA / QUALISYS, from_format=None, created_utc=UTC, common_is_world=True)
    assert (document.provenance.options["from_format"], document.provenance.options["unit"]) == ("qualisys", "mm")
    ours, theirs = rig_of(document), rig_of(load("recognition/pose2sim_single/dataset.json"))
    for camera, other in zip(ours.cameras, theirs.cameras, strict=True):
        assert (camera.id, camera.camera.size_wh) == (other.id, other.camera.size_wh)
        np.testing.assert_allclose(camera.camera.params, other.camera.params, atol=1e-9)
        np.testing.assert_allclose(camera.cam_from_rig.matrix, other.cam_from_rig.matrix, atol=1e-9)
    np.testing.assert_allclose(ours.world_from_rig.matrix, theirs.world_from_rig.matrix, atol=1e-9)


def test_qualisys_gives_the_focal_lengths_that_the_capture_documents():
    focals = [camera.coefficients["fx"] for camera in load(QUALISYS).cameras]
    np.testing.assert_allclose(focals, [1681.2, 1673.7, 1681.6, 1675.2], atol=0.06)


def test_opencv_s_own_camera_file_is_a_rig_of_one():
    (camera,) = load(f"{STEREO}/left_intrinsics.yml").cameras
    assert (camera.model, camera.size_wh) == ("opencv5", (640, 480))
    coefficients = camera.coefficients
    assert coefficients["fx"] == coefficients["fy"] == 535.91573396163199
    assert (coefficients["k1"], coefficients["k3"]) == (-0.26637260909660682, 0.23839153080878486)


def test_opencv_s_own_stereo_file_asks_for_what_it_lacks(tmp_path):
    with pytest.raises(FormatEntryError, match="cannot use the entry R") as caught:
        load(f"{STEREO}/intrinsics.yml")
    assert "in one beside it" in caught.value.expected
    text = (DATA / STEREO / "intrinsics.yml").read_text(encoding="utf-8")
    (tmp_path / "intrinsics.yml").write_text(text, encoding="utf-8")
    matrix = "{}: !!opencv-matrix\n   rows: 3\n   cols: {}\n   dt: d\n   data: {}\n"
    pose = "%YAML:1.0\n" + matrix.format("R", 3, [1, 0, 0, 0, 1, 0, 0, 0, 1]) + matrix.format("T", 1, [-83, 0, 0])
    (tmp_path / "extrinsics.yml").write_text(pose, encoding="utf-8")
    with pytest.raises(FormatEntryError) as caught:
        load(tmp_path)
    assert caught.value.expected == "the images' size in pixels: add a line such as 'image_width: 1920'"
    (tmp_path / "extrinsics.yml").write_text(pose + "image_width: 640\nimage_height: 480\n", encoding="utf-8")
    document = import_rig(tmp_path, from_format=None, created_utc=UTC, unit="mm")
    assert [camera.coefficients["k1"] for camera in document.cameras] == [0.29589439552724328, -0.16916358306948096]
    np.testing.assert_allclose(distances_m(document), 0.083)
