"""Whether what was found can be believed, and where nothing was found, why.

Nothing is read where every camera sees the board, and more often than a part of a larger board or markers in another
layout. Otherwise at most ten images are searched for every cause, so that the answer comes in seconds: another board,
then one that is seen too poorly, then a part of one; and where none of these is there, what was tried in vain.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

from rigcal.board import AprilGrid, Checkerboard
from rigcal.captures import Capture
from rigcal.cores import core_count
from rigcal.detect.markers import shows_back
from rigcal.detect.sweep import one_thread_per_image
from rigcal.detections import SiteDetections
from rigcal.diagnose.others import Count, other_board
from rigcal.diagnose.sample import sample_shots
from rigcal.diagnose.sight import looks_of_images, part_in_sight, poor_sight
from rigcal.diagnose.spacing import measured_spacing
from rigcal.errors import MirroredImagesError, NoBoardError, UnclearBoardError, WrongBoardError, WrongSpacingError

FEW_VIEWS = 3
"""Fewer views do not determine a lens."""
ANOTHER_BOARD = ("a checkerboard larger than", "its markers do not lie")
"""How the reasons of finders begin where they saw another board than the given one."""
SPACING_OFF = 0.02
"""Share by which the measured spacing may differ: on nine real grids of 0.3 it came out as 0.300-0.302."""


def check_boards(capture: Capture, detections: SiteDetections) -> None:
    """Refuse detections that say the board is another one, and say why there are none.

    Args:
        capture: the images, read again for a sample.
        detections: what was found of the board that was given.

    Raises:
        WrongSpacingError: where an AprilGrid's tags are set wider or narrower than was given.
        MirroredImagesError: where every view of two cameras or more shows the board's mirror image.
        WrongBoardError: where another board is found in the images of the cameras that do not see the given one.
        UnclearBoardError: where a camera sees no board because it is too small, blurred, faint or partly hidden.
        NoBoardError: where a camera sees no board at all.
    """
    _check_spacing(detections)
    _check_sides(detections)
    cameras = _in_doubt(detections)
    if cameras:
        with one_thread_per_image(), ThreadPoolExecutor(core_count()) as pool:
            _diagnose(capture, detections, cameras, pool)


def _check_spacing(detections: SiteDetections) -> None:
    board = detections.board
    if not isinstance(board, AprilGrid):
        return
    views = [(view.corner_ids, view.corners_px) for camera in detections.cameras for view in camera.views]
    spacing = measured_spacing(board, views)
    if spacing is not None and abs(spacing / board.spacing - 1) > SPACING_OFF:
        raise WrongSpacingError(given=board.spacing, measured=spacing, views=len(views))


def _check_sides(detections: SiteDetections) -> None:
    """A capture of several cameras in which none ever sees the front: mirrored images, or a mirrored print."""
    board = detections.board
    seeing = [camera for camera in detections.cameras if camera.views]
    if isinstance(board, Checkerboard) or len(seeing) < 2:
        return
    if all(shows_back(board, view.corner_ids, view.corners_px) for camera in seeing for view in camera.views):
        views = sum(len(camera.views) for camera in seeing)
        raise MirroredImagesError([camera.camera_id for camera in seeing], views=views)


def _contradicted(detections: SiteDetections) -> bool:
    """Whether more boards were refused, as parts of larger ones or for their layout, than found."""
    return len(_refused(detections)) > sum(len(camera.views) for camera in detections.cameras)


def _refused(detections: SiteDetections) -> list[str]:
    """Why boards were refused that are not the given one."""
    findings = [finding for camera in detections.cameras for finding in camera.findings]
    return [f.reason for f in findings if f.action == "dropped" and f.reason.startswith(ANOTHER_BOARD)]


def _in_doubt(detections: SiteDetections) -> list[int]:
    """Cameras to look at: all where all see too little, else the first that sees nothing or next to nothing."""
    counts = [len(camera.views) for camera in detections.cameras]
    frames = [len(camera.frames) for camera in detections.cameras]
    few = [c for c, count in enumerate(counts) if count < FEW_VIEWS and 2 * count < frames[c]]
    if _contradicted(detections) or len(few) == len(counts):
        return list(range(len(counts)))
    return sorted(few, key=lambda c: (counts[c] > 0, c))[:1]


def _diagnose(capture: Capture, detections: SiteDetections, cameras: list[int], pool: ThreadPoolExecutor) -> None:
    given = detections.board
    names = [detections.cameras[c].camera_id for c in cameras]
    views = sum(len(detections.cameras[c].views) for c in cameras)
    images = sum(len(detections.cameras[c].frames) for c in cameras)
    shots = sample_shots(capture, cameras, pool)
    other, tried = other_board(capture, detections, cameras, shots, pool)
    if other is not None:
        raise _wrong_board(detections, names, other)
    if _contradicted(detections):
        refused = _refused(detections)
        raise WrongBoardError(
            where=_where(names),
            given=given.spec,
            given_count=views,
            found=refused[0],
            found_count=len(refused),
            images=images,
        )
    if views:
        return
    sight = poor_sight(given, shots, pool) or part_in_sight(given, shots, pool)
    if sight is not None:
        raise UnclearBoardError(
            where=_where(names),
            board=given.spec,
            cause=sight.cause.name,
            value=sight.cause.value,
            limit=sight.cause.limit,
            square_px=sight.cause.square_px,
            shown=sight.shown,
            images=sight.images,
        )
    silent = [camera.camera_id for camera in detections.cameras if not camera.views]
    raise NoBoardError(
        _where(names),
        board=given.spec,
        images=images,
        tried=[board.spec for board in tried],
        seen=looks_of_images(shots),
        also=[name for name in silent if name not in names],
    )


def _wrong_board(detections: SiteDetections, names: list[str], other: Count) -> WrongBoardError:
    return WrongBoardError(
        where=_where(names),
        given=detections.board.spec,
        given_count=other.given,
        found=other.board.spec,
        found_count=other.found,
        images=other.images,
        sampled=other.sampled,
        spec=other.board.spec,
    )


def _where(names: list[str]) -> str:
    return f"camera {', '.join(names)}"
