"""One-stage people networks of any family: fit the image, run, decode, and keep each person once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from recognition.detectors.family import PeopleFamily
from recognition.detectors.fit import fit_region, whole_image
from recognition.detectors.manifest import PeopleManifest
from recognition.detectors.network import Network
from recognition.detectors.picking import pick
from recognition.detectors.protocol import ModelInfo, People


class OnnxPeopleDetector:
    """A network that finds people with their joints; a :class:`recognition.detectors.PeopleDetector`."""

    def __init__(self, network: Network, family: PeopleFamily, manifest: PeopleManifest, info: ModelInfo) -> None:
        self.model_info = (info,)
        self._network, self._family, self._manifest = network, family, manifest

    def people(self, image_bgr: NDArray[np.uint8]) -> People:
        """People in one image (H, W, 3), of at least the manifest's score, by falling score."""
        spec = self._manifest.input
        fit = fit_region(image_bgr, whole_image(image_bgr), spec)
        edges, score, joints = self._family.decode(self._network.run(fit.tensor), spec.size_wh)
        kept, xyxy = pick(
            fit.image_xyxy(edges),
            score,
            np.zeros(len(score), dtype=np.int64),
            size_wh=(image_bgr.shape[1], image_bgr.shape[0]),
            score_threshold=self._manifest.score_threshold,
        )
        found = joints[kept]
        found[..., :2] = fit.image_px(found[..., :2])
        return People(found, xyxy)
