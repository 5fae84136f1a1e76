"""Pose networks of any family: one crop per person box."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from recognition.detectors.family import PoseFamily
from recognition.detectors.fit import fit_region
from recognition.detectors.manifest import PoseManifest
from recognition.detectors.network import Network
from recognition.detectors.protocol import ModelInfo
from recognition.observations import JOINTS
from rigcal.geometry import Floats, Ints


class OnnxPoseEstimator:
    """A pose network; a :class:`recognition.detectors.PoseEstimator`.

    The crop shows the box, grown by the manifest's margin, and nothing beside it: a network that looks for one
    person otherwise finds the neighbour; unless the family's networks were trained on crops of the input's aspect.
    Where it leaves the image it is padded, not shifted, so that the person stays in its middle.
    """

    def __init__(self, network: Network, family: PoseFamily, manifest: PoseManifest, info: ModelInfo) -> None:
        self.model_info = (info,)
        self._network, self._family, self._manifest = network, family, manifest

    def poses(self, image_bgr: NDArray[np.uint8], boxes_xyxy: Floats) -> Floats:
        """Joints (P, 17, 3) of the people in the boxes (P, 4): x, y in pixels of the full image, score 0..1."""
        width, height = self._manifest.input.size_wh
        aspect = width / height if self._family.fills_input else None
        found = np.empty((len(boxes_xyxy), len(JOINTS), 3))
        for box, pose in zip(boxes_xyxy, found, strict=True):
            spec = self._manifest.input
            fit = fit_region(image_bgr, crop_region(box, self._manifest.crop_margin, aspect), spec)
            joints = self._family.decode(self._network.run(fit.tensor), spec.size_wh)
            pose[:, :2], pose[:, 2] = fit.image_px(joints[:, :2]), joints[:, 2]
        return found


def crop_region(box_xyxy: Floats, margin: float, aspect: float | None = None) -> Ints:
    """(4,) edges of the crop in whole pixels: the box (4,) in pixels, ``margin`` times as large about its centre.

    With an ``aspect``, width over height, the shorter side is then lengthened to it.
    """
    centre = (box_xyxy[:2] + box_xyxy[2:]) / 2 + 0.5
    half = (box_xyxy[2:] - box_xyxy[:2]) * margin / 2
    if aspect is not None:
        half = np.maximum(half, half[::-1] * (aspect, 1 / aspect))
    low, high = np.rint(centre - half).astype(int), np.rint(centre + half).astype(int)
    return np.concatenate([low, np.maximum(high, low + 1)])
