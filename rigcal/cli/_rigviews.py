"""Board views of a capture made with a rig that is already calibrated."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rigcal.cli._app import console

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
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from rigcal.cache import default_cache
    from rigcal.captures import open_capture
    from rigcal.detect import detect_boards
    from rigcal.diagnose import check_boards
    from rigcal.instants import find_instants

    found = open_capture(path)
    _check_cameras(found, document)
    ids = [camera.id for camera in found.cameras]
    capture = open_capture(path, camera_order=[c for c in document.camera_ids if c in ids])
    columns = (TextColumn("finding boards"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    terminal = console(stderr=True)
    with Progress(*columns, console=terminal, transient=True, disable=not terminal.is_terminal) as bar:
        task = bar.add_task("", total=None)
        detections = detect_boards(
            capture,
            board,
            instants=find_instants(capture),
            cache=default_cache() if cache else None,
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )
    if not any(camera.views for camera in detections.cameras):
        check_boards(capture, detections)
    return detections


def _check_cameras(capture: Capture, document: RigDocument) -> None:
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
