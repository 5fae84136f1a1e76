"""A box network and a pose network as one detector of workers and objects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recognition.detectors.protocol import BoxDetector, ModelInfo, PoseEstimator
from recognition.errors import ModelError
from recognition.observations import ViewDetections
from rigcal.errors import OptionError
from rigcal.geometry import Bools, Floats


@dataclass(frozen=True, slots=True)
class PeopleOptions:
    """What counts as a joint, and what as a person."""

    joint_score: float = 0.3
    """A joint of a lower score is not detected. Of MoveNet's joints with 0.2 to 0.3 every second lay more than 100 px
    from OpenPose's (people of 800 px), with 0.3 to 0.4 one in three, with 0.5 to 0.6 one in ten."""
    min_joints: int = 4
    """Somebody of whom fewer joints are detected is not detected. Of 482 people in boxes of yolox_nano none had fewer
    than 5, of 44 poses in boxes of FastestDet that show nobody 12 had fewer than 4."""
    duplicate_distance: float = 0.1
    """Two poses are one person where their joints are nearer on average than this times the larger box's longer side.
    At 0.1 no person was lost in 200 images with two overlapping people, at 0.13 one."""

    def __post_init__(self) -> None:
        if not 0 < self.joint_score < 1:
            raise OptionError("joint_score", expected="more than 0 and less than 1", got=self.joint_score)
        if not 1 <= self.min_joints <= 17:
            raise OptionError("min_joints", expected="1 to 17", got=self.min_joints)
        if not 0 <= self.duplicate_distance < 1:
            raise OptionError("duplicate_distance", expected="0 or more and less than 1", got=self.duplicate_distance)


class PeopleAndObjects:
    """Boxes of people go to the pose network, all others are objects; a :class:`recognition.detectors.Detector`.

    Without a pose network boxes of people are objects like any other.
    """

    def __init__(
        self, boxes: BoxDetector, poses: PoseEstimator | None = None, *, options: PeopleOptions | None = None
    ) -> None:
        if poses is not None and boxes.person_class is None:
            raise ModelError(
                "the box network finds no people, so that the pose network has nothing to look at",
                where=boxes.model_info.name,
                expected="person_class in its manifest",
                got="none",
                do_next="name the class of people in the manifest, or give a box network that finds people",
            )
        self._boxes, self._poses, self._options = boxes, poses, options or PeopleOptions()

    @property
    def model_info(self) -> tuple[ModelInfo, ...]:
        """The box network, then the pose network where there is one."""
        return (self._boxes.model_info,) + (() if self._poses is None else (self._poses.model_info,))

    def detect(self, image_bgr: NDArray[np.uint8]) -> ViewDetections:
        """People, each once, and objects in one image (H, W, 3)."""
        boxes = self._boxes.boxes(image_bgr)
        if self._poses is None:
            people, is_person = np.zeros((0, 17, 3)), np.zeros(len(boxes.classes), dtype=bool)
        else:
            is_person = np.array([name == self._boxes.person_class for name in boxes.classes], dtype=bool)
            person_xyxy = boxes.xyxy[is_person]
            found = self._poses.poses(image_bgr, person_xyxy)
            known = known_joints(found, (image_bgr.shape[1], image_bgr.shape[0]), self._options.joint_score)
            people = distinct_people(known, person_xyxy, self._options)
        objects = np.flatnonzero(~is_person)
        return ViewDetections(
            people[..., :2],
            people[..., 2],
            tuple(boxes.classes[idx] for idx in objects),
            boxes.xyxy[objects],
            boxes.score[objects],
        )


def known_joints(poses: Floats, size_wh: tuple[int, int], joint_score: float) -> Floats:
    """Poses (P, 17, 3) with joints outside the image or of a lower score as NaN, NaN, 0."""
    high = np.array(size_wh) - 0.5
    with np.errstate(invalid="ignore"):
        inside = ((poses[..., :2] >= -0.5) & (poses[..., :2] <= high)).all(axis=-1)
    known = inside & (poses[..., 2] >= joint_score)
    return np.asarray(np.where(known[..., None], poses, [np.nan, np.nan, 0.0]))


def distinct_people(poses: Floats, boxes_xyxy: Floats, options: PeopleOptions) -> Floats:
    """Poses (P, 17, 3) of enough joints, each person once.

    Boxes that overlap too little to be one box can still show one person, and a pose network may find the
    nearer neighbour in both. Of two poses whose shared joints agree, the one with the higher mean score stays.
    """
    known = poses[..., 2] > 0
    extent = (boxes_xyxy[:, 2:] - boxes_xyxy[:, :2]).max(axis=1)
    kept: list[int] = []
    for idx in np.argsort(-poses[..., 2].mean(axis=1), kind="stable"):
        if known[idx].sum() >= options.min_joints and not any(
            _mean_distance(poses[idx], poses[other]) < options.duplicate_distance * max(extent[idx], extent[other])
            for other in kept
        ):
            kept.append(int(idx))
    return poses[sorted(kept)]


def _mean_distance(first: Floats, second: Floats) -> float:
    shared: Bools = (first[:, 2] > 0) & (second[:, 2] > 0)
    if not shared.any():
        return np.inf
    return float(np.linalg.norm(first[shared, :2] - second[shared, :2], axis=-1).mean())
