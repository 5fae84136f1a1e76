"""Every family on a tiny graph of its layout: constant outputs, known boxes and joints in pixels of the image.

The image is 200 x 100, the input of most networks 64 x 64, letterboxed to the middle: 0.32 of the size, 16 rows of
padding above. Pixel x of the image is at 0.32 (x + 0.5) from the input's left edge, pixel y at 0.32 (y + 0.5) + 16
from its top.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from tiny_onnx import INT32, brightest_pixel_simcc, tiny_network, write

from recognition.detectors import load_detector, load_model

IMAGE = np.full((100, 200, 3), 90, np.uint8)
CELLS = {"usual": 64 + 16 + 4, "four heads": 64 + 16 + 4 + 1}

BOX_XYXY = np.array([39.5, 19.5, 139.5, 69.5])
"""In pixels of the image: 40 to 140 and 20 to 70 px from its edges."""
BOX_IN_INPUT = np.array([28.8, 30.4, 32.0, 16.0])
"""The same in the input: centre x, y, width, height."""
JOINTS_PX = np.stack([np.linspace(45, 130, 17), np.linspace(20, 65, 17)], axis=-1)
JOINTS_IN_INPUT = (JOINTS_PX + 0.5) * 0.32 + [0, 16]
JOINT_SCORE = np.linspace(0.4, 0.95, 17)

INPUT = """
[input]
name = "images"
size_wh = [64, 64]
layout = "nchw"
dtype = "float32"
colour = "rgb"
scale = 0.00392156862745098
resize = "letterbox"
align = "centre"
"""


def head(family, entries):
    return f'family = "{family}"\nlicence = "AGPL-3.0"\nsha256 = "{{sha256}}"\n{entries}\n'


def boxes_manifest(family):
    return head(family, 'classes = ["person", "helmet"]\nperson_class = "person"\nscore_threshold = 0.4') + INPUT


def people_manifest(family):
    return head(family, 'joints = "coco17"\nscore_threshold = 0.4') + INPUT


def joints_row():
    return np.column_stack([JOINTS_IN_INPUT, JOINT_SCORE]).ravel()


def network(output, **changes):
    return tiny_network(output, shape=(1, 3, 64, 64), **changes)


def yolov8(cells, *rows):
    """(1, channels, A): candidates in some of the columns, the others zero."""
    output = np.zeros((1, len(rows[0]), cells))
    output[0, :, 3 : 3 + len(rows)] = np.transpose(rows)
    return output


def yolov7(cells, *rows):
    """(1, 3 A, columns)."""
    return yolov8(3 * cells, *rows).transpose(0, 2, 1)


@pytest.mark.parametrize("cells", CELLS.values(), ids=CELLS)
def test_yolov8_gives_boxes_without_objectness(tmp_path, cells):
    output = yolov8(cells, [*BOX_IN_INPUT, 0.2, 0.7], [*BOX_IN_INPUT, 0.6, 0.1], [*BOX_IN_INPUT, 0.39, 0.1])
    found = load_model(write(tmp_path, network(output), boxes_manifest("yolov8"))).boxes(IMAGE)
    assert found.classes == ("helmet", "person")
    assert found.xyxy == pytest.approx(np.array([BOX_XYXY, BOX_XYXY]), abs=1e-4)
    assert found.score == pytest.approx([0.7, 0.6])


@pytest.mark.parametrize("cells", CELLS.values(), ids=CELLS)
def test_yolov7_gives_boxes_whose_score_is_objectness_times_class(tmp_path, cells):
    output = yolov7(cells, [*BOX_IN_INPUT, 0.8, 0.1, 0.9], [*BOX_IN_INPUT, 0.5, 0.79, 0.1])
    found = load_model(write(tmp_path, network(output), boxes_manifest("yolov7"))).boxes(IMAGE)
    assert found.classes == ("helmet",)
    assert found.xyxy == pytest.approx(BOX_XYXY[None], abs=1e-4)
    assert found.score == pytest.approx([0.72])


@pytest.mark.parametrize("cells", CELLS.values(), ids=CELLS)
def test_yolov8_pose_gives_people_with_joints(tmp_path, cells):
    output = yolov8(cells, [*BOX_IN_INPUT, 0.8, *joints_row()])
    found = load_model(write(tmp_path, network(output), people_manifest("yolov8_pose"))).people(IMAGE)
    assert_the_person(found)


@pytest.mark.parametrize("cells", CELLS.values(), ids=CELLS)
def test_yolov7_pose_gives_people_with_joints_and_carries_its_raw_heads_behind_them(tmp_path, cells):
    output = {"output": yolov7(cells, [*BOX_IN_INPUT, 0.9, 0.9, *joints_row()]), "head": np.zeros((1, 3, 8, 8, 57))}
    found = load_model(write(tmp_path, network(output), people_manifest("yolov7_pose"))).people(IMAGE)
    assert_the_person(found)


@pytest.mark.parametrize("shape", [(1, 64, 64, 3), ("batch", "height", "width", 3)], ids=["fixed", "open"])
def test_movenet_multipose_gives_people_with_joints(tmp_path, shape):
    output = np.zeros((1, 6, 56))
    output[0, 2, :51] = np.column_stack([JOINTS_IN_INPUT[:, ::-1] / 64, JOINT_SCORE]).ravel()
    centre, half = BOX_IN_INPUT[:2], BOX_IN_INPUT[2:] / 2
    output[0, 2, 51:] = [*(centre - half)[::-1] / 64, *(centre + half)[::-1] / 64, 0.8]
    manifest = people_manifest("movenet_multipose").replace("nchw", "nhwc").replace("float32", "int32")
    manifest = manifest.replace("scale = 0.00392156862745098\n", "")
    onnx = tiny_network(output, element_type=INT32, shape=shape)
    assert_the_person(load_model(write(tmp_path, onnx, manifest)).people(IMAGE))


def assert_the_person(found):
    assert found.xyxy == pytest.approx(BOX_XYXY[None], abs=1e-4)
    assert found.joints[0, :, :2] == pytest.approx(JOINTS_PX, abs=1e-4)
    assert found.joints[0, :, 2] == pytest.approx(JOINT_SCORE)


def test_of_candidates_that_overlap_the_best_person_stays(tmp_path):
    rows = [np.concatenate([BOX_IN_INPUT, [score], joints_row()]) for score in (0.5, 0.9, 0.6, 0.39)]
    rows[0][0] += 1.0  # 3 px in the image
    rows[2][0] -= 28.0  # beside it, and partly outside the image
    output = yolov8(CELLS["usual"], *rows)
    found = load_model(write(tmp_path, network(output), people_manifest("yolov8_pose"))).people(IMAGE)
    assert found.xyxy == pytest.approx(np.array([BOX_XYXY, [-0.5, 19.5, 52.0, 69.5]]), abs=1e-4)


def test_an_image_of_nobody_gives_nobody(tmp_path):
    output = np.zeros((1, 56, CELLS["usual"]))
    found = load_model(write(tmp_path, network(output), people_manifest("yolov8_pose"))).people(IMAGE)
    assert found.joints.shape == (0, 17, 3)


def test_a_network_of_open_size_runs_at_the_size_of_its_manifest(tmp_path):
    onnx = tiny_network(yolov8(CELLS["usual"], [*BOX_IN_INPUT, 0.1, 0.7]), shape=("n", 3, "h", "w"))
    found = load_model(write(tmp_path, onnx, boxes_manifest("yolov8"))).boxes(IMAGE)
    assert found.xyxy == pytest.approx(BOX_XYXY[None], abs=1e-4)


RTMPOSE = """
family = "rtmpose"
licence = "Apache-2.0"
sha256 = "{sha256}"
joints = "coco17"
crop_margin = 1.25

[input]
name = "input"
size_wh = [48, 64]
layout = "nchw"
dtype = "float32"
colour = "rgb"
scale = 0.00392156862745098
resize = "letterbox"
align = "centre"
pad = 0
"""


@pytest.mark.parametrize(
    ("box", "dot"),
    [
        # 1.25 times as high, the crop is 64 rows and 48 columns, one pixel of the image for each of the input.
        ([90.5, 20.5, 110.5, 71.7], (103, 44)),
        ([90.5, 20.5, 110.5, 71.7], (77, 15)),  # outside the box, for the crop is widened to the input's aspect
        ([-4.5, 20.5, 15.5, 71.7], (0, 16)),  # the crop leaves the image
        # 96 by 128: half the size; a dot of 2 x 2 pixels has its middle between them.
        ([70.5, -11.7, 130.5, 90.7], (99.5, 28.5)),
    ],
)
def test_rtmpose_finds_a_dot_in_a_crop_where_it_is_in_the_image(tmp_path, box, dot):
    image = np.zeros((100, 200, 3), np.uint8)
    image[[[np.floor(dot[1]).astype(int)], [np.ceil(dot[1]).astype(int)]],
          [[np.floor(dot[0]).astype(int), np.ceil(dot[0]).astype(int)]]] = 204  # fmt: skip
    model = load_model(write(tmp_path, brightest_pixel_simcc(48, 64), RTMPOSE))
    joints = model.poses(image, np.array([box]))
    assert joints[0, :, :2] == pytest.approx(np.tile(dot, (17, 1)), abs=1e-6)
    assert joints[0, :, 2] == pytest.approx(np.full(17, 0.8), abs=1e-3)


def test_rtmpose_reads_half_bins_and_scores_by_the_weaker_axis(tmp_path):
    x, y = np.zeros((1, 17, 96)), np.zeros((1, 17, 128))
    x[0, :, 31], y[0, :, 40] = 0.9, 0.6
    x[0, 4, 31], y[0, 5], x[0, 6, 31], y[0, 6, 40] = 0.5, -1.0, 1.4, 1.2
    onnx = tiny_network({"simcc_x": x, "simcc_y": y}, name="input", shape=(1, 3, 64, 48))
    joints = load_model(write(tmp_path, onnx, RTMPOSE)).poses(IMAGE, np.array([[90.5, 20.5, 110.5, 71.7]]))
    # The crop's first pixel is (77, 15); bin 31 is its pixel 15.5, bin 40 its pixel 20.
    assert joints[0, :4, :2] == pytest.approx(np.tile([77 + 15.5, 15 + 20], (4, 1)))
    assert joints[0, 3:7, 2] == pytest.approx([0.6, 0.5, 0.0, 1.0])


def test_a_people_network_alone_finds_the_people_of_an_image(tmp_path):
    output = yolov8(CELLS["usual"], [*BOX_IN_INPUT, 0.8, *joints_row()])
    detector = load_detector(pose_model=write(tmp_path, network(output), people_manifest("yolov8_pose")))
    found = detector.detect(IMAGE)
    assert found.people_px == pytest.approx(JOINTS_PX[None], abs=1e-4)
    assert found.people_score == pytest.approx(JOINT_SCORE[None])
    assert found.object_class == ()


def test_a_sites_own_names_become_the_names_of_the_rules(tmp_path):
    manifest = boxes_manifest("yolov8").replace(
        'classes = ["person", "helmet"]\nperson_class = "person"',
        'classes = ["worker", "white helmet", "red helmet", "cone"]\nperson_class = "worker"\n'
        'rename = {"white helmet" = "hard_hat", "red helmet" = "hard_hat", worker = "person"}',
    )
    elsewhere = BOX_IN_INPUT + [0, 14, 0, 0]
    output = yolov8(
        CELLS["usual"],
        [*BOX_IN_INPUT, 0, 0.7, 0, 0],
        [*BOX_IN_INPUT, 0, 0, 0.9, 0],  # one hat, in two colours: it is there once
        [*BOX_IN_INPUT, 0.6, 0, 0, 0],
        [*elsewhere, 0, 0.5, 0, 0],
        [*BOX_IN_INPUT, 0, 0, 0, 0.45],
    )
    model = load_model(write(tmp_path, network(output), manifest))
    assert model.person_class == "person"
    assert model.boxes(IMAGE).classes == ("hard_hat", "person", "hard_hat", "cone")
