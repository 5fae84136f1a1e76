"""RTMPose: joints as the most probable bin on each axis (SimCC).

Jiang et al., RTMPose: Real-Time Multi-Person Pose Estimation based on MMPose, 2023; Li et al., SimCC, 2022. Crop,
normalisation and decoding are those of ``projects/rtmpose/examples/onnxruntime/main.py`` in open-mmlab/mmpose.
"""

from __future__ import annotations

import numpy as np

from recognition.detectors.family import Layout, Outputs, PoseFamily
from recognition.observations import JOINTS
from rigcal.geometry import Floats

_BINS_PER_PX = 2
"""``simcc_split_ratio`` of every RTMPose network."""


def decode_rtmpose(outputs: Outputs, _size_wh: tuple[int, int]) -> Floats:
    """Read the output of an RTMPose network.

    mmpose warps pixels with whole numbers at their centres and labels bin k with the pixel k / 2 of the crop, which
    lies k / 2 + 0.5 from the crop's edge. A network that points at a blurred dot, in 60 random crops of up to 2.4 px
    of the image to one of the input, found it 0.08 and 0.04 px beside its place on average.

    Args:
        outputs: (1, 17, 2 w) and (1, 17, 2 h) of an input of w x h: response of each bin on x and on y.

    Returns:
        (17, 3): x, y in edge coordinates of the input; score: the lower of the two responses, cut to 0..1 for they
        are no probabilities.
    """
    bins = np.stack([axis[0].argmax(axis=-1) for axis in outputs], axis=-1)
    response = np.minimum(*(axis[0].max(axis=-1).astype(np.float64) for axis in outputs))
    return np.column_stack([bins / _BINS_PER_PX + 0.5, np.clip(response, 0, 1)])


def _layouts(size_wh: tuple[int, int], _classes: int) -> tuple[Layout, ...]:
    width, height = size_wh
    return (((1, len(JOINTS), _BINS_PER_PX * width), (1, len(JOINTS), _BINS_PER_PX * height)),)


RTMPOSE = PoseFamily(_layouts, decode_rtmpose, fills_input=True)
