"""FastestDet: one grid of stride 16, one box per cell (github.com/dog-qiuqiu/FastestDet, ``utils/tool.py``)."""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from recognition.detectors.family import BoxFamily, Layout, Outputs
from rigcal.geometry import Floats

_STRIDE = 16


def decode_fastestdet(outputs: Outputs, size_wh: tuple[int, int]) -> tuple[Floats, Floats]:
    """Read the output of a FastestDet network.

    Args:
        outputs: (1, 5 + C, h, w): objectness; centre relative to the cell's corner, in cells, through tanh; size in
            inputs, through the logistic function; class probabilities.
        size_wh: size of the input.

    Returns:
        Boxes (A, 4) in edge coordinates of the input, and scores (A, C): objectness times class probability.
    """
    raw = outputs[0][0].astype(np.float64)
    rows, columns = np.indices(raw.shape[1:])
    input_wh = np.array(size_wh)
    cells = np.stack([columns, rows], axis=-1).reshape(-1, 2)
    channels = raw.reshape(len(raw), -1).T
    centre = (cells + np.tanh(channels[:, 1:3])) / (raw.shape[2], raw.shape[1]) * input_wh
    half = expit(channels[:, 3:5]) * input_wh / 2
    return np.hstack([centre - half, centre + half]), channels[:, :1] * channels[:, 5:]


def _layouts(size_wh: tuple[int, int], classes: int) -> tuple[Layout, ...]:
    return (((1, 5 + classes, size_wh[1] // _STRIDE, size_wh[0] // _STRIDE),),)


FASTESTDET = BoxFamily(_layouts, decode_fastestdet)
