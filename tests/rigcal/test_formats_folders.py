"""Claims about formats of several files: written whole or not at all, and each mistake named by file and entry."""

import json
import struct
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from rigcal.camera import Camera
from rigcal.errors import ForeignNameError, FormatEntryError, FormatError, OutputError, UnknownFormatError
from rigcal.formats import FORMATS, export_rig, import_rig
from rigcal.formats import _source as source_module
from rigcal.geometry import Pose
from rigcal.rig import Rig, RigCamera
from rigcal.rigfile import document_of_rig, rig_of, write_rigfile

UTC = "2026-11-22T09:30:01Z"
LENS = Camera("opencv5", (640, 480), np.array([500.0, 510.0, 320.0, 240.0, 0.1, -0.02, 0.001, 0.002, 0.003]))
FOLDERS = [form.name for form in FORMATS.values() if form.is_folder]


def rig(*names, lens=LENS):
    poses = [Pose.from_rvec([0.0, 0.1 * i, 0.0], [-1.0 * i, 0.0, 0.0]) for i in range(len(names))]
    cameras = tuple(RigCamera(name, lens, pose) for name, pose in zip(names, poses, strict=True))
    return document_of_rig(Rig("s", cameras, names[0], "IMPORTED"), created_utc=UTC, inputs_sha256="")


def exported(folder, to_format, *names):
    path = folder / "out"
    export_rig(rig(*(names or ("left", "right"))), path, to_format)
    return path


def load(path, from_format=None):
    return import_rig(path, from_format=from_format, created_utc=UTC)


def refusal(path, from_format=None):
    with pytest.raises(FormatError) as caught:
        load(path, from_format)
    return caught.value


def change(path, old, new):
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


@pytest.mark.parametrize("to_format", FOLDERS)
def test_a_folder_of_the_same_rig_is_replaced(tmp_path, to_format):
    path = exported(tmp_path, to_format)
    for file in path.iterdir():
        file.write_text("old", encoding="utf-8")
    exported(tmp_path, to_format)
    assert load(path).camera_ids == ("left", "right")
    assert [entry.name for entry in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("to_format", FOLDERS)
def test_a_folder_with_other_files_is_left_alone(tmp_path, to_format):
    path = exported(tmp_path, to_format)
    (path / "mine.txt").write_text("notes", encoding="utf-8")
    before = {file.name: file.read_bytes() for file in path.iterdir()}
    with pytest.raises(FormatError, match="this format writes a folder of its own") as caught:
        exported(tmp_path, to_format)
    assert caught.value.got == "mine.txt"
    assert {file.name: file.read_bytes() for file in path.iterdir()} == before


def test_a_file_in_the_place_of_the_folder_is_left_alone(tmp_path):
    (tmp_path / "out").write_text("notes", encoding="utf-8")
    with pytest.raises(FormatError, match="a folder of its own") as caught:
        exported(tmp_path, "ros")
    assert caught.value.got == "a file"


def test_nothing_is_left_half_written_when_the_disk_is_full(tmp_path, monkeypatch):
    path = exported(tmp_path, "mrcal")
    before = {file.name: file.read_bytes() for file in path.iterdir()}

    def full(file, text):
        if file.name.startswith("right"):
            raise OSError(28, "No space left on device")
        Path(file).write_text("new " + text, encoding="utf-8")

    monkeypatch.setattr(source_module, "write_atomically", full)
    with pytest.raises(OutputError, match="No space left on device"):
        exported(tmp_path, "mrcal")
    assert {file.name: file.read_bytes() for file in path.iterdir()} == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["out"]


def test_cameras_of_a_folder_are_in_natural_order(tmp_path):
    assert load(exported(tmp_path, "mrcal", "cam10", "cam2")).camera_ids == ("cam2", "cam10")


def test_the_hash_of_a_folder_changes_with_any_file_and_its_name(tmp_path):
    path = exported(tmp_path, "mrcal")
    hashes = {load(path).provenance.inputs_sha256}
    change(path / "left.cameramodel", "500.0", "500.5")
    hashes.add(load(path).provenance.inputs_sha256)
    (path / "left.cameramodel").rename(path / "other.cameramodel")
    hashes.add(load(path).provenance.inputs_sha256)
    assert len(hashes) == 3


def test_names_that_differ_in_capitals_only_are_refused_where_they_become_files(tmp_path):
    with pytest.raises(ForeignNameError) as caught:
        exported(tmp_path, "mrcal", "Cam", "cam")
    assert caught.value.expected == "names that differ in more than capitals"


def test_a_name_that_a_format_cannot_hold_is_named_with_a_way_out(tmp_path):
    with pytest.raises(ForeignNameError) as caught:
        exported(tmp_path, "easymocap", "left", "north gate")
    assert str(caught.value) == (
        "easymocap cannot hold the name of camera north gate\n"
        "  where:    camera north gate\n"
        "  expected: letters, digits, _ and -, as OpenCV allows in a key\n"
        "  got:      'north gate'\n"
        "  do next:  rename that camera's folder in the capture and calibrate again, or export to anipose or "
        "foxglove, which hold any name"
    )
    with pytest.raises(ForeignNameError, match="foxglove cannot hold the name of camera rig"):
        exported(tmp_path, "foxglove", "rig", "left")


def test_a_folder_of_no_format_names_the_file_in_it_that_is_one(tmp_path):
    (tmp_path / "site").mkdir()
    export_rig(rig("a", "b"), tmp_path / "site" / "Calib.toml", "anipose")
    (tmp_path / "site" / "notes.txt").write_text("hello", encoding="utf-8")
    error = refusal(tmp_path / "site")
    assert error.what == "this folder is of no format, but it holds a file that is"
    assert error.got == "Calib.toml (anipose)"
    error = refusal(tmp_path / "site", "anipose")
    assert (error.what, error.got) == ("anipose is one file, not a folder", "a folder with Calib.toml, notes.txt")


def test_a_folder_without_any_calibration_lists_what_is_read(tmp_path):
    (tmp_path / "cam0").mkdir()
    error = refusal(tmp_path)
    assert (error.what, error.got) == ("no calibration file in this folder", "1 other entries")
    (tmp_path / "notes.txt").write_text("hello", encoding="utf-8")
    with pytest.raises(UnknownFormatError, match="cannot tell the format of this folder"):
        load(tmp_path)


def test_a_folder_with_a_rig_file_is_told_so(tmp_path):
    write_rigfile(rig("a"), tmp_path / "a.rig.json")
    assert refusal(tmp_path).what == "this is a rig file already"


def test_a_folder_of_two_formats_names_both(tmp_path):
    path = exported(tmp_path, "ros")
    export_rig(rig("left"), path / "mono.yml", "opencv")
    assert refusal(path).got == "opencv and ros"
    assert load(path, "ros").camera_ids == ("left", "right")


@pytest.mark.parametrize(
    ("from_format", "file", "what"),
    [
        ("easymocap", "extri.yml", "there is no intri.yml"),
        ("ros", "tf_static.yaml", "there is no camera_info file"),
        ("colmap-model", "rigs.txt", "this is no COLMAP model"),
    ],
)
def test_one_file_of_a_folder_asks_for_the_rest(tmp_path, from_format, file, what):
    error = refusal(exported(tmp_path, from_format) / file, from_format)
    assert (error.what, error.got) == (what, file)
    assert error.do_next.startswith("give the ")


def test_one_camera_s_file_of_several_is_a_rig_of_one(tmp_path):
    assert load(exported(tmp_path, "mrcal") / "right.cameramodel").camera_ids == ("right",)
    (tmp_path / "ros").mkdir()
    assert load(exported(tmp_path / "ros", "ros") / "left_camera_info.yaml").camera_ids == ("left",)


MISTAKES = [
    ("easymocap", "intri.yml", "K_right", "K_write", "K_right", "this entry"),
    ("easymocap", "intri.yml", "W_left", "V_left", "W_left", "this entry"),
    ("easymocap", "extri.yml", "T_right", "T_write", "T_right", "this entry"),
    ("easymocap", "intri.yml", "cols: 5", "cols: 6", "dist_left", "a list of 4 or 5 numbers"),
    ("mrcal", "left.cameramodel", "OPENCV5", "CAHVOR", "lensmodel", "LENSMODEL_OPENCV8"),
    ("mrcal", "left.cameramodel", "OPENCV5", "OPENCV8", "intrinsics", "a list of 12 numbers"),
    ("mrcal", "left.cameramodel", "'imagersize'", "'size'", "imagersize", "this entry"),
    ("mrcal", "left.cameramodel", "[640, 480]", "[640.5, 480]", "imagersize", "whole pixels"),
    ("ros", "left_camera_info.yaml", "plumb_bob", "thin_prism", "distortion_model", "rational_polynomial, equidistant"),
    ("ros", "left_camera_info.yaml", "plumb_bob", "equidistant", "distortion_coefficients.data", "a list of 4 numbers"),
    ("ros", "left_camera_info.yaml", "data: [500.0, 0.0", "data: [500.0, 0.1", "camera_matrix.data", "[[fx, 0, cx]"),
    ("ros", "tf_static.yaml", "right_optical_frame", "wrong", "transforms", "a transform for every camera's frame"),
    ("ros", "tf_static.yaml", '"rig"', '"other"', "transforms", "every camera on one root frame"),
    ("ros", "tf_static.yaml", '"rig"', '"left_optical_frame"', "transforms", "a tree of frames"),
    (
        "ros",
        "tf_static.yaml",
        "      w: ",
        "      w: 1",
        "transforms[0].transform.rotation",
        "a quaternion of length 1",
    ),
    ("colmap-model", "cameras.txt", "FULL_OPENCV", "FOV", "cameras, camera 1, MODEL", "OPENCV_FISHEYE"),
    ("colmap-model", "cameras.txt", " 0.003 ", " 0.003 0.1 ", "cameras, camera 1, PARAMS", "a list of 12 numbers"),
    ("colmap-model", "images.txt", "1 1.0 ", "1 1.5 ", "images, image 1, QW QX QY QZ", "a quaternion of length 1"),
    ("colmap-model", "images.txt", "-1.0", "nan", "images, image 2, TX TY TZ[0]", "a finite number"),
]


@pytest.mark.parametrize(("to_format", "file", "old", "new", "entry", "expected"), MISTAKES)
def test_a_mistake_is_named_by_its_entry(tmp_path, to_format, file, old, new, entry, expected):
    path = exported(tmp_path, to_format)
    change(path / file, old, new)
    with pytest.raises(FormatEntryError) as caught:
        load(path)
    assert caught.value.what == f"cannot use the entry {entry}"
    assert expected in caught.value.expected


def test_ros_coefficients_after_k6_must_be_zero(tmp_path):
    path = exported(tmp_path, "ros", "left") / "left_camera_info.yaml"
    change(path, "plumb_bob", "rational_polynomial")
    change(path, "0.002, 0.003]", "0.002, 0.003, 0, 0, 0, 0, 0, 0, 0]")
    assert rig_of(load(path)).cameras[0].camera.model == "opencv8"
    change(path, "0.003, 0, 0, 0, 0, 0, 0, 0]", "0.003, 0, 0, 0, 0, 0, 0, 0.1]")
    assert "thin prism" in refusal(path).expected


def test_cameras_without_transforms_are_told_how_to_save_them(tmp_path):
    path = exported(tmp_path, "ros")
    (path / "tf_static.yaml").unlink()
    error = refusal(path)
    assert error.what == "nothing says where these cameras are"
    assert "ros2 topic echo --once /tf_static > tf_static.yaml" in error.do_next


def test_a_body_s_frame_is_not_taken_for_the_camera_s(tmp_path):
    """It looks along x, not z: the rig would be turned by 90 degrees without a word."""
    path = exported(tmp_path, "ros")
    change(path / "tf_static.yaml", "right_optical_frame", "right_link")
    assert refusal(path).got == "none for right_optical_frame"


def test_a_camera_s_file_that_cannot_be_read_is_not_passed_over(tmp_path):
    path = exported(tmp_path, "mrcal")
    (path / "right.cameramodel").write_bytes("{ 'lensmodel': }".encode("utf-16"))
    error = refusal(path)
    assert (error.what, Path(error.where).name) == ("this is not a text file", "right.cameramodel")
    (tmp_path / "ros").mkdir()
    path = exported(tmp_path / "ros", "ros")
    change(path / "right_camera_info.yaml", "image_width", "image_breadth")
    assert refusal(path).what == "cannot use the entry image_width"


def test_two_single_cameras_of_opencv_in_a_folder_are_not_mixed_up(tmp_path):
    for name in ("left", "right"):
        export_rig(rig(name), tmp_path / f"{name}.yml", "opencv")
    error = refusal(tmp_path)
    assert (error.what, Path(error.where).name) == ("cannot use the entry names", "right.yml")
    assert "give one file where each is a camera of its own" in error.expected


def test_frames_that_hang_on_one_another_are_followed(tmp_path):
    """As a real tree has it: a mast, a camera body on it, the optical frame on that."""
    path = exported(tmp_path, "ros")
    straight = rig_of(load(path)).cameras[1].cam_from_rig.matrix
    turned = "x: -0.5\n      y: 0.5\n      z: -0.5\n      w: 0.5\n"
    frame = (
        '- header:\n    frame_id: "{}"\n  child_frame_id: "{}"\n  transform:\n'
        "    translation:\n      x: {}\n      y: 0\n      z: 0\n    rotation:\n      {}"
    )
    still = "x: 0\n      y: 0\n      z: 0\n      w: 1\n"
    change(path / "tf_static.yaml", '"right_optical_frame"', '"right_link"')
    more = frame.format("right_link", "right_optical_frame", 0.25, turned) + frame.format("mast", "rig", 7, still)
    with (path / "tf_static.yaml").open("a", encoding="utf-8") as stream:
        stream.write(more)
    optical_from_link = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, -0.25], [0, 0, 0, 1]])
    again = rig_of(load(path)).cameras[1].cam_from_rig.matrix
    np.testing.assert_allclose(again, optical_from_link @ straight, atol=1e-12)


def test_a_damaged_camera_model_is_named_with_its_file(tmp_path):
    path = exported(tmp_path, "mrcal")
    change(path / "left.cameramodel", "}", "")
    error = refusal(path)
    assert (error.what, Path(error.where).name) == ("this is not a camera model", "left.cameramodel")


@pytest.mark.parametrize("key", ["lens_model", "lensmodel"])
def test_camera_models_of_older_and_newer_mrcal_are_read(tmp_path, key):
    """As mrcal writes them, with comments, a region and the inputs of its own optimisation."""
    text = (
        "# generated with mrcal-calibrate-cameras\n{\n"
        f"    '{key}':  'LENSMODEL_OPENCV12',\n\n"
        "    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....\n"
        "    'intrinsics': [ 1766, 1765, 1944, 1064, 2.1, -1.1, -1e-05, 7e-04, -0.2, 2.4, -0.6, -0.6, 0, 0, 0, 0,],\n"
        "    'valid_intrinsics_region': [\n    [ 0, 0 ],\n    [ 10, 0 ],\n    [ 0, 10 ],\n],\n"
        "    # extrinsics are rt_fromref\n    'extrinsics': [ 0, 0, 0, -0.1, 0, 0,],\n"
        "    'imagersize': [ 3840, 2160,],\n    'optimization_inputs': b'P)h>@6aWAK2mk',\n}\n"
    )
    path = tmp_path / "one.cameramodel"
    path.write_text(text, encoding="utf-8")
    (camera,) = load(path).cameras
    assert (camera.id, camera.model, camera.size_wh, camera.coefficients["k6"]) == (
        "one",
        "opencv8",
        (3840, 2160),
        -0.6,
    )
    change(path, "-0.6, 0, 0, 0, 0,]", "-0.6, 0, 0, 0, 0.1,]")
    assert "thin prism" in refusal(path).expected


def colmap_binary(tmp_path, frames=1):
    """A model that pycolmap itself wrote: a rig of two cameras seen at several instants."""
    text = exported(tmp_path, "colmap-model")
    rows = (text / "frames.txt").read_text(encoding="utf-8"), (text / "images.txt").read_text(encoding="utf-8")
    if frames == 2:
        (text / "frames.txt").write_text(rows[0] + "2 1 1 0 0 0 5 0 0 2 CAMERA 1 3 CAMERA 2 4\n", encoding="utf-8")
        more = rows[1].replace("1 1.0", "3 1.0", 1).replace("\n2 ", "\n4 ", 1).replace("000000", "000001")
        (text / "images.txt").write_text(rows[1] + more, encoding="utf-8")
    binary = tmp_path / "binary"
    binary.mkdir()
    pycolmap.Reconstruction(text).write_binary(binary)
    return text, binary


@pytest.mark.parametrize("frames", [1, 2])
def test_a_binary_model_is_read_as_the_text_is(tmp_path, frames):
    text, binary = colmap_binary(tmp_path, frames)
    assert len(pycolmap.Reconstruction(binary).images) == 2 * frames
    ours, theirs = load(text), load(binary)
    assert ours.cameras == theirs.cameras
    assert ours.camera_ids == ("left", "right")
    assert ours.cameras[1].cam_from_rig.translation_m == pytest.approx((-1.0, 0.0, 0.0))


def test_observations_of_a_binary_model_are_passed_over(tmp_path):
    _, binary = colmap_binary(tmp_path)
    data = (binary / "images.bin").read_bytes()
    end = data.index(b".png\0") + 5
    points = struct.pack("<Q", 2) + struct.pack("<ddqddq", 1.0, 2.0, -1, 3.0, 4.0, 7)
    (binary / "images.bin").write_bytes(data[:end] + points + data[end + 8 :])
    assert load(binary).camera_ids == ("left", "right")


def test_a_cut_or_foreign_binary_model_is_refused(tmp_path):
    _, binary = colmap_binary(tmp_path)
    data = (binary / "cameras.bin").read_bytes()
    (binary / "cameras.bin").write_bytes(data[:-4])
    assert refusal(binary).what == "this is not a COLMAP model file, or it is damaged"
    (binary / "cameras.bin").write_bytes(data[:12] + struct.pack("<i", 10) + data[16:])
    assert refusal(binary).got.startswith("camera model number 10; rigcal has SIMPLE_PINHOLE")


def test_a_damaged_line_of_a_model_is_named(tmp_path):
    path = exported(tmp_path, "colmap-model")
    change(path / "images.txt", "\n2 ", "\ntwo ")
    error = refusal(path)
    assert error.where == f"{path / 'images.txt'}, line 3"
    change(path / "images.txt", "\ntwo ", "\n2 ")
    change(path / "rigs.txt", "CAMERA 2", "IMU 2")
    frames = path / "images.txt"
    frames.write_text(frames.read_text(encoding="utf-8") * 2, encoding="utf-8")
    assert refusal(path).got == "a sensor that is no camera"


def test_a_model_of_moving_cameras_asks_for_their_rig(tmp_path):
    text, _ = colmap_binary(tmp_path, frames=2)
    (text / "rigs.txt").unlink()
    error = refusal(text)
    assert error.got == "4 images of 2 cameras, 0 rigs that join them"
    assert "rig_configurator" in error.do_next


def test_an_older_model_without_rigs_is_read_by_its_images(tmp_path):
    path = exported(tmp_path, "colmap-model")
    for name in ("rigs.txt", "frames.txt", "points3D.txt"):
        (path / name).unlink()
    change(path / "images.txt", "left/000000.png", "left.png")
    change(path / "cameras.txt", "1 FULL", "# a comment\n1 FULL")
    assert load(path).camera_ids == ("left", "right")


def test_a_world_is_refused_where_a_format_has_none(tmp_path):
    path = tmp_path / "rig_config.json"
    export_rig(rig("a", "b"), path, "colmap")
    with pytest.raises(FormatError) as caught:
        import_rig(path, from_format=None, created_utc=UTC, common_is_world=True)
    assert str(caught.value).startswith("colmap has no world frame\n")
    assert "rigcal world" in caught.value.do_next
    assert json.loads(path.read_text(encoding="utf-8"))


def test_a_binary_model_that_promises_more_observations_than_it_has_is_refused(tmp_path):
    _, binary = colmap_binary(tmp_path)
    data = (binary / "images.bin").read_bytes()
    end = data.index(b".png\0") + 5
    (binary / "images.bin").write_bytes(data[:end] + struct.pack("<Q", 2**60) + data[end + 8 :])
    assert refusal(binary).got == "the file ends early"
