"""What training minimises."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from recognition.detectors.bundled.decode import site_cells
from recognition.detectors.bundled.geometry import WORKER_STRIDE
from tools.train.assign import assign, generalised_iou, ignored_cells
from tools.train.networks import boxes_from, hat_boxes, points_from
from tools.train.samples import Batch

Parts = dict[str, Tensor]
_SIGMA = 1.0
"""Of the heat of a joint, in cells."""


class SiteLoss:
    """Classes by cross entropy with task-aligned targets, boxes by generalised IoU, points by distance over size."""

    def __init__(self) -> None:
        self._centres, self._strides = (torch.from_numpy(values).float() for values in site_cells())

    def __call__(self, outputs: tuple[Tensor, Tensor], batch: Batch) -> Parts:
        """Parts of the loss; their sum is minimised."""
        logits, places = (output.float() for output in outputs)
        boxes = boxes_from(places[..., :4], self._centres, self._strides)
        found = assign(logits.sigmoid(), boxes, self._centres, self._strides, batch)
        image, truth = batch.image_idx[found.annotation], batch.boxes[found.annotation]
        label = batch.classes[found.annotation]
        target, weight = torch.zeros_like(logits), torch.ones_like(logits)
        weight[ignored_cells(self._centres, self._strides, batch)] = 0.0
        target[image, found.cell, label] = found.quality
        weight[image, found.cell, label] = 1.0
        total = found.quality.sum().clamp(min=1.0)
        score = functional.binary_cross_entropy_with_logits(logits, target, weight, reduction="sum") / total
        overlap = generalised_iou(boxes[image, found.cell], truth)
        parts = {"class": score, "box": 3.0 * ((1.0 - overlap) * found.quality).sum() / total}
        centres, strides = self._centres[found.cell], self._strides[found.cell]
        raw, points, size = places[image, found.cell], batch.points[found.annotation], batch.sizes[found.annotation]
        person = (label == 0)[:, None]
        joints = points_from(raw[:, 4:38], centres, strides)
        keypoints = points_from(raw[:, 55:], centres, strides)
        quality = found.quality[:, None]
        known = points[..., 2] > 0
        parts["joints"] = 5.0 * _distance(joints, points, size, quality * (known & person)) / total
        known_few = quality * (known & ~person)[:, :4]
        parts["keypoints"] = 5.0 * _distance(keypoints, points[:, :4], size, known_few) / total
        seen = functional.binary_cross_entropy_with_logits(
            raw[:, 38:55], (points[..., 2] == 2).float(), quality.expand(-1, 17) * person, reduction="sum"
        )
        return parts | {"visible": 0.3 * seen / 17 / total}


def _distance(points: Tensor, truth: Tensor, size: Tensor, weight: Tensor) -> Tensor:
    """Sum over rows of the weighted mean distance (|x| + |y|) over the size."""
    distance = (points - truth[..., :2]).abs().sum(-1) / size[:, None]
    return (distance * weight).sum() / weight.shape[1] * 2.0


class WorkerLoss:
    """Joints by cross entropy over the cells, states by cross entropy, hats by focal loss and generalised IoU."""

    def __init__(self, joints: tuple[int, ...]) -> None:
        self._joints = list(joints)

    def __call__(self, outputs: tuple[Tensor, Tensor, Tensor], batch: Batch) -> Parts:
        """Parts of the loss; their sum is minimised."""
        heat, hats, states = (output.float() for output in outputs)
        first = torch.searchsorted(batch.image_idx, torch.arange(len(heat)))
        points = batch.points[first][:, self._joints]
        rest = torch.ones_like(batch.ignore)
        rest[first] = False
        known = points[..., 2] > 0
        target = _gaussians(points[..., :2] / WORKER_STRIDE, heat.shape[2:])
        target = target / target.sum((2, 3), keepdim=True).clamp(min=1e-6)
        surprise = -(target.flatten(2) * heat.flatten(2).log_softmax(-1)).sum(-1)
        state = torch.stack([known, points[..., 2] == 2], -1).float()
        return {
            "joints": (surprise * known).sum() / known.sum().clamp(min=1),
            "states": functional.binary_cross_entropy_with_logits(states, state),
        } | _hat_loss(hats, batch.image_idx[rest], batch.boxes[rest], batch.ignore[rest])


def _gaussians(places: Tensor, grid: torch.Size) -> Tensor:
    """(N, J, H, W) Gaussians around places (N, J, 2) in cells."""
    y, x = (torch.exp(-((torch.arange(size) + 0.5 - places[..., axis, None]) ** 2) / (2 * _SIGMA**2))
            for axis, size in ((1, grid[0]), (0, grid[1])))  # fmt: skip
    return y[..., :, None] * x[..., None, :]


def _hat_loss(raw: Tensor, image: Tensor, boxes: Tensor, ignore: Tensor) -> Parts:
    """Zhou et al., Objects as Points, equation 1, with Gaussians of a sixth of the box; boxes around the middle."""
    height, width = raw.shape[2:]
    y, x = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    middle = (boxes[:, :2] + boxes[:, 2:]) / 2 / WORKER_STRIDE
    sigma = ((boxes[:, 2:] - boxes[:, :2]) / 6 / WORKER_STRIDE).clamp(min=0.5)
    dx, dy = x - middle[:, 0, None, None], y - middle[:, 1, None, None]
    bumps = torch.exp(-((dx / sigma[:, 0, None, None]) ** 2 + (dy / sigma[:, 1, None, None]) ** 2) / 2)
    place = (middle - 1e-4).long().clamp(min=0)
    place = torch.minimum(place, torch.tensor([width - 1, height - 1]))
    bumps[torch.arange(len(boxes)), place[:, 1], place[:, 0]] = 1.0
    asked = ~ignore
    target, weight = torch.zeros_like(raw[:, 0]), torch.ones_like(raw[:, 0])
    for idx in range(len(boxes)):
        if asked[idx]:
            target[image[idx]] = torch.maximum(target[image[idx]], bumps[idx])
        else:
            weight[image[idx]] *= bumps[idx] < 0.1
    score = raw[:, 0].sigmoid().clamp(1e-4, 1 - 1e-4)
    hit = target == 1.0
    count = hit.sum().clamp(min=1)
    focal = torch.where(hit, (1 - score) ** 2 * score.log(), (1 - target) ** 4 * score**2 * (1 - score).log())
    near = (dx.abs() <= 1.0) & (dy.abs() <= 1.0) & asked[:, None, None]
    which, row, column = torch.nonzero(near, as_tuple=True)
    found = hat_boxes(raw[:, 1:])[image[which], row, column]
    overlap = generalised_iou(found, boxes[which])
    return {
        "hats": -(focal * torch.where(hit, 1.0, weight)).sum() / count,
        "hat_boxes": (1.0 - overlap).sum() / max(len(which), 1),
    }
