"""The worker network at work: joints and hard hats in native-resolution crops around the workers of one image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from recognition.detectors.bundled.decode import decode_hats, decode_joints
from recognition.detectors.bundled.geometry import crop_placing, crop_xyxy
from recognition.detectors.bundled.images import Image, worker_input
from recognition.detectors.bundled.manifests import WorkerManifest
from recognition.detectors.network import Network
from recognition.detectors.protocol import ModelInfo
from recognition.observations import JOINTS
from rigcal.geometry import Floats


@dataclass(frozen=True, slots=True, eq=False)
class WorkerFindings:
    """What the worker network finds around P workers, in pixels of the image."""

    joints: Floats
    """(P, 17, 3) x, y and score; score 0 where the network does not know the joint."""
    hat_xyxy: Floats
    """(H, 4) hard hats of all crops; one that two crops show is there twice."""
    hat_score: Floats
    """(H,)."""


class WorkerNetwork:
    """A worker network with its manifest."""

    def __init__(self, network: Network, manifest: WorkerManifest, info: ModelInfo) -> None:
        self.manifest, self.info = manifest, info
        self._network = network
        self._joints = np.array([JOINTS.index(name) for name in manifest.joints])

    def find(self, levels: tuple[Image, ...], boxes_xyxy: Floats) -> WorkerFindings:
        """Joints and hats of the workers in the boxes (P, 4), in pixels of the image; one run for all.

        Args:
            levels: the image (H, W, 3) and what :func:`~recognition.detectors.bundled.images.halves` makes of it.
            boxes_xyxy: one around each worker.
        """
        image_bgr, *smaller = levels
        joints = np.zeros((len(boxes_xyxy), len(JOINTS), 3))
        if not len(boxes_xyxy):
            return WorkerFindings(joints, np.zeros((0, 4)), np.zeros(0))
        placings = [crop_placing(crop) for crop in crop_xyxy(boxes_xyxy + 0.5)]
        crops = np.stack([worker_input(image_bgr, placing, *smaller) for placing in placings])
        heat, states, hats = self._network.run(crops)
        known, boxes, scores = decode_joints(heat, states)[..., :3], [], []
        found_hats = decode_hats(hats, threshold=self.manifest.hat_score)
        for placing, points, (crop_xyxys, score) in zip(placings, known, found_hats, strict=True):
            points[:, :2] = placing.to_image(points[:, :2]) - 0.5
            boxes.append(placing.to_image(crop_xyxys.reshape(-1, 2, 2)).reshape(-1, 4) - 0.5)
            scores.append(score)
        joints[:, self._joints] = known
        return WorkerFindings(joints, np.concatenate(boxes), np.concatenate(scores))
