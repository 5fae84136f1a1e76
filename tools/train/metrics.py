"""Average precision as COCO counts it, over boxes or over joints.

Lin et al., Microsoft COCO, and the evaluation code that it points to: detections by falling score, each matched to the
free truth with the highest similarity of at least a threshold, one that is asked for before one that is ignored; what
matches an ignored truth does not count; precision, made falling, is averaged over 101 recalls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

SIGMAS = np.array([26, 25, 25, 35, 35, 79, 79, 72, 72, 62, 62, 107, 107, 87, 87, 89, 89]) / 1000
"""COCO's spread of annotators per joint, over the square root of the person's area."""
AREA_OF_BOX = 0.53
"""A person's area over that of the box, as is usual where there is no outline."""
THRESHOLDS = tuple(float(x) for x in np.arange(0.5, 0.96, 0.05).round(2))
_RECALLS = np.linspace(0.0, 1.0, 101)


@dataclass(frozen=True, slots=True, eq=False)
class Scored:
    """Detections and truths of one class in one image."""

    scores: Floats
    """(D,)."""
    similarity: Floats
    """(D, T) intersection over union, or joint similarity."""
    ignored: Bools
    """(T,) truths that are not asked for."""
    outside: Bools
    """(D,) detections that are no errors where they match nothing: of a size that is not asked for."""


def average_precision(images: Sequence[Scored], threshold: float) -> float:
    """Average precision at one threshold; NaN where nothing is asked for."""
    asked = sum(int((~image.ignored).sum()) for image in images)
    if asked == 0:
        return float("nan")
    scores, hits, counted = [], [], []
    for image in images:
        hit, count = matched(image, threshold)
        scores.append(image.scores)
        hits.append(hit)
        counted.append(count)
    keep = np.concatenate(counted)
    order = np.argsort(-np.concatenate(scores)[keep], kind="stable")
    hit = np.concatenate(hits)[keep][order]
    if not len(hit):
        return 0.0
    recall = np.cumsum(hit) / asked
    precision = np.cumsum(hit) / np.arange(1, len(hit) + 1)
    falling = np.append(np.maximum.accumulate(precision[::-1])[::-1], 0.0)
    return float(falling[np.searchsorted(recall, _RECALLS - 1e-12, side="left")].mean())


def matched(image: Scored, threshold: float) -> tuple[Bools, Bools]:
    """(D,) whether each detection is a hit, and whether it counts."""
    hit, counts = np.zeros(len(image.scores), dtype=bool), ~image.outside
    free = np.ones(len(image.ignored), dtype=bool)
    for idx in np.argsort(-image.scores, kind="stable"):
        near = free & (image.similarity[idx] >= threshold)
        for group in (near & ~image.ignored, near & image.ignored):
            if group.any():
                best = int(np.where(group, image.similarity[idx], -1.0).argmax())
                free[best] = False
                hit[idx] = counts[idx] = not image.ignored[best]
                break
    return hit, counts


def joint_similarity(found: Floats, truth: Floats, sizes: Floats) -> Floats:
    """(D, T) object keypoint similarity of joints (D, 17, 2+) and labelled joints (T, 17, 3).

    Args:
        found: x, y in pixels.
        truth: x, y and a flag; joints of flag 0 do not count. Without any the similarity is 0.
        sizes: (T,) square root of the area of each person's box in pixels.
    """
    distance = ((found[:, None, :, :2] - truth[None, :, :, :2]) ** 2).sum(axis=-1)
    spread = 2.0 * AREA_OF_BOX * sizes[None, :, None] ** 2 * (2.0 * SIGMAS) ** 2
    known = truth[None, :, :, 2] > 0
    similarity = np.where(known, np.exp(-distance / spread), 0.0).sum(axis=-1)
    return np.asarray(similarity / np.maximum(known.sum(axis=-1), 1))
