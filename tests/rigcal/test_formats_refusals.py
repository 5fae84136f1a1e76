"""Claims about files and rigs that are refused: which entry, what was expected, what to do next."""

import json

import numpy as np
import pytest

from rigcal.camera import MODELS, Camera
from rigcal.errors import FormatEntryError, FormatError, LossyExportError, OptionError, RigFileError, UnknownFormatError
from rigcal.formats import FORMATS, export_rig, import_rig
from rigcal.geometry import Pose
from rigcal.rig import Rig, RigCamera
from rigcal.rigfile import document_of_rig, rig_of, write_rigfile

UTC = "2026-11-22T09:30:01Z"
IMPORT_ONLY = ("multiview-dataset", "qualisys")
K = [[1000.0, 0.0, 320.0], [0.0, 1001.0, 240.0], [0.0, 0.0, 1.0]]
EYE = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]

ANIPOSE = """
[cam_0]
name = "left"
size = [640, 480]
matrix = [[1000.0, 0.0, 320.0], [0.0, 1001.0, 240.0], [0.0, 0.0, 1.0]]
distortions = [0.1, 0.0, 0.0, 0.0, 0.0]
rotation = [0.0, 0.0, 0.0]
translation = [0.0, 0.0, 0.0]

[cam_1]
name = "right"
size = [640, 480]
matrix = [[1000.0, 0.0, 320.0], [0.0, 1001.0, 240.0], [0.0, 0.0, 1.0]]
distortions = [0.1, 0.0, 0.0, 0.0, 0.0]
rotation = [0.0, 0.1, 0.0]
translation = [-60.0, 0.0, 0.0]
"""
KALIBR = """
cam0:
  camera_model: pinhole
  intrinsics: [1000, 1001, 320, 240]
  distortion_model: radtan
  distortion_coeffs: [0.1, 0, 0, 0]
  resolution: [640, 480]
cam1:
  camera_model: pinhole
  intrinsics: [1000, 1001, 320, 240]
  distortion_model: radtan
  distortion_coeffs: [0.1, 0, 0, 0]
  resolution: [640, 480]
  T_cn_cnm1:
  - [1, 0, 0, -0.1]
  - [0, 1, 0, 0]
  - [0, 0, 1, 0]
  - [0, 0, 0, 1]
"""


def dataset():
    cameras = [
        {
            "name": name,
            "image_size": [640, 480],
            "K": [list(row) for row in K],
            "dist": [0.1, 0, 0, 0, 0],
            "R": EYE,
            "t": [0, 0, t],
        }
        for name, t in (("left", 1.0), ("right", 2.0))
    ]
    return {"name": "d", "format": "multiview-dataset/1", "units": "metre", "fps": 60, "cameras": cameras}


def colmap():
    lens = {
        "camera_model_name": "OPENCV",
        "camera_params": [1000, 1001, 320.5, 240.5, 0.1, 0, 0, 0],
        "image_width": 640,
        "image_height": 480,
    }
    pose = {"cam_from_rig_rotation": [1, 0, 0, 0], "cam_from_rig_translation": [-0.1, 0, 0]}
    return [{"cameras": [lens | {"image_prefix": "a/l/", "ref_sensor": True}, lens | pose | {"image_prefix": "a/r/"}]}]


def put(folder, content):
    path = folder / "calibration.file"
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return path


def load(path, from_format=None, unit=None):
    return import_rig(path, from_format=from_format, created_utc=UTC, unit=unit)


def changed(data, path, value):
    holder = data
    for key in path[:-1]:
        holder = holder[key]
    if value is None:
        del holder[path[-1]]
    else:
        holder[path[-1]] = value
    return data


def rig(model, **coefficients):
    values = {"fx": 1000, "fy": 1001, "cx": 320, "cy": 240} | coefficients
    lens = Camera(model, (640, 480), np.array([float(values.get(name, 0)) for name in MODELS[model]]))
    return document_of_rig(
        Rig("s", (RigCamera("gate", lens, Pose.identity()),), "gate", "IMPORTED"), created_utc=UTC, inputs_sha256=""
    )


def test_the_small_files_of_this_module_are_read_as_they_stand(tmp_path):
    for content, name in ((KALIBR, "kalibr"), (dataset(), "multiview-dataset"), (colmap(), "colmap")):
        document = load(put(tmp_path, content))
        assert document.provenance.options["from_format"] == name
        camera = document.cameras[0]
        assert (camera.size_wh, camera.coefficients["cx"], camera.coefficients["k1"]) == ((640, 480), 320.0, 0.1)
    assert load(put(tmp_path, colmap())).camera_ids == ("l", "r")
    assert load(put(tmp_path, ANIPOSE), unit="mm").cameras[1].cam_from_rig.translation_m == (-0.06, 0.0, 0.0)


@pytest.mark.parametrize("rotation", ["[[0.0], [0.1], [0.0]]", "[[0.0, 0.1, 0.0]]"])
def test_a_rotation_vector_may_be_a_column_or_a_row(tmp_path, rotation):
    nested = ANIPOSE.replace("rotation = [0.0, 0.1, 0.0]", f"rotation = {rotation}")
    assert load(put(tmp_path, nested), unit="mm").cameras == load(put(tmp_path, ANIPOSE), unit="mm").cameras


def test_a_camera_that_caliscope_ignores_is_left_out(tmp_path):
    text = (
        ANIPOSE.replace('name = "right"', "ignore = true").replace("cam_1", "cameras.1").replace("cam_0", "cameras.0")
    )
    assert load(put(tmp_path, text)).camera_ids == ("left",)


def test_an_absent_file_is_named(tmp_path):
    with pytest.raises(FormatError, match="no such file") as caught:
        load(tmp_path / "absent.toml")
    assert caught.value.where.endswith("absent.toml")
    with pytest.raises(FormatError, match="no calibration file in this folder") as caught:
        load(tmp_path)
    assert caught.value.got == "an empty folder"


def test_an_unknown_format_lists_those_that_exist(tmp_path):
    path = put(tmp_path, ANIPOSE)
    for call, option in (
        (lambda: load(path, "vicon"), "--from"),
        (lambda: export_rig(rig("opencv4"), path, "vicon"), "--to"),
    ):
        with pytest.raises(UnknownFormatError) as caught:
            call()
        assert str(caught.value) == (
            "there is no format 'vicon'\n"
            f"  where:    {path}\n"
            f"  expected: one of {', '.join(FORMATS)}\n"
            "  got:      vicon\n"
            f"  do next:  name one of these formats with {option}"
        )


def test_a_format_that_is_only_exported_cannot_be_imported(tmp_path):
    with pytest.raises(UnknownFormatError, match="usd can be exported only") as caught:
        load(put(tmp_path, "#usda 1.0"), "usd")
    assert caught.value.expected == "one of " + ", ".join(name for name in FORMATS if name != "usd")


def test_a_format_that_is_only_imported_cannot_be_exported(tmp_path):
    assert not FORMATS["multiview-dataset"].can_export
    with pytest.raises(UnknownFormatError, match="multiview-dataset can be imported only") as caught:
        export_rig(rig("opencv4"), tmp_path / "x", "multiview-dataset")
    assert caught.value.expected == "one of " + ", ".join(name for name in FORMATS if name not in IMPORT_ONLY)


@pytest.mark.parametrize("content", ["", "hello", "{}", "[]", "[1]", "a = 1", "cam0:\n  model: x\n", '{"a": [[['])
def test_a_content_that_is_not_recognised_lists_the_formats(tmp_path, content):
    with pytest.raises(UnknownFormatError, match="cannot tell the format of this file") as caught:
        load(put(tmp_path, content))
    assert caught.value.got == "none of them"
    assert caught.value.do_next == "name one of these formats with --from"


def test_a_content_that_fits_two_formats_names_both(tmp_path):
    content = f'note = """{KALIBR}"""\n{ANIPOSE}'
    with pytest.raises(UnknownFormatError) as caught:
        load(put(tmp_path, content))
    assert caught.value.got == "anipose and kalibr"


def test_a_binary_file_is_no_calibration(tmp_path):
    path = tmp_path / "cameras.bin"
    path.write_bytes(b"\x01\x00\xff\xfe")
    with pytest.raises(FormatError, match="this is not a text file") as caught:
        load(path)
    assert caught.value.got == "4 bytes that are not"


def test_a_rig_file_is_recognised_and_not_imported(tmp_path):
    path = tmp_path / "a.rig.json"
    write_rigfile(rig("opencv4"), path)
    with pytest.raises(FormatError, match="this is a rig file already"):
        load(path)


@pytest.mark.parametrize("name", ["anipose", "colmap", "multiview-dataset"])
def test_a_text_in_another_syntax_than_the_named_format_is_refused(tmp_path, name):
    with pytest.raises(FormatError, match=r"this is not (TOML|JSON)"):
        load(put(tmp_path, "cam0: }{"), name)


JSON_MISTAKES = [
    (dataset, ("cameras", 1, "R"), None, "cameras[1].R", "this entry", "nothing"),
    (dataset, ("cameras",), [], "cameras", "a list that is not empty", "[]"),
    (dataset, ("cameras", 0, "t"), [0, 0], "cameras[0].t", "a list of 3 numbers", "[0, 0]"),
    (dataset, ("cameras", 0, "t"), [0, 0, "1"], "cameras[0].t[2]", "a finite number", "1"),
    (dataset, ("cameras", 0, "R"), np.diag([1, 1, 2]).tolist(), "cameras[0].R", "a rotation", "off the identity by 3"),
    (dataset, ("cameras", 0, "R"), np.diag([1, 1, -1]).tolist(), "cameras[0].R", "determinant +1", "determinant -1"),
    (dataset, ("cameras", 0, "R"), EYE[:2], "cameras[0].R", "3 rows of 3 numbers", "2 rows"),
    (dataset, ("cameras", 0, "K", 0, 1), 0.5, "cameras[0].K", "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]", "0.5"),
    (dataset, ("cameras", 0, "K", 0, 0), -5.0, "cameras[0].K", "focal lengths above 0 px", "-5.0"),
    (dataset, ("cameras", 0, "image_size"), [640.5, 480], "cameras[0].image_size", "whole pixels", "640.5"),
    (dataset, ("cameras", 0, "dist"), [0.1], "cameras[0].dist", "a list of 5 numbers", "[0.1]"),
    (dataset, ("cameras", 0), 3, "cameras[0]", "a table of named entries", "3"),
    (dataset, ("cameras", 0, "name"), 3, "cameras[0].name", "a text", "3"),
    (dataset, ("units",), "millimetre", "units", "'metre'", "millimetre"),
    (dataset, ("format",), "multiview-dataset/2", "format", "'multiview-dataset/1'", "multiview-dataset/2"),
    (colmap, (0, "cameras", 0, "image_width"), None, "[0].cameras[0].image_width", "this entry", "nothing"),
    (colmap, (0, "cameras", 1, "cam_from_rig_rotation"), None, "[0].cameras[1].cam_from_rig_rotation", "this", "noth"),
    (
        colmap,
        (0, "cameras", 1, "cam_from_rig_rotation"),
        [1, 1, 0, 0],
        "[0].cameras[1].cam_from_rig_rotation",
        "a quaternion of length 1",
        "length 1.41421",
    ),
    (colmap, (0, "cameras", 0, "camera_model_name"), "FOV", "[0].cameras[0].camera_model_name", "OPENCV", "FOV"),
    (colmap, (0, "cameras", 0, "camera_params"), [1, 2], "[0].cameras[0].camera_params", "8 numbers", "[1, 2]"),
    (colmap, (0, "cameras", 0, "ref_sensor"), "yes", "[0].cameras[0].ref_sensor", "true or false", "yes"),
    (colmap, (0, "cameras", 0, "image_prefix"), "/", "[0].cameras[0].image_prefix", "name of a folder", "/"),
]


@pytest.mark.parametrize(("make", "path", "value", "entry", "expected", "got"), JSON_MISTAKES)
def test_a_mistake_in_a_json_file_is_named_by_its_entry(tmp_path, make, path, value, entry, expected, got):
    name = "colmap" if make is colmap else "multiview-dataset"
    with pytest.raises(FormatEntryError) as caught:
        load(put(tmp_path, changed(make(), path, value)), name)
    assert str(caught.value).splitlines()[0] == f"cannot use the entry {entry}"
    assert expected in caught.value.expected
    assert got in caught.value.got
    assert "write the file again with the tool that made it" in str(caught.value)


TEXT_MISTAKES = [
    (ANIPOSE, "rotation = [0.0, 0.1, 0.0]\n", "", "cam_1.rotation", "this entry"),
    (ANIPOSE, "rotation = [0.0, 0.1, 0.0]", "rotation = [[1, 0, 0], [0, 1, 0], [0, 0.1, 1]]", "cam_1.rotation", "rota"),
    (ANIPOSE, "distortions = [0.1, 0.0, 0.0, 0.0, 0.0]", "distortions = [0.1]", "cam_0.distortions", "4 or 5 or 8"),
    (ANIPOSE, 'name = "left"', "fisheye = true", "cam_0.distortions", "a list of 4 numbers"),
    (ANIPOSE, 'name = "left"', 'fisheye = "yes"', "cam_0.fisheye", "true or false"),
    (ANIPOSE, "[cam_0]", '[metadata]\nunits = "inch"\n[cam_0]', "metadata.units", "one of m, cm, mm"),
    (ANIPOSE, "[-60.0, 0.0, 0.0]", "[-inf, 0.0, 0.0]", "cam_1.translation[0]", "a finite number"),
    (ANIPOSE, "rotation = [0.0, 0.1, 0.0]", "rotation = [0.0, 0.1]", "cam_1.rotation", "a list of 3 numbers"),
    (
        ANIPOSE,
        "rotation = [0.0, 0.1, 0.0]",
        "rotation = [0.0, 45.0, 0.0]",
        "cam_1.rotation",
        "a rotation vector in rad",
    ),
    (KALIBR, "  T_cn_cnm1:", "  T_cn:", "cam1.T_cn_cnm1", "this entry"),
    (KALIBR, "cam1:", "cam2:", "cam1", "this entry"),
    (KALIBR, "camera_model: pinhole", "camera_model: omni", "cam0.camera_model", "'pinhole'"),
    (KALIBR, "radtan", "fov", "cam0.distortion_model", "one of radtan, equidistant, none"),
    (KALIBR, "- [0, 0, 0, 1]", "- [0, 0, 0.1, 1]", "cam1.T_cn_cnm1", "a last row of 0, 0, 0, 1"),
    (KALIBR, "- [1, 0, 0, -0.1]", "- [1, 0.01, 0, -0.1]", "cam1.T_cn_cnm1", "a rotation matrix"),
    (KALIBR, "[1000, 1001, 320, 240]", "[0, 1001, 320, 240]", "cam0.intrinsics", "focal lengths above 0 px"),
]


@pytest.mark.parametrize(("text", "old", "new", "entry", "expected"), TEXT_MISTAKES)
def test_a_mistake_in_a_toml_or_yaml_file_is_named_by_its_entry(tmp_path, text, old, new, entry, expected):
    assert old in text
    name = "anipose" if text is ANIPOSE else "kalibr"
    with pytest.raises(FormatEntryError) as caught:
        load(put(tmp_path, text.replace(old, new, 1)), name, unit="mm" if name == "anipose" else None)
    assert str(caught.value).splitlines()[0] == f"cannot use the entry {entry}"
    assert expected in caught.value.expected


def test_a_toml_file_without_cameras_says_what_a_camera_has(tmp_path):
    with pytest.raises(FormatEntryError, match="a table per camera with distortions, matrix, rotation, translation"):
        load(put(tmp_path, "[charuco]\ncolumns = 4\n"), "anipose")


def test_several_rigs_in_one_file_are_refused(tmp_path):
    with pytest.raises(FormatEntryError) as caught:
        load(put(tmp_path, colmap() * 2))
    assert (caught.value.expected, caught.value.got) == ("one rig in the file", "2 rigs")


def test_cameras_of_one_name_are_refused(tmp_path):
    with pytest.raises(FormatError, match="camera identifiers repeat: left, left"):
        load(put(tmp_path, ANIPOSE.replace('"right"', '"left"')), unit="mm")


def test_a_long_value_is_shortened_in_the_message(tmp_path):
    with pytest.raises(FormatEntryError) as caught:
        load(put(tmp_path, changed(dataset(), ("cameras", 0, "name"), list(range(1000)))))
    assert len(caught.value.got) == 100


def test_a_file_without_a_unit_that_makes_a_giant_in_metres_asks_for_the_unit(tmp_path):
    path = put(tmp_path, ANIPOSE)
    with pytest.raises(FormatError) as caught:
        load(path)
    assert str(caught.value).startswith("the file does not say its unit of length, and metres are unlikely\n")
    assert caught.value.got == "two cameras 60 apart"
    assert "--unit mm" in caught.value.do_next
    assert load(path, unit="m").provenance.options == {"from_format": "anipose", "unit": "m", "unit_from": "option"}
    near = put(tmp_path, ANIPOSE.replace("-60.0", "-0.06"))
    assert load(near).provenance.options["unit_from"] == "assumed"


def test_a_unit_in_the_metadata_is_followed_and_may_not_be_contradicted(tmp_path):
    path = put(tmp_path, ANIPOSE + '[metadata]\nunits = "mm"\n')
    document = load(path)
    assert document.provenance.options["unit_from"] == "file"
    assert rig_of(document).cameras[1].cam_from_rig.translation_m[0] == pytest.approx(-0.06)
    with pytest.raises(FormatError, match="this anipose file is in mm"):
        load(path, unit="m")
    with pytest.raises(FormatError, match="this kalibr file is in m"):
        load(put(tmp_path, KALIBR), unit="mm")
    with pytest.raises(OptionError, match="option --unit is out of range"):
        load(path, unit="inch")


FISHEYE = "fisheye k1 = 0, fisheye k2 = 0.5, fisheye k3 = 0, fisheye k4 = 0"
LOSSES = [
    ("kalibr", "opencv5", {"k3": -0.012}, "kalibr radtan", "k3 = -0.012", "--model opencv4, or export to colmap"),
    ("kalibr", "opencv8", {"k3": 0.1, "k6": 0.2}, "kalibr radtan", "k3 = 0.1, k6 = 0.2", "--model opencv4"),
    ("anipose", "opencv8", {"k1": 0.1, "k4": 0.3}, "anipose", "k4 = 0.3", "--model opencv5, or export to colmap"),
    ("easymocap", "opencv8", {"k1": 0.1, "k5": 0.3}, "easymocap", "k5 = 0.3", "--model opencv5, or export to colmap"),
    ("nerfstudio", "opencv8", {"k4": 1e-9}, "nerfstudio", "k4 = 1e-09", "--model opencv5, or export to colmap"),
    ("easymocap", "fisheye4", {"k2": 0.5}, "easymocap", FISHEYE, "which hold a fisheye lens"),
    ("mrcal", "fisheye4", {"k2": 0.5}, "mrcal", FISHEYE, "which hold a fisheye lens"),
]


@pytest.mark.parametrize(("to_format", "model", "coefficients", "named", "got", "do_next"), LOSSES)
def test_an_export_that_would_drop_a_coefficient_is_refused(
    tmp_path, to_format, model, coefficients, named, got, do_next
):
    path = tmp_path / "out"
    with pytest.raises(LossyExportError) as caught:
        export_rig(rig(model, **coefficients), path, to_format)
    assert str(caught.value).splitlines()[0] == f"{named} cannot hold every coefficient of camera gate"
    assert caught.value.where == f"camera gate, model {model}"
    assert caught.value.got == got
    assert do_next in caught.value.do_next
    assert not path.exists()


@pytest.mark.parametrize(("to_format", "model"), [(name, "opencv8") for name in FORMATS if name not in IMPORT_ONLY])
def test_a_coefficient_of_zero_is_no_loss(tmp_path, to_format, model):
    assert export_rig(rig(model, k1=0.1), tmp_path / "out", to_format)


def test_an_absent_folder_is_named(tmp_path):
    with pytest.raises(RigFileError, match="cannot write this file"):
        export_rig(rig("opencv4"), tmp_path / "absent" / "out", "colmap")
