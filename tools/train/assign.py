"""Which cells of the site network answer for which annotation: task-aligned assignment.

Feng et al., TOOD: Task-aligned One-stage Object Detection, equations 2 and 3: the cells whose score^alpha * IoU^beta is
highest, and a target score that grows with it. Exponents and the number of cells as in Ultralytics YOLOv8.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from recognition.detectors.bundled.geometry import SITE_STRIDES
from tools.train.samples import Batch

_ALPHA, _BETA, _CELLS = 0.5, 6.0, 10
_LEAST_HALF = 0.75
"""Half side, in the finest cells, that every box has at least when cells inside it are sought: a box smaller than a
cell may hold no centre."""


@dataclass(frozen=True, slots=True, eq=False)
class Assignment:
    """P pairs of an annotation and a cell."""

    annotation: Tensor
    """(P,) into the batch's annotations."""
    cell: Tensor
    """(P,)."""
    quality: Tensor
    """(P,) target score, 0..1."""


@torch.no_grad()
def assign(scores: Tensor, boxes: Tensor, centres: Tensor, strides: Tensor, batch: Batch) -> Assignment:
    """Pairs for the annotations that are not ignored; a cell answers for one at most.

    Args:
        scores: (N, A, C) predicted, 0..1.
        boxes: (N, A, 4) predicted.
        centres: (A, 2) of the cells.
        strides: (A, 1) of the cells.
        batch: annotations.
    """
    asked = torch.nonzero(~batch.ignore)[:, 0]
    if not len(asked):
        none = torch.zeros(0, dtype=torch.long)
        return Assignment(none, none, torch.zeros(0))
    image, truth = batch.image_idx[asked], batch.boxes[asked]
    iou = pair_iou(truth[:, None, :], boxes[image])
    metric = scores[image, :, batch.classes[asked]].clamp(min=1e-6) ** _ALPHA * iou**_BETA
    inside = _inside(truth, centres, strides)
    middle = (truth[:, None, :2] + truth[:, None, 2:]) / 2
    nearness = 1.0 / (1.0 + (centres - middle).abs().sum(-1) / strides[:, 0])
    metric = (metric + 1e-9 * nearness) * inside
    best, cell = metric.topk(min(_CELLS, metric.shape[1]), dim=1)
    row = torch.arange(len(asked))[:, None].expand_as(cell)[best > 0]
    cell, best = cell[best > 0], best[best > 0]
    overlap = iou[row, cell] + 1e-6 * nearness[row, cell]
    place = image[row] * len(centres) + cell
    highest = torch.zeros(len(scores) * len(centres)).scatter_reduce(0, place, overlap, "amax")
    kept = overlap >= highest[place]
    row, cell, best, overlap = row[kept], cell[kept], best[kept], overlap[kept]
    top = torch.zeros(len(asked)).scatter_reduce(0, row, best, "amax")
    top_iou = torch.zeros(len(asked)).scatter_reduce(0, row, overlap, "amax")
    quality = (best / top[row] * top_iou[row]).clamp(0.0, 1.0)
    return Assignment(asked[row], cell, quality)


def ignored_cells(centres: Tensor, strides: Tensor, batch: Batch) -> tuple[Tensor, Tensor, Tensor]:
    """Images, cells and classes of which nothing is asked, because an ignored annotation lies there."""
    rows = torch.nonzero(batch.ignore)[:, 0]
    row, cell = torch.nonzero(_inside(batch.boxes[rows], centres, strides), as_tuple=True)
    return batch.image_idx[rows][row], cell, batch.classes[rows][row]


def _inside(boxes: Tensor, centres: Tensor, strides: Tensor) -> Tensor:
    """(G, A) whether the centre of a cell lies in a box."""
    middle, half = (boxes[:, None, :2] + boxes[:, None, 2:]) / 2, (boxes[:, None, 2:] - boxes[:, None, :2]) / 2
    least = torch.where(strides == SITE_STRIDES[0], _LEAST_HALF * SITE_STRIDES[0], 0.0)
    return ((centres - middle).abs() <= torch.maximum(half, least)).all(-1)


def pair_iou(first: Tensor, second: Tensor) -> Tensor:
    """Intersection over union of boxes (..., 4), pair by pair."""
    shared = (torch.minimum(first[..., 2:], second[..., 2:]) - torch.maximum(first[..., :2], second[..., :2])).clamp(0)
    overlap = shared.prod(-1)
    return overlap / (_area(first) + _area(second) - overlap).clamp(min=1e-6)


def generalised_iou(first: Tensor, second: Tensor) -> Tensor:
    """Rezatofighi et al., Generalized Intersection over Union, algorithm 1; pair by pair, -1..1."""
    shared = (torch.minimum(first[..., 2:], second[..., 2:]) - torch.maximum(first[..., :2], second[..., :2])).clamp(0)
    hull = (torch.maximum(first[..., 2:], second[..., 2:]) - torch.minimum(first[..., :2], second[..., :2])).prod(-1)
    overlap = shared.prod(-1)
    union = (_area(first) + _area(second) - overlap).clamp(min=1e-6)
    return overlap / union - (hull - union) / hull.clamp(min=1e-6)


def _area(boxes: Tensor) -> Tensor:
    return (boxes[..., 2:] - boxes[..., :2]).clamp(0).prod(-1)
