"""Networks composed into one detector of people and objects.

Decision: one class for each way in which people are found. Two-stage, a pose network looks at the boxes of people that
a box network found, whose other boxes are the objects, so that it runs once for both; one-stage, a people network
needs nobody, and a box network beside it gives objects. A network that gives everything at once, or refines what
another found, is a :class:`recognition.detectors.Detector` of its own. The alternative, a pipeline of stages that pass
a growing result on, has an order to get wrong, and with two networks nothing to show for it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from recognition.detectors.people import PeopleOptions, settled
from recognition.detectors.protocol import BoxDetector, Boxes, ModelInfo, People, PeopleDetector, PoseEstimator
from recognition.errors import ModelError
from recognition.observations import ViewDetections
from rigcal.geometry import Bools, Floats


class PeopleAndObjects:
    """Two-stage: boxes of people go to the pose network, all others are objects.

    A :class:`recognition.detectors.Detector`. Without a pose network boxes of people are objects like any other.
    """

    def __init__(
        self, boxes: BoxDetector, poses: PoseEstimator | None = None, *, options: PeopleOptions | None = None
    ) -> None:
        if poses is not None and boxes.person_class is None:
            raise ModelError(
                "the box network finds no people, so that the pose network has nothing to look at",
                where=boxes.model_info[0].name,
                expected="person_class in its manifest",
                got="none",
                do_next="name the class of people in the manifest, or give a box network that finds people",
            )
        self._boxes, self._poses, self._options = boxes, poses, options or PeopleOptions()

    @property
    def model_info(self) -> tuple[ModelInfo, ...]:
        """The box network, then the pose network where there is one."""
        return self._boxes.model_info + (() if self._poses is None else self._poses.model_info)

    def detect(self, image_bgr: NDArray[np.uint8]) -> ViewDetections:
        """People, each once, and objects in one image (H, W, 3)."""
        boxes = self._boxes.boxes(image_bgr)
        if self._poses is None:
            return _detections(np.zeros((0, 17, 3)), boxes, np.ones(len(boxes.classes), dtype=bool))
        is_person = _of_class(boxes, self._boxes.person_class)
        person_xyxy = boxes.xyxy[is_person]
        people = People(self._poses.poses(image_bgr, person_xyxy), person_xyxy)
        return _detections(settled(people, _size_wh(image_bgr), self._options), boxes, ~is_person)


class OneStagePeople:
    """One-stage: people and their joints from one network, objects from a box network where there is one.

    A :class:`recognition.detectors.Detector`. Boxes of people that the box network finds as well are left out.
    """

    def __init__(
        self, people: PeopleDetector, objects: BoxDetector | None = None, *, options: PeopleOptions | None = None
    ) -> None:
        self._people, self._objects, self._options = people, objects, options or PeopleOptions()

    @property
    def model_info(self) -> tuple[ModelInfo, ...]:
        """The box network where there is one, then the people network."""
        return (() if self._objects is None else self._objects.model_info) + self._people.model_info

    def detect(self, image_bgr: NDArray[np.uint8]) -> ViewDetections:
        """People, each once, and objects in one image (H, W, 3)."""
        people = settled(self._people.people(image_bgr), _size_wh(image_bgr), self._options)
        if self._objects is None:
            return _detections(people, _NO_BOXES, np.zeros(0, dtype=bool))
        boxes = self._objects.boxes(image_bgr)
        return _detections(people, boxes, ~_of_class(boxes, self._objects.person_class))


_NO_BOXES = Boxes(np.zeros((0, 4)), np.zeros(0), ())


def _size_wh(image_bgr: NDArray[np.uint8]) -> tuple[int, int]:
    return image_bgr.shape[1], image_bgr.shape[0]


def _of_class(boxes: Boxes, name: str | None) -> Bools:
    return np.array([one == name for one in boxes.classes], dtype=bool)


def _detections(people: Floats, boxes: Boxes, is_object: Bools) -> ViewDetections:
    objects = np.flatnonzero(is_object)
    return ViewDetections(
        people[..., :2],
        people[..., 2],
        tuple(boxes.classes[idx] for idx in objects),
        boxes.xyxy[objects],
        boxes.score[objects],
        boxes.keypoints_px[objects],
    )
