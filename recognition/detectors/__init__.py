"""Detectors: people and objects in one camera's image, by ONNX networks that manifests describe.

Use :func:`load_detector` for a ready detector, :func:`load_model` for one network. Any other object that has
:class:`Detector`'s two members serves the runtime as well.
"""

from recognition.detectors.loading import BOX_FAMILIES, POSE_FAMILIES, load_detector, load_model
from recognition.detectors.people import PeopleAndObjects, PeopleOptions
from recognition.detectors.protocol import BoxDetector, Boxes, Detector, ModelInfo, PoseEstimator

__all__ = [
    "BOX_FAMILIES",
    "POSE_FAMILIES",
    "BoxDetector",
    "Boxes",
    "Detector",
    "ModelInfo",
    "PeopleAndObjects",
    "PeopleOptions",
    "PoseEstimator",
    "load_detector",
    "load_model",
]
