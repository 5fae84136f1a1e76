"""From a capture to every board view in it, on all cores, remembering what was searched before.

Frames are searched with the quick finders first. Where a camera's checkerboard views stay few, the thorough finders
try frames without a board again, spread evenly over the camera's frames, and stop when ten of them showed nothing:
stills taken one by one get their second chance, a long video without a board does not take hours.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from rigcal.board import AprilGrid, Board, Charuco, Checkerboard
from rigcal.cache import DetectionCache, cache_key
from rigcal.captures import Capture, CaptureCamera, file_sha256, read_frames, read_image
from rigcal.detect.checkerboards import find_checkerboard
from rigcal.detect.found import FoundBoard, Grey
from rigcal.detect.markers import find_aprilgrid, find_charuco
from rigcal.detect.results import QUICK, THOROUGH, UNSEARCHED, Results
from rigcal.detections import BoardDetections, BoardView, Finding, Instants, SiteDetections, join_findings

DETECTOR_VERSION = f"1 opencv {cv2.__version__}"
"""Part of every cache key; the number grows with each change of what finders return."""
ENOUGH_VIEWS = 30
"""A camera with this many views of a checkerboard is not searched again; lenses need a dozen."""
FRAMES_IN_TURN, TURNS = 10, 3
"""Frames that the thorough finders try in a turn, and turns at most; 0.4-0.8 s for each frame of 2 million pixels."""
TURNED = "its corners came turned by 180 degrees; put right by the colours of the squares"
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
    with one_thread_per_image(), ThreadPoolExecutor(workers or core_count()) as pool:
        paths = [path for camera in capture.cameras for path in camera.paths]
        sha256 = dict(zip(paths, pool.map(file_sha256, paths), strict=True))
        counter = _Counter(sum(len(camera.frames) for camera in capture.cameras), progress)
        search = _Search(pool, workers or core_count(), board, cache, sha256, counter)
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
        results = Results.joined([Results.from_arrays(self._stored(path), per_file) for path in camera.paths])
        before = list(results.effort)
        first = [index for index, effort in enumerate(before) if effort == UNSEARCHED]
        self.counter.add(done=len(before) - len(first))
        self._sweep(camera, results, first, QUICK)
        second = self._try_again(camera, results) if isinstance(self.board, Checkerboard) else set()
        for k, path in enumerate(camera.paths):
            part = results.part(k * per_file, per_file)
            if self.cache is not None and part.effort != before[k * per_file : (k + 1) * per_file]:
                self.cache.store(self._key(path), part.to_arrays())
        counted = {i: b for i, b in results.boards.items() if results.effort[i] == QUICK or i in second}
        return _detections(camera, counted)

    def _try_again(self, camera: CaptureCamera, results: Results) -> set[int]:
        """Let the thorough finders try some frames in turns, up to a turn that finds nothing; which frames they tried.

        What they found in an earlier run does not count, so that the choice never changes.
        """
        missed = [i for i, effort in enumerate(results.effort) if effort == THOROUGH or i not in results.boards]
        tried: set[int] = set()
        if not missed or len(results.effort) - len(missed) >= ENOUGH_VIEWS:
            return tried
        spread = np.unique(np.linspace(0, len(missed) - 1, TURNS * FRAMES_IN_TURN).round().astype(int))
        turns = -(-len(spread) // FRAMES_IN_TURN)
        for turn in (spread[k::turns] for k in range(turns)):
            frames = {missed[k] for k in turn}
            unknown = sorted(i for i in frames if results.effort[i] < THOROUGH)
            self.counter.add(total=len(unknown))
            self._sweep(camera, results, unknown, THOROUGH)
            tried |= frames
            if not frames & results.boards.keys():
                break
        return tried

    def _stored(self, path: Path) -> dict[str, NDArray[Any]] | None:
        return self.cache.load(self._key(path)) if self.cache is not None else None

    def _key(self, path: Path) -> str:
        return cache_key(self.sha256[path], board=self.board.spec, version=DETECTOR_VERSION)

    def _sweep(self, camera: CaptureCamera, results: Results, wanted: Sequence[int], effort: int) -> None:
        """Search the wanted frames, a bounded number ahead of the one whose result is waited for."""
        waiting: deque[tuple[int, Future[FoundBoard | None]]] = deque()

        def take() -> None:
            index, future = waiting.popleft()
            found = future.result()
            if found is not None:
                results.boards[index] = found
            results.effort[index] = effort
            self.counter.add(done=1)

        for index, load in _loaders(camera, set(wanted)):
            waiting.append((index, self.pool.submit(_search_one, load, self.board, effort)))
            if len(waiting) > LOOK_AHEAD * self.workers:
                take()
        while waiting:
            take()


def _search_one(load: Callable[[], Grey], board: Board, effort: int) -> FoundBoard | None:
    return find_board(load(), board, thorough=effort == THOROUGH)


def _loaders(camera: CaptureCamera, wanted: set[int]) -> Iterator[tuple[int, Callable[[], Grey]]]:
    """The wanted frames as functions that give the image: images are decoded by the worker, videos by the caller."""
    if camera.kind == "images":
        yield from ((index, partial(read_image, camera, camera.paths[index])) for index in sorted(wanted))
    elif wanted:
        yield from ((index, partial(_same, image)) for index, image in read_frames(camera) if index in wanted)


def _same(image: Grey) -> Grey:
    return image


def _detections(camera: CaptureCamera, found: Mapping[int, FoundBoard]) -> BoardDetections:
    """Views and findings of a camera, from the boards found by frame."""
    used = {index: board for index, board in found.items() if not board.problem}
    turned = {index for index, board in used.items() if board.turned}
    odd = turned if 2 * len(turned) <= len(used) else set(used) - turned
    findings = [Finding(camera.frames[i], "dropped", board.problem) for i, board in found.items() if board.problem]
    findings += [Finding(camera.frames[i], "unflipped", TURNED) for i in odd]
    views = tuple(BoardView(index, board.corner_ids, board.corners_px) for index, board in sorted(used.items()))
    return BoardDetections(camera.id, camera.size_wh, camera.frames, views, join_findings(findings))


def core_count() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def one_thread_per_image() -> Iterator[None]:
    """OpenCV keeps to one thread while the images themselves are searched side by side.

    With more, the finders' random numbers would also depend on how the threads take turns.
    """
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)
