"""From the bundled networks' outputs to detections; this text is the definition of the outputs.

All coordinates are input pixels counted from the left and top edge of the input. Inputs are ``image``, (N, H, W, 3)
uint8 in BGR order: nothing is to be scaled or transposed outside the network.

**Site network**, N = 1, H, W = 288, 512. Cells stand at strides 8, 16 and 32: 64 x 36, 32 x 18 and 16 x 9 of them,
A = 3024 in this order, row by row. One row per cell:

    scores (1, A, C)       0..1 per class; class 0 is ``person``
    places (1, A, 63)      in units of the cell's stride s, from its centre (x, y):
         0..3              logarithms of the distances to the left, top, right and bottom of what is visible:
                           left = x - s exp(places[0]), of whatever class scores highest
         4..37             17 joints of a person, COCO-17 order: joint x = x + s places[4], y = y + s places[5], ...
                           joints that something hides have a position all the same
        38..54             per joint how surely it is visible, before the logistic function
        55..62             4 keypoints of an object, as the joints: the canonical order of its category; a category with
                           fewer uses the first ones

Only cells that score are worth decoding, hence this is left to the reader.

**Worker network**, any N, H, W = 128, 96 around one worker each (``geometry.crop_xyxy``). Cells stand at stride 4:
32 x 24; the centre of cell (row, column) is at (4 column + 2, 4 row + 2). J joints, 17 or those of the manifest:

    heat (N, J, 32, 24)    where the joint is: sums to 1 over the cells of each joint
    states (N, J, 2)       how surely the joint is in the crop, and visible (0..1 each)
    hats (N, 5, 32, 24)    for a hard hat whose middle is in this cell: score 0..1, and its box left, top, right, bottom
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from recognition.detectors.bundled.geometry import SITE_STRIDES, SITE_WH, WORKER_STRIDE, WORKER_WH
from rigcal.geometry import Floats, Ints

SITE_OUTPUTS = ("scores", "places")
WORKER_OUTPUTS = ("heat", "states", "hats")
LOG_DISTANCE = (-6.0, 4.5)
"""Least and greatest logarithm of a distance over the stride."""
_PLACES = 4 + 34 + 17 + 8
_CANDIDATES = 300
"""Cells per input that go into suppression; a site has at most 18 things, each found by about 10 cells."""


@dataclass(frozen=True, slots=True, eq=False)
class SiteDetections:
    """What the site network finds in one image, by falling score."""

    classes: Ints
    """(K,)."""
    scores: Floats
    """(K,)."""
    boxes: Floats
    """(K, 4) xyxy."""
    joints: Floats
    """(K, 17, 3) x, y, visibility; means nothing unless the class is 0."""
    keypoints: Floats
    """(K, 4, 2)."""


def site_shapes(classes: int) -> tuple[tuple[int, ...], ...]:
    """Shapes of the site network's outputs."""
    return (1, len(_CENTRES), classes), (1, len(_CENTRES), _PLACES)


def worker_shapes(crops: int, joints: int) -> tuple[tuple[int, ...], ...]:
    """Shapes of the worker network's outputs for some crops."""
    cells = (WORKER_WH[1] // WORKER_STRIDE, WORKER_WH[0] // WORKER_STRIDE)
    return (crops, joints, *cells), (crops, joints, 2), (crops, 5, *cells)


def decode_site(
    scores: NDArray[np.float32], places: NDArray[np.float32], *, threshold: ArrayLike = 0.05, overlap: float = 0.6
) -> SiteDetections:
    """Detections of one image.

    Args:
        scores: (A, C), without the batch axis.
        places: (A, 63).
        threshold: scores below it are no detections; one for all, or (C,) by class.
        overlap: of two boxes of a class with more intersection over union than this, the lower score goes.
    """
    cell, label = np.nonzero(scores >= np.asarray(threshold, dtype=np.float32))
    score = scores[cell, label].astype(np.float64)
    order = np.argsort(-score, kind="stable")[:_CANDIDATES]
    cell, label, score = cell[order], label[order], score[order]
    raw, centre, stride = places[cell].astype(np.float64), _CENTRES[cell], _STRIDES[cell]
    distances = stride * np.exp(np.clip(raw[:, :4], *LOG_DISTANCE))
    boxes = np.concatenate([centre - distances[:, :2], centre + distances[:, 2:]], axis=1)
    kept = suppressed(boxes + label[:, None] * 1e4, overlap)
    raw, centre, stride = raw[kept], centre[kept, None], stride[kept, None]
    joints = centre + stride * raw[:, 4:38].reshape(-1, 17, 2)
    visible = 1.0 / (1.0 + np.exp(-np.clip(raw[:, 38:55], -30.0, 30.0)))
    return SiteDetections(
        label[kept],
        score[kept],
        boxes[kept],
        np.concatenate([joints, visible[..., None]], axis=-1),
        centre + stride * raw[:, 55:].reshape(-1, 4, 2),
    )


def site_cells() -> tuple[Floats, Floats]:
    """Centres (A, 2) and strides (A, 1) of the site network's cells."""
    centres, strides = [], []
    for stride in SITE_STRIDES:
        rows, columns = np.mgrid[: SITE_WH[1] // stride, : SITE_WH[0] // stride]
        centres.append((np.stack([columns, rows], axis=-1).reshape(-1, 2) + 0.5) * stride)
        strides.append(np.full((rows.size, 1), float(stride)))
    return np.concatenate(centres), np.concatenate(strides)


_CENTRES, _STRIDES = site_cells()


def suppressed(boxes: Floats, overlap: float) -> Ints:
    """Indices of the boxes (K, 4), best first, that no better one overlaps by more than ``overlap``."""
    alive = np.ones(len(boxes), dtype=bool)
    shared = box_iou(boxes, boxes) > overlap if len(boxes) > 1 else np.zeros((1, 1), dtype=bool)
    for idx in range(len(boxes)):
        if alive[idx]:
            alive[idx + 1 :] &= ~shared[idx, idx + 1 :]
    return np.flatnonzero(alive)


def box_iou(first: Floats, second: Floats) -> Floats:
    """(M, N) intersection over union of boxes (M, 4) and (N, 4); 0 where both are empty."""
    low = np.maximum(first[:, None, :2], second[None, :, :2])
    high = np.minimum(first[:, None, 2:], second[None, :, 2:])
    shared = np.clip(high - low, 0.0, None).prod(axis=2)
    areas = [np.clip(boxes[:, 2:] - boxes[:, :2], 0.0, None).prod(axis=1) for boxes in (first, second)]
    union = areas[0][:, None] + areas[1][None, :] - shared
    return np.asarray(shared / np.maximum(union, 1e-12))


def decode_joints(heat: NDArray[np.float32], states: NDArray[np.float32]) -> Floats:
    """Joints (N, J, 4): x, y in crop pixels, score, and how surely it is visible; of ``heat`` and ``states``.

    The place is the top of a parabola through the logarithm of the highest cell and its neighbours, exact where the
    heat is a Gaussian. The score is how surely the joint is in the crop times the share of the heat in the 3 x 3 cells
    around the highest.
    """
    count, joints, height, width = heat.shape
    flat = heat.reshape(count, joints, -1)
    row, column = np.divmod(flat.argmax(axis=2), width)
    padded = np.pad(heat, ((0, 0), (0, 0), (1, 1), (1, 1)), constant_values=0.0)
    who = np.ix_(np.arange(count), np.arange(joints))
    around = np.stack([np.stack([padded[(*who, row + dy, column + dx)] for dx in range(3)], -1) for dy in range(3)], -2)
    place = np.stack(
        [
            column + _parabola(around[..., 1, :], column, width) + 0.5,
            row + _parabola(around[..., :, 1], row, height) + 0.5,
        ],
        axis=-1,
    )
    score = states[..., 0] * around.sum(axis=(2, 3))
    return np.concatenate([place * WORKER_STRIDE, score[..., None], states[..., 1:]], axis=-1).astype(np.float64)


def _parabola(three: NDArray[np.float32], place: Ints, size: int) -> Floats:
    """Where the top lies, -0.5 to 0.5 cells from the middle of (..., 3) values; 0 at the border of the grid."""
    log = np.log(np.maximum(three, 1e-9))
    bend = log[..., 0] - 2.0 * log[..., 1] + log[..., 2]
    top = 0.5 * (log[..., 0] - log[..., 2]) / np.where(bend < -1e-6, bend, -np.inf)
    inside = (place > 0) & (place < size - 1)
    return np.where(inside, np.clip(top, -0.5, 0.5), 0.0)


def decode_hats(
    hats: NDArray[np.float32], *, threshold: float = 0.05, overlap: float = 0.5
) -> tuple[tuple[Floats, Floats], ...]:
    """Per crop boxes (K, 4) xyxy in crop pixels and scores (K,) of the hard hats, by falling score; of (N, 5, H, W)."""
    found = []
    for crop in hats:
        row, column = np.nonzero(crop[0] >= threshold)
        score = crop[0, row, column].astype(np.float64)
        order = np.argsort(-score, kind="stable")[:_CANDIDATES]
        boxes = crop[1:, row[order], column[order]].T.astype(np.float64)
        kept = suppressed(boxes, overlap)
        found.append((boxes[kept], score[order][kept]))
    return tuple(found)
