"""Boxes, poses and people composed into people and objects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from recognition.detectors import Boxes, Detector, ModelInfo, OneStagePeople, People, PeopleAndObjects, PeopleOptions
from recognition.detectors.people import distinct_people
from recognition.errors import ModelError
from rigcal.errors import OptionError

IMAGE = np.zeros((400, 600, 3), np.uint8)


class FakeBoxes:
    model_info = (ModelInfo("boxes.onnx", "0" * 64, "yolox", "MIT"),)

    def __init__(self, *rows, person_class="person"):
        self.rows, self.person_class = rows, person_class

    def boxes(self, image_bgr):
        return Boxes(
            np.array([row[1] for row in self.rows], float).reshape(-1, 4),
            np.array([row[2] for row in self.rows], float),
            tuple(row[0] for row in self.rows),
        )


class FakePoses:
    model_info = (ModelInfo("poses.onnx", "1" * 64, "movenet", "MIT"),)

    def __init__(self, *poses):
        self.given, self.asked = np.array(poses).reshape(-1, 17, 3), []

    def poses(self, image_bgr, boxes_xyxy):
        self.asked.append(boxes_xyxy)
        return self.given


class FakePeople:
    model_info = (ModelInfo("people.onnx", "2" * 64, "yolov8_pose", "MIT"),)

    def __init__(self, *poses):
        joints = np.array(poses).reshape(-1, 17, 3)
        self.given = People(joints, np.hstack([joints[:, 0, :2], joints[:, -1, :2]]))

    def people(self, image_bgr):
        return self.given


def pose(left_px, top_px, *, score=0.9, noise_px=0.0):
    """A person of 80 x 160 px."""
    rng = np.random.default_rng(7)
    across, down = np.linspace(0, 80, 17), np.linspace(0, 160, 17)
    xy = np.stack([left_px + across, top_px + down], axis=-1) + rng.normal(0, noise_px, (17, 2))
    return np.column_stack([xy, np.full(17, score)])


def box(left_px, top_px):
    return ("person", [left_px, top_px, left_px + 80, top_px + 160], 0.9)


HAT = ("hat", [10, 20, 30, 40], 0.6)


def test_people_boxes_go_to_the_pose_network_and_the_others_are_objects():
    poses = FakePoses(pose(100, 100), pose(300, 100))
    found = PeopleAndObjects(FakeBoxes(box(100, 100), HAT, box(300, 100)), poses).detect(IMAGE)
    assert poses.asked[0] == pytest.approx(np.array([[100, 100, 180, 260], [300, 100, 380, 260]]))
    assert found.people_px == pytest.approx(np.array([pose(100, 100), pose(300, 100)])[..., :2])
    assert found.people_score == pytest.approx(np.full((2, 17), 0.9))
    assert found.object_class == ("hat",)
    assert found.object_px == pytest.approx(np.array([[20, 30]]))
    assert found.object_score == pytest.approx([0.6])


def test_without_a_pose_network_people_are_objects():
    found = PeopleAndObjects(FakeBoxes(box(100, 100), HAT)).detect(IMAGE)
    assert found.people_px.shape == (0, 17, 2)
    assert found.object_class == ("person", "hat")


def test_an_image_of_nothing_gives_nothing():
    found = PeopleAndObjects(FakeBoxes(), FakePoses()).detect(IMAGE)
    assert found.people_px.shape == (0, 17, 2)
    assert found.object_xyxy.shape == (0, 4)


def test_weak_joints_and_joints_outside_the_image_are_unknown():
    given = pose(100, 100)
    given[3, 2] = 0.29
    given[4, :2] = -0.6, 50
    given[5, :2] = 599.5, 399.5
    given[6, 0] = 599.6
    given[7, 0] = np.nan
    found = PeopleAndObjects(FakeBoxes(box(100, 100)), FakePoses(given)).detect(IMAGE)
    unknown = np.isnan(found.people_px[0]).all(axis=1)
    assert np.flatnonzero(unknown).tolist() == [3, 4, 6, 7]
    assert (found.people_score[0] == 0).tolist() == unknown.tolist()


def test_two_boxes_on_one_person_give_one_person_and_the_better_pose():
    better, worse = pose(103, 102, noise_px=3), pose(100, 100, score=0.5)
    boxes = FakeBoxes(box(100, 100), box(100, 160))
    found = PeopleAndObjects(boxes, FakePoses(worse, better)).detect(IMAGE)
    assert found.people_px == pytest.approx(better[None, :, :2])


def test_a_hint_never_displaces_somebody_who_is_none():
    poses, boxes = np.stack([pose(103, 102), pose(100, 100, score=0.5)]), np.array([box(100, 100)[1]] * 2)
    assert distinct_people(poses, boxes, PeopleOptions()).tolist() == [0]
    assert distinct_people(poses, boxes, PeopleOptions(), hint=np.array([True, False])).tolist() == [1]


def test_two_people_one_behind_the_other_stay_two():
    # 40 px beside each other: a quarter of their height.
    poses = FakePoses(pose(100, 100), pose(140, 100))
    found = PeopleAndObjects(FakeBoxes(box(100, 100), box(140, 100)), poses).detect(IMAGE)
    assert len(found.people_px) == 2


def test_poses_without_a_joint_in_common_are_two_people():
    upper, lower = pose(100, 100), pose(100, 100)
    upper[8:, 2], lower[:8, 2] = 0, 0
    found = PeopleAndObjects(FakeBoxes(box(100, 100), box(100, 100)), FakePoses(upper, lower)).detect(IMAGE)
    assert len(found.people_px) == 2


def test_a_box_with_too_few_joints_is_nobody():
    given = pose(100, 100)
    given[3:, 2] = 0.1
    found = PeopleAndObjects(FakeBoxes(box(100, 100)), FakePoses(given)).detect(IMAGE)
    assert found.people_px.shape == (0, 17, 2)
    found = PeopleAndObjects(FakeBoxes(box(100, 100)), FakePoses(given), options=PeopleOptions(min_joints=3)).detect(
        IMAGE
    )
    assert found.people_px.shape == (1, 17, 2)


def test_the_networks_are_named_for_the_provenance():
    detector: Detector = PeopleAndObjects(FakeBoxes(), FakePoses())
    assert [info.name for info in detector.model_info] == ["boxes.onnx", "poses.onnx"]
    assert [info.name for info in PeopleAndObjects(FakeBoxes()).model_info] == ["boxes.onnx"]


def test_a_people_network_needs_no_boxes():
    detector: Detector = OneStagePeople(FakePeople(pose(100, 100), pose(300, 100)))
    found = detector.detect(IMAGE)
    assert found.people_px == pytest.approx(np.array([pose(100, 100), pose(300, 100)])[..., :2])
    assert found.object_xyxy.shape == (0, 4)
    assert [info.name for info in detector.model_info] == ["people.onnx"]


def test_beside_a_people_network_the_boxes_of_people_are_left_out():
    detector = OneStagePeople(FakePeople(pose(100, 100)), FakeBoxes(box(100, 100), HAT, box(300, 100)))
    found = detector.detect(IMAGE)
    assert len(found.people_px) == 1
    assert found.object_class == ("hat",)
    assert found.object_score == pytest.approx([0.6])
    assert [info.name for info in detector.model_info] == ["boxes.onnx", "people.onnx"]


@pytest.mark.parametrize("compose", [
    PeopleAndObjects,
    lambda boxes: PeopleAndObjects(boxes, FakePoses(pose(100, 100))),
    lambda boxes: OneStagePeople(FakePeople(pose(100, 100)), boxes),
])  # fmt: skip
def test_keypoints_of_objects_are_passed_on(compose):
    class WithKeypoints(FakeBoxes):
        def boxes(self, image_bgr):
            return replace(super().boxes(image_bgr), keypoints_px=np.arange(16.0).reshape(2, 4, 2))

    found = compose(WithKeypoints(box(100, 100), HAT)).detect(IMAGE)
    assert found.object_keypoints_px[-1].tolist() == np.arange(8.0, 16.0).reshape(4, 2).tolist()
    without = compose(FakeBoxes(box(100, 100), HAT)).detect(IMAGE)
    assert np.isnan(without.object_keypoints_px).all()


def test_people_of_one_stage_count_by_the_same_rules():
    better, worse, unseen = pose(103, 102), pose(100, 100, score=0.5), pose(300, 100, score=0.29)
    better[3, 2] = 0.29
    found = OneStagePeople(FakePeople(worse, better, unseen)).detect(IMAGE)
    assert np.isnan(found.people_px[0]).all(axis=1).nonzero()[0].tolist() == [3]
    assert len(found.people_px) == 1
    strict = PeopleOptions(joint_score=0.95)
    assert len(OneStagePeople(FakePeople(better), options=strict).detect(IMAGE).people_px) == 0


def test_a_pose_network_without_anybody_to_look_at_is_refused():
    with pytest.raises(ModelError) as caught:
        PeopleAndObjects(FakeBoxes(person_class=None), FakePoses())
    assert str(caught.value) == (
        "the box network finds no people, so that the pose network has nothing to look at\n"
        "  where:    boxes.onnx\n"
        "  expected: person_class in its manifest\n"
        "  got:      none\n"
        "  do next:  name the class of people in the manifest, or give a box network that finds people"
    )


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("joint_score", 0.0, "more than 0 and less than 1"),
        ("joint_score", 1.0, "more than 0 and less than 1"),
        ("min_joints", 0, "1 to 17"),
        ("min_joints", 18, "1 to 17"),
        ("duplicate_distance", -0.1, "0 or more and less than 1"),
    ],
)
def test_options_out_of_range_are_refused(name, value, expected):
    with pytest.raises(OptionError) as caught:
        PeopleOptions(**{name: value})
    assert f"option {name} is out of range\n  expected: {expected}\n  got:      {value!r}" in str(caught.value)
