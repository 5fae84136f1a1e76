"""Box networks of any family: fit the image, run, decode, and keep one box per object."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from recognition.detectors.family import BoxFamily
from recognition.detectors.fit import fit_region, whole_image
from recognition.detectors.manifest import BoxManifest
from recognition.detectors.network import Network
from recognition.detectors.picking import pick
from recognition.detectors.protocol import Boxes, ModelInfo
from rigcal.geometry import Floats


class OnnxBoxDetector:
    """A box network; a :class:`recognition.detectors.BoxDetector`."""

    def __init__(self, network: Network, family: BoxFamily, manifest: BoxManifest, info: ModelInfo) -> None:
        self.model_info = (info,)
        self.person_class = manifest.person_name
        self._network, self._family, self._manifest = network, family, manifest

    def boxes(self, image_bgr: NDArray[np.uint8]) -> Boxes:
        """Boxes in one image (H, W, 3), of at least the manifest's score, one per object."""
        spec = self._manifest.input
        fit = fit_region(image_bgr, whole_image(image_bgr), spec)
        edges, scores = self._family.decode(self._network.run(fit.tensor), spec.size_wh)
        return pick_boxes(
            fit.image_xyxy(edges),
            scores,
            classes=self._manifest.names,
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
        classes: (C,) names; classes of one name are one class.
        size_wh: of the image.
        score_threshold: candidates below it are left out.
    """
    likely = scores.max(axis=1) >= score_threshold  # few, so that the best class is looked for in few
    best, score = scores[likely].argmax(axis=1), scores[likely].max(axis=1)
    number = np.array([classes.index(name) for name in classes])
    kept, inside = pick(xyxy[likely], score, number[best], size_wh=size_wh, score_threshold=score_threshold)
    return Boxes(inside, score[kept], tuple(classes[idx] for idx in best[kept]))
