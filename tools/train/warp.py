"""Augmentation of places: what moves pixels moves boxes and points with them."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from recognition.detectors.bundled.geometry import PAD
from rigcal.geometry import Floats
from tools.train.coco import Category, Truth
from tools.train.geometry import mirrored

Image = NDArray[np.uint8]
LEAST_KEPT = 0.3
"""A box of which less than this stays inside the picture is ignored."""


@dataclass(frozen=True, slots=True)
class Mirror:
    """Which point becomes which in a mirror image, per class."""

    orders: tuple[tuple[int, ...], ...]
    """(classes, 17)."""

    @classmethod
    def of(cls, categories: tuple[Category, ...], points: int = 17) -> Mirror:
        """By the words left and right in the names of the points."""
        orders = []
        for category in categories:
            order = mirrored(category.keypoints)
            orders.append(order + tuple(range(len(order), points)))
        return cls(tuple(orders))


def similarity(
    scale: float, turn_rad: float, from_xy: tuple[float, float], to_xy: tuple[float, float], *, flip: bool
) -> Floats:
    """(2, 3) in edge coordinates: the point ``from_xy`` goes to ``to_xy``; scaled, turned, mirrored first of all."""
    c, s = scale * np.cos(turn_rad), scale * np.sin(turn_rad)
    linear = np.array([[c, -s], [s, c]]) @ np.diag([-1.0 if flip else 1.0, 1.0])
    shift = np.array(to_xy) - linear @ np.array(from_xy)
    return np.column_stack([linear, shift])


def warp_image(image: Image, matrix: Floats, size_wh: tuple[int, int]) -> Image:
    """The image under (2, 3) in edge coordinates; grey where nothing is."""
    centres = matrix.copy()
    centres[:, 2] += matrix[:, :2] @ [0.5, 0.5] - 0.5
    grey = (PAD, PAD, PAD)
    return np.asarray(cv2.warpAffine(image, centres, size_wh, flags=cv2.INTER_LINEAR, borderValue=grey), np.uint8)


def warp_truth(truth: Truth, matrix: Floats, size_wh: tuple[int, int], mirror: Mirror) -> Truth:
    """The truth under (2, 3) in edge coordinates, clipped to the picture.

    Points outside are unlabelled. Boxes outside go; boxes of which little stays are ignored. A mirror image changes
    left and right. A turned box is that of the ellipse in it, since corners are empty more often than not.
    """
    points = truth.points.copy()
    points[..., :2] = truth.points[..., :2] @ matrix[:, :2].T + matrix[:, 2]
    if np.linalg.det(matrix[:, :2]) < 0:
        for idx, label in enumerate(truth.classes):
            points[idx] = points[idx, list(mirror.orders[label])]
    middle = (truth.boxes[:, :2] + truth.boxes[:, 2:]) / 2 @ matrix[:, :2].T + matrix[:, 2]
    half = np.sqrt(((truth.boxes[:, 2:] - truth.boxes[:, :2]) / 2) ** 2 @ (matrix[:, :2] ** 2).T)
    boxes = np.concatenate([middle - half, middle + half], axis=1)
    return clipped(Truth(truth.classes, boxes, points, truth.ignore), (0.0, 0.0, *size_wh))


def clipped(truth: Truth, window: tuple[float, float, float, float]) -> Truth:
    """The part of the truth inside a window ltrb."""
    low, high = np.array(window[:2]), np.array(window[2:])
    boxes = np.clip(truth.boxes, np.tile(low, 2), np.tile(high, 2))
    areas = [np.maximum((box[:, 2:] - box[:, :2]).prod(axis=1), 1e-9) for box in (boxes, truth.boxes)]
    kept = areas[0] / areas[1]
    points = truth.points.copy()
    inside = ((points[..., :2] >= low) & (points[..., :2] <= high)).all(axis=-1)
    points[~inside] = 0.0
    some = (boxes[:, 2:] - boxes[:, :2] > 1.0).all(axis=1)
    return Truth(truth.classes, boxes, points, truth.ignore | (kept < LEAST_KEPT)).picked(some)


def hidden(truth: Truth, holes: Floats) -> Truth:
    """The truth where rectangles (R, 4) lie in front: points in them are occluded, boxes they cover are ignored."""
    points, ignore = truth.points.copy(), truth.ignore.copy()
    for hole in holes:
        inside = ((points[..., :2] >= hole[:2]) & (points[..., :2] <= hole[2:])).all(axis=-1)
        points[..., 2] = np.where(inside, np.minimum(points[..., 2], 1.0), points[..., 2])
        shared = np.minimum(truth.boxes[:, 2:], hole[2:]) - np.maximum(truth.boxes[:, :2], hole[:2])
        area = (truth.boxes[:, 2:] - truth.boxes[:, :2]).prod(axis=1)
        ignore |= np.maximum(shared, 0.0).prod(axis=1) > (1.0 - LEAST_KEPT) * area
    return Truth(truth.classes, truth.boxes, points, ignore)


def side_by_side(first: tuple[Image, Truth], second: tuple[Image, Truth], column: int) -> tuple[Image, Truth]:
    """One picture of the left part of the first and the right part of the second."""
    height, width = first[0].shape[:2]
    image = np.concatenate([first[0][:, :column], second[0][:, column:]], axis=1)
    left, right = clipped(first[1], (0, 0, column, height)), clipped(second[1], (column, 0, width, height))
    fields = (np.concatenate([getattr(left, name), getattr(right, name)]) for name in Truth.__slots__)
    return image, Truth(*fields)
