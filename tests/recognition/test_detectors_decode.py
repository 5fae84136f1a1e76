"""Outputs of networks, read by hand-made arrays and by plain loops."""

from __future__ import annotations

import math

import numpy as np
import pytest

from recognition.detectors.coco import COCO80
from recognition.detectors.fastestdet import decode_fastestdet
from recognition.detectors.movenet import decode_movenet
from recognition.detectors.onnx_boxes import pick_boxes
from recognition.detectors.onnx_poses import crop_region
from recognition.detectors.yolox import decode_yolox

SIZE_WH = (96, 64)
CLASSES = ("hat", "ladder", "person")


def test_yolox_reads_cells_row_by_row_and_stride_after_stride():
    rng = np.random.default_rng(1)
    cells = [(s, r, c) for s in (8, 16, 32) for r in range(SIZE_WH[1] // s) for c in range(SIZE_WH[0] // s)]
    output = rng.uniform(-1, 1, (1, len(cells), 8)).astype(np.float32)
    boxes, scores = decode_yolox((output,), SIZE_WH)
    for idx, (stride, row, column) in enumerate(cells):
        dx, dy, log_w, log_h, objectness, *classes = (float(value) for value in output[0, idx])
        x, y, w, h = (column + dx) * stride, (row + dy) * stride, math.exp(log_w) * stride, math.exp(log_h) * stride
        assert boxes[idx] == pytest.approx([x - w / 2, y - h / 2, x + w / 2, y + h / 2])
        assert scores[idx] == pytest.approx([objectness * value for value in classes])


def test_yolox_survives_sizes_that_overflow():
    output = np.zeros((1, 126, 8), np.float32)
    output[..., 2:4] = 3e38
    boxes, _ = decode_yolox((output,), SIZE_WH)
    assert np.isfinite(boxes).all()


def test_fastestdet_reads_one_box_per_cell():
    rng = np.random.default_rng(2)
    output = rng.uniform(-2, 2, (1, 8, 4, 6)).astype(np.float32)
    boxes, scores = decode_fastestdet((output,), SIZE_WH)
    for row in range(4):
        for column in range(6):
            objectness, dx, dy, w, h, *classes = (float(value) for value in output[0, :, row, column])
            x, y = (column + math.tanh(dx)) / 6 * 96, (row + math.tanh(dy)) / 4 * 64
            half_w, half_h = 48 / (1 + math.exp(-w)), 32 / (1 + math.exp(-h))
            assert boxes[row * 6 + column] == pytest.approx([x - half_w, y - half_h, x + half_w, y + half_h])
            assert scores[row * 6 + column] == pytest.approx([objectness * value for value in classes])


def test_movenet_gives_y_before_x():
    output = np.zeros((1, 1, 17, 3), np.float32)
    output[0, 0, 5] = 0.25, 0.75, 0.875
    joints = decode_movenet((output,), (192, 192))
    assert joints[5] == pytest.approx([144, 48, 0.875])
    assert joints.shape == (17, 3)


def pick(xyxy, scores, threshold=0.3):
    return pick_boxes(
        np.array(xyxy, float), np.array(scores, float), classes=CLASSES, size_wh=(200, 100), score_threshold=threshold
    )


def test_overlapping_boxes_of_one_class_are_one_object_and_of_two_classes_two():
    one, almost, apart = [10, 10, 50, 90], [12, 10, 52, 90], [120, 10, 160, 90]
    boxes = pick([one, almost, one, apart], [[0, 0, 0.6], [0.1, 0, 0.9], [0, 0.5, 0.4], [0, 0, 0.7]])
    assert boxes.classes == ("person", "person", "ladder")
    assert boxes.xyxy == pytest.approx(np.array([almost, apart, one]))
    assert boxes.score == pytest.approx([0.9, 0.7, 0.5])


def test_boxes_below_the_threshold_are_dropped_and_at_it_kept():
    boxes = pick([[0, 0, 20, 20], [40, 0, 60, 20]], [[0.5, 0, 0], [0.4999, 0, 0]], threshold=0.5)
    assert boxes.score == pytest.approx([0.5])


def test_boxes_end_at_the_edges_of_the_image():
    boxes = pick([[-30, -30, 20, 400], [210, 10, 250, 50]], [[0.9, 0, 0], [0.8, 0, 0]])
    assert boxes.xyxy == pytest.approx(np.array([[-0.5, -0.5, 20, 99.5]]))


def test_boxes_that_are_not_numbers_are_dropped():
    boxes = pick([[np.nan] * 4, [0, 0, 20, 20]], [[0.9, 0, 0], [np.nan] * 3])
    assert boxes.classes == ()


def test_no_box_is_a_result_too():
    boxes = pick([[0, 0, 20, 20]], [[0.1, 0, 0]])
    assert boxes.xyxy.shape == (0, 4)
    assert boxes.classes == ()


def test_a_crop_is_the_box_grown_about_its_centre():
    # Pixels 10..19 and 20..59, so edges 10, 20 and 60 px further down.
    assert crop_region(np.array([9.5, 19.5, 19.5, 59.5]), 1.0).tolist() == [10, 20, 20, 60]
    assert crop_region(np.array([9.5, 19.5, 19.5, 59.5]), 1.2).tolist() == [9, 16, 21, 64]
    assert crop_region(np.array([-0.5, -0.5, 9.5, 9.5]), 2.0).tolist() == [-5, -5, 15, 15]


def test_a_crop_is_never_empty():
    left, top, right, bottom = crop_region(np.array([3.1, 4.0, 3.2, 4.1]), 1.0)
    assert (right - left, bottom - top) == (1, 1)


def test_coco_has_its_80_classes_at_their_numbers():
    assert len(set(COCO80)) == 80
    assert [COCO80[idx] for idx in (0, 24, 56, 67, 79)] == ["person", "backpack", "chair", "cell phone", "toothbrush"]
