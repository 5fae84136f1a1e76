"""Site files: what they may say, and how mistakes are told."""

from pathlib import Path

import pytest

from rigcal.board import Checkerboard
from rigcal.errors import SiteFileError
from rigcal.site import GateLimits, load_site

GOOD = """
site = "hall-3"
board = "checkerboard:9x6:60mm"
fastest_motion_m_per_s = 2.0
[[cameras]]
id = "cam0"
serial = "7004512"
size_wh = [1920, 1080]
fps = 30.0
source = "rtsp://camera-0.local/live"
clock = "ntp://camera-0.local"
capture_latency_s = 0.012
capture_latency_bound_s = 0.004
[[cameras]]
id = "cam1"
model = "fisheye4"
[gates]
intrinsic_rmse_px = 0.4
"""


def written(tmp_path, text):
    path = tmp_path / "hall.site.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_site_file_of_the_interface_is_read(tmp_path):
    site = load_site(written(tmp_path, GOOD))
    assert site.calibration_board == Checkerboard(9, 6, 0.06)
    assert [camera.id for camera in site.cameras] == ["cam0", "cam1"]
    assert site.camera("cam0").size_wh == (1920, 1080)
    assert site.camera("cam1").model == "fisheye4"
    assert site.camera("cam9") is None
    assert site.gates.intrinsic_rmse_px == 0.4
    assert site.gates.refined_rmse_px == GateLimits().refined_rmse_px


@pytest.mark.parametrize(
    ("change", "entry", "words"),
    [
        (("fps = 30.0", "fps = -1"), "cameras[0].fps", "greater than 0"),
        (("fps = 30.0", "fsp = 30"), "cameras[0].fsp", "one of id, serial, size_wh, fps"),
        (('60mm"', '60"'), "board", "has no unit"),
        (('id = "cam1"', 'id = "cam0"'), "cameras", "camera ids repeat: cam0"),
        (('model = "fisheye4"', 'model = "fish"'), "cameras[1].model", "opencv4, opencv5, opencv8, fisheye4"),
        (("intrinsic_rmse_px", "intrinsic_rms"), "gates.intrinsic_rms", "one of intrinsic_rmse_px"),
        (('site = "hall-3"', ""), "site", "required"),
    ],
)
def test_a_mistake_is_named_with_its_place(tmp_path, change, entry, words):
    path = written(tmp_path, GOOD.replace(*change))
    with pytest.raises(SiteFileError) as caught:
        load_site(path)
    message = str(caught.value)
    assert f"entry {entry}: " in message
    assert words in message
    assert str(path) in message
    assert f"do next:  mend or remove {entry}" in message


def test_cameras_may_be_declared_alike(tmp_path):
    cameras = "".join(
        f'[[cameras]]\nid = "c{i}"\n{like}\n' for i, like in enumerate(["", 'like = "c0"', "", 'like = "c1"'])
    )
    site = load_site(written(tmp_path, 'site = "hall"\n' + cameras))
    assert site.sisters == (("c0", "c1", "c3"),)
    assert load_site(written(tmp_path, GOOD)).sisters == ()


def test_measured_distances_stand_in_the_file(tmp_path):
    site = load_site(written(tmp_path, GOOD + '[[distances]]\ncameras = ["cam0", "cam1"]\nlength = "2.41m"\n'))
    (distance,) = site.measured_distances
    assert distance.cameras == ("cam0", "cam1")
    assert distance.length.length_m == 2.41


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[[distances]]\ncameras = ["cam0", "cam1"]\nlength = "2.41"\n', "the size '2.41' has no unit"),
        (
            '[[distances]]\ncameras = ["cam0", "cam9"]\nlength = "2.41m"\n',
            "a distance names cam9; the cameras are cam0, cam1",
        ),
        ('[[distances]]\ncameras = ["cam0", "cam0"]\nlength = "2.41m"\n', "both ends are camera cam0"),
        (
            '[[cameras]]\nid = "cam2"\nlike = "cam9"\n',
            "camera cam2 is like 'cam9', not one of the other cameras: cam0, cam1",
        ),
        ('[[cameras]]\nid = "cam2"\nlike = "cam2"\n', "camera cam2 is like 'cam2'"),
    ],
)
def test_what_contradicts_the_cameras_is_refused(tmp_path, text, words):
    with pytest.raises(SiteFileError) as caught:
        load_site(written(tmp_path, GOOD + text))
    assert words in str(caught.value).replace("value error, ", "")


def test_absent_and_unreadable_files_are_told_apart(tmp_path):
    with pytest.raises(SiteFileError, match="no such file"):
        load_site(tmp_path / "none.site.toml")
    with pytest.raises(SiteFileError, match="not TOML") as caught:
        load_site(written(tmp_path, "site = hall"))
    assert "line 1" in str(caught.value)


def test_every_shipped_site_file_loads():
    shipped = sorted((Path(__file__).parents[2] / "rig_configs").rglob("*.site.toml"))
    assert shipped
    for path in shipped:
        assert load_site(path).cameras
