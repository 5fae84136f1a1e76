"""What a detector is: an image in, people and objects in pixels out.

A ``Detector`` is all that the runtime knows. Three narrower kinds are composed into one by
:mod:`recognition.detectors.composition`: a ``BoxDetector`` finds boxes with classes, a ``PoseEstimator`` finds the
joints of one person per box, and a ``PeopleDetector`` finds people with their joints at once.

All pixels are distorted, of the full image; pixel (0, 0) is the centre of the top-left pixel, so that the image of
width W spans -0.5 to W - 0.5. Images are (H, W, 3) uint8 in BGR order, as OpenCV has them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from recognition.observations import ViewDetections
from rigcal.geometry import Floats, freeze


@dataclass(frozen=True, slots=True)
class ModelInfo:
    """Which network gave a result; for the provenance of a recording."""

    name: str
    """File name of the ONNX file, without folders."""
    sha256: str
    """SHA-256 of the ONNX file, hexadecimal."""
    family: str
    """Which adapter reads its output."""
    licence: str
    """As the manifest states it."""
    notice: str = ""
    """What whoever uses a result of this network must know; empty where there is nothing."""
    manifest_sha256: str = ""
    """SHA-256 of what the manifest says, thresholds among it, hexadecimal."""


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """What a box network found in one image, by falling score."""

    xyxy: Floats
    """(K, 4) left, top, right, bottom in pixels, within the image."""
    score: Floats
    """(K,) scores, 0..1."""
    classes: tuple[str, ...]
    """(K,) class of each box."""
    keypoints_px: Floats = field(default_factory=lambda: np.zeros((0, 4, 2)))
    """(K, 4, 2) as of :attr:`recognition.observations.ViewDetections.object_keypoints_px`."""

    def __post_init__(self) -> None:
        count = len(self.classes)
        if len(self.keypoints_px) == 0:
            object.__setattr__(self, "keypoints_px", np.full((count, 4, 2), np.nan))
        freeze(self, np.float64, xyxy=(count, 4), score=(count,), keypoints_px=(count, 4, 2))


@dataclass(frozen=True, slots=True, eq=False)
class People:
    """People whom a network found in one image, with every joint, however low its score; COCO-17 order."""

    joints: Floats
    """(P, 17, 3) joints: x, y in pixels of the full image, score 0..1."""
    xyxy: Floats
    """(P, 4) box of each: left, top, right, bottom in pixels, within the image."""

    def __post_init__(self) -> None:
        count = len(self.joints)
        freeze(self, np.float64, joints=(count, 17, 3), xyxy=(count, 4))


class BoxDetector(Protocol):
    """Finds boxes with classes."""

    @property
    def model_info(self) -> tuple[ModelInfo, ...]:
        """Every network that takes part."""
        ...

    @property
    def person_class(self) -> str | None:
        """The class whose boxes are people; None where the network finds no people."""
        ...

    def boxes(self, image_bgr: NDArray[np.uint8]) -> Boxes:
        """Boxes in one image (H, W, 3)."""
        ...


class PoseEstimator(Protocol):
    """Finds the joints of one person per box."""

    @property
    def model_info(self) -> tuple[ModelInfo, ...]:
        """Every network that takes part."""
        ...

    def poses(self, image_bgr: NDArray[np.uint8], boxes_xyxy: Floats) -> Floats:
        """Joints (P, 17, 3) of the people in the boxes (P, 4): x, y in pixels of the full image, score 0..1.

        Every joint is given, however low its score; COCO-17 order.
        """
        ...


class PeopleDetector(Protocol):
    """Finds people with their joints in one run over the image."""

    @property
    def model_info(self) -> tuple[ModelInfo, ...]:
        """Every network that takes part."""
        ...

    def people(self, image_bgr: NDArray[np.uint8]) -> People:
        """People in one image (H, W, 3)."""
        ...


class Detector(Protocol):
    """Finds people and objects in one camera's image."""

    @property
    def model_info(self) -> tuple[ModelInfo, ...]:
        """Every network that takes part."""
        ...

    def detect(self, image_bgr: NDArray[np.uint8]) -> ViewDetections:
        """People and objects in one image (H, W, 3); several threads may call it at once."""
        ...
