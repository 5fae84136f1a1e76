"""Augmentation of colours: what stands between a render and a real camera.

Each effect is drawn independently; all work on (H, W, 3) uint8 BGR images and leave places alone.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Floats = NDArray[np.float64]
_NOISE = np.random.default_rng(7).normal(0.0, 1.0, (720, 1280, 3)).astype(np.float32)
"""Noise from which windows are cut: drawing it anew for each image took longer than all other effects together."""


def recoloured(image: Image, rng: np.random.Generator) -> Image:
    """All effects, each with its probability."""
    if rng.random() < 0.9:
        image = toned(image, rng)
    if rng.random() < 0.5:
        image = saturated(image, rng)
    if rng.random() < 0.3:
        image = blurred(image, rng)
    if rng.random() < 0.15:
        image = coarsened(image, rng)
    if rng.random() < 0.4:
        image = noisy(image, rng)
    if rng.random() < 0.15:
        image = compressed(image, rng)
    return image


def toned(image: Image, rng: np.random.Generator) -> Image:
    """Exposure, contrast, gamma and white balance in one table per channel."""
    x = np.linspace(0.0, 1.0, 256)[:, None]
    balance = np.exp(rng.normal(0.0, 0.07, 3))
    x = x ** np.exp(rng.normal(0.0, 0.22)) * np.exp(rng.normal(0.0, 0.22)) * balance
    x = (x - 0.5) * np.exp(rng.normal(0.0, 0.18)) + 0.5 + rng.normal(0.0, 0.05)
    table = np.clip(x * 255.0, 0.0, 255.0).astype(np.uint8)[:, None, :]
    return np.asarray(cv2.LUT(image, table.transpose(1, 0, 2)), np.uint8)


def saturated(image: Image, rng: np.random.Generator) -> Image:
    """More or less colour, now and then none."""
    amount = 0.0 if rng.random() < 0.15 else float(np.exp(rng.normal(0.0, 0.35)))
    grey = cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR)
    return np.asarray(cv2.addWeighted(image, amount, grey, 1.0 - amount, 0.0), np.uint8)


def blurred(image: Image, rng: np.random.Generator) -> Image:
    """Out of focus, or moved along a line."""
    if rng.random() < 0.5:
        return np.asarray(cv2.GaussianBlur(image, (0, 0), float(rng.uniform(0.4, 1.3))), np.uint8)
    length, angle = rng.uniform(2.0, 6.0), rng.uniform(0.0, np.pi)
    kernel = np.zeros((9, 9), dtype=np.float32)
    reach = np.array([np.cos(angle), np.sin(angle)]) * length / 2
    steps = np.linspace(-1.0, 1.0, 32)[:, None] * reach + 4.0
    np.add.at(kernel, tuple(np.rint(steps).astype(int).T[::-1]), 1.0)
    return np.asarray(cv2.filter2D(image, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE), np.uint8)


def coarsened(image: Image, rng: np.random.Generator) -> Image:
    """Less resolution than pixels."""
    height, width = image.shape[:2]
    share = float(rng.uniform(0.45, 0.85))
    small = cv2.resize(image, (int(width * share), int(height * share)), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR), np.uint8)


def noisy(image: Image, rng: np.random.Generator) -> Image:
    """Noise of the sensor, coarser in half the cases."""
    height, width = image.shape[:2]
    sigma = float(rng.uniform(1.0, 10.0))
    top, left = int(rng.integers(720 - height + 1)), int(rng.integers(1280 - width + 1))
    noise = _NOISE[top : top + height, left : left + width]
    if rng.random() < 0.5:
        noise = cv2.blur(noise, (2, 2)) * 2.0
    return np.asarray(cv2.add(image, noise * sigma, dtype=cv2.CV_8U), np.uint8)


def compressed(image: Image, rng: np.random.Generator) -> Image:
    """JPEG and back."""
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(25, 85))])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)


def holed(image: Image, rng: np.random.Generator, donor: Image) -> tuple[Image, Floats]:
    """Up to four rectangles filled with one colour, with noise or with a piece of another image, at any place.

    Args:
        image: (H, W, 3).
        rng: random numbers.
        donor: of the same size.

    Returns:
        The image and the rectangles (R, 4) ltrb.
    """
    image = image.copy()
    height, width = image.shape[:2]
    holes = []
    for _ in range(int(rng.integers(1, 5))):
        h, w = (max(2, int(rng.uniform(0.02, 0.2) * side)) for side in (height, width))
        top, left = int(rng.integers(height - h)), int(rng.integers(width - w))
        window = image[top : top + h, left : left + w]
        kind = rng.random()
        if kind < 0.4:
            window[:] = rng.integers(0, 256, 3)
        elif kind < 0.5:
            window[:] = rng.integers(0, 256, (h, w, 3))
        else:
            y, x = int(rng.integers(height - h)), int(rng.integers(width - w))
            window[:] = donor[y : y + h, x : x + w]
        holes.append((left, top, left + w, top + h))
    return image, np.array(holes, dtype=np.float64)
