"""Board views of a capture made with a rig that is already calibrated."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rigcal.cli._capture import search

if TYPE_CHECKING:
    from rigcal.board import Board
    from rigcal.captures import Capture
    from rigcal.detections import SiteDetections
    from rigcal.rigdocument import RigDocument


def board_of_rig(spec: str | None, document: RigDocument) -> Board:
    """The board given, else the one that calibrated the rig."""
    from rigcal.board import parse_board
    from rigcal.errors import BoardSpecError

    if spec is not None:
        return parse_board(spec)
    if document.calibration_board is None:
        raise BoardSpecError("", problem="the rig file names no board", expected="--board SPEC")
    return document.calibration_board


def views_of_rig(path: Path, board: Board, document: RigDocument, cache: bool) -> SiteDetections:
    """Find the board in a capture of some of the rig's cameras; cameras that do not see it have no views.

    Cameras and image sizes are checked before any image is searched. Where no camera sees the board, the cause is
    looked for as in a calibration.
    """
    from rigcal.captures import open_capture
    from rigcal.diagnose import check_boards
    from rigcal.rigfile import rig_of

    found = open_capture(path)
    check_cameras(found, document)
    ids = [camera.id for camera in found.cameras]
    capture = open_capture(path, camera_order=[c for c in document.camera_ids if c in ids])
    detections = search(capture, board, cache, {camera.id: camera.clock for camera in rig_of(document).cameras})
    if not any(camera.views for camera in detections.cameras):
        check_boards(capture, detections)
    return detections


def check_cameras(capture: Capture, document: RigDocument) -> None:
    from rigcal.errors import ImageSizeError, RigCaptureError

    known = {camera.id: camera for camera in document.cameras}
    if unknown := [camera.id for camera in capture.cameras if camera.id not in known]:
        raise RigCaptureError(capture.path, unknown=unknown, known=list(known))
    for camera in capture.cameras:
        if camera.size_wh != known[camera.id].size_wh:
            raise ImageSizeError(
                camera.id,
                where=capture.path,
                expected_wh=known[camera.id].size_wh,
                got_wh=camera.size_wh,
                source="the rig file",
            )
