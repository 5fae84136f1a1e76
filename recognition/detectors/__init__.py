"""Detectors: people and objects in one camera's image, by ONNX networks that manifests describe.

Use :func:`load_bundled` for the networks that come with the package, :func:`load_detector` for networks of your own,
or both kinds together, :func:`load_model` for one network. Any other object that has
:class:`Detector`'s two members serves the runtime as well.
"""

from recognition.detectors.bundled import BundledDetector, load_bundled
from recognition.detectors.composition import OneStagePeople, PeopleAndObjects
from recognition.detectors.families import BOX_FAMILIES, PEOPLE_FAMILIES, POSE_FAMILIES
from recognition.detectors.loading import load_detector, load_model
from recognition.detectors.people import PeopleOptions
from recognition.detectors.protocol import (
    BoxDetector,
    Boxes,
    Detector,
    ModelInfo,
    People,
    PeopleDetector,
    PoseEstimator,
)

__all__ = [
    "BOX_FAMILIES",
    "PEOPLE_FAMILIES",
    "POSE_FAMILIES",
    "BoxDetector",
    "Boxes",
    "BundledDetector",
    "Detector",
    "ModelInfo",
    "OneStagePeople",
    "People",
    "PeopleAndObjects",
    "PeopleDetector",
    "PeopleOptions",
    "PoseEstimator",
    "load_bundled",
    "load_detector",
    "load_model",
]
