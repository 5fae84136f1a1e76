"""Augmented samples and batches for both networks.

A sample follows from (seed, epoch, index) alone, so that a run that was interrupted goes on as if it had not been.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import DataLoader, Dataset, Sampler

from recognition.detectors.bundled.geometry import SITE_WH, WORKER_WH
from rigcal.geometry import Floats
from tools.train.cache import CACHED_WH, CROP_WH, DENSITY, Cache
from tools.train.coco import Truth
from tools.train.heads import bareheaded, cut_at, head_of, spotlit, worker_first
from tools.train.pixels import holed, recoloured
from tools.train.warp import Mirror, hidden, side_by_side, similarity, warp_image, warp_truth

Image = NDArray[np.uint8]
Key = tuple[int, int]
"""Epoch and number of the sample."""
BARE_TIMES = 4
"""How often an epoch shows a bare head. In the 12,262 training crops 10,489 heads are seen, 1,286 of them bare: four
times that makes more than one of three."""


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Images and what is in them; G annotations of all images one after the other."""

    images: Tensor
    """(N, H, W, 3) uint8 BGR."""
    image_idx: Tensor
    """(G,) image of each annotation."""
    classes: Tensor
    """(G,)."""
    boxes: Tensor
    """(G, 4) xyxy."""
    points: Tensor
    """(G, 17, 3) x, y, flag."""
    sizes: Tensor
    """(G,) square root of the area of all that is labelled."""
    ignore: Tensor
    """(G,) bool."""


def collate(samples: Sequence[tuple[Image, Truth]]) -> Batch:
    """Samples as a batch."""
    truths = [truth for _, truth in samples]
    counts = [len(truth.classes) for truth in truths]

    def joined(parts: list[NDArray[np.float64]]) -> Tensor:
        return torch.from_numpy(np.concatenate(parts).astype(np.float32))

    return Batch(
        torch.from_numpy(np.stack([image for image, _ in samples])),
        torch.repeat_interleave(torch.arange(len(samples)), torch.tensor(counts)),
        torch.from_numpy(np.concatenate([truth.classes for truth in truths])),
        joined([truth.boxes for truth in truths]),
        joined([truth.points for truth in truths]),
        joined([truth.sizes() for truth in truths]),
        torch.from_numpy(np.concatenate([truth.ignore for truth in truths])),
    )


def network_input(images: Tensor) -> Tensor:
    """(N, 3, H, W) 0..1 in bfloat16 of (N, H, W, 3) uint8; in memory the channels stay last."""
    return images.permute(0, 3, 1, 2).to(torch.bfloat16).mul_(1 / 255)


class SiteSamples(Dataset[tuple[Image, Truth]]):
    """Augmented whole images of one size."""

    def __init__(self, cache: Cache, mirror: Mirror, seed: int, size_wh: tuple[int, int] = SITE_WH) -> None:
        self._cache, self._mirror, self._seed, self._size_wh = cache, mirror, seed, size_wh

    def __len__(self) -> int:
        return len(self._cache.truths)

    def __getitem__(self, key: Key) -> tuple[Image, Truth]:
        """The sample of a key."""
        rng = np.random.default_rng((self._seed, *key))
        image, truth = self._placed(key[1], rng)
        if rng.random() < 0.2:
            column = int(self._size_wh[0] * rng.uniform(0.3, 0.7))
            image, truth = side_by_side((image, truth), self._placed(int(rng.integers(len(self))), rng), column)
        if rng.random() < 0.35:
            donor = self._cache.images[int(rng.integers(len(self)))][: self._size_wh[1], : self._size_wh[0]]
            image, holes = holed(image, rng, donor)
            truth = hidden(truth, holes)
        return recoloured(image, rng), truth

    def _placed(self, index: int, rng: np.random.Generator) -> tuple[Image, Truth]:
        scale = SITE_WH[0] / CACHED_WH[0] * np.exp(rng.uniform(np.log(0.6), np.log(1.6)))
        size, wanted = np.array(CACHED_WH) * scale, np.array(self._size_wh)
        corner = -(size - wanted) * rng.random(2) + rng.normal(0.0, 0.03, 2) * wanted
        matrix = similarity(
            float(scale), 0.0, (CACHED_WH[0] / 2, CACHED_WH[1] / 2), tuple(corner + size / 2), flip=rng.random() < 0.5
        )
        image = warp_image(self._cache.images[index], matrix, self._size_wh)
        return image, warp_truth(self._cache.truths[index], matrix, self._size_wh, self._mirror)


class WorkerSamples(Dataset[tuple[Image, Truth]]):
    """Augmented crops; the first annotation is the worker in the middle, hats follow.

    Crops of bare heads come ``BARE_TIMES`` times an epoch, each time augmented differently. Seven of eight heads in
    the data wear a hat, and a network that sees them as they come learns that there is one wherever a head is. So the
    bundled one did until its epoch 40: of the validation pictures it took 13 % of the bare heads for hats while it
    missed 12 % of the hats that are worn. After 12 more epochs like this it was 8 % while it missed as many.
    """

    def __init__(self, cache: Cache, mirror: Mirror, seed: int) -> None:
        self._cache, self._mirror, self._seed = cache, mirror, seed
        bare = [idx for idx, truth in enumerate(cache.truths) if bareheaded(truth)]
        self._crops = np.concatenate([np.arange(len(cache.truths)), np.tile(bare, BARE_TIMES - 1)]).astype(int)
        """(samples,) crop of each sample."""

    def __len__(self) -> int:
        return len(self._crops)

    def __getitem__(self, key: Key) -> tuple[Image, Truth]:
        """The sample of a key."""
        rng = np.random.default_rng((self._seed, *key))
        crop = self._crops[key[1]]
        matrix = _crop_matrix(rng)
        image = warp_image(self._cache.images[crop], matrix, WORKER_WH)
        truth = warp_crop(self._cache.truths[crop], matrix, self._mirror)
        head = head_of(truth)
        if head is not None and rng.random() < 0.3:
            image = spotlit(image, rng, head)
        if head is not None and rng.random() < 0.06:
            image, truth = cut_at(image, truth, rng, head)
        if rng.random() < 0.35:
            donor = self._cache.images[int(rng.integers(len(self._cache.truths)))][: WORKER_WH[1], : WORKER_WH[0]]
            image, holes = holed(image, rng, donor)
            truth = hidden(truth, holes)
        return recoloured(image, rng), truth


def _crop_matrix(rng: np.random.Generator) -> Floats:
    scale = np.exp(rng.normal(0.0, 0.14)) / DENSITY
    from_xy = np.array(CROP_WH) * (0.5 + rng.normal(0.0, 0.04, 2))
    if rng.random() < 0.15:  # boxes of people whose legs are hidden: the crop shows the upper half
        scale *= rng.uniform(1.2, 1.6)
        from_xy[1] -= CROP_WH[1] * rng.uniform(0.05, 0.12)
    turn = float(np.clip(rng.normal(0.0, 0.14), -0.5, 0.5))
    middle = (WORKER_WH[0] / 2, WORKER_WH[1] / 2)
    return similarity(float(np.clip(scale, 0.5, 1.5)), turn, tuple(from_xy), middle, flip=rng.random() < 0.5)


def plain_crop() -> Floats:
    """(2, 3) from a cached crop to what the network sees at run time."""
    middle = (WORKER_WH[0] / 2, WORKER_WH[1] / 2)
    return similarity(1 / DENSITY, 0.0, (CROP_WH[0] / 2, CROP_WH[1] / 2), middle, flip=False)


def warp_crop(truth: Truth, matrix: Floats, mirror: Mirror) -> Truth:
    """The truth of a crop under (2, 3); the worker in the middle stays the first annotation whatever is left of him."""
    parts = [warp_truth(truth.picked(part), matrix, WORKER_WH, mirror) for part in ([0], slice(1, None))]
    return worker_first(truth, *parts)


class Shuffled(Sampler[Key]):
    """Keys of one epoch in random order, the same for the same seed and epoch."""

    def __init__(self, count: int, seed: int) -> None:
        self._count, self._seed, self.epoch = count, seed, 0

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Key]:
        """Keys of the current epoch."""
        order = np.random.default_rng((self._seed, self.epoch)).permutation(self._count)
        return iter([(self.epoch, int(idx)) for idx in order])


def _alone(_worker: int) -> None:
    cv2.setNumThreads(0)
    torch.set_num_threads(1)


def batches(
    samples: Dataset[tuple[Image, Truth]], sampler: Shuffled, size: int, processes: int
) -> DataLoader[tuple[Image, Truth]]:
    """Batches of an epoch after the other; the epoch is set at the sampler."""
    return DataLoader(
        samples,
        batch_size=size,
        sampler=sampler,
        num_workers=processes,
        collate_fn=collate,
        drop_last=True,
        worker_init_fn=_alone,
        persistent_workers=processes > 0,
        prefetch_factor=3 if processes else None,
    )
