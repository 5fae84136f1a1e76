"""What a capture's pictures say of its cameras' clocks: which method serves, and the stamps that it works on."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from rigcal.cli.sync._app import progress_bar

if TYPE_CHECKING:
    from rigcal.board import Board
    from rigcal.captures import Capture
    from rigcal.rig import Rig
    from rigcal.rigdocument import RigDocument
    from rigcal.stamps import FrameStamps
    from rigcal.sync.content.lags import ContentLags


class By(StrEnum):
    """What clocks are compared by."""

    AUTO = "auto"
    BOARD = "board"
    PEOPLE = "people"
    LIGHT = "light"
    MOTION = "motion"


@dataclass(frozen=True, slots=True)
class Content:
    """A capture, ready to be compared."""

    capture: Capture
    stamps: FrameStamps
    """In rig time, by the clocks that the rig has."""
    reference: str
    rig: Rig | None = None
    board: Board | None = None
    detections: Path | None = None
    readout_s: dict[str, float] = field(default_factory=dict)


def content_of(path: Path, document: RigDocument | None) -> Content:
    """Open a capture; where a rig is given its cameras and image sizes are checked, and its clocks are applied."""
    from rigcal.captures import open_capture
    from rigcal.cli._rigviews import check_cameras
    from rigcal.rigfile import rig_of

    capture = open_capture(path)
    if document is None:
        return Content(capture, stamps_of(capture, None), capture.cameras[0].id)
    check_cameras(capture, document)
    ids = [camera.id for camera in capture.cameras]
    capture = open_capture(path, camera_order=[c for c in document.camera_ids if c in ids])
    rig = rig_of(document)
    reference = rig.reference if rig.reference in ids else capture.cameras[0].id
    return Content(capture, stamps_of(capture, rig), reference, rig, document.calibration_board)


def stamps_of(capture: Capture, rig: Rig | None) -> FrameStamps:
    """The stamps of a capture, in rig time where they share an epoch and the rig has clocks."""
    from rigcal.errors import NoStampsError
    from rigcal.stamps import FrameStamps, frame_stamps, in_rig_time

    stamps = frame_stamps(capture)
    if stamps is None:
        raise NoStampsError(capture.path)
    if rig is None or not stamps.shared:
        return stamps
    clocks = [rig.camera(camera.id).clock for camera in capture.cameras]
    return FrameStamps(stamps.rule, tuple(map(in_rig_time, stamps.times_s, clocks)))


def compare(content: Content, by: By) -> ContentLags:
    """The lags by one method; ``auto`` takes joints where they are given, else the board, else a light, else motion."""
    if by is By.AUTO:
        return _best(content)
    return {By.BOARD: _board, By.PEOPLE: _people, By.LIGHT: _light, By.MOTION: _motion}[by](content)


def _best(content: Content) -> ContentLags:
    if content.detections is not None:
        return _people(content)
    board = _board(content) if content.rig is not None and content.board is not None else None
    if board is not None and decides(board):
        return board
    light = _light(content)
    if decides(light):
        return light
    return board or _motion(content)


def decides(lags: ContentLags) -> bool:
    """Whether the content decided the clock of any camera beside the reference."""
    return any(camera.confident for camera in lags.cameras if camera.camera_id != lags.reference)


def _board(content: Content) -> ContentLags:
    from rigcal.errors import OptionError
    from rigcal.sync.content.board import board_lags
    from rigcal.sync.content.points.solve import LagOptions

    if content.rig is None or content.board is None:
        raise OptionError("--by board", expected="a rig file, and a board in it or by --board SPEC", got="none")
    options = LagOptions(readout_s=content.readout_s)
    with _progress("following the board") as tell:
        return board_lags(content.capture, content.board, content.rig, content.stamps, options=options, progress=tell)


def compare_board(content: Content) -> tuple[ContentLags | None, dict[str, str]]:
    """The lags by the board, of cameras that hold their own pictures; and whose pictures the others hold."""
    from rigcal.errors import OptionError
    from rigcal.sync.content.board import board_tracks
    from rigcal.sync.content.points.solve import estimate_lags
    from rigcal.sync.content.swaps import swapped_cameras

    if content.rig is None or content.board is None:
        raise OptionError("--board", expected="a board in the rig file or by --board SPEC", got="none")
    with _progress("following the board") as tell:
        tracks = board_tracks(content.capture, content.board, content.rig, content.stamps, progress=tell)
    swapped = dict(swapped_cameras(content.rig, tracks))
    own = [track for track in tracks if track.camera_id not in swapped]
    return estimate_lags(content.rig, own, method="board") if len(own) > 1 else None, swapped


def _people(content: Content) -> ContentLags:
    """From 2D joints whose frame numbers count the capture's instants."""
    import numpy as np

    from rigcal.errors import OptionError
    from rigcal.instants import find_instants
    from rigcal.sync.content.people import PeopleOptions, people_lags, read_keypoints

    if content.rig is None or content.detections is None:
        raise OptionError("--by people", expected="--rig RIG and --detections FILE.npz", got="not both")
    rig, capture = content.rig, content.capture
    keypoints = read_keypoints(content.detections, rig)
    ids = [camera.id for camera in capture.cameras]
    frame_idx = find_instants(capture, {camera.id: camera.clock for camera in rig.cameras}).frame_idx
    times_s = np.full((len(frame_idx), len(rig.cameras)), np.nan)
    for view, camera_id in enumerate(rig.camera_ids):
        if camera_id in ids:
            frames = frame_idx[:, ids.index(camera_id)]
            times_s[frames >= 0, view] = content.stamps.times_s[ids.index(camera_id)][frames[frames >= 0]]
    return people_lags(rig, keypoints, times_s, options=PeopleOptions(readout_s=content.readout_s))


def _light(content: Content) -> ContentLags:
    from rigcal.sync.content.light import LightOptions, light_lags, measure_brightness

    with _progress("looking at the light") as tell:
        series = measure_brightness(content.capture, content.stamps, progress=tell)
    return light_lags(series, reference=content.reference, options=LightOptions(readout_s=content.readout_s))


def _motion(content: Content) -> ContentLags:
    from rigcal.sync.content.energy import energy_lags

    with _progress("looking at the motion") as tell:
        return energy_lags(content.capture, content.stamps, reference=content.reference, progress=tell)


@contextmanager
def _progress(label: str) -> Iterator[Callable[[int, int], None]]:
    with progress_bar(label) as bar:
        task = bar.add_task("", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def readouts(text: list[str] | None, camera_ids: tuple[str, ...]) -> dict[str, float]:
    """Readout times in seconds of ``20ms`` for all cameras, or ``CAMERA=20ms``."""
    from rigcal.errors import OptionError

    found: dict[str, float] = {}
    for entry in text or []:
        name, sign, value = entry.rpartition("=")
        try:
            milliseconds = float(value.removesuffix("ms"))
        except ValueError:
            milliseconds = -1.0
        if not value.endswith("ms") or milliseconds < 0 or (sign and name not in camera_ids):
            known = ", ".join(camera_ids)
            raise OptionError("--readout", expected=f"20ms, or CAMERA=20ms with CAMERA one of {known}", got=entry)
        found |= {name: milliseconds * 1e-3} if sign else dict.fromkeys(camera_ids, milliseconds * 1e-3)
    return found
