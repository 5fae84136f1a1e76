"""YOLOv8, YOLO11 and later networks of Ultralytics, as ``yolo export format=onnx`` writes them.

The exported graph ends in the head's decoding (``Detect._inference`` and ``Pose.kpts_decode`` in
``ultralytics/nn/modules/head.py``): centres and sizes are pixels of the input, scores and the joints' confidences have
been through the logistic function, and there is no objectness. Cells have their anchor at the middle, so that
coordinates count from the input's edge. Networks with an end-to-end head (YOLO26) have this form where the other head
is exported: without ``nms``, and with ``end2end=False`` where the version knows it.

Of exports with random weights (8.4.190, open size), 46 people of YOLOv8-pose and 33 boxes of YOLO11 lay within 0.0002
px of where Ultralytics' own code puts them, but for the half pixel between its edge and our centre of a pixel.
"""

from __future__ import annotations

import numpy as np

from recognition.detectors.family import BoxFamily, Layout, Outputs, PeopleFamily, corners, grid_cells
from recognition.observations import JOINTS
from rigcal.geometry import Floats

_STRIDES = ((8, 16, 32), (8, 16, 32, 64))
"""Of the usual networks, and of the large ones whose names end in p6."""


def decode_yolov8(outputs: Outputs, _size_wh: tuple[int, int]) -> tuple[Floats, Floats]:
    """Read boxes.

    Args:
        outputs: (1, 4 + C, A): centre x, y, width, height in pixels of the input, class probabilities.

    Returns:
        Boxes (A, 4) in edge coordinates of the input, and scores (A, C).
    """
    cells = outputs[0][0].T.astype(np.float64)
    return corners(cells[:, :4]), cells[:, 4:]


def decode_yolov8_pose(outputs: Outputs, _size_wh: tuple[int, int]) -> tuple[Floats, Floats, Floats]:
    """Read boxes with joints.

    Args:
        outputs: (1, 5 + 51, A): centre x, y, width, height in pixels of the input, the person's probability, and x, y,
            probability of 17 joints.

    Returns:
        Boxes (A, 4) in edge coordinates of the input, scores (A,) and joints (A, 17, 3).
    """
    cells = outputs[0][0].T.astype(np.float64)
    return corners(cells[:, :4]), cells[:, 4], cells[:, 5:].reshape(-1, len(JOINTS), 3)


def _layouts(size_wh: tuple[int, int], classes: int) -> tuple[Layout, ...]:
    return tuple(((1, 4 + classes, grid_cells(size_wh, strides)),) for strides in _STRIDES)


def _pose_layouts(size_wh: tuple[int, int], _: int) -> tuple[Layout, ...]:
    return _layouts(size_wh, 1 + 3 * len(JOINTS))


YOLOV8 = BoxFamily(_layouts, decode_yolov8)
YOLOV8_POSE = PeopleFamily(_pose_layouts, decode_yolov8_pose)
