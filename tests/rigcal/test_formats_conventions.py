"""Claims about directions, axes and units of each format, by numbers worked out by hand and by independent readers.

The rig: camera ``left`` 2 m above the floor, level, looking along the world's y; camera ``right`` 1 m to its right,
that is at world x = 1, looking the same way. So a point maps as ``x_cam = (x - 1, 2 - z, y)`` into ``right``: a turn
of 90 degrees about x and the translation (-1, 2, 0).
"""

import ast
import json
import sys
import tomllib
import types
from xml.etree import ElementTree

import cv2
import numpy as np
import pycolmap
import pytest
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from google.protobuf import json_format
from scipy.spatial.transform import Rotation

from rigcal.camera import MODELS, Camera
from rigcal.formats import export_rig
from rigcal.geometry import Pose
from rigcal.rig import Rig, RigCamera
from rigcal.rigfile import document_of_rig

UTC = "2026-11-22T09:30:01Z"
HALF_TURN = np.pi / 2
ROOT_HALF = np.sqrt(0.5)
WORLD_FROM_LEFT = Pose(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]), np.array([0.0, 0.0, 2.0]))
POINT_IN_WORLD = np.array([1.5, 4.0, 1.0])
"""Half a metre right of camera ``right``, 1 m below it, 4 m ahead."""
POINT_IN_RIGHT = np.array([0.5, 1.0, 4.0])
PIXEL_IN_RIGHT = np.array([500.0 * 0.125 + 320.0, 510.0 * 0.25 + 240.0])
"""Without distortion, in OpenCV's pixels."""


def lens(model="opencv4", **coefficients):
    values = {"fx": 500.0, "fy": 510.0, "cx": 320.0, "cy": 240.0} | coefficients
    return Camera(model, (640, 480), np.array([values.get(name, 0.0) for name in MODELS[model]]))


def rig(*, world=True, lenses=None):
    left, right = lenses or (lens(), lens())
    right_from_left = Pose(np.eye(3), np.array([-1.0, 0.0, 0.0]))
    cameras = (RigCamera("left", left, Pose.identity()), RigCamera("right", right, right_from_left))
    return Rig("s", cameras, "left", "IMPORTED", WORLD_FROM_LEFT if world else None)


def written(folder, to_format, of=None):
    path = folder / "out"
    export_rig(document_of_rig(of or rig(), created_utc=UTC, inputs_sha256=""), path, to_format)
    return path


def test_the_hand_worked_point_is_where_the_rig_says():
    right = rig().cameras[1]
    in_cam = (right.cam_from_rig @ WORLD_FROM_LEFT.inverse()).apply(POINT_IN_WORLD)
    np.testing.assert_allclose(in_cam, POINT_IN_RIGHT, atol=1e-15)
    np.testing.assert_allclose(right.camera.project(in_cam), PIXEL_IN_RIGHT)


def opencv_pixel(point, rvec, tvec, K, distortion):
    pixels, _ = cv2.projectPoints(point.reshape(1, 1, 3), np.array(rvec), np.array(tvec), np.array(K), distortion)
    return pixels.ravel()


def test_anipose_maps_from_the_world_to_the_camera(tmp_path):
    table = tomllib.loads(written(tmp_path, "anipose").read_text(encoding="utf-8"))["cam_1"]
    np.testing.assert_allclose(table["rotation"], [HALF_TURN, 0, 0], atol=1e-15)
    np.testing.assert_allclose(table["translation"], [-1, 2, 0], atol=1e-15)
    pixel = opencv_pixel(POINT_IN_WORLD, table["rotation"], table["translation"], table["matrix"], np.zeros(5))
    np.testing.assert_allclose(pixel, PIXEL_IN_RIGHT)


def easymocap_reads(folder, name):
    """What EasyMocap's own reader takes of the two files."""
    intri, extri = (cv2.FileStorage(str(folder / file), cv2.FILE_STORAGE_READ) for file in ("intri.yml", "extri.yml"))
    names = [intri.getNode("names").at(i).string() for i in range(intri.getNode("names").size())]
    size = [int(intri.getNode(f"{axis}_{name}").real()) for axis in "WH"]
    lens_nodes = [intri.getNode(f"{key}_{name}").mat() for key in ("K", "dist")]
    return names, size, *lens_nodes, *(extri.getNode(f"{key}_{name}").mat() for key in ("R", "Rot", "T"))


def test_easymocap_maps_from_the_world_to_the_camera(tmp_path):
    names, size, K, dist, rvec, rotation, tvec = easymocap_reads(written(tmp_path, "easymocap"), "right")
    assert (names, size) == (["left", "right"], [640, 480])
    assert [matrix.shape for matrix in (K, dist, rvec, rotation, tvec)] == [(3, 3), (1, 5), (3, 1), (3, 3), (3, 1)]
    np.testing.assert_allclose(rvec.ravel(), [HALF_TURN, 0, 0], atol=1e-15)
    np.testing.assert_allclose(cv2.Rodrigues(rvec)[0], rotation, atol=1e-12)
    np.testing.assert_allclose(tvec.ravel(), [-1, 2, 0], atol=1e-15)
    np.testing.assert_allclose(opencv_pixel(POINT_IN_WORLD, rvec, tvec, K, dist), PIXEL_IN_RIGHT)


def test_easymocap_keeps_leading_zeros_for_a_reader_that_takes_bare_digits_for_numbers(tmp_path):
    cameras = tuple(
        RigCamera(name, camera.camera, camera.cam_from_rig)
        for name, camera in zip(("01", "002"), rig().cameras, strict=True)
    )
    folder = written(tmp_path, "easymocap", Rig("s", cameras, "01", "IMPORTED"))
    assert easymocap_reads(folder, "002")[0] == ["01", "002"]


def test_mrcal_maps_from_the_reference_to_the_camera(tmp_path):
    folder = written(tmp_path, "mrcal", rig(lenses=(lens(), lens("opencv8", k1=0.1, k6=0.2))))
    assert sorted(file.name for file in folder.iterdir()) == ["left.cameramodel", "right.cameramodel"]
    model = ast.literal_eval((folder / "right.cameramodel").read_text(encoding="utf-8"))
    assert model["lensmodel"] == "LENSMODEL_OPENCV8"
    assert model["intrinsics"] == [500, 510, 320, 240, 0.1, 0, 0, 0, 0, 0, 0, 0.2]
    assert model["imagersize"] == [640, 480]
    np.testing.assert_allclose(model["extrinsics"], [HALF_TURN, 0, 0, -1, 2, 0], atol=1e-15)


def test_kalibr_maps_from_the_camera_before(tmp_path):
    lines = written(tmp_path, "kalibr").read_text(encoding="utf-8").splitlines()
    rows = [json.loads(line.removeprefix("  - ")) for line in lines if line.startswith("  - ")]
    assert rows == [[1, 0, 0, -1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


def test_opencv_maps_from_the_first_to_the_second(tmp_path):
    storage = cv2.FileStorage(str(written(tmp_path, "opencv")), cv2.FILE_STORAGE_READ)
    np.testing.assert_array_equal(storage.getNode("T").mat(), [[-1], [0], [0]])
    np.testing.assert_array_equal(storage.getNode("R").mat(), np.eye(3))
    np.testing.assert_array_equal(storage.getNode("K2").mat(), rig().cameras[1].camera.matrix)
    assert storage.getNode("D2").mat().shape == (1, 4)


def test_colmap_s_rig_maps_from_the_reference_and_counts_pixels_from_the_corner(tmp_path):
    (config,) = pycolmap.read_rig_config(written(tmp_path, "colmap"))
    left, right = config.cameras
    assert (left.ref_sensor, left.image_prefix, right.image_prefix) == (True, "left/", "right/")
    np.testing.assert_array_equal(right.cam_from_rig.translation, [-1, 0, 0])
    np.testing.assert_allclose(right.camera.img_from_cam(POINT_IN_RIGHT[None]).ravel(), PIXEL_IN_RIGHT + 0.5)


@pytest.mark.parametrize("model", MODELS)
def test_colmap_itself_reads_the_model_and_projects_to_our_pixels(tmp_path, model):
    ours = lens(model, k1=0.1, k2=-0.02, p1=0.001, p2=-0.002, k3=0.003, k4=0.05, k5=0.01, k6=-0.003)
    folder = written(tmp_path, "colmap-model", rig(lenses=(lens(), ours)))
    theirs = pycolmap.Reconstruction(folder)
    assert (theirs.num_rigs(), theirs.num_frames(), theirs.num_images()) == (1, 1, 2)
    image = theirs.image(2)
    assert (image.name, theirs.camera(2).width, theirs.camera(2).height) == ("right/000000.png", 640, 480)
    np.testing.assert_allclose(image.cam_from_world() * POINT_IN_WORLD, POINT_IN_RIGHT, atol=1e-12)
    pixel = theirs.camera(2).img_from_cam(POINT_IN_RIGHT[None]).ravel()
    np.testing.assert_allclose(pixel, ours.project(POINT_IN_RIGHT) + 0.5, atol=1e-9)


def world_from_right(translation, rotation):
    """Camera to world of x y z and a quaternion x y z w, as ROS and Foxglove have it."""
    pose = Pose(
        Rotation.from_quat([rotation[k] for k in "xyzw"]).as_matrix(), np.array([translation[k] for k in "xyz"])
    )
    np.testing.assert_allclose(pose.apply(POINT_IN_RIGHT), POINT_IN_WORLD, atol=1e-12)


def test_foxglove_places_the_camera_in_the_world_in_messages_that_its_schemas_accept(tmp_path):
    content = json.loads(written(tmp_path, "foxglove").read_text(encoding="utf-8"))
    transform = content["foxglove.FrameTransforms"]["transforms"][1]
    assert (transform["parent_frame_id"], transform["child_frame_id"]) == ("world", "right")
    assert list(transform["translation"].values()) == pytest.approx([1, 0, 2])
    assert list(transform["rotation"].values()) == pytest.approx([-ROOT_HALF, 0, 0, ROOT_HALF])
    world_from_right(transform["translation"], transform["rotation"])
    for message, parsed in (
        (content["foxglove.FrameTransforms"], FrameTransforms()),
        (content["foxglove.CameraCalibration"][1], CameraCalibration()),
    ):
        json_format.ParseDict(without_timestamps(message), parsed)
    assert (parsed.distortion_model, len(parsed.D), parsed.frame_id) == ("plumb_bob", 5, "right")
    np.testing.assert_array_equal(np.reshape(parsed.P, (3, 4)), np.hstack([lens().matrix, np.zeros((3, 1))]))


def without_timestamps(value):
    """The JSON form of the schemas has sec and nsec; the Protobuf form, whose names are checked here, a text."""
    if isinstance(value, list):
        return [without_timestamps(item) for item in value]
    if isinstance(value, dict):
        return {key: without_timestamps(item) for key, item in value.items() if key != "timestamp"}
    return value


@pytest.mark.parametrize(
    ("model", "foxglove", "ros"),
    [
        ("opencv4", "plumb_bob", "plumb_bob"),
        ("opencv5", "plumb_bob", "plumb_bob"),
        ("opencv8", "rational_polynomial", "rational_polynomial"),
        ("fisheye4", "kannala_brandt", "equidistant"),
    ],
)
def test_foxglove_and_ros_have_a_name_for_every_lens(tmp_path, model, foxglove, ros):
    one = rig(lenses=(lens(), lens(model)))
    (tmp_path / "ros").mkdir()
    content = json.loads(written(tmp_path, "foxglove", one).read_text(encoding="utf-8"))
    assert content["foxglove.CameraCalibration"][1]["distortion_model"] == foxglove
    text = (written(tmp_path / "ros", "ros", one) / "right_camera_info.yaml").read_text(encoding="utf-8")
    assert f"\ndistortion_model: {ros}\n" in text


def test_the_launch_file_publishes_the_camera_in_the_world(tmp_path, monkeypatch):
    launch, actions = types.ModuleType("launch"), types.ModuleType("launch_ros.actions")
    launch.LaunchDescription, actions.Node = list, dict
    for name, module in (("launch", launch), ("launch_ros", types.ModuleType("x")), ("launch_ros.actions", actions)):
        monkeypatch.setitem(sys.modules, name, module)
    namespace = {}
    exec((written(tmp_path, "ros") / "static_transforms.launch.py").read_text(encoding="utf-8"), namespace)
    nodes = namespace["generate_launch_description"]()
    assert {(node["package"], node["executable"]) for node in nodes} == {("tf2_ros", "static_transform_publisher")}
    given = dict(zip(nodes[1]["arguments"][::2], nodes[1]["arguments"][1::2], strict=True))
    assert (given["--frame-id"], given["--child-frame-id"]) == ("world", "right_optical_frame")
    values = {name: float(given[f"--{name}"]) for name in ("x", "y", "z", "qx", "qy", "qz", "qw")}
    world_from_right(values, {name: values["q" + name] for name in "xyzw"})


def urdf_pose(root, link):
    """Where a link is in the root, through its joints: fixed-axis roll, pitch, yaw."""
    pose = Pose.identity()
    while True:
        joints = [joint for joint in root.iter("joint") if joint.find("child").get("link") == link]
        if not joints:
            return link, pose
        origin = joints[0].find("origin")
        xyz, rpy = (np.array([float(v) for v in origin.get(key).split()]) for key in ("xyz", "rpy"))
        pose = Pose(Rotation.from_euler("xyz", rpy).as_matrix(), xyz) @ pose
        link = joints[0].find("parent").get("link")


def test_the_urdf_has_a_body_that_looks_along_x_and_an_optical_frame_that_looks_along_z(tmp_path):
    root = ElementTree.parse(written(tmp_path, "ros") / "rig.urdf").getroot()
    name, world_from_body = urdf_pose(root, "right_link")
    assert name == "world"
    np.testing.assert_allclose(world_from_body.translation_m, [1, 0, 2], atol=1e-15)
    np.testing.assert_allclose(world_from_body.rotation @ [1, 0, 0], [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(world_from_body.rotation @ [0, 0, 1], [0, 0, 1], atol=1e-12)
    origin = root.find("joint[@name='right_optical_frame_joint']/origin")
    assert [float(v) for v in origin.get("rpy").split()] == [-HALF_TURN, 0, -HALF_TURN]
    _, world_from_optical = urdf_pose(root, "right_optical_frame")
    np.testing.assert_allclose(world_from_optical.apply(POINT_IN_RIGHT), POINT_IN_WORLD, atol=1e-12)


@pytest.mark.parametrize("pitch_deg", [90.0, -90.0, 90.0 - 1e-6, -90.0 + 1e-9, 45.0])
def test_the_urdf_loses_nothing_where_a_camera_looks_straight_up_or_down(tmp_path, pitch_deg):
    down = Pose(Rotation.from_euler("ZYX", [30.0, pitch_deg, -70.0], degrees=True).as_matrix(), np.zeros(3))
    one = rig(world=False)
    steep = Rig("s", (one.cameras[0], RigCamera("right", lens(), down.inverse())), "left", "IMPORTED")
    root = ElementTree.parse(written(tmp_path, "ros", steep) / "rig.urdf").getroot()
    name, rig_from_optical = urdf_pose(root, "right_optical_frame")
    assert name == "rig"
    np.testing.assert_allclose(rig_from_optical.rotation, down.rotation, atol=1e-14)


def test_nerfstudio_has_the_camera_in_the_world_with_y_up_and_z_back(tmp_path):
    content = json.loads(written(tmp_path, "nerfstudio").read_text(encoding="utf-8"))
    frame = content["frames"][1]
    assert (content["camera_model"], frame["file_path"]) == ("OPENCV", "images/right.png")
    np.testing.assert_allclose(frame["transform_matrix"], [[1, 0, 0, 1], [0, 0, -1, 0], [0, 1, 0, 2], [0, 0, 0, 1]])


def test_nerfstudio_stands_upright_without_a_world(tmp_path):
    content = json.loads(written(tmp_path, "nerfstudio", rig(world=False)).read_text(encoding="utf-8"))
    np.testing.assert_allclose(
        content["frames"][1]["transform_matrix"], [[1, 0, 0, 1], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]
    )


def test_a_ray_of_nerfstudio_through_our_pixel_meets_the_point(tmp_path):
    """The ray as nerfstudio's Cameras makes it: through index + 0.5, direction (x, -y, -1), turned by the matrix."""
    frame = json.loads(written(tmp_path, "nerfstudio").read_text(encoding="utf-8"))["frames"][1]
    x, y = ((PIXEL_IN_RIGHT + 0.5) - [frame["cx"], frame["cy"]]) / [frame["fl_x"], frame["fl_y"]]
    c2w = np.array(frame["transform_matrix"])
    along = c2w[:3, :3] @ [x, -y, -1.0]
    np.testing.assert_allclose(c2w[:3, 3] + 4.0 * along, POINT_IN_WORLD, atol=1e-12)


def usd_values(text, prim):
    """The attributes of one camera of a .usda text."""
    block = text.partition(f'def Camera "{prim}"')[2].partition("    }")[0]
    return dict(line.strip().split(" = ", 1) for line in block.splitlines() if " = " in line)


def test_usd_has_the_camera_in_the_scene_in_rows_and_the_image_in_its_apertures(tmp_path):
    """USD's frustum: a pixel's place between the borders, in apertures, is where its ray leaves at the focal length."""
    ours = lens("opencv5", cx=300.0, cy=250.0, k3=0.25)
    text = written(tmp_path, "usd", rig(lenses=(lens(), ours))).read_text(encoding="utf-8")
    values = usd_values(text, "camera_1")
    rows = np.array(ast.literal_eval(values["matrix4d xformOp:transform"]))
    np.testing.assert_allclose(rows, [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [1, 0, 2, 1]], atol=1e-15)
    focal, width, height, right, up = (
        float(values[f"float {name}"])
        for name in (
            "focalLength",
            "horizontalAperture",
            "verticalAperture",
            "horizontalApertureOffset",
            "verticalApertureOffset",
        )
    )
    u, v = np.array([500.0 * 0.125 + 300.0, 510.0 * 0.25 + 250.0]) + 0.5
    ray = [(u / 640 - 0.5) * width + right, (0.5 - v / 480) * height + up, -focal]
    in_scene = np.array([*ray, 1.0]) @ rows - rows[3]
    np.testing.assert_allclose(rows[3, :3] + in_scene[:3] * 4.0 / focal, POINT_IN_WORLD, atol=1e-12)
    assert ast.literal_eval(values["custom double[] rigcal:coefficients"]) == ours.params.tolist()
    assert "k3" in values["custom string[] rigcal:coefficientNames"]
