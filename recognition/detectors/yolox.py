"""YOLOX: anchor-free boxes at strides 8, 16 and 32 (Ge et al., YOLOX: Exceeding YOLO Series in 2021, section 2.1)."""

from __future__ import annotations

import numpy as np

from recognition.detectors.family import BoxFamily, Layout, Outputs, grid_cells
from rigcal.geometry import Floats

_STRIDES = (8, 16, 32)
_LOG_SIZE_LIMIT = 10.0  # e**10 strides is larger than any image, and far from overflow


def decode_yolox(outputs: Outputs, size_wh: tuple[int, int]) -> tuple[Floats, Floats]:
    """Read the raw output of a YOLOX network that was exported without decoding.

    Args:
        outputs: (1, A, 5 + C): centre within the grid cell, in strides; log of the size in strides; objectness; and
            class probabilities. The A cells run row by row over the grids of stride 8, 16, 32.
        size_wh: size of the input.

    Returns:
        Boxes (A, 4) in edge coordinates of the input, and scores (A, C): objectness times class probability.
    """
    raw = outputs[0][0].astype(np.float64)
    cells, stride = _grid(size_wh)
    centre = (raw[:, :2] + cells) * stride
    half = np.exp(np.minimum(raw[:, 2:4], _LOG_SIZE_LIMIT)) * stride / 2
    return np.hstack([centre - half, centre + half]), raw[:, 4:5] * raw[:, 5:]


def _grid(size_wh: tuple[int, int]) -> tuple[Floats, Floats]:
    cells, strides = [], []
    for stride in _STRIDES:
        columns, rows = np.meshgrid(np.arange(size_wh[0] // stride), np.arange(size_wh[1] // stride))
        cells.append(np.stack([columns, rows], axis=-1).reshape(-1, 2))
        strides.append(np.full((columns.size, 1), float(stride)))
    return np.concatenate(cells).astype(np.float64), np.concatenate(strides)


def _layouts(size_wh: tuple[int, int], classes: int) -> tuple[Layout, ...]:
    return (((1, grid_cells(size_wh, _STRIDES), 5 + classes),),)


YOLOX = BoxFamily(_layouts, decode_yolox)
