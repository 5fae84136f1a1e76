"""The site network at work: people with coarse joints, and objects with keypoints, in the whole image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from recognition.detectors.bundled.decode import SiteDetections, decode_site
from recognition.detectors.bundled.images import Image, site_input
from recognition.detectors.bundled.manifests import SiteManifest
from recognition.detectors.fit import Fit
from recognition.detectors.network import Network
from recognition.detectors.protocol import Boxes, ModelInfo, People
from rigcal.geometry import Bools, Floats


@dataclass(frozen=True, slots=True, eq=False)
class SiteFindings:
    """What the site network finds in one image, in pixels of the image."""

    people: People
    """Joints score by how surely they are visible."""
    person_score: Floats
    """(P,) of each person."""
    hint: Bools
    """(P,) whose score is too low to count alone."""
    objects: Boxes
    """All other classes."""


class SiteNetwork:
    """A site network with its manifest."""

    def __init__(self, network: Network, manifest: SiteManifest, info: ModelInfo) -> None:
        self.manifest, self.info = manifest, info
        self._network = network
        self._thresholds = np.array([manifest.score_thresholds[name] for name in manifest.classes])
        self._with_hints = self._thresholds.copy()
        self._with_hints[0] = manifest.hint_score or self._thresholds[0]
        counts = np.array([manifest.keypoints.get(name, 0) for name in manifest.classes])
        self._has_keypoint = np.arange(4) < counts[:, None]

    def find(self, levels: tuple[Image, ...], *, hints: bool = False) -> SiteFindings:
        """People and objects in one image, of at least their class's score, boxes cut to the image.

        Args:
            levels: the image (H, W, 3) and what :func:`~recognition.detectors.bundled.images.halves` makes of it.
            hints: Whether people of the manifest's ``hint_score`` are given too.
        """
        fit = site_input(*levels)
        scores, places = self._network.run(fit.tensor)
        found = decode_site(scores[0], places[0], threshold=self._with_hints if hints else self._thresholds)
        high = np.array(levels[0].shape[1::-1]) - 0.5
        xyxy = np.clip(fit.image_xyxy(found.boxes), -0.5, [*high, *high])
        real = (xyxy[:, 2:] > xyxy[:, :2]).all(axis=1)
        people, things = np.flatnonzero(real & (found.classes == 0)), np.flatnonzero(real & (found.classes > 0))
        joints = found.joints[people]
        joints[..., :2] = fit.image_px(joints[..., :2])
        objects = Boxes(
            xyxy[things],
            found.scores[things],
            tuple(self.manifest.classes[label] for label in found.classes[things]),
            self._keypoints_px(found, fit, high)[things],
        )
        score = found.scores[people]
        return SiteFindings(People(joints, xyxy[people]), score, score < self._thresholds[0], objects)

    def _keypoints_px(self, found: SiteDetections, fit: Fit, high: Floats) -> Floats:
        """(K, 4, 2) keypoints; NaN where the class has none, or outside the image."""
        keypoints_px = fit.image_px(found.keypoints)
        inside = ((keypoints_px >= -0.5) & (keypoints_px <= high)).all(axis=-1)
        return np.where((inside & self._has_keypoint[found.classes])[..., None], keypoints_px, np.nan)
