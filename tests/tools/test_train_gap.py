"""People of the detector and of OpenPose are matched by their joints; figures by hand."""

import numpy as np
import pytest

from recognition.observations import JOINTS
from tools.train.__main__ import main
from tools.train.gap import compare, gap_facts


def person(left, top, height=100.0, *, joints=17, score=0.9):
    """Joints down a line."""
    points = np.column_stack([np.full(17, left), top + np.linspace(0, height, 17), np.full(17, score)])
    points[joints:, 2] = 0.0
    return points


def detected(truth, shift):
    return truth[:, :2] + shift


def test_a_person_is_who_stands_nearest_and_distances_are_those_of_the_joints():
    truth = np.stack([person(100, 50), person(300, 50, 200.0)])
    found = np.stack([detected(truth[1], (6.0, 8.0)), detected(truth[0], (3.0, 4.0))])
    image = compare(truth, found)
    assert image.found.tolist() == [True, True]
    assert image.error_px[:, 0].tolist() == [5.0, 10.0]
    assert image.height_px.tolist() == [100.0, 200.0]
    assert image.false == 0


def test_who_is_farther_than_a_quarter_of_the_height_is_somebody_else():
    truth = np.stack([person(100, 50)])
    assert compare(truth, detected(truth[0], (24.0, 0.0))[None]).found.tolist() == [True]
    image = compare(truth, detected(truth[0], (26.0, 0.0))[None])
    assert image.found.tolist() == [False]
    assert image.false == 1
    assert np.isnan(image.error_px).all()


def test_who_has_few_joints_is_not_asked_for_but_no_error_when_found():
    truth = np.stack([person(100, 50, joints=7), person(300, 50, joints=8)])
    image = compare(truth, detected(truth[0], (1.0, 0.0))[None])
    assert image.found.tolist() == [False]
    assert image.false == 0


def test_unsure_joints_of_openpose_and_joints_that_are_not_given_do_not_count():
    truth = np.stack([person(100, 50)])
    truth[0, 0, 2] = 0.2
    found = detected(truth[0], (2.0, 0.0))[None]
    found[0, 5] = np.nan
    image = compare(truth, found)
    assert np.isnan(image.error_px[0, [0, 5]]).all()
    facts = gap_facts([image])
    assert facts["joints"]["recall"] == pytest.approx(15 / 16)
    assert facts["by_joint"][JOINTS[5]]["recall"] == 0.0
    assert facts["by_joint"][JOINTS[1]] == pytest.approx(
        {"median_px": 2.0, "median_of_height": 2.0 / image.height_px[0], "recall": 1.0, "recall_near": 1.0}
    )


def test_two_people_with_fewer_than_three_joints_in_common_are_not_compared():
    truth = np.stack([person(100, 50)])
    found = np.full((1, 17, 2), np.nan)
    found[0, :2] = truth[0, :2, :2]
    assert compare(truth, found).false == 1


def test_an_image_without_anybody_is_counted():
    nobody = compare(np.zeros((0, 17, 3)), np.zeros((2, 17, 2)))
    facts = gap_facts([nobody])
    assert (facts["images"], facts["people"], facts["false_people_per_image"]) == (1, 0, 2.0)
    assert np.isnan(facts["recall"])


def test_where_there_is_no_capture_nothing_is_measured_and_the_command_says_so(tmp_path, capsys):
    assert main(["gap", "--capture", str(tmp_path / "none"), "--figures", str(tmp_path)]) == 0
    assert "no real capture there" in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == []
