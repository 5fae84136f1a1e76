"""The two bundled networks as one detector: the site network looks at the image, the worker network at its workers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from recognition.detectors.bundled.decode import suppressed
from recognition.detectors.bundled.geometry import crop_xyxy
from recognition.detectors.bundled.images import halves
from recognition.detectors.bundled.manifests import HARD_HAT, PERSON
from recognition.detectors.bundled.site import SiteFindings, SiteNetwork
from recognition.detectors.bundled.worker import WorkerFindings, WorkerNetwork
from recognition.detectors.people import PeopleOptions, distinct_people, known_joints
from recognition.detectors.protocol import Boxes, ModelInfo, People
from recognition.observations import ViewDetections
from rigcal.geometry import Bools, Floats

_SAME_HAT = 0.15
"""Intersection over union above which two hard hats are one. In 15 validation sequences of SICSG two boxes of one hat
overlap 289 times, in all but two by 0.1 or more, and boxes of two hats 103 times, never by as much."""


class BundledDetector:
    """Workers with joints, and objects with keypoints.

    A :class:`recognition.detectors.Detector`; beside networks of another kind also a
    :class:`recognition.detectors.BoxDetector` or a :class:`recognition.detectors.PeopleDetector`. It holds no state
    that a call changes, so that several threads may share it.

    A joint is the worker network's where that is sure of it, else the site network's where it sees the joint, else not
    detected. Of hard hats that overlap, one that a crop shows goes before one of the whole image. Where a crop shows
    the place, one of the whole image counts from the score on that hats in crops need: where the site network's own
    threshold stood, half of the bare heads taken for hats (17 % on validation pictures, 9 % so) were its alone.
    """

    person_class = PERSON

    def __init__(self, site: SiteNetwork, worker: WorkerNetwork) -> None:
        self._site, self._worker = site, worker
        self.people_options = PeopleOptions(
            joint_score=min(site.manifest.joint_score, worker.manifest.joint_score),
            min_joints=site.manifest.min_joints,
        )
        """What counts as a person, by the manifests."""

    @property
    def model_info(self) -> tuple[ModelInfo, ...]:
        """The site network, then the worker network."""
        return self._site.info, self._worker.info

    def detect(self, image_bgr: NDArray[np.uint8]) -> ViewDetections:
        """People, each once, and objects in one image (H, W, 3)."""
        whole, crops = self._find(image_bgr, hints=True)
        size_wh = (image_bgr.shape[1], image_bgr.shape[0])
        people = known_joints(self._refined(whole, crops).joints, size_wh, self.people_options.joint_score)
        kept = distinct_people(people, whole.people.xyxy, self.people_options, hint=whole.hint)
        people, hints = people[kept], np.flatnonzero(whole.hint[kept])
        objects = self._objects(whole, crops, size_wh)
        return ViewDetections(
            people[..., :2], people[..., 2], objects.classes, objects.xyxy, objects.score, objects.keypoints_px, hints
        )

    def people(self, image_bgr: NDArray[np.uint8]) -> People:
        """People in one image (H, W, 3); a joint that is not detected scores 0."""
        return self._refined(*self._find(image_bgr))

    def boxes(self, image_bgr: NDArray[np.uint8]) -> Boxes:
        """People's boxes, and objects with their keypoints, in one image (H, W, 3)."""
        whole, crops = self._find(image_bgr)
        objects = self._objects(whole, crops, (image_bgr.shape[1], image_bgr.shape[0]))
        count = len(whole.person_score)
        return _by_score(
            np.concatenate([whole.people.xyxy, objects.xyxy]),
            np.concatenate([whole.person_score, objects.score]),
            (PERSON,) * count + objects.classes,
            np.concatenate([np.full((count, 4, 2), np.nan), objects.keypoints_px]),
        )

    def _find(self, image_bgr: NDArray[np.uint8], *, hints: bool = False) -> tuple[SiteFindings, WorkerFindings]:
        levels = halves(image_bgr)
        whole = self._site.find(levels, hints=hints)
        return whole, self._worker.find(levels, whole.people.xyxy)

    def _refined(self, whole: SiteFindings, crops: WorkerFindings) -> People:
        coarse = whole.people.joints
        fine = (crops.joints[..., 2] >= self._worker.manifest.joint_score)[..., None]
        seen = (coarse[..., 2] >= self._site.manifest.joint_score)[..., None]
        return People(np.where(fine, crops.joints, np.where(seen, coarse, 0.0)), whole.people.xyxy)

    def _objects(self, whole: SiteFindings, crops: WorkerFindings, size_wh: tuple[int, int]) -> Boxes:
        """All objects, hats of both networks each once."""
        objects = whole.objects
        is_hat = np.array([name == HARD_HAT for name in objects.classes], dtype=bool)
        doubted = _looked_at(objects.xyxy, whole.people.xyxy) & (objects.score < self._worker.manifest.hat_score)
        others, coarse = np.flatnonzero(~is_hat), np.flatnonzero(is_hat & ~doubted)
        high = np.array([*size_wh, *size_wh]) - 0.5
        cut = np.clip(crops.hat_xyxy, -0.5, high)
        best = np.argsort(-crops.hat_score, kind="stable")
        best = best[(cut[best, 2:] > cut[best, :2]).all(axis=1)]
        xyxy = np.concatenate([cut[best], objects.xyxy[coarse]])
        score = np.concatenate([crops.hat_score[best], objects.score[coarse]])
        keypoints = np.concatenate([self._hat_keypoints(cut[best]), objects.keypoints_px[coarse]])
        kept = suppressed(xyxy, _SAME_HAT)
        return _by_score(
            np.concatenate([objects.xyxy[others], xyxy[kept]]),
            np.concatenate([objects.score[others], score[kept]]),
            tuple(objects.classes[idx] for idx in others) + (HARD_HAT,) * len(kept),
            np.concatenate([objects.keypoints_px[others], keypoints[kept]]),
        )

    def _hat_keypoints(self, xyxy: Floats) -> Floats:
        """(H, 4, 2) the middle as the only keypoint, where the site network's hats have one as well."""
        keypoints = np.full((len(xyxy), 4, 2), np.nan)
        if HARD_HAT in self._site.manifest.keypoints:
            keypoints[:, 0] = (xyxy[:, :2] + xyxy[:, 2:]) / 2
        return keypoints


def _looked_at(xyxy: Floats, people_xyxy: Floats) -> Bools:
    """(K,) whether the middle of a box (K, 4) lies in the crop of one of the people (P, 4)."""
    middle = (xyxy[:, None, :2] + xyxy[:, None, 2:]) / 2
    crops = crop_xyxy(people_xyxy + 0.5) - 0.5
    inside = (middle >= crops[:, :2]) & (middle <= crops[:, 2:])
    return np.asarray(np.any(np.all(inside, axis=2), axis=1))


def _by_score(xyxy: Floats, score: Floats, classes: tuple[str, ...], keypoints_px: Floats) -> Boxes:
    order = np.argsort(-score, kind="stable")
    return Boxes(xyxy[order], score[order], tuple(classes[idx] for idx in order), keypoints_px[order])
