"""MoveNet, single pose: 17 joints of the one person in a crop (TensorFlow Hub, ``movenet/singlepose``)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from recognition.detectors.family import PoseFamily
from recognition.detectors.manifest import PoseManifest
from recognition.observations import JOINTS
from rigcal.geometry import Floats


def decode_movenet(output: NDArray[Any], size_wh: tuple[int, int]) -> Floats:
    """Read MoveNet's output.

    Its coordinates are taken to count from the crop's edge: mirroring 300 crops and adding both x gave 190.5 to 192.4
    pixels by joint, mean 191.4, of a crop of 192; the rest, 0.3 px of the network, is smaller than the differences
    between joints.

    Args:
        output: (1, 1, 17, 3): y, x in 0..1 of the input, score; COCO-17 order.
        size_wh: size of the input.

    Returns:
        (17, 3): x, y in edge coordinates of the input, score.
    """
    y, x, score = output[0, 0].astype(np.float64).T
    return np.stack([x * size_wh[0], y * size_wh[1], score], axis=-1)


def _output_shape(_: PoseManifest) -> tuple[int, ...]:
    return (1, 1, len(JOINTS), 3)


MOVENET = PoseFamily(_output_shape, decode_movenet)
