"""From a capture to every board view in it, on all cores, remembering what was searched before.

Frames are searched with the quick finders first. Where a camera's checkerboard views stay few, the thorough finders
try frames without a board again, spread evenly over the camera's frames: stills taken one by one all get their second
chance, a long video without a board does not take hours.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np

from rigcal.board import AprilGrid, Board, Charuco
from rigcal.cache import DetectionCache, cache_key
from rigcal.captures import Capture, CaptureCamera, file_sha256, read_frames, read_image
from rigcal.detect.checkerboards import find_checkerboard
from rigcal.detect.found import FoundBoard, Grey
from rigcal.detect.markers import find_aprilgrid, find_charuco
from rigcal.detect.results import QUICK, THOROUGH, UNSEARCHED, FileResults
from rigcal.detections import BoardDetections, BoardView, Finding, Instants, SiteDetections

DETECTOR_VERSION = f"1 opencv {cv2.__version__}"
"""Part of every cache key; the number grows with each change of what finders return."""
ENOUGH_VIEWS = 30
"""A camera with this many views of a checkerboard is not searched again; lenses need a dozen."""
MOST_SECOND_CHANCES = 30
"""Frames of a camera that the thorough finders try, at 0.4-0.8 s each in 2 million pixels."""
LOOK_AHEAD = 2
"""Images held in memory per worker."""

Progress: TypeAlias = Callable[[int, int], None]


def detect_boards(
    capture: Capture,
    board: Board,
    *,
    instants: Instants,
    cache: DetectionCache | None = None,
    progress: Progress | None = None,
    workers: int | None = None,
) -> SiteDetections:
    """Find the board in every frame of every camera.

    Args:
        capture: the images or videos; videos whose frames are all in the cache are not decoded.
        board: the board to look for.
        instants: which frames belong together; passed on.
        cache: where results are kept between runs; None keeps nothing.
        progress: called with (frames done, frames in all) from the calling thread.
        workers: threads; one per core that this process may use when None.

    Returns:
        Views with at least six corners. Frames whose checkerboard is a part of a larger one, and grids of markers that
        lie otherwise than the board says, are findings ``dropped``; frames whose corners a finder gave turned by 180
        degrees, against the majority of the camera's frames, are put right and are findings ``unflipped``.

    Raises:
        BrokenFileError: where an image or a video cannot be decoded.
        ImageSizeError: where a camera's images differ in size.
    """
    with _one_thread_per_image(), ThreadPoolExecutor(workers or _cores()) as pool:
        paths = [path for camera in capture.cameras for path in camera.paths]
        sha256 = dict(zip(paths, pool.map(file_sha256, paths), strict=True))
        counter = _Counter(sum(len(camera.frames) for camera in capture.cameras), progress)
        search = _Search(pool, workers or _cores(), board, cache, sha256, counter)
        cameras = tuple(search.camera(camera) for camera in capture.cameras)
    return SiteDetections(board, cameras, instants, capture.digest(sha256))


def find_board(grey: Grey, board: Board, *, thorough: bool = True) -> FoundBoard | None:
    """The board in one (height, width) 8-bit image, or None.

    Args:
        grey: the image.
        board: the board to look for.
        thorough: try the slow finders of checkerboards as well.
    """
    if isinstance(board, Charuco):
        return find_charuco(grey, board)
    if isinstance(board, AprilGrid):
        return find_aprilgrid(grey, board)
    return find_checkerboard(grey, board, thorough=thorough)


@dataclass(slots=True)
class _Counter:
    """Frames done, and in all."""

    total: int
    progress: Progress | None
    done: int = 0

    def add(self, done: int = 0, total: int = 0) -> None:
        self.done, self.total = self.done + done, self.total + total
        if self.progress is not None:
            self.progress(self.done, self.total)


@dataclass(frozen=True, slots=True)
class _Search:
    """Everything that the search of one camera needs."""

    pool: ThreadPoolExecutor
    workers: int
    board: Board
    cache: DetectionCache | None
    sha256: Mapping[Path, str]
    counter: _Counter

    def camera(self, camera: CaptureCamera) -> BoardDetections:
        """All board views of a camera."""
        per_file = len(camera.frames) // len(camera.paths)
        files = [FileResults.from_arrays(self._stored(path), per_file) for path in camera.paths]
        before = [list(file.effort) for file in files]
        frames = [(file, k) for file in files for k in range(per_file)]
        first = [index for index, (file, k) in enumerate(frames) if file.effort[k] == UNSEARCHED]
        self.counter.add(done=len(frames) - len(first))
        self._sweep(camera, frames, first, QUICK if self.board.kind == "checkerboard" else THOROUGH)
        second = _second_chances(frames)
        self.counter.add(total=len(second))
        self._sweep(camera, frames, second, THOROUGH)
        for path, file, effort in zip(camera.paths, files, before, strict=True):
            if self.cache is not None and file.effort != effort:
                self.cache.store(self._key(path), file.to_arrays())
        found = {index: file.boards[k] for index, (file, k) in enumerate(frames) if k in file.boards}
        return _detections(camera, found)

    def _key(self, path: Path) -> str:
        return cache_key(self.sha256[path], board=self.board.spec, version=DETECTOR_VERSION)
