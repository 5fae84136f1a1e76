"""Thresholds are those of the best F1, worked out by hand."""

import numpy as np
import pytest

from tools.train.coco import Picture, Truth
from tools.train.evaluate import Result
from tools.train.metrics import Scored
from tools.train.predict import Found
from tools.train.thresholds import best_cut, choice_of_boxes, choice_of_joints


def cut(scores, hits, asked):
    return best_cut(np.array(scores, float), np.array(hits, bool), asked)


def test_the_threshold_lies_between_the_last_that_helps_and_the_next():
    # F1 of the first 1, 2, 3, 4 of three truths: 2/4, 4/5, 4/6, 4/7
    choice = cut([0.9, 0.7, 0.5, 0.2], [True, True, False, False], 3)
    assert choice.threshold == pytest.approx(0.6)
    assert (choice.f1, choice.precision, choice.recall) == pytest.approx((0.8, 1.0, 2 / 3))


def test_an_error_among_hits_is_taken_if_what_follows_is_worth_it():
    # F1: 2/4, 2/5, 4/6, 6/7
    choice = cut([0.4, 0.9, 0.6, 0.8], [True, True, True, False], 3)
    assert choice.threshold == pytest.approx(0.4)
    assert choice.f1 == pytest.approx(6 / 7)


def test_equal_scores_are_not_parted():
    choice = cut([0.8, 0.8, 0.3], [True, False, False], 1)
    assert choice.threshold == pytest.approx(0.55)
    assert choice.precision == pytest.approx(0.5)


def test_thresholds_stay_within_what_is_looked_at():
    assert cut([0.99, 0.98], [True, False], 1).threshold == 0.95
    assert cut([0.02], [True], 1).threshold == 0.05


def test_nothing_asked_for_or_nothing_right_leaves_the_choice_open():
    assert cut([0.9], [False], 3) is None
    assert cut([], [], 0) is None


def test_what_matches_an_ignored_truth_neither_helps_nor_harms():
    image = Scored(
        np.array([0.9, 0.8, 0.6]), np.array([[0.0, 0.9], [0.7, 0.0], [0.0, 0.0]]), np.array([False, True]),
        np.zeros(3, bool),
    )  # fmt: skip
    choice = choice_of_boxes([image])
    assert choice.threshold == pytest.approx(0.7)
    assert (choice.f1, choice.precision) == (1.0, 1.0)
    assert choice_of_boxes([]) is None


def test_joints_are_right_near_their_place_and_wrong_where_there_is_none():
    box = np.array([[100.0, 50.0, 200.0, 250.0]])
    points = np.zeros((1, 17, 3))
    points[0, :, :2], points[0, :, 2] = (150.0, 150.0), 2.0
    points[0, 16] = 0.0  # not in the picture
    joints = points.copy()
    joints[0, :, :2], joints[0, :, 2] = (150.0, 150.0), 0.9
    joints[0, 15], joints[0, 16] = (150.0, 90.0, 0.4), (10.0, 10.0, 0.3)
    truth = Truth(np.zeros(1, int), box, points, np.zeros(1, bool))
    found = Found(np.zeros(1, int), np.array([0.9]), box, joints, np.zeros((1, 4, 2)))
    result = Result(Picture(None, (512, 288), "dusk", "gl", truth), found, 1.0)
    choice = choice_of_joints([result])
    assert choice.threshold == pytest.approx(0.65)
    assert (choice.precision, choice.recall) == pytest.approx((1.0, 15 / 16))
    elsewhere = Found(found.classes, found.scores, box + 150, joints, found.keypoints)
    assert choice_of_joints([Result(result.picture, elsewhere, 1.0)]) is None
