"""Coordinates that training adds to those of the networks' inputs (``recognition.detectors.bundled.geometry``)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from recognition.detectors.bundled.geometry import Placing
from recognition.observations import JOINTS

RULE_JOINTS = (
    "nose", "left_ear", "right_ear", "left_shoulder", "right_shoulder", "left_wrist", "right_wrist", "left_hip",
    "right_hip", "left_ankle", "right_ankle",
)  # fmt: skip
"""What the rules look at: head, shoulders, hands, hips, feet."""
WORKER_JOINTS = {"all": JOINTS, "rules": RULE_JOINTS}
"""Joints that a worker network gives, in their order, by what its training was asked for."""


def letterbox(image_wh: ArrayLike, input_wh: ArrayLike) -> Placing:
    """The whole image in the middle of the input, as large as it fits; whole pixels, so that it can be resized."""
    image, wanted = np.asarray(image_wh, dtype=np.float64), np.asarray(input_wh, dtype=np.float64)
    scale = float((wanted / image).min())
    corner = (wanted - np.rint(image * scale)) // 2
    return Placing(scale, (float(corner[0]), float(corner[1])))


def mirrored(names: tuple[str, ...]) -> tuple[int, ...]:
    """Which point becomes which in a mirror image: ``left`` and ``right`` of the names change places."""
    swap = {"left": "right", "right": "left"}
    swapped = ["_".join(swap.get(part, part) for part in name.split("_")) for name in names]
    return tuple(names.index(name) if name in names else idx for idx, name in enumerate(swapped))
