"""One network or two from files as one detector: every combination works, or says which network is missing."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from tiny_onnx import UINT8, tiny_network, write

from recognition.detectors import OneStagePeople, PeopleAndObjects, PeopleOptions, load_detector
from recognition.errors import ModelError

IMAGE = np.full((64, 64, 3), 80, np.uint8)
INPUT = """
[input]
name = "images"
size_wh = [32, 32]
layout = "nchw"
dtype = "float32"
colour = "rgb"
resize = "letterbox"
align = "centre"
"""
HEAD = 'licence = "MIT"\nsha256 = "{sha256}"\n'
CELLS = 16 + 4 + 1
JOINTS = np.column_stack([np.linspace(10, 22, 17), np.linspace(8, 24, 17), np.full(17, 0.9)])
"""In the input, which is half the image."""


def box_network(folder, *, person_class="person"):
    """A person in rows 16 to 48 of the image and all its columns, and a hat in its upper left quarter."""
    output = np.zeros((1, 6, CELLS))
    output[0, :, 4], output[0, :, 9] = [16, 16, 32, 16, 0.9, 0], [8, 8, 16, 16, 0, 0.7]
    entry = "" if person_class is None else f'person_class = "{person_class}"\n'
    manifest = f'family = "yolov8"\n{HEAD}classes = ["person", "hat"]\n{entry}score_threshold = 0.5\n{INPUT}'
    return write(folder, tiny_network(output), manifest, "boxes")


def people_network(folder):
    output = np.zeros((1, 56, CELLS))
    output[0, :5, 7], output[0, 5:, 7] = [16, 16, 16, 20, 0.8], JOINTS.ravel()
    manifest = f'family = "yolov8_pose"\n{HEAD}joints = "coco17"\nscore_threshold = 0.5\n{INPUT}'
    return write(folder, tiny_network(output), manifest, "people")


def pose_network(folder):
    """Every joint a quarter down and half across the crop, with score 0.75."""
    output = np.tile([0.25, 0.5, 0.75], (1, 1, 17, 1))
    spec = INPUT.replace("nchw", "nhwc").replace("float32", "uint8")
    manifest = f'family = "movenet"\n{HEAD}joints = "coco17"\ncrop_margin = 1.0\n{spec}'
    return write(folder, tiny_network(output, element_type=UINT8, shape=(1, 32, 32, 3)), manifest, "poses")


def refusal(*args):
    with pytest.raises(ModelError) as caught:
        load_detector(*args)
    return str(caught.value)


def test_boxes_and_poses_make_a_two_stage_detector(tmp_path):
    detector = load_detector(box_network(tmp_path), pose_network(tmp_path))
    found = detector.detect(IMAGE)
    assert [info.family for info in detector.model_info] == ["yolov8", "movenet"]
    # The crop is square about the box, so that its quarter is the box's upper edge.
    assert found.people_px == pytest.approx(np.tile([31.5, 15.5], (1, 17, 1)))
    assert found.people_score == pytest.approx(np.full((1, 17), 0.75))
    assert found.object_class == ("hat",)


def test_a_people_network_stands_alone(tmp_path):
    detector = load_detector(None, people_network(tmp_path))
    found = detector.detect(IMAGE)
    assert isinstance(detector, OneStagePeople)
    assert [info.family for info in detector.model_info] == ["yolov8_pose"]
    assert found.people_px == pytest.approx(2 * JOINTS[None, :, :2] - 0.5)
    assert found.object_class == ()


def test_a_box_network_beside_a_people_network_gives_the_objects_alone(tmp_path):
    detector = load_detector(box_network(tmp_path), people_network(tmp_path))
    found = detector.detect(IMAGE)
    assert [info.family for info in detector.model_info] == ["yolov8", "yolov8_pose"]
    assert found.people_px == pytest.approx(2 * JOINTS[None, :, :2] - 0.5)
    assert found.object_class == ("hat",)
    assert found.object_xyxy == pytest.approx(np.array([[-0.5, -0.5, 31.5, 31.5]]))


def test_a_box_network_without_people_is_enough_beside_a_people_network(tmp_path):
    found = load_detector(box_network(tmp_path, person_class=None), people_network(tmp_path)).detect(IMAGE)
    assert len(found.people_px) == 1
    assert found.object_class == ("person", "hat")


def test_a_box_network_alone_gives_people_as_objects(tmp_path):
    detector = load_detector(box_network(tmp_path))
    assert isinstance(detector, PeopleAndObjects)
    assert detector.detect(IMAGE).object_class == ("person", "hat")


def test_what_counts_as_a_person_can_be_chosen(tmp_path):
    options = PeopleOptions(joint_score=0.95)
    assert len(load_detector(None, people_network(tmp_path), options=options).detect(IMAGE).people_px) == 0


def test_a_pose_network_alone_misses_a_box_network(tmp_path):
    path = pose_network(tmp_path)
    assert refusal(None, path) == (
        "nothing finds the people whom the pose network looks at one by one\n"
        f"  where:    {path}\n"
        "  expected: a box network that finds people beside it\n"
        "  got:      family movenet alone\n"
        "  do next:  give an object model with person_class too, or a pose model that finds people by itself (family "
        "movenet_multipose, yolov7_pose or yolov8_pose)"
    )


def test_a_box_network_without_people_is_not_enough_for_a_pose_network(tmp_path):
    message = refusal(box_network(tmp_path, person_class=None), pose_network(tmp_path))
    assert message.startswith("the box network finds no people, so that the pose network has nothing to look at\n")


def test_networks_in_each_others_place_are_told(tmp_path):
    boxes, people = box_network(tmp_path), people_network(tmp_path)
    assert refusal(people) == (
        "the object model is no box network\n"
        f"  where:    {people}\n"
        "  expected: a network that finds boxes: family fastestdet, yolov7, yolov8 or yolox\n"
        "  got:      family yolov8_pose, which finds joints\n"
        "  do next:  give it as the pose model"
    )
    assert refusal(None, boxes) == (
        "the pose model finds no joints\n"
        f"  where:    {boxes}\n"
        "  expected: a network that finds joints: family movenet, movenet_multipose, rtmpose, yolov7_pose or "
        "yolov8_pose\n"
        "  got:      family yolov8, which finds boxes\n"
        "  do next:  give it as the object model"
    )


def test_no_network_at_all_is_refused():
    assert refusal(None, None).startswith("there is no network to look at the images with\n")
