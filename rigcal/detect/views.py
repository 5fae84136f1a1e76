"""From the boards found in one camera's frames to its views, and what is to be told about them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rigcal.captures import CaptureCamera
from rigcal.detect.found import FoundBoard
from rigcal.detections import BoardDetections, BoardView, Finding, join_findings

TURNED = "its corners came turned by 180 degrees; put right by the colours of the squares"
BLURRED_TIMES, BLURRED_PX = 3.0, 3.0
"""A view is dropped where its edges are that many times as wide as the camera's median view, and that wide at least.
A board at rest is as sharp as its lens; edges three times as wide are those of a board in motion or far out of focus,
and a moving board is elsewhere by the time the next camera sees it. Up to 3 px the corners of a board at rest are as
near to the truth as those of a sharp one (0.01 px in renders)."""
LEAST_TO_COMPARE = 5
"""Views that make a median."""


def board_detections(camera: CaptureCamera, found: Mapping[int, FoundBoard]) -> BoardDetections:
    """Views and findings of a camera, from the boards found by frame."""
    sound = {index: board for index, board in sorted(found.items()) if not board.problem}
    blurred = _blurred(sound)
    used = {index: board for index, board in sound.items() if index not in blurred}
    turned = {index for index, board in used.items() if board.turned}
    odd = turned if 2 * len(turned) <= len(used) else set(used) - turned
    findings = [Finding(camera.frames[i], "dropped", board.problem) for i, board in found.items() if board.problem]
    findings += [Finding(camera.frames[i], "dropped", reason) for i, reason in blurred.items()]
    findings += [Finding(camera.frames[i], "unflipped", TURNED) for i in odd]
    views = tuple(BoardView(i, board.corner_ids, board.corners_px, board.blur_px) for i, board in used.items())
    return BoardDetections(camera.id, camera.size_wh, camera.frames, views, join_findings(findings))


def _blurred(boards: Mapping[int, FoundBoard]) -> dict[int, str]:
    """Frames whose board is blurred far beyond the others, and what to say about each."""
    widths = {index: board.blur_px for index, board in boards.items() if board.blur_px > 0}
    if len(widths) < LEAST_TO_COMPARE:
        return {}
    median_px = float(np.median(list(widths.values())))
    return {
        index: f"blurred: edges {px:.1f} px wide, {px / median_px:.1f} times the camera's median view"
        for index, px in widths.items()
        if px > max(BLURRED_TIMES * median_px, BLURRED_PX)
    }
