"""From a capture on disk to board detections, with progress on a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from rigcal.cli._app import console

if TYPE_CHECKING:
    from rigcal.board import Board
    from rigcal.captures import Capture
    from rigcal.detections import SiteDetections
    from rigcal.rig import ClockModel
    from rigcal.site import Site


def find_boards(
    path: Path, board: Board, site: Site | None, cache: bool, clocks: Mapping[str, ClockModel | None] | None = None
) -> SiteDetections:
    """Open a capture and find the boards in it; refuse it with the cause where too few are found."""
    from rigcal.captures import open_capture
    from rigcal.diagnose import check_boards

    capture = open_capture(path, camera_order=[camera.id for camera in site.cameras] if site else None)
    detections = search(capture, board, cache, clocks)
    check_boards(capture, detections)
    _check_sizes(detections, site)
    return detections


def search(
    capture: Capture, board: Board, cache: bool, clocks: Mapping[str, ClockModel | None] | None = None
) -> SiteDetections:
    """Find the boards in an open capture, with a progress bar on a terminal; instants by the rig's clocks."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from rigcal.cache import default_cache
    from rigcal.detect import detect_boards
    from rigcal.instants import find_instants

    columns = (TextColumn("finding boards"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    terminal = console(stderr=True)
    with Progress(*columns, console=terminal, transient=True, disable=not terminal.is_terminal) as bar:
        task = bar.add_task("", total=None)
        return detect_boards(
            capture,
            board,
            instants=find_instants(capture, clocks),
            cache=default_cache() if cache else None,
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )


def _check_sizes(detections: SiteDetections, site: Site | None) -> None:
    from rigcal.errors import ImageSizeError

    for camera in detections.cameras:
        declared = site.camera(camera.camera_id) if site else None
        if declared and declared.size_wh and declared.size_wh != camera.size_wh:
            raise ImageSizeError(
                camera.camera_id,
                where="this capture",
                expected_wh=declared.size_wh,
                got_wh=camera.size_wh,
                source="the site file",
            )
