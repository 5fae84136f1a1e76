"""FastestDet: one grid of stride 16, one box per cell (github.com/dog-qiuqiu/FastestDet, ``utils/tool.py``)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from recognition.detectors.family import BoxFamily
from recognition.detectors.manifest import BoxManifest
from rigcal.geometry import Floats

_STRIDE = 16


def decode_fastestdet(output: NDArray[Any], size_wh: tuple[int, int]) -> tuple[Floats, Floats]:
    """Read the output of a FastestDet network.

    Args:
        output: (1, 5 + C, h, w): objectness; centre relative to the cell's corner, in cells, through tanh; size in
            inputs, through the logistic function; class probabilities.
        size_wh: size of the input.

    Returns:
        Boxes (A, 4) in edge coordinates of the input, and scores (A, C): objectness times class probability.
    """
    raw = output[0].astype(np.float64)
    rows, columns = np.indices(raw.shape[1:])
    input_wh = np.array(size_wh)
    cells = np.stack([columns, rows], axis=-1).reshape(-1, 2)
    channels = raw.reshape(len(raw), -1).T
    centre = (cells + np.tanh(channels[:, 1:3])) / (raw.shape[2], raw.shape[1]) * input_wh
    half = expit(channels[:, 3:5]) * input_wh / 2
    return np.hstack([centre - half, centre + half]), channels[:, :1] * channels[:, 5:]


def _output_shape(manifest: BoxManifest) -> tuple[int, ...]:
    width, height = manifest.input.size_wh
    return (1, 5 + len(manifest.classes), height // _STRIDE, width // _STRIDE)


FASTESTDET = BoxFamily(_output_shape, decode_fastestdet)
