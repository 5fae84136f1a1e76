"""Decoded images in memory maps, so that an augmented sample costs milliseconds: whole images for the site network,
native-resolution crops for the worker network.

A map lies beside the data and is made again when the data file changes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from recognition.detectors.bundled.geometry import PAD, WORKER_WH, Placing, crop_placing, crop_xyxy
from rigcal.geometry import Floats
from tools.train.coco import DataError, DataSet, Picture, Truth
from tools.train.geometry import letterbox
from tools.train.warp import warp_image

Image = NDArray[np.uint8]
CACHED_WH = (640, 360)
"""Of whole images for training: enough for objects that augmentation enlarges up to 1.6 times at 512 x 288."""
AROUND = 1.5
"""A cached crop's side over the network's: room for turning, shifting and shrinking."""
DENSITY = 1.25
"""Cached crop pixels per pixel of the network's input."""
CROP_WH = (int(WORKER_WH[0] * AROUND * DENSITY), int(WORKER_WH[1] * AROUND * DENSITY))


@dataclass(frozen=True, slots=True, eq=False)
class Cache:
    """Images of one size with their truth."""

    images: NDArray[np.uint8]
    """(M, H, W, 3) BGR, a memory map."""
    truths: tuple[Truth, ...]
    """In edge coordinates of these images; of crops the first annotation is the worker in the middle."""


def read_image(picture: Picture) -> Image:
    """Decode a picture.

    Raises:
        DataError: where it is missing, no image or of another size than the data file says.
    """
    image = cv2.imread(str(picture.path), cv2.IMREAD_COLOR)
    size = None if image is None else (image.shape[1], image.shape[0])
    if image is None or size != picture.size_wh:
        raise DataError(
            "an image is not what the data file says", where=picture.path, expected=picture.size_wh, got=size,
            do_next="Render it again, or export the data file again.",
        )  # fmt: skip
    return np.asarray(image, dtype=np.uint8)


def placed(image: Image, placing: Placing, size_wh: tuple[int, int]) -> Image:
    """The image under a placing, grey beside it; averaged where it shrinks to less than half."""
    share = 1.0
    if placing.scale < 0.5:
        share = 0.5 ** int(np.floor(-np.log2(placing.scale)))
        image = np.asarray(cv2.resize(image, None, fx=share, fy=share, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    matrix = np.column_stack([np.eye(2) * placing.scale / share, placing.offset])
    return warp_image(image, matrix, size_wh)


def letterboxed(image: Image, size_wh: tuple[int, int]) -> Image:
    """The whole image in a network's input: means over exact areas, grey beside it."""
    placing = letterbox((image.shape[1], image.shape[0]), size_wh)
    inner = np.rint(np.array([image.shape[1], image.shape[0]]) * placing.scale).astype(int)
    canvas = np.full((size_wh[1], size_wh[0], 3), PAD, dtype=np.uint8)
    x, y = (int(corner) for corner in placing.offset)
    canvas[y : y + inner[1], x : x + inner[0]] = cv2.resize(
        image, (int(inner[0]), int(inner[1])), interpolation=cv2.INTER_AREA
    )
    return canvas


def moved(truth: Truth, placing: Placing) -> Truth:
    """The truth in the coordinates of an input."""
    points = truth.points.copy()
    points[..., :2] = placing.to_input(points[..., :2])
    boxes = placing.to_input(truth.boxes.reshape(-1, 2, 2)).reshape(-1, 4)
    return Truth(truth.classes, boxes, points, truth.ignore)


def site_cache(data: DataSet, size_wh: tuple[int, int], say: Callable[[str], None]) -> Cache:
    """Every picture letterboxed to a size (``CACHED_WH`` to train, ``SITE_WH`` to validate)."""

    def fill(images: NDArray[np.uint8]) -> None:
        for idx, picture in enumerate(data.pictures):
            images[idx] = letterboxed(read_image(picture), size_wh)

    truths = tuple(moved(picture.truth, letterbox(picture.size_wh, size_wh)) for picture in data.pictures)
    return Cache(_mapped(data, f"site{size_wh[0]}", (len(truths), size_wh[1], size_wh[0], 3), fill, say), truths)


def worker_cache(data: DataSet, say: Callable[[str], None]) -> Cache:
    """A crop around every worker that counts, ``AROUND`` times what the network sees, with the hats in it."""
    hat = data.number("hard_hat")
    places: list[tuple[int, Placing]] = []
    truths = []
    for number, picture in enumerate(data.pictures):
        truth = picture.truth
        for who in np.flatnonzero((truth.classes == 0) & ~truth.ignore):
            placing = crop_placing(widened(crop_xyxy(truth.boxes[who])[0]), CROP_WH)
            hats = np.flatnonzero(truth.classes == hat)
            places.append((number, placing))
            truths.append(moved(truth.picked(np.concatenate([[who], hats])), placing))

    def fill(images: NDArray[np.uint8]) -> None:
        last, image = -1, np.zeros((0, 0, 3), dtype=np.uint8)
        for idx, (number, placing) in enumerate(places):
            if number != last:
                last, image = number, read_image(data.pictures[number])
            images[idx] = placed(image, placing, CROP_WH)

    return Cache(_mapped(data, "worker", (len(places), CROP_WH[1], CROP_WH[0], 3), fill, say), tuple(truths))


def widened(crop: Floats) -> Floats:
    """The crop (4,) with ``AROUND``."""
    middle, half = (crop[:2] + crop[2:]) / 2, (crop[2:] - crop[:2]) / 2 * AROUND
    return np.concatenate([middle - half, middle + half])


def _mapped(
    data: DataSet,
    name: str,
    shape: tuple[int, ...],
    fill: Callable[[NDArray[np.uint8]], None],
    say: Callable[[str], None],
) -> NDArray[np.uint8]:
    key = hashlib.sha256(data.source.read_bytes() + repr(shape).encode()).hexdigest()[:16]
    stem = f"{data.source.stem}_{name}"
    folder = data.source.parent / "cache"
    path = folder / f"{stem}_{key}.npy"
    if not path.exists():
        folder.mkdir(exist_ok=True)
        for old in folder.glob(f"{stem}_*.npy"):
            old.unlink()
        say(f"decoding {shape[0]} images into {path}")
        part = path.with_suffix(".part")
        images = np.lib.format.open_memmap(part, mode="w+", dtype=np.uint8, shape=shape)
        fill(images)
        images.flush()
        part.rename(path)
    return np.asarray(np.load(path, mmap_mode="r"))
