"""Runs of consecutive frames and the boards in them, on all cores."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from typing import TypeAlias

import av
import av.error
import numpy as np

from rigcal.board import Board
from rigcal.captures import Capture, CaptureCamera, read_frames
from rigcal.cores import core_count
from rigcal.detect import FoundBoard, find_board
from rigcal.detect.found import Grey
from rigcal.detect.sweep import one_thread_per_image

Progress: TypeAlias = Callable[[int, int], None]
Boards: TypeAlias = dict[int, FoundBoard | None]
"""Of each frame of a camera that was looked at, the board in it."""


@dataclass(frozen=True, slots=True)
class Run:
    """Frames of one camera to look at: from the first to the last, every ``stride``-th."""

    camera: int
    first: int
    stop: int
    stride: int = 1

    @property
    def frames(self) -> range:
        """Indices of the frames."""
        return range(self.first, self.stop, self.stride)


def find_in_runs(
    capture: Capture,
    board: Board,
    runs: Sequence[Run],
    known: Sequence[Mapping[int, FoundBoard | None]],
    tell: Progress,
) -> list[Boards]:
    """The boards in the frames of runs, per camera; frames that are known already are not searched again.

    Raises:
        BrokenFileError: where a frame cannot be decoded.
    """
    found: list[Boards] = [dict(boards) for boards in known]
    total, done = sum(len(run.frames) for run in runs), 0
    with one_thread_per_image(), ThreadPoolExecutor(core_count()) as pool:
        jobs: dict[Future[Boards], Run] = {
            pool.submit(_find, capture.cameras[run.camera], board, run, known[run.camera]): run for run in runs
        }
        for job in as_completed(jobs):
            run = jobs[job]
            found[run.camera].update(job.result())
            done += len(run.frames)
            tell(done, total)
    return found


def _find(camera: CaptureCamera, board: Board, run: Run, known: Mapping[int, FoundBoard | None]) -> Boards:
    wanted = [index for index in run.frames if index not in known]
    found: Boards = {}
    for index, grey in _frames(camera, wanted):
        seen = find_board(grey, board, thorough=False)
        found[index] = seen if seen is not None and not seen.problem else None
    return found


def _frames(camera: CaptureCamera, wanted: Sequence[int]) -> Iterator[tuple[int, Grey]]:
    """Frames of a camera, ascending; of a video, decoded from the key frame before the first of them."""
    given = 0
    if camera.kind == "video" and wanted and wanted[0] > 0:
        for index, grey in _sought(camera, wanted):
            given += 1
            yield index, grey
    yield from read_frames(camera, wanted=set(wanted[given:]))


def _sought(camera: CaptureCamera, wanted: Sequence[int]) -> Iterator[tuple[int, Grey]]:
    """Frames of a video by their times, as far as they are found at them: some files cannot be sought in."""
    left = iter(wanted)
    due = next(left)
    try:
        with av.open(str(camera.paths[0])) as container:
            stream = container.streams.video[0]
            ticks = sorted(packet.pts for packet in container.demux(stream) if packet.size and packet.pts is not None)
            if len(ticks) != len(camera.frames):
                return
            index_of = {tick: index for index, tick in enumerate(ticks)}
            container.seek(ticks[due], stream=stream)
            for frame in container.decode(stream):
                index = index_of.get(frame.pts, -1) if frame.pts is not None else -1
                if index > due:
                    return
                if index == due:
                    yield index, np.asarray(frame.to_ndarray(format="gray"), dtype=np.uint8)
                    due = next(left, len(ticks))
                    if due == len(ticks):
                        return
    except av.error.FFmpegError:
        return
