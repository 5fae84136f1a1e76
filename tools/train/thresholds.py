"""Chooses from which score on something counts as found, on validation pictures.

Rules: each class, and the hard hats of crops, at the score of the best F1 of boxes that overlap the truth by half.
Joints at the score of the best F1 of joints at the right place: of people whose boxes are found, a joint in the picture
(hidden or not) is right where its similarity, COCO's of a single joint, is one half or more; one that is given inside
the picture though the truth has none there is wrong. Each network is judged alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from recognition.detectors.bundled.manifests import HARD_HAT
from rigcal.geometry import Bools, Floats
from tools.train.coco import DataSet
from tools.train.evaluate import Result, decoded, run, scored_boxes
from tools.train.facts import stem
from tools.train.metrics import AREA_OF_BOX, SIGMAS, Scored, matched
from tools.train.package import Thresholds, preliminary
from tools.train.predict import SiteAlone, classes_of, crops_alone, load_networks

_STEPS = 10_000
"""Thresholds are rounded down to so many parts of 1, lest what is at the threshold be lost."""
_LEAST, _MOST = 0.05, 0.95


@dataclass(frozen=True, slots=True)
class Choice:
    """A threshold and what it brings."""

    threshold: float
    f1: float
    precision: float
    recall: float


def best_cut(scores: Floats, hits: Bools, asked: int) -> Choice | None:
    """The threshold of the best F1 in the middle between the scores around it; None where nothing was asked or found.

    Args:
        scores: (D,) of what was found and counts.
        hits: (D,) whether it is right; each truth at most once.
        asked: number of truths.
    """
    if asked == 0 or not hits.any():
        return None
    order = np.argsort(-scores, kind="stable")
    score, right = scores[order], np.cumsum(hits[order])
    taken = np.arange(1, len(score) + 1)
    below = np.append(score[1:], score[-1])
    f1 = np.where(np.append(score[1:] < score[:-1], True), 2 * right / (taken + asked), -1.0)
    best = int(f1.argmax())
    threshold = float(np.floor(np.clip((score[best] + below[best]) / 2, _LEAST, _MOST) * _STEPS) / _STEPS)
    return Choice(threshold, float(f1[best]), float(right[best] / taken[best]), float(right[best] / asked))


def choice_of_boxes(images: Sequence[Scored]) -> Choice | None:
    """The best threshold of boxes of one class."""
    pairs = [matched(image, 0.5) for image in images]
    if not pairs:
        return None
    counts = np.concatenate([count for _, count in pairs])
    scores = np.concatenate([image.scores for image in images])[counts]
    hits = np.concatenate([hit for hit, _ in pairs])[counts]
    return best_cut(scores, hits, sum(int((~image.ignored).sum()) for image in images))


def choice_of_joints(results: Sequence[Result]) -> Choice | None:
    """The best threshold of joints of people who are found."""
    scores, hits, asked = [np.zeros(0)], [np.zeros(0, dtype=bool)], 0
    for result in results:
        truth = result.picture.truth.picked(result.picture.truth.classes == 0)
        joints = result.found.joints[result.found.classes == 0]
        boxes = scored_boxes(result, 0)
        for who in np.flatnonzero(~boxes.ignored) if len(joints) else ():
            best = int(boxes.similarity[:, who].argmax())
            if boxes.similarity[best, who] >= 0.5:
                known = truth.points[who, :, 2] > 0
                right = known & _near(joints[best], truth.points[who], float(truth.sizes()[who]))
                given = known | _inside(joints[best], result.picture.size_wh)
                scores.append(joints[best, given, 2])
                hits.append(right[given])
                asked += int(known.sum())
    return best_cut(np.concatenate(scores), np.concatenate(hits), asked)


def _near(joints: Floats, truth: Floats, size: float) -> Bools:
    spread = 2.0 * AREA_OF_BOX * size**2 * (2.0 * SIGMAS) ** 2
    square = ((joints[:, :2] - truth[:, :2]) ** 2).sum(axis=1)
    return np.asarray(np.exp(-square / spread) >= 0.5)


def _inside(joints: Floats, size_wh: tuple[int, int]) -> Bools:
    return np.asarray(((joints[:, :2] >= 0) & (joints[:, :2] <= size_wh)).all(axis=1))


def choose(
    models: Path, precision: str, data: DataSet, say: Callable[[str], None]
) -> tuple[Thresholds, dict[str, Any]]:
    """Thresholds of both networks of a precision, and what each brings."""
    names = classes_of(models, precision)
    crops, _ = run(load_networks(models, precision, crops_alone(models, precision)), decoded(data), say)
    whole, _ = run(SiteAlone(models / f"{stem('site', precision)}.onnx"), decoded(data), say)
    choices: dict[str, Choice | None] = {
        name: choice_of_boxes([scored_boxes(result, label) for result in whole]) for label, name in enumerate(names)
    }
    in_crops = {
        "hat": choice_of_boxes([scored_boxes(result, names.index(HARD_HAT)) for result in crops]),
        "worker_joint": choice_of_joints(crops),
        "site_joint": choice_of_joints(whole),
    }
    start = preliminary(names)

    def cut(choice: Choice | None, otherwise: float) -> float:
        return otherwise if choice is None else choice.threshold

    chosen = Thresholds(
        {name: cut(choices[name], start.classes[name]) for name in names},
        cut(in_crops["site_joint"], start.site_joint),
        cut(in_crops["worker_joint"], start.worker_joint),
        cut(in_crops["hat"], start.hat),
    )
    return chosen, {"pictures": len(data.pictures), "classes": _rows(choices), "others": _rows(in_crops)}


def _rows(choices: dict[str, Choice | None]) -> dict[str, Any]:
    return {
        name: None
        if choice is None
        else {
            "threshold": choice.threshold, "f1": choice.f1, "precision": choice.precision, "recall": choice.recall,
        }
        for name, choice in choices.items()
    }  # fmt: skip
