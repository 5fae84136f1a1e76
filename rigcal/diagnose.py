"""Why no board is found: another board than the one given is in the images, or none.

Only called for when something is wrong, and then on a dozen images, so that the answer comes in seconds. A larger or
smaller checkerboard is proposed by OpenCV's newer finder, which can let a grid grow to its true size; every proposal
is then searched for like a board that was given, and counted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import cv2
import numpy as np

from rigcal.board import AprilGrid, Board, Charuco, Checkerboard
from rigcal.captures import Capture, read_frames, read_image
from rigcal.detect import find_board
from rigcal.detect.found import Grey
from rigcal.detections import SiteDetections
from rigcal.errors import NoBoardError, WrongBoardError

SAMPLED_IMAGES = 12
COUNTED_IMAGES = 60
"""Captures of at most this many images are counted in full, others in the sample."""
LEAST_SHARE = 0.1
"""Share of the images in which another board must be found to be named."""
SMALLEST_GRID = (4, 3)
"""Where the growing grid starts: on real images 3x3 and 5x4 grow to the true size less often."""
MARKER_DICTIONARIES = ("DICT_4X4_1000", "DICT_5X5_1000", "DICT_6X6_1000", "DICT_7X7_1000", "DICT_ARUCO_ORIGINAL")
MARKER_RATIOS = (0.5, 0.6, 0.7, 0.75, 0.8)


def check_boards(capture: Capture, detections: SiteDetections) -> None:
    """Refuse detections that say the board is another one.

    Nothing is read where every camera sees the board, and more often than a part of a larger board or markers in
    another layout.

    Args:
        capture: the images, read again for a sample.
        detections: what was found of the board that was given.

    Raises:
        WrongBoardError: where another board is found in the images of the cameras that do not see the given one.
        NoBoardError: where a camera sees no board at all.
    """
    views = sum(len(camera.views) for camera in detections.cameras)
    refused = [f for camera in detections.cameras for f in camera.findings if f.action == "dropped"]
    silent = [c for c, camera in enumerate(detections.cameras) if not camera.views]
    contradicted = len(refused) > views
    if not silent and not contradicted:
        return
    looked_at = list(range(len(detections.cameras))) if contradicted else silent
    images = _Images.of(capture, detections, looked_at)
    other = _best(images, _proposals(detections.board, images))
    if other is not None:
        raise other
    if contradicted:
        raise WrongBoardError()
    first = detections.cameras[silent[0]]
    raise NoBoardError(first.camera_id, board=detections.board.spec, images=len(first.frames), tried=[])
