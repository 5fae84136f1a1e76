"""Claims about the formats of one file that came later: each mistake is named by its entry, with what to do."""

import json

import numpy as np
import pytest

from rigcal.camera import Camera
from rigcal.errors import FormatEntryError, FormatError
from rigcal.formats import export_rig, import_rig
from rigcal.geometry import Pose
from rigcal.rig import Rig, RigCamera
from rigcal.rigfile import document_of_rig

UTC = "2026-11-22T09:30:01Z"
QUALISYS = """<?xml version='1.0' encoding='ASCII'?>
<calibration source="a">
  <cameras>
    <camera active="1" model="Miqus M3" serial="11" viewrotation="0">
      <fov_video bottom="9" left="0" right="9" top="0"/>
    </camera>
    <camera active="1" model="Miqus Video" serial="007" viewrotation="0" video_resolution="1080p">
      <fov_video bottom="1919" left="8" right="1095" top="0"/>
      <transform r11="1" r12="0" r13="0" r21="0" r22="1" r23="0" r31="0" r32="0" r33="1" x="100" y="200" z="3000"/>
      <intrinsic centerPointU="34560" centerPointV="61440" focalLengthU="107520" focalLengthV="107584"
        radialDistortion1="-0.05" radialDistortion2="0.1" radialDistortion3="0.01" skew="0"
        tangentalDistortion1="0.0006" tangentalDistortion2="0.0007"/>
    </camera>
  </cameras>
</calibration>
"""
FREEMOCAP = """
[cam_0]
name = "0"
size = [640, 480]
matrix = [[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]]
distortions = [0.1, 0.0, 0.0, 0.0, 0.0]
rotation = [0.0, 0.0, 0.0]
translation = [0.0, 0.0, 0.0]
world_position = [0.0, 0.0, 0.0]
world_orientation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]

[cam_1]
name = "1"
size = [640, 480]
matrix = [[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]]
distortions = [0.1, 0.0, 0.0, 0.0, 0.0]
rotation = [0.0, 0.0, 0.0]
translation = [-1250.0, 0.0, 0.0]
world_position = [1250.0, 0.0, 0.0]
world_orientation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]

[metadata]
charuco_square_size = 39.0
groundplane_calibration = false
"""


def rig(*models):
    cameras = []
    for index, model in enumerate(models):
        lens = Camera(model, (640, 480), np.array([500.0, 510.0, 320.0, 240.0, 0.1, 0.01, 0.001, 0.002]))
        cameras.append(RigCamera(f"c{index}", lens, Pose(np.eye(3), np.array([-1.0 * index, 0.0, 0.0]))))
    return document_of_rig(Rig("s", tuple(cameras), "c0", "IMPORTED"), created_utc=UTC, inputs_sha256="")


def load(path, from_format=None):
    return import_rig(path, from_format=from_format, created_utc=UTC)


def put(folder, content):
    path = folder / "calibration.file"
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return path


def exported(folder, to_format, *models):
    path = folder / "exported"
    export_rig(rig(*(models or ("opencv4", "opencv4"))), path, to_format)
    return path.read_text(encoding="utf-8")


def refusal(path, from_format=None):
    with pytest.raises(FormatError) as caught:
        load(path, from_format)
    return caught.value


def test_qualisys_reads_video_cameras_and_passes_over_marker_cameras(tmp_path):
    (camera,) = load(put(tmp_path, QUALISYS)).cameras
    assert (camera.id, camera.size_wh, camera.model) == ("007", (1088, 1920), "opencv5")
    assert list(camera.coefficients.values()) == [1680, 1681, 532, 960, -0.05, 0.1, 0.0006, 0.0007, 0.01]


def test_qualisys_looks_along_minus_z_with_y_up(tmp_path):
    """Without turn such a camera looks down on the floor from 3 m; a point 1 m below it stands at z = 1 in front."""
    document = import_rig(put(tmp_path, QUALISYS), from_format=None, created_utc=UTC, common_is_world=True)
    cam_from_world = document.world_from_rig.pose.inverse()
    np.testing.assert_allclose(cam_from_world.apply([0.3, 0.2, 2.0]), [0.2, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(cam_from_world.apply([0.1, 0.5, 2.0]), [0.0, -0.3, 1.0], atol=1e-12)


QUALISYS_MISTAKES = [
    ('serial="007" viewrotation="0"', 'serial="007" viewrotation="90"', "camera 007.viewrotation", "0"),
    ('"1080p"', '"720p"', "camera 007.video_resolution", "1080p"),
    ('skew="0"', 'skew="0.5"', "camera 007.intrinsic.skew", "0, as no lens model here has a skew"),
    ('r33="1"', 'r33="1.1"', "camera 007.transform", "a rotation matrix"),
    ('x="100"', 'x="near"', "camera 007.transform.x", "a finite number"),
    ('right="1095"', 'right="1095.5"', "camera 007.fov_video", "whole pixels"),
    (' focalLengthV="107584"', "", "camera 007.intrinsic.focalLengthV", "this entry"),
    ('"Miqus Video"', '"Arqus"', "cameras", "a video camera: Miqus Video"),
]


@pytest.mark.parametrize(("old", "new", "entry", "expected"), QUALISYS_MISTAKES)
def test_a_mistake_in_a_qualisys_file_is_named(tmp_path, old, new, entry, expected):
    assert old in QUALISYS
    error = refusal(put(tmp_path, QUALISYS.replace(old, new, 1)), "qualisys")
    assert isinstance(error, FormatEntryError)
    assert error.what == f"cannot use the entry {entry}"
    assert expected in error.expected


def test_text_that_is_no_xml_is_no_qualisys_file(tmp_path):
    assert refusal(put(tmp_path, QUALISYS[:-20]), "qualisys").what == "this is not XML"


def test_freemocap_is_known_by_its_world_position_and_works_in_millimetres(tmp_path):
    document = load(put(tmp_path, FREEMOCAP))
    assert document.provenance.options == {"from_format": "anipose", "unit": "mm", "unit_from": "file"}
    assert document.cameras[1].cam_from_rig.translation_m == (-1.25, 0.0, 0.0)


def test_four_coefficients_of_opencv_must_say_whether_they_are_a_fisheye_s(tmp_path):
    text = exported(tmp_path, "opencv", "fisheye4")
    assert "fisheye: 1\n" in text
    assert load(put(tmp_path, text)).cameras[0].model == "fisheye4"
    assert load(put(tmp_path, text.replace("fisheye: 1", "fisheye: 0"))).cameras[0].model == "opencv4"
    error = refusal(put(tmp_path, text.replace("fisheye: 1\n", "")))
    assert error.what == "cannot use the entry distortion_coefficients"
    assert "a line 'fisheye: 1' (cv2.fisheye) or 'fisheye: 0', as 4 may be either" in error.expected


def test_opencv_coefficients_after_k6_must_be_zero(tmp_path):
    text = exported(tmp_path, "opencv", "opencv4").replace("cols: 4", "cols: 12")
    twelve = text.replace("0.002]", "0.002, 0.3, 0, 0, 0.6, 0, 0, 0, {}]")
    assert load(put(tmp_path, twelve.format(0))).cameras[0].coefficients["k6"] == 0.6
    assert "thin prism" in refusal(put(tmp_path, twelve.format(0.1))).expected


def test_opencv_s_stereo_names_of_the_samples_and_of_the_documentation_are_one(tmp_path):
    text = exported(tmp_path, "opencv")
    assert load(put(tmp_path, text)).camera_ids == ("c0", "c1")
    nameless = text.replace('names:\n   - "c0"\n   - "c1"\n', "").replace("K1:", "M1:").replace("K2:", "M2:")
    assert load(put(tmp_path, nameless)).camera_ids == ("cam1", "cam2")


@pytest.mark.parametrize("content", ["", "hello", "%YAML:1.0\n---\na: [1,", "{", '{"a": '])
def test_a_text_that_opencv_cannot_read_is_refused(tmp_path, content):
    assert refusal(put(tmp_path, content), "opencv").what == "OpenCV cannot read this file"


def test_three_cameras_are_no_stereo_pair(tmp_path):
    with pytest.raises(FormatError) as caught:
        export_rig(rig("opencv4", "opencv4", "opencv4"), tmp_path / "x", "opencv")
    assert caught.value.got == "3: c0, c1, c2"
    assert "easymocap" in caught.value.do_next


def test_mixed_lenses_are_named_for_nerfstudio(tmp_path):
    with pytest.raises(FormatError) as caught:
        export_rig(rig("opencv4", "fisheye4"), tmp_path / "x", "nerfstudio")
    assert caught.value.got == "fisheye: c1"


def test_nerfstudio_takes_shared_intrinsics_before_a_frame_s_own(tmp_path):
    content = json.loads(exported(tmp_path, "nerfstudio")) | {"fl_x": 600.0, "w": 1280}
    for camera in load(put(tmp_path, content)).cameras:
        assert (camera.coefficients["fx"], camera.coefficients["fy"], camera.size_wh) == (600.0, 510.0, (1280, 480))


JSON_MISTAKES = [
    ("nerfstudio", ("frames", 1, "transform_matrix", 3), [0, 0, 0, 2], "frames[1].transform_matrix", "a last row"),
    ("nerfstudio", ("frames", 0, "transform_matrix", 0, 0), 2.0, "frames[0].transform_matrix", "a rotation matrix"),
    ("nerfstudio", ("frames", 0, "k4"), 0.1, "frames[0]", "k4 of 0"),
    ("nerfstudio", ("frames", 0, "fl_y"), None, "frames[0].fl_y", "this entry"),
    ("nerfstudio", ("frames", 1, "w"), 640.5, "frames[1].w, h", "whole pixels"),
    ("nerfstudio", ("camera_model",), "EQUIRECTANGULAR", "camera_model", "one of OPENCV, PINHOLE, OPENCV_FISHEYE"),
    ("foxglove", ("foxglove.CameraCalibration", 0, "K"), [1] * 8, "foxglove.CameraCalibration[0].K", "3 rows of 3"),
    (
        "foxglove",
        ("foxglove.CameraCalibration", 0, "distortion_model"),
        "fisheye62",
        "foxglove.CameraCalibration[0].distortion_model",
        "kannala_brandt",
    ),
    (
        "foxglove",
        ("foxglove.FrameTransforms", "transforms", 1, "rotation", "w"),
        2.0,
        "foxglove.FrameTransforms.transforms[1].rotation",
        "a quaternion of length 1",
    ),
    ("foxglove", ("foxglove.FrameTransforms",), None, "foxglove.FrameTransforms", "this entry"),
]


@pytest.mark.parametrize(("to_format", "path", "value", "entry", "expected"), JSON_MISTAKES)
def test_a_mistake_in_a_json_file_is_named_by_its_entry(tmp_path, to_format, path, value, entry, expected):
    content = json.loads(exported(tmp_path, to_format))
    holder = content
    for key in path[:-1]:
        holder = holder[key]
    if value is None:
        del holder[path[-1]]
    else:
        holder[path[-1]] = value
    error = refusal(put(tmp_path, content), to_format)
    assert isinstance(error, FormatEntryError)
    assert error.what == f"cannot use the entry {entry}"
    assert expected in error.expected
