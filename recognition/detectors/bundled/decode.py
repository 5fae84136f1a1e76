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
OBJECT_OVERLAP = 0.4
"""Intersection over union above which two boxes of one class of objects are one. In 15 validation sequences of SICSG
629 pairs of boxes of one object overlap by 0.4 or more, and 0.2 is the most that boxes of two do."""
_CANDIDATES = 300
"""Cells per image that go into suppression; a site has at most 18 things, each found by about 10 cells."""


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
    scores: NDArray[np.float32],
    places: NDArray[np.float32],
    *,
    threshold: ArrayLike = 0.05,
    people_overlap: float = 0.6,
    overlap: float = OBJECT_OVERLAP,
) -> SiteDetections:
    """Detections of one image.

    Args:
        scores: (A, C), without the batch axis.
        places: (A, 63).
        threshold: scores below it are no detections; one for all, or (C,) by class.
        people_overlap: of two boxes of class 0 with more intersection over union than this, the lower score goes.
        overlap: the same of the other classes.
    """
    least = np.full(scores.shape[1], threshold, dtype=np.float32)
    flat = scores.reshape(-1)
    likely = np.flatnonzero(flat >= least.min())  # few: only they are held against their own class's threshold
    likely = likely[flat[likely] >= least[likely % len(least)]]
    likely = likely[np.argsort(-flat[likely], kind="stable")[:_CANDIDATES]]
    cell, label = np.divmod(likely, len(least))
    centre, stride = _CENTRES[cell], _STRIDES[cell]
    distances = stride * np.exp(np.clip(places[cell, :4].astype(np.float64), *LOG_DISTANCE))
    boxes = np.concatenate([centre - distances[:, :2], centre + distances[:, 2:]], axis=1)
    kept = suppressed(_apart(boxes, label), np.where(label == 0, people_overlap, overlap))
    raw, centre, stride = places[cell[kept]].astype(np.float64), centre[kept, None], stride[kept, None]
    joints = centre + stride * raw[:, 4:38].reshape(-1, 17, 2)
    visible = 1.0 / (1.0 + np.exp(-np.clip(raw[:, 38:55], -30.0, 30.0)))
    return SiteDetections(
        label[kept],
        flat[likely[kept]].astype(np.float64),
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


def suppressed(boxes: Floats, overlap: ArrayLike) -> Ints:
    """Indices of the boxes (K, 4), best first, that no better one overlaps by more than ``overlap``: of all, or of each
    better one (K,)."""
    alive = np.ones(len(boxes), dtype=bool)
    if len(boxes) > 1:
        distinct = ~(box_iou(boxes, boxes) > np.broadcast_to(overlap, len(boxes))[:, None])
        for idx in range(len(boxes) - 1):
            if alive[idx]:
                alive[idx + 1 :] &= distinct[idx, idx + 1 :]
    return np.flatnonzero(alive)


def _apart(boxes: Floats, group: Ints) -> Floats:
    """Boxes (K, 4) so far from those of other groups (K,) that none of another suppresses them."""
    return boxes + group[:, None] * 1e4


def box_iou(first: Floats, second: Floats) -> Floats:
    """(M, N) intersection over union of boxes (M, 4) and (N, 4); 0 where both are empty."""
    one, other = np.ascontiguousarray(first.T)[:, :, None], np.ascontiguousarray(second.T)[:, None, :]
    shared = _area(*np.maximum(one[:2], other[:2]), *np.minimum(one[2:], other[2:]))
    union = _area(*one) + _area(*other) - shared
    return np.asarray(shared / np.maximum(union, 1e-12))


def _area(left: Floats, top: Floats, right: Floats, bottom: Floats) -> Floats:
    """Of boxes; 0 where they are empty."""
    return np.asarray(np.maximum(right - left, 0.0) * np.maximum(bottom - top, 0.0))


def decode_joints(heat: NDArray[np.float32], states: NDArray[np.float32]) -> Floats:
    """Joints (N, J, 4): x, y in crop pixels, score, and how surely it is visible; of ``heat`` and ``states``.

    The place is the top of a parabola through the logarithm of the highest cell and its neighbours, exact where the
    heat is a Gaussian. The score is how surely the joint is in the crop times the share of the heat in the 3 x 3 cells
    around the highest.
    """
    count, joints, height, width = heat.shape
    row, column = np.divmod(heat.reshape(count, joints, -1).argmax(axis=2), width)
    padded = np.zeros((count, joints, height + 2, width + 2), dtype=np.float32)
    padded[:, :, 1:-1, 1:-1] = heat
    corner = (np.arange(count * joints).reshape(count, joints) * (height + 2) + row) * (width + 2) + column
    three_by_three = np.arange(3)[:, None] * (width + 2) + np.arange(3)
    around = padded.reshape(-1)[corner[..., None, None] + three_by_three]
    cell = np.stack([column, row], axis=-1)
    inside = (cell > 0) & (cell < (width - 1, height - 1))
    top = _parabola(np.stack([around[..., 1, :], around[..., :, 1]], axis=-2))
    place = (cell + np.where(inside, top, 0.0) + 0.5) * WORKER_STRIDE
    score = states[..., 0] * around.sum(axis=(2, 3))
    return np.concatenate([place, score[..., None], states[..., 1:]], axis=-1).astype(np.float64)


def _parabola(three: NDArray[np.float32]) -> NDArray[np.float32]:
    """Where the top lies, -0.5 to 0.5 cells from the middle of (..., 3) values."""
    log = np.log(np.maximum(three, 1e-9))
    bend = log[..., 0] - 2.0 * log[..., 1] + log[..., 2]
    top = 0.5 * (log[..., 0] - log[..., 2]) / np.where(bend < -1e-6, bend, -np.inf)
    return np.clip(top, -0.5, 0.5)


def decode_hats(
    hats: NDArray[np.float32], *, threshold: float = 0.05, overlap: float = 0.5
) -> tuple[tuple[Floats, Floats], ...]:
    """Per crop boxes (K, 4) xyxy in crop pixels and scores (K,) of the hard hats, by falling score; of (N, 5, H, W)."""
    crops = hats.reshape(len(hats), 5, -1)
    who, cell = np.nonzero(crops[:, 0] >= threshold)
    order = np.argsort(-crops[who, 0, cell], kind="stable")[:_CANDIDATES]
    who, found = who[order], crops[who[order], :, cell[order]].astype(np.float64)
    kept = suppressed(_apart(found[:, 1:], who), overlap)
    who, found = who[kept], found[kept]
    return tuple((found[who == crop, 1:], found[who == crop, 0]) for crop in range(len(hats)))
