"""Outputs that are not the family's: the message names the shapes, and whose they are where that can be told."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from tiny_onnx import tiny_network, write

from recognition.detectors import load_model
from recognition.errors import ModelError

BOXES = """
family = "{family}"
licence = "MIT"
sha256 = "{{sha256}}"
classes = ["hat", "ladder"]
score_threshold = 0.5
"""
JOINTS = """
family = "{family}"
licence = "MIT"
sha256 = "{{sha256}}"
joints = "coco17"
{entry}
"""
INPUT = """
[input]
name = "images"
size_wh = [64, 64]
layout = "nchw"
dtype = "float32"
colour = "rgb"
resize = "letterbox"
"""
AT_64 = "at 64x64 px"


def manifest(family):
    if family in {"fastestdet", "yolov7", "yolov8", "yolox"}:
        return BOXES.format(family=family) + INPUT
    entry = "crop_margin = 1.25" if family in {"movenet", "rtmpose"} else "score_threshold = 0.5"
    return JOINTS.format(family=family, entry=entry) + INPUT


def refusal(folder, family, *shapes):
    outputs = {f"out{number}": np.zeros(shape) for number, shape in enumerate(shapes)}
    path = write(folder, tiny_network(outputs, shape=(1, 3, 64, 64)), manifest(family))
    with pytest.raises(ModelError) as caught:
        load_model(path)
    return str(caught.value)


def advice(message):
    return message.rpartition("do next:  ")[2]


def test_the_message_gives_shapes_by_name_and_the_number_of_classes_that_they_hold(tmp_path):
    assert refusal(tmp_path, "yolox", (1, 84, 8)) == (
        "the network's output is not what the manifest's family gives\n"
        f"  where:    {tmp_path / 'model.onnx'}\n"
        f"  expected: 1x84x7, of family yolox with 2 classes {AT_64}\n"
        "  got:      'out0' 1x84x8\n"
        '  do next:  this looks like family = "yolox" with 3 classes: mend the manifest'
    )


@pytest.mark.parametrize(
    ("family", "expected"),
    [
        ("yolov8", f"1x6x84 or 1x6x85, of family yolov8 with 2 classes {AT_64}"),
        ("yolov7", f"1x252x7 or 1x255x7, of family yolov7 with 2 classes {AT_64}"),
        ("fastestdet", f"1x7x4x4, of family fastestdet with 2 classes {AT_64}"),
        ("yolov8_pose", f"1x56x84 or 1x56x85, of family yolov8_pose {AT_64}"),
        ("yolov7_pose", f"1x252x57 or 1x255x57, of family yolov7_pose {AT_64}"),
        ("movenet", f"1x1x17x3, of family movenet {AT_64}"),
        ("movenet_multipose", f"1x6x56, of family movenet_multipose {AT_64}"),
        ("rtmpose", f"1x17x128 and 1x17x128, of family rtmpose {AT_64}"),
    ],
)
def test_every_family_says_what_it_expects(tmp_path, family, expected):
    message = refusal(tmp_path, family, (1, 3))
    assert f"  expected: {expected}\n" in message
    assert advice(message).startswith("check family, classes and input.size_wh of the manifest")


@pytest.mark.parametrize(
    ("shapes", "alike"),
    [
        ([(1, 6, 84)], 'family = "yolov8" with 2 classes'),
        ([(1, 84, 84)], 'family = "yolov8" with 80 classes, or family = "yolox" with 79 classes'),
        ([(1, 252, 7)], 'family = "yolov7" with 2 classes'),
        ([(1, 84, 7)], 'family = "yolox" with 2 classes'),
        ([(1, 7, 4, 4)], 'family = "fastestdet" with 2 classes'),
        ([(1, 255, 57), (1, 3, 8, 8, 57)], 'family = "yolov7" with 52 classes, or family = "yolov7_pose"'),
        ([(1, 6, 56)], 'family = "movenet_multipose"'),
        ([(1, 1, 17, 3)], 'family = "movenet"'),
        ([(1, 17, 128), (1, 17, 128)], 'family = "rtmpose"'),
    ],
)
def test_another_familys_output_is_recognised(tmp_path, shapes, alike):
    stated = "yolov8_pose" if shapes == [(1, 1, 17, 3)] else "movenet"
    assert advice(refusal(tmp_path, stated, *shapes)) == f"this looks like {alike}: mend the manifest"


def test_a_one_stage_network_is_told_from_boxes_of_as_many_classes(tmp_path):
    assert advice(refusal(tmp_path, "yolov8", (1, 56, 84))) == (
        'this looks like family = "yolov8" with 52 classes, or family = "yolov8_pose": mend the manifest'
    )


@pytest.mark.parametrize("shape", [(1, 300, 6), (1, 300, 57), (100, 7)])
def test_an_export_with_non_maximum_suppression_is_recognised(tmp_path, shape):
    assert advice(refusal(tmp_path, "yolov8", shape)) == (
        "this looks like an export that ends in non-maximum suppression: export it again without (Ultralytics: no "
        "nms, and end2end=False for YOLO26; YOLOv7: no --end2end)"
    )


def test_raw_heads_are_recognised(tmp_path):
    assert advice(refusal(tmp_path, "yolov7", (1, 3, 8, 8, 7), (1, 3, 4, 4, 7), (1, 3, 2, 2, 7))) == (
        "these look like the raw heads of YOLOv7 or YOLOv5: export it again with the decoding (--grid)"
    )


def test_one_output_of_two_is_not_enough(tmp_path):
    assert "  got:      'out0' 1x17x128\n" in refusal(tmp_path, "rtmpose", (1, 17, 128))
