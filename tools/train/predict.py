"""The bundled detector over whole pictures, with thresholds of one's own: what it would find if it were less choosy."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from recognition.detectors.bundled import BundledDetector, load_bundled
from recognition.detectors.bundled.decode import decode_site
from recognition.detectors.bundled.images import site_input
from recognition.detectors.bundled.manifests import HARD_HAT, PERSON
from rigcal.geometry import Floats
from tools.train.coco import DataError
from tools.train.facts import NETWORKS, digests, stem
from tools.train.package import Thresholds, read_toml, write_thresholds

NEVER, ALWAYS = 0.999999, 0.000001
"""Thresholds, which manifests want between 0 and 1, above and below every score."""
_PERSON, _OTHERS = 0.1, 0.05
"""Scores from which on average precision is counted. Each person costs a crop."""


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """What was found in one picture, in edge coordinates of the picture; K detections."""

    classes: NDArray[np.int64]
    """(K,)."""
    scores: Floats
    """(K,)."""
    boxes: Floats
    """(K, 4) xyxy."""
    joints: Floats
    """(K, 17, 3) x, y, score; 0 where the class is not 0."""
    keypoints: Floats
    """(K, 4, 2); NaN where there is none."""


class Networks:
    """Both networks of a folder in one precision, as the runtime composes them."""

    def __init__(self, detector: BundledDetector, classes: tuple[str, ...]) -> None:
        self._detector = detector
        self._number = {name: number for number, name in enumerate(classes)}

    def find(self, image: NDArray[np.uint8]) -> Found:
        """Everything in one picture (H, W, 3) BGR, by falling score."""
        boxes, people = self._detector.boxes(image), self._detector.people(image)
        classes = np.array([self._number[name] for name in boxes.classes], dtype=np.int64)
        joints = np.zeros((len(classes), 17, 3))
        joints[classes == self._number[PERSON]] = people.joints + [0.5, 0.5, 0.0]
        return Found(classes, boxes.score, boxes.xyxy + 0.5, joints, boxes.keypoints_px + 0.5)


class SiteAlone:
    """An exported site network that no worker network helps."""

    def __init__(self, path: Path) -> None:
        """Load an ONNX file.

        Raises:
            DataError: where there is none.
        """
        self._session = session(path)

    def find(self, image: NDArray[np.uint8]) -> Found:
        """Everything in one picture (H, W, 3) BGR, by falling score; joints score by how surely they are visible."""
        fit = site_input(image)
        scores, places = self._session.run(None, {"image": fit.tensor})
        found = decode_site(scores[0], places[0], threshold=_OTHERS)
        joints = np.where((found.classes == 0)[:, None, None], found.joints, 0.0)
        joints[..., :2] = fit.image_px(joints[..., :2]) + 0.5
        height, width = image.shape[:2]
        boxes = np.clip(fit.image_xyxy(found.boxes) + 0.5, 0.0, [width, height, width, height])
        keypoints = fit.image_px(found.keypoints) + 0.5
        return Found(found.classes, found.scores, boxes, joints, keypoints)


def session(path: Path) -> onnxruntime.InferenceSession:
    """A network that runs in one thread.

    Raises:
        DataError: where there is none.
    """
    if not path.is_file():
        raise DataError(
            "there is no network", where=path, expected="an ONNX file", got="no file",
            do_next="Export it first: python -m tools.train export --help.",
        )  # fmt: skip
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])


def classes_of(models: Path, precision: str) -> tuple[str, ...]:
    """Classes of the site network of a folder."""
    return tuple(read_toml(models / f"{stem('site', precision)}.toml")["classes"])


def open_thresholds(models: Path, precision: str) -> Thresholds:
    """So low that average precision can be counted, and every joint has a place.

    From which score on a joint is the worker network's stays as its manifest says.
    """
    worker = read_toml(models / f"{stem('worker', precision)}.toml")
    classes = dict.fromkeys(classes_of(models, precision), _OTHERS) | {PERSON: _PERSON}
    return Thresholds(classes, ALWAYS, worker["joint_score"], _OTHERS)


def crops_alone(models: Path, precision: str) -> Thresholds:
    """As open, with joints and hats of the worker network only."""
    classes = dict.fromkeys(classes_of(models, precision), _OTHERS) | {HARD_HAT: NEVER}
    return Thresholds(classes, NEVER, ALWAYS, _OTHERS)


def load_networks(models: Path, precision: str, thresholds: Thresholds) -> Networks:
    """The networks of a folder with other thresholds than its manifests have.

    Raises:
        DataError: where a file is missing.
        recognition.errors.ModelError: where files and manifests do not fit together.
    """
    digests(models, (precision,))
    with TemporaryDirectory() as place:
        folder = Path(place)
        for network in NETWORKS:
            shutil.copy(models / f"{stem(network, precision)}.onnx", folder)
        write_thresholds(models, precision, thresholds, to=folder)
        detector = load_bundled("int8" if precision == "int8" else "fp32", folder=folder)
    return Networks(detector, classes_of(models, precision))
