"""From a capture to every board view in it, on all cores, remembering what was searched before.

The frames that :mod:`rigcal.detect.looks` chooses are searched with the quick finders. Where a camera's checkerboard
views stay few, the thorough finders try frames without a board again, spread evenly over the camera's frames, and stop
when five of them showed nothing: stills taken one by one get their second chance. A video gets it only where it showed
no board at all, since its other frames are chances enough.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np

from rigcal.board import AprilGrid, Board, Charuco, Checkerboard
from rigcal.cache import DetectionCache, cache_key
from rigcal.captures import Capture, CaptureCamera, file_sha256, read_frames, read_frames_at, read_image
from rigcal.cores import core_count
from rigcal.detect.checkerboards import find_checkerboard
from rigcal.detect.found import FoundBoard, Grey
from rigcal.detect.looks import closer_looks, first_looks
from rigcal.detect.markers import find_aprilgrid, find_charuco
from rigcal.detect.results import QUICK, THOROUGH, UNSEARCHED, Results
from rigcal.detect.views import board_detections
from rigcal.detections import BoardDetections, Instants, SiteDetections

DETECTOR_VERSION = f"3 opencv {cv2.__version__}"
"""Part of every cache key; the number grows with each change of what finders return."""
ENOUGH_VIEWS = 30
"""A camera with this many views of a checkerboard is not searched again; lenses need a dozen."""
FRAMES_IN_TURN, TURNS = 5, 4
"""Frames that the thorough finders try in a turn, and turns at most; 0.4-0.8 s for each frame of 2 million pixels."""
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
    """Find the board in every image of every camera, and in the frames of videos that are worth a look.

    Args:
        capture: the images or videos; videos whose frames are all in the cache are not decoded.
        board: the board to look for.
        instants: which frames belong together; long videos are looked at in the same instants.
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
        search = _Search(pool, workers or core_count(), board, cache, sha256, _Counter(progress))
        cameras = search.capture(capture, instants)
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

    progress: Progress | None
    total: int = 0
    done: int = 0

    def add(self, done: int = 0, total: int = 0) -> None:
        self.done, self.total = self.done + done, self.total + total
        if self.progress is not None:
            self.progress(self.done, self.total)


@dataclass(slots=True)
class _Searched:
    """A camera and what its search has brought so far."""

    camera: CaptureCamera
    results: Results
    kept: list[int]
    """The effort of each frame that the cache knows of."""
    looked: set[int] = field(default_factory=set)
    """Frames looked at with the quick finders, now or in an earlier run."""
    tried: set[int] = field(default_factory=set)
    """Frames that the thorough finders tried, now or in an earlier run."""

    @property
    def boards(self) -> dict[int, FoundBoard]:
        """What this run's looks show: what an earlier run found elsewhere does not count."""
        found, effort = self.results.boards, self.results.effort
        return {i: b for i, b in found.items() if i in (self.looked if effort[i] == QUICK else self.tried)}


@dataclass(frozen=True, slots=True)
class _Search:
    """Everything that the search of a capture needs."""

    pool: ThreadPoolExecutor
    workers: int
    board: Board
    cache: DetectionCache | None
    sha256: Mapping[Path, str]
    counter: _Counter

    def capture(self, capture: Capture, instants: Instants) -> tuple[BoardDetections, ...]:
        """All board views of every camera."""
        searched = [self._stored(camera) for camera in capture.cameras]
        self._look(searched, first_looks(capture, instants))
        boards = [s.boards.keys() for s in searched]
        self._look(searched, closer_looks(capture, instants, boards, enough=ENOUGH_VIEWS))
        if isinstance(self.board, Checkerboard):
            for one in searched:
                self._try_again(one)
                self._store(one)
        return tuple(board_detections(one.camera, one.boards) for one in searched)

    def _look(self, searched: Sequence[_Searched], looks: Sequence[set[int]]) -> None:
        """Search the frames ``looks`` of each camera with the quick finders."""
        unknown = [
            {i for i in look if one.results.effort[i] == UNSEARCHED} for one, look in zip(searched, looks, strict=True)
        ]
        self.counter.add(done=sum(map(len, looks)) - sum(map(len, unknown)), total=sum(map(len, looks)))
        for one, look, wanted in zip(searched, looks, unknown, strict=True):
            self._sweep(one, wanted, QUICK)
            one.looked |= look
            self._store(one)

    def _try_again(self, one: _Searched) -> None:
        """Let the thorough finders try some frames in turns, up to a turn that finds nothing.

        What they found in an earlier run does not count, so that the choice never changes.
        """
        effort, boards = one.results.effort, one.results.boards
        missed = [i for i in sorted(one.looked) if effort[i] == THOROUGH or i not in boards]
        enough = ENOUGH_VIEWS if one.camera.kind == "images" else 1
        if not missed or len(one.looked) - len(missed) >= enough:
            return
        spread = np.unique(np.linspace(0, len(missed) - 1, TURNS * FRAMES_IN_TURN).round().astype(int))
        turns = -(-len(spread) // FRAMES_IN_TURN)
        for turn in (spread[k::turns] for k in range(turns)):
            frames = {missed[k] for k in turn}
            unknown = {i for i in frames if effort[i] < THOROUGH}
            self.counter.add(total=len(unknown))
            self._sweep(one, unknown, THOROUGH)
            one.tried |= frames
            if not frames & boards.keys():
                return

    def _stored(self, camera: CaptureCamera) -> _Searched:
        """What the cache knows of a camera."""
        per_file = len(camera.frames) // len(camera.paths)
        stored = [self.cache.load(self._key(path)) if self.cache else None for path in camera.paths]
        results = Results.joined([Results.from_arrays(arrays, per_file) for arrays in stored])
        return _Searched(camera, results, list(results.effort))

    def _store(self, one: _Searched) -> None:
        """Keep what is new."""
        per_file = len(one.camera.frames) // len(one.camera.paths)
        for k, path in enumerate(one.camera.paths):
            part = one.results.part(k * per_file, per_file)
            if self.cache is not None and part.effort != one.kept[k * per_file : (k + 1) * per_file]:
                self.cache.store(self._key(path), part.to_arrays())
        one.kept = list(one.results.effort)

    def _key(self, path: Path) -> str:
        return cache_key(self.sha256[path], board=self.board.spec, version=DETECTOR_VERSION)

    def _sweep(self, one: _Searched, wanted: Set[int], effort: int) -> None:
        """Search the wanted frames, a bounded number ahead of the one whose result is waited for."""
        waiting: deque[tuple[int, Future[FoundBoard | None]]] = deque()

        def take() -> None:
            index, future = waiting.popleft()
            found = future.result()
            if found is not None:
                one.results.boards[index] = found
            one.results.effort[index] = effort
            self.counter.add(done=1)

        for index, load in _loaders(one.camera, wanted, few=effort == THOROUGH):
            waiting.append((index, self.pool.submit(_search_one, load, self.board, effort)))
            if len(waiting) > LOOK_AHEAD * self.workers:
                take()
        while waiting:
            take()


def _search_one(load: Callable[[], Grey], board: Board, effort: int) -> FoundBoard | None:
    return find_board(load(), board, thorough=effort == THOROUGH)


def _loaders(camera: CaptureCamera, wanted: Set[int], *, few: bool) -> Iterator[tuple[int, Callable[[], Grey]]]:
    """The wanted frames as functions that give the image: images are decoded by the worker, videos by the caller."""
    if camera.kind == "images":
        yield from ((index, partial(read_image, camera, camera.paths[index])) for index in sorted(wanted))
    elif wanted:
        frames = read_frames_at(camera, sorted(wanted)) if few else read_frames(camera, wanted=wanted)
        yield from ((index, partial(_same, image)) for index, image in frames)


def _same(image: Grey) -> Grey:
    return image


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
