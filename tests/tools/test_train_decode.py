"""The decoder reads the outputs as its docstring defines them."""

import numpy as np
import pytest

from recognition.detectors.bundled.decode import (
    box_iou,
    decode_hats,
    decode_joints,
    decode_site,
    site_cells,
    suppressed,
)


def empty_site(classes=3):
    cells = 64 * 36 + 32 * 18 + 16 * 9
    return np.zeros((cells, classes), np.float32), np.zeros((cells, 63), np.float32)


def test_cells_stand_finest_first_row_by_row():
    centres, strides = site_cells()
    assert len(centres) == 3024
    assert centres[0].tolist() == [4.0, 4.0]
    assert centres[64].tolist() == [4.0, 12.0]
    assert centres[2304].tolist() == [8.0, 8.0]
    assert centres[-1].tolist() == [496.0, 272.0]
    assert strides[[0, 2304, -1], 0].tolist() == [8.0, 16.0, 32.0]


def test_a_cell_gives_its_box_its_joints_and_its_keypoints():
    scores, places = empty_site()
    cell = 2304 + 32 * 2 + 5  # stride 16, row 2, column 5: centre (88, 40)
    scores[cell, 0] = 0.9
    places[cell, :4] = np.log([0.5, 1.0, 1.5, 2.0])
    places[cell, 4:8] = [1.0, -2.0, 0.5, 0.25]
    places[cell, 38:40] = [0.0, 3.0]
    places[cell, 55:57] = [-1.0, 1.0]
    found = decode_site(scores, places)
    assert found.classes.tolist() == [0]
    assert found.scores[0] == pytest.approx(0.9)
    assert np.allclose(found.boxes, [[80.0, 24.0, 112.0, 72.0]], atol=1e-4)
    assert np.allclose(found.joints[0, :2, :2], [[104.0, 8.0], [96.0, 44.0]])
    assert np.allclose(found.joints[0, :2, 2], [0.5, 1.0 / (1.0 + np.exp(-3.0))])
    assert np.allclose(found.keypoints[0, 0], [72.0, 56.0])


def test_of_two_cells_with_one_box_the_better_stays_but_classes_do_not_suppress_each_other():
    scores, places = empty_site()
    places[:2, :4] = np.log(2.0)
    scores[0, 1], scores[1, 1], scores[1, 2] = 0.6, 0.8, 0.3
    found = decode_site(scores, places, overlap=0.4)
    assert found.classes.tolist() == [1, 2]
    assert np.allclose(found.scores, [0.8, 0.3])


def test_nothing_found_is_empty_of_the_right_shape():
    found = decode_site(*empty_site())
    assert found.boxes.shape == (0, 4)
    assert found.joints.shape == (0, 17, 3)
    assert found.keypoints.shape == (0, 4, 2)


def test_overlap_of_boxes_by_hand():
    first, second = np.array([[0.0, 0.0, 2.0, 2.0]]), np.array([[1.0, 1.0, 3.0, 3.0], [5.0, 5.0, 6.0, 6.0]])
    assert np.allclose(box_iou(first, second), [[1 / 7, 0.0]])
    assert suppressed(np.array([[0, 0, 2, 2], [0, 0, 2, 1.9], [4, 4, 5, 5.0]]), 0.5).tolist() == [0, 2]


def gaussian_heat(x, y, sigma=1.0):
    columns, rows = np.arange(24) + 0.5, np.arange(32) + 0.5
    bump = np.exp(-((columns - x / 4) ** 2 + (rows[:, None] - y / 4) ** 2) / (2 * sigma**2))
    return bump / bump.sum()


def test_a_gaussian_is_found_to_a_hundredth_of_a_pixel():
    rng = np.random.default_rng(1)
    places = np.column_stack([rng.uniform(8, 88, 30), rng.uniform(8, 120, 30)])
    heat = np.stack([gaussian_heat(*place) for place in places])[:, None].astype(np.float32)
    states = np.full((30, 1, 2), [0.8, 0.4], np.float32)
    joints = decode_joints(heat, states)
    assert np.abs(joints[:, 0, :2] - places).max() < 0.01
    assert np.allclose(joints[:, 0, 3], 0.4)
    assert ((joints[:, 0, 2] > 0.5) & (joints[:, 0, 2] <= 0.8)).all()


def test_a_flat_heat_has_a_low_score_and_a_peak_at_the_border_its_cell():
    flat = np.full((1, 1, 32, 24), 1 / 768, np.float32)
    assert decode_joints(flat, np.ones((1, 1, 2), np.float32))[0, 0, 2] < 0.02
    corner = np.full((1, 1, 32, 24), 1e-6, np.float32)
    corner[0, 0, 0, 23] = 1.0
    assert np.allclose(decode_joints(corner, np.ones((1, 1, 2), np.float32))[0, 0, :2], [94.0, 2.0])


def test_hats_are_given_once_per_crop_by_falling_score():
    hats = np.zeros((2, 5, 32, 24), np.float32)
    hats[1, :, 3, 4] = [0.7, 10.0, 10.0, 26.0, 20.0]
    hats[1, :, 3, 5] = [0.9, 11.0, 10.0, 27.0, 20.0]
    hats[1, :, 20, 9] = [0.3, 30.0, 70.0, 46.0, 82.0]
    (none, _), (boxes, scores) = decode_hats(hats)
    assert none.shape == (0, 4)
    assert np.allclose(boxes, [[11, 10, 27, 20], [30, 70, 46, 82]])
    assert np.allclose(scores, [0.9, 0.3])
