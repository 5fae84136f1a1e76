"""MoveNet (TensorFlow Hub): 17 joints of the one person in a crop, or of up to six people in an image."""

from __future__ import annotations

import numpy as np

from recognition.detectors.family import Layout, Outputs, PeopleFamily, PoseFamily
from recognition.observations import JOINTS
from rigcal.geometry import Floats

_MOST_PEOPLE = 6


def decode_movenet(outputs: Outputs, size_wh: tuple[int, int]) -> Floats:
    """Read the output of ``movenet/singlepose``.

    Its coordinates are taken to count from the crop's edge: mirroring 300 crops and adding both x gave 190.5 to 192.4
    pixels by joint, mean 191.4, of a crop of 192; the rest, 0.3 px of the network, is smaller than the differences
    between joints.

    Args:
        outputs: (1, 1, 17, 3): y, x in 0..1 of the input, score; COCO-17 order.
        size_wh: size of the input.

    Returns:
        (17, 3): x, y in edge coordinates of the input, score.
    """
    return _joints(outputs[0][0, 0].astype(np.float64), size_wh)


def decode_movenet_multipose(outputs: Outputs, size_wh: tuple[int, int]) -> tuple[Floats, Floats, Floats]:
    """Read the output of ``movenet/multipose``.

    Args:
        outputs: (1, 6, 56): y, x in 0..1 of the input and score of 17 joints; then top, left, bottom, right in 0..1
            of the input and score of the person. Rows of nobody score near 0.
        size_wh: size of the input.

    Returns:
        Boxes (6, 4) in edge coordinates of the input, scores (6,) and joints (6, 17, 3).
    """
    people = outputs[0][0].astype(np.float64)
    boxes = people[:, [52, 51, 54, 53]] * (size_wh * 2)
    return boxes, people[:, 55], _joints(people[:, :51].reshape(-1, len(JOINTS), 3), size_wh)


def _joints(yx_score: Floats, size_wh: tuple[int, int]) -> Floats:
    return np.asarray(yx_score[..., [1, 0, 2]] * (*size_wh, 1))


def _layouts(_size_wh: tuple[int, int], _classes: int) -> tuple[Layout, ...]:
    return (((1, 1, len(JOINTS), 3),),)


def _multipose_layouts(_size_wh: tuple[int, int], _classes: int) -> tuple[Layout, ...]:
    return (((1, _MOST_PEOPLE, 3 * len(JOINTS) + 5),),)


MOVENET = PoseFamily(_layouts, decode_movenet, fills_input=False)
MOVENET_MULTIPOSE = PeopleFamily(_multipose_layouts, decode_movenet_multipose)
