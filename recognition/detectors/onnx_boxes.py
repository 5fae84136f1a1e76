"""Box networks of any family: fit the image, run, decode, and keep one box per object."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from recognition.detectors.family import BoxFamily
from recognition.detectors.fit import fit_region, whole_image
from recognition.detectors.manifest import BoxManifest
from recognition.detectors.network import Network
from recognition.detectors.protocol import Boxes, ModelInfo
from rigcal.geometry import Floats

_NMS_IOU = 0.45
"""Boxes of one class that overlap more are one object. At 0.65 yolox_nano gave 2.13 boxes per image for two near
people, at 0.45 2.01, with the same recall (100 frames of a real capture)."""


class OnnxBoxDetector:
    """A box network; a :class:`recognition.detectors.BoxDetector`."""

    def __init__(self, network: Network, family: BoxFamily, manifest: BoxManifest, info: ModelInfo) -> None:
        self.model_info = info
        self.person_class = manifest.person_class
        self._network, self._family, self._manifest = network, family, manifest

    def boxes(self, image_bgr: NDArray[np.uint8]) -> Boxes:
        """Boxes in one image (H, W, 3), of at least the manifest's score, one per object."""
        spec = self._manifest.input
        fit = fit_region(image_bgr, whole_image(image_bgr), spec)
        edges, scores = self._family.decode(self._network.run(fit.tensor), spec.size_wh)
        return pick_boxes(
            fit.image_xyxy(edges),
            scores,
            classes=self._manifest.classes,
            size_wh=(image_bgr.shape[1], image_bgr.shape[0]),
            score_threshold=self._manifest.score_threshold,
        )


def pick_boxes(
    xyxy: Floats,
    scores: Floats,
    *,
    classes: tuple[str, ...],
    size_wh: tuple[int, int],
    score_threshold: float,
) -> Boxes:
    """Of all candidates those that score, cut to the image, without the overlapping ones of the same class.

    Args:
        xyxy: (A, 4) candidates in pixels.
        scores: (A, C) of each candidate and class; a candidate is of its best class.
        classes: (C,) names.
        size_wh: of the image.
        score_threshold: candidates below it are left out.
    """
    class_idx = scores.argmax(axis=1)
    score = scores[np.arange(len(scores)), class_idx]
    high = np.array([size_wh[0], size_wh[1]] * 2) - 0.5
    inside = np.clip(xyxy, -0.5, high)
    keep = (score >= score_threshold) & (inside[:, 2:] > inside[:, :2]).all(axis=1)
    inside, score, class_idx = inside[keep], score[keep], class_idx[keep]
    # cv2 separates classes by shifting their boxes apart, which wants coordinates from 0.
    left_top_wh = np.hstack([inside[:, :2] + 0.5, inside[:, 2:] - inside[:, :2]])
    picked = cv2.dnn.NMSBoxesBatched(left_top_wh.tolist(), score.tolist(), class_idx.tolist(), 0.0, _NMS_IOU)
    kept = np.asarray(picked, dtype=np.int64)
    kept = kept[np.argsort(-score[kept], kind="stable")]
    return Boxes(inside[kept], score[kept], tuple(classes[idx] for idx in class_idx[kept]))
