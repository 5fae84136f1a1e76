"""Clocks of cameras from a board that is moved before them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigcal.board import Board
from rigcal.captures import Capture
from rigcal.errors import ImageSizeError, OptionError, RigCaptureError
from rigcal.geometry import Floats
from rigcal.order import corner_orders
from rigcal.rig import Rig
from rigcal.stamps import FrameStamps
from rigcal.sync.content.board.frames import Boards, Progress, Run, find_in_runs
from rigcal.sync.content.board.orders import CameraBoards, corner_rows, in_one_order, middles
from rigcal.sync.content.board.windows import looking_runs, moving_windows
from rigcal.sync.content.lags import ContentLags
from rigcal.sync.content.points.search import search_offsets
from rigcal.sync.content.points.seen import prepare
from rigcal.sync.content.points.solve import LagOptions, estimate_lags
from rigcal.sync.content.points.verdict import search_problem
from rigcal.sync.content.tracks import PointTracks

_NEAR_S = 0.5
"""What the first looks leave open of an offset at most: they are a third of a second apart."""


@dataclass(frozen=True, slots=True)
class FrameBudget:
    """How many frames of each camera may be searched for a board.

    At 18 ms for a frame of 1920x1080 pixels with a board, the defaults take four cameras 21 s on two cores, and the
    time to decode them.

    Raises:
        OptionError: for less than a few seconds of frames.
    """

    looks: int = 180
    """Looks to see where the board is and moves: a minute of them."""
    consecutive: int = 400
    """Consecutive frames where it moves."""

    def __post_init__(self) -> None:
        if min(self.looks, self.consecutive) < 60:
            got = min(self.looks, self.consecutive)
            raise OptionError("frames per camera", expected="at least 60 looks and 60 consecutive frames", got=got)


def board_lags(
    capture: Capture,
    board: Board,
    rig: Rig,
    stamps: FrameStamps,
    *,
    options: LagOptions = LagOptions(),
    budget: FrameBudget = FrameBudget(),
    progress: Progress | None = None,
) -> ContentLags:
    """Offset and drift of every camera of a capture against the reference, from a board that is moved.

    Args:
        capture: Videos or images; cameras of the rig.
        board: The board.
        rig: The rig, calibrated for images of this size.
        stamps: Stamps of the capture's frames.
        options: How clocks are sought.
        budget: How many frames are searched.
        progress: Called with (frames done, frames in all); the total grows when it is known where the board moves.

    Raises:
        RigCaptureError: for cameras that the rig does not have.
        ImageSizeError: for images of another size than the rig's.
        BrokenFileError: where a frame cannot be decoded.
        TracksError: for a capture of one camera.
    """
    tracks, start_s = _follow(capture, board, rig, stamps, options.search_s, budget, progress)
    near = all(camera_id in start_s for camera_id in (track.camera_id for track in tracks))
    return estimate_lags(
        rig,
        tracks,
        method="board",
        options=replace(options, search_s=min(_NEAR_S, options.search_s)) if near else options,
        start_s=start_s,
    )


def board_tracks(
    capture: Capture,
    board: Board,
    rig: Rig,
    stamps: FrameStamps,
    *,
    search_s: float = LagOptions().search_s,
    budget: FrameBudget = FrameBudget(),
    progress: Progress | None = None,
) -> tuple[PointTracks, ...]:
    """The corners of a board that is moved, in runs of consecutive frames, numbered alike in all cameras.

    Args and errors as of :func:`board_lags`; ``search_s`` is the most that the stamps of two cameras may be apart.
    """
    return _follow(capture, board, rig, stamps, search_s, budget, progress)[0]


def _follow(
    capture: Capture,
    board: Board,
    rig: Rig,
    stamps: FrameStamps,
    search_s: float,
    budget: FrameBudget,
    progress: Progress | None,
) -> tuple[tuple[PointTracks, ...], dict[str, float]]:
    """Tracks, and the offsets of cameras as far as the first looks tell them."""
    _check(capture, rig)
    times = [np.asarray(t) for t in stamps.times_s]
    steps = _Steps(progress)
    nothing: list[Boards] = [{} for _ in capture.cameras]
    whole = [Run(camera, 0, len(t)) for camera, t in enumerate(times)]
    short = all(len(t) <= budget.consecutive for t in times)
    first = whole if short else looking_runs(times, budget.looks)
    found = find_in_runs(capture, board, first, nothing, steps.tell)
    boards = [_boards(rig, capture, board, c, looks, times[c]) for c, looks in enumerate(found)]
    start_s = _first_offsets(board, boards, search_s)
    offset_s = np.array([start_s.get(camera.id, 0.0) for camera in capture.cameras])
    if not short:
        seen = [(b.t_s[b.seen], middles(board, b.corners_px[b.seen])[:, 0]) for b in boards]
        runs = moving_windows(times, seen, offset_s, budget.consecutive)
        steps.next()
        found = find_in_runs(capture, board, runs, found, steps.tell)
        inside = [{frame for run in runs if run.camera == c for frame in run.frames} for c in range(len(times))]
        followed = [{frame: found[c][frame] for frame in frames} for c, frames in enumerate(inside)]
        boards = [_boards(rig, capture, board, c, looks, times[c]) for c, looks in enumerate(followed)]
    ordered = in_one_order(boards, offset_s, corner_orders(board))
    return tuple(PointTracks(b.member.id, b.t_s, b.corners_px) for b in ordered), start_s


@dataclass(slots=True)
class _Steps:
    """Progress over two searches, the second of which is planned after the first."""

    progress: Progress | None
    before: int = 0
    done: int = 0

    def tell(self, done: int, total: int) -> None:
        self.done = done
        if self.progress is not None:
            self.progress(self.before + done, self.before + total)

    def next(self) -> None:
        self.before, self.done = self.before + self.done, 0


def _check(capture: Capture, rig: Rig) -> None:
    unknown = [camera.id for camera in capture.cameras if camera.id not in rig.camera_ids]
    if unknown:
        raise RigCaptureError(capture.path, unknown=unknown, known=rig.camera_ids)
    for camera in capture.cameras:
        size_wh = rig.camera(camera.id).camera.size_wh
        if camera.size_wh != size_wh:
            raise ImageSizeError(
                camera.id, where=capture.path, expected_wh=size_wh, got_wh=camera.size_wh, source="the rig file"
            )


def _boards(rig: Rig, capture: Capture, board: Board, camera: int, found: Boards, times: Floats) -> CameraBoards:
    """A camera's boards in order of time, without frames whose stamps do not ascend."""
    frames = np.array(sorted(found), dtype=np.int64)
    stamps = times[frames]
    ascends = np.append(True, np.diff(np.maximum.accumulate(stamps)) > 0)[: len(frames)]
    rows = corner_rows(board, [found[frame] for frame in frames[ascends].tolist()])
    return CameraBoards(rig.camera(capture.cameras[camera].id), stamps[ascends], rows)


def _first_offsets(board: Board, boards: Sequence[CameraBoards], search_s: float) -> dict[str, float]:
    """Offsets to a tenth of a second, by the corners where they have one order, else by the board's middle."""
    alone = len(corner_orders(board)) == 1
    tracks = [PointTracks(b.member.id, b.t_s, b.corners_px if alone else middles(board, b.corners_px)) for b in boards]
    epoch_s = min((float(b.t_s[0]) for b in boards if len(b.t_s)), default=0.0)
    seen = [prepare(b.member, track, epoch_s) for b, track in zip(boards, tracks, strict=True)]
    found = search_offsets(seen, np.zeros(len(seen)), search_s=search_s)
    return {
        s.camera_id: f.offset_s
        for s, f in zip(seen, found, strict=True)
        if f is not None and (s is seen[0] or not search_problem(f, s, search_s))
    }
