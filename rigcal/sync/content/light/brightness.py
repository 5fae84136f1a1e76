"""How bright each part of each frame is: what a light that is switched is found in.

The image is divided into rows of cells. Rows, because a rolling shutter exposes them one after the other; cells of a
row, because a lamp may light one corner only and people walk through the rest. Decoding takes nearly all of the time:
of each cell only a sample of the pixels is read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from rigcal.captures import Capture, CaptureCamera, read_frames
from rigcal.geometry import Floats, freeze
from rigcal.stamps import FrameStamps

BANDS, COLUMNS = 32, 8
"""Cells of a frame: a row of cells spans 0.6 ms of a readout of 20 ms."""
_SAMPLED_PX = 320  # pixels read along either side of an image
_WHITE = 250  # grey levels from here on are taken for clipped


@dataclass(frozen=True, slots=True, eq=False)
class BrightnessSeries:
    """The brightness of one camera's image over time."""

    camera_id: str
    t_s: Floats
    """(F,) stamp of each frame by the camera's own clock, ascending, in seconds."""
    cells: Floats
    """(F, B, C) mean grey of each cell, 0 to 255; band 0 is the top of the image."""
    clipped: Floats
    """(B, C) greatest share of a cell's pixels that were white in any frame: there, more light does not show."""
    height_px: int
    coded: bool = False
    """Whether the frames come from a video, whose encoder hides small changes and smears them over its blocks."""

    def __post_init__(self) -> None:
        freeze(self, np.float64, t_s=(None,))
        freeze(self, np.float64, cells=(len(self.t_s), None, None))
        freeze(self, np.float64, clipped=self.cells.shape[1:])

    @property
    def rows(self) -> Floats:
        """(B,) middle of each band, from -1/2 at the centre of the first row to 1/2 at the centre of the last."""
        bands = self.cells.shape[1]
        row_px = (np.arange(bands) + 0.5) * self.height_px / bands - 0.5
        return np.asarray(row_px / max(self.height_px - 1, 1) - 0.5)

    @property
    def period_s(self) -> float:
        """Frame period: the median spacing of the stamps."""
        return float(np.median(np.diff(self.t_s)))


def measure_brightness(
    capture: Capture, stamps: FrameStamps, *, progress: Callable[[int, int], None] | None = None
) -> tuple[BrightnessSeries, ...]:
    """The brightness of every camera's frames.

    Args:
        capture: the capture; every frame is decoded.
        stamps: its frames' stamps.
        progress: told frames done and frames in all.

    Raises:
        BrokenFileError, ImageSizeError: where frames cannot be decoded.
        ValueError: where the stamps are another capture's.
    """
    counts = stamps.counts_for(capture)
    series: list[BrightnessSeries] = []
    for camera, t_s in zip(capture.cameras, stamps.times_s, strict=True):
        done = sum(len(one.t_s) for one in series)
        frames = _counted(camera, progress, done, sum(counts))
        series.append(brightness_of_frames(camera.id, t_s, frames, coded=camera.kind == "video"))
    return tuple(series)


def _counted(
    camera: CaptureCamera, progress: Callable[[int, int], None] | None, done: int, total: int
) -> Iterator[NDArray[np.uint8]]:
    for index, image in read_frames(camera):
        yield image
        if progress is not None:
            progress(done + index + 1, total)


def brightness_of_frames(
    camera_id: str, t_s: Floats, frames: Iterable[NDArray[np.uint8]], *, coded: bool = False
) -> BrightnessSeries:
    """The brightness of images (H, W), grey, of one camera; ``coded`` where an encoder had them before.

    Raises:
        ValueError: where there is another number of images than of stamps, or none.
    """
    means, height_px, clipped = [], 0, np.zeros((BANDS, COLUMNS))
    for image in frames:
        height_px, sample = len(image), _sample(image)
        means.append(_cell_means(sample))
        if sample.max() >= _WHITE:
            clipped = np.maximum(clipped, _cell_means(sample >= _WHITE))
    return BrightnessSeries(camera_id, t_s, np.array(means), clipped, height_px, coded)


def _sample(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Every n-th row and column, so that about ``_SAMPLED_PX`` are left of each."""
    rows, columns = (max(size // _SAMPLED_PX, 1) for size in image.shape)
    return image[rows // 2 :: rows, columns // 2 :: columns]


def _cell_means(sample: NDArray[np.generic]) -> Floats:
    """(B, C) mean of each cell; pixels that two cells share count in parts."""
    means = cv2.resize(sample.astype(np.float32), (COLUMNS, BANDS), interpolation=cv2.INTER_AREA)
    return np.asarray(means, dtype=np.float64)
