"""Heads in crops of workers: which are bare, and augmentation of what is on them.

Places are in edge coordinates of a crop; its first annotation is the worker in the middle, hats follow.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from recognition.detectors.bundled.geometry import PAD, WORKER_WH
from recognition.observations import JOINTS
from tools.train.coco import Truth
from tools.train.warp import clipped

Image = NDArray[np.uint8]
Head = tuple[float, float, float]
"""Middle x, y and radius in pixels."""
_FACE = [JOINTS.index(name) for name in ("nose", "left_eye", "right_eye", "left_ear", "right_ear")]
_SHOULDERS = [JOINTS.index(name) for name in ("left_shoulder", "right_shoulder")]
_BEYOND, _RADIUS = 0.3, 0.6
"""Of the way from the shoulders' middle to that of the face: how much farther the head's lies, and its radius."""
_LEAST_RADIUS = 3.0


def bareheaded(truth: Truth) -> bool:
    """Whether the head of a crop's worker is seen and no hat is on it.

    On it: the hat's middle is nearer to that of the face's joints than the longer side of the hat. Of the heads in the
    training data that are seen, with or without a hat, this tells 98 % as the scenes do.
    """
    joints = truth.points[0, _FACE]
    if not (joints[:, 2] == 2).any():
        return False
    hats = truth.boxes[1:].reshape(-1, 2, 2)
    away = np.linalg.norm(hats.mean(axis=1) - joints[joints[:, 2] > 0, :2].mean(axis=0), axis=1)
    return not (away <= (hats[:, 1] - hats[:, 0]).max(axis=1, initial=0.0)).any()


def head_of(truth: Truth) -> Head | None:
    """The head, hat included, of a crop's worker; None where it is not seen or the shoulders are not in the crop."""
    face, shoulders = truth.points[0, _FACE], truth.points[0, _SHOULDERS]
    if not (face[:, 2] == 2).any() or not (shoulders[:, 2] > 0).all():
        return None
    middle = face[face[:, 2] > 0, :2].mean(axis=0)
    up = middle - shoulders[:, :2].mean(axis=0)
    x, y = middle + _BEYOND * up
    return float(x), float(y), max(_LEAST_RADIUS, _RADIUS * float(np.linalg.norm(up)))


def spotlit(image: Image, rng: np.random.Generator, head: Head) -> Image:
    """The head lighter or darker than the rest of the image (H, W, 3), and of another tint: hair has any colour.

    What is farther from the head's middle than 1.6 times its radius stays as it is.
    """
    height, width = image.shape[:2]
    x, y, radius = head
    square = (np.arange(width) + 0.5 - x) ** 2 + ((np.arange(height) + 0.5 - y) ** 2)[:, None]
    share = np.exp(-((square / radius**2) ** 2)).astype(np.float32)[..., None]
    gain = np.exp(rng.normal(0.15, 0.5) + rng.normal(0.0, 0.15, 3)).astype(np.float32)
    return np.rint(np.clip(image * (1.0 + share * (gain - 1.0)), 0, 255)).astype(np.uint8)


def cut_at(image: Image, truth: Truth, rng: np.random.Generator, head: Head) -> tuple[Image, Truth]:
    """The crop as if the camera's image ended in the head: at the top, the left or the right."""
    width, height = WORKER_WH
    x, y, radius = (round(value) for value in head)
    side, shift = int(rng.integers(3)), int(rng.integers(-radius, radius + 1))
    left, top = (max(0, x + shift) if side == 1 else 0), (max(0, y + shift) if side == 0 else 0)
    right = min(width, x + shift) if side == 2 else width
    if left >= width - 1 or top >= height - 1 or right <= 1:
        return image, truth
    seen = np.full_like(image, PAD)
    seen[top:, left:right] = image[top:, left:right]
    parts = [clipped(truth.picked(part), (left, top, right, height)) for part in ([0], slice(1, None))]
    return seen, worker_first(truth, *parts)


def worker_first(truth: Truth, worker: Truth, hats: Truth) -> Truth:
    """What is left of a crop's worker and hats; of a worker of whom nothing is left an empty annotation."""
    if not len(worker.classes):
        worker = Truth(truth.classes[:1], np.zeros((1, 4)), np.zeros((1, 17, 3)), np.ones(1, dtype=bool))
    return Truth(*(np.concatenate([getattr(worker, name), getattr(hats, name)]) for name in Truth.__slots__))
