"""Average precision, joint similarity and the figures made of them, against values worked out by hand."""

import numpy as np
import pytest

from recognition.observations import JOINTS
from tools.train.coco import Category, Picture, Truth
from tools.train.evaluate import (
    SIDES,
    WIDTHS,
    Result,
    joint_errors,
    keypoint_errors,
    report,
    scored_boxes,
    summary,
    table,
)
from tools.train.metrics import Scored, average_precision, joint_similarity
from tools.train.predict import Found


def scored(scores, similarity, ignored=None, outside=None):
    similarity = np.array(similarity, float)
    ignored = np.zeros(similarity.shape[1], bool) if ignored is None else np.array(ignored)
    outside = np.zeros(len(scores), bool) if outside is None else np.array(outside)
    return Scored(np.array(scores, float), similarity, ignored, outside)


def test_all_found_and_nothing_else_is_one():
    images = [scored([0.9], [[0.8]]), scored([0.7, 0.6], [[0.9, 0.0], [0.0, 0.7]])]
    assert average_precision(images, 0.5) == pytest.approx(1.0)
    assert average_precision(images, 0.75) == pytest.approx(67 / 101)  # recalls up to 2/3: 0, .01, ... .66


def test_a_better_scored_error_halves_the_precision():
    images = [scored([0.9, 0.5], [[0.1], [0.9]])]
    assert average_precision(images, 0.5) == pytest.approx(0.5)


def test_precision_is_made_falling():
    # hit, error, hit of two truths: precision 1 up to recall 1/2, then 2/3
    images = [scored([0.9, 0.8, 0.7], [[0.9, 0.0], [0.0, 0.0], [0.0, 0.9]])]
    assert average_precision(images, 0.5) == pytest.approx((51 + 50 * 2 / 3) / 101)


def test_a_truth_found_twice_counts_once():
    images = [scored([0.9, 0.8], [[0.9], [0.8]])]
    assert average_precision(images, 0.5) == pytest.approx(1.0)  # the second is an error below full recall
    images = [scored([0.9, 0.8, 0.7], [[0.9, 0.0], [0.8, 0.0], [0.0, 0.8]])]
    assert average_precision(images, 0.5) == pytest.approx((51 + 50 * 2 / 3) / 101)


def test_what_matches_an_ignored_truth_is_no_error():
    images = [scored([0.9, 0.5], [[0.9, 0.0], [0.0, 0.9]], ignored=[True, False])]
    assert average_precision(images, 0.5) == pytest.approx(1.0)


def test_a_detection_outside_the_size_is_no_error_unless_it_hits():
    assert average_precision([scored([0.9, 0.5], [[0.0], [0.9]], outside=[True, False])], 0.5) == pytest.approx(1.0)
    assert average_precision([scored([0.9], [[0.9]], outside=[True])], 0.5) == pytest.approx(1.0)


def test_nothing_asked_for_has_no_precision_and_nothing_found_has_none():
    assert np.isnan(average_precision([scored([0.9], [[0.9]], ignored=[True])], 0.5))
    assert average_precision([scored([], np.zeros((0, 1)))], 0.5) == 0.0


def test_joint_similarity_by_hand():
    truth = np.zeros((1, 17, 3))
    truth[0, 0], truth[0, 9] = (10.0, 10.0, 2.0), (50.0, 50.0, 1.0)
    found = np.zeros((1, 17, 3))
    found[0, 0, :2], found[0, 9, :2] = (10.0, 10.0), (53.0, 54.0)
    size = 100.0
    # one joint exact; the wrist 5 px off with sigma .062: exp(-25 / (2 * .53 * 100^2 * (2 * .062)^2))
    expected = (1.0 + np.exp(-25.0 / (2 * 0.53 * 1e4 * 0.124**2))) / 2
    assert joint_similarity(found, truth, np.array([size]))[0, 0] == pytest.approx(expected)


def site(widths=(30.0, 8.0)):
    """Two hats of these widths in the input (a picture is twice as wide), one person; all found, 1 px to the right."""
    boxes = np.array([[100, 100, 100 + 2 * w, 110 + w] for w in widths] + [[200, 100, 260, 250]], float)
    points = np.zeros((3, 17, 3))
    points[0, 0] = (100.0, 105.0, 2.0)
    points[2, :, :2], points[2, :, 2] = (230.0, 150.0), 2.0
    points[2, 3, 2] = 1.0
    truth = Truth(np.array([1, 1, 0]), boxes, points, np.zeros(3, bool))
    joints = points.copy()
    joints[..., 0] += 1.0
    found = Found(truth.classes, np.array([0.9, 0.8, 0.7]), boxes + [1, 0, 1, 0], joints, joints[:, :4, :2])
    categories = (Category("person", JOINTS), Category("hard_hat", ("centre",)))
    picture = Picture(None, (1024, 576), "dusk", "gl", truth)
    return [Result(picture, found, 0.5)], categories


def test_widths_are_counted_alone_in_pixels_of_the_input():
    results, _ = site()
    assert scored_boxes(results[0], 1, WIDTHS[0]).ignored.tolist() == [True, False]
    assert scored_boxes(results[0], 1, WIDTHS[1]).ignored.tolist() == [False, True]


def test_sides_are_roots_of_areas_in_pixels_of_the_input():
    boxes = np.array([[0, 0, 40, 20], [0, 0, 200, 40], [0, 0, 200, 60.0]])  # 14.1, 44.7 and 54.8 px in the input
    assert [size.holds(boxes, 0.5).tolist() for size in SIDES] == np.eye(3, dtype=bool).tolist()


def test_the_report_has_all_groups_and_its_table_can_be_read():
    results, categories = site()
    figures = report(results, categories)
    assert set(figures) == {"all", "light dusk", "renderer gl"}
    assert figures["all"]["classes"]["hard_hat"]["ap50"] == pytest.approx(1.0)
    assert figures["all"]["classes"]["hard_hat"]["asked 8-12"] == 1
    assert figures["all"]["oks_ap50"] == pytest.approx(1.0)
    assert "hard_hat" in table(figures["all"])
    assert [line.split()[0] for line in summary(figures).splitlines()] == ["group", "all", "light", "renderer"]


def test_errors_of_joints_and_keypoints_are_distances_in_the_picture():
    results, categories = site()
    errors = joint_errors(results)
    assert errors["visible"]["median_px"] == pytest.approx(1.0)
    assert errors["occluded"]["p90_px"] == pytest.approx(1.0)
    assert keypoint_errors(results, categories)["hard_hat"]["median_px"] == pytest.approx(1.0)
