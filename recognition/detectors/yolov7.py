"""YOLOv7 (github.com/WongKinYiu/yolov7), exported with ``--grid``; YOLOv5 exports have the same form.

The exported graph ends in the head's decoding (``Detect`` and ``IKeypoint`` in ``models/yolo.py``): centres, sizes and
joints are pixels of the input, all scores have been through the logistic function. Cells have their zero at the middle,
``(2 s - 0.5 + cell) * stride``, so that coordinates count from the input's edge. Exports of the pose branch carry
the raw heads behind the first output; they are not read.
"""

from __future__ import annotations

import numpy as np

from recognition.detectors.family import BoxFamily, Layout, Outputs, PeopleFamily, corners, grid_cells
from recognition.observations import JOINTS
from rigcal.geometry import Floats

_STRIDES = ((8, 16, 32), (8, 16, 32, 64))
"""Of the usual networks, and of those with four heads, as yolov7-w6-pose."""
_ANCHORS = 3
"""Boxes per cell."""


def decode_yolov7(outputs: Outputs, _size_wh: tuple[int, int]) -> tuple[Floats, Floats]:
    """Read boxes.

    Args:
        outputs: (1, A, 5 + C): centre x, y, width, height in pixels of the input, objectness, class probabilities.

    Returns:
        Boxes (A, 4) in edge coordinates of the input, and scores (A, C): objectness times class probability.
    """
    cells = outputs[0][0].astype(np.float64)
    return corners(cells[:, :4]), cells[:, 4:5] * cells[:, 5:]


def decode_yolov7_pose(outputs: Outputs, _size_wh: tuple[int, int]) -> tuple[Floats, Floats, Floats]:
    """Read boxes with joints.

    Args:
        outputs: (1, A, 5 + 1 + 51): as of boxes with the one class, then x, y, probability of 17 joints.

    Returns:
        Boxes (A, 4) in edge coordinates of the input, scores (A,) and joints (A, 17, 3).
    """
    cells = outputs[0][0].astype(np.float64)
    return corners(cells[:, :4]), cells[:, 4] * cells[:, 5], cells[:, 6:].reshape(-1, len(JOINTS), 3)


def _layouts(size_wh: tuple[int, int], classes: int) -> tuple[Layout, ...]:
    return tuple(((1, _ANCHORS * grid_cells(size_wh, strides), 5 + classes),) for strides in _STRIDES)


def _pose_layouts(size_wh: tuple[int, int], _: int) -> tuple[Layout, ...]:
    return _layouts(size_wh, 1 + 3 * len(JOINTS))


YOLOV7 = BoxFamily(_layouts, decode_yolov7)
YOLOV7_POSE = PeopleFamily(_pose_layouts, decode_yolov7_pose)
