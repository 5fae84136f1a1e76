"""The sensor: from linear radiance to the 8-bit picture of a cheap camera.

Veiling glare and bloom of the lens, vignetting, exposure, shot and read noise under a mild denoiser, a filmic curve,
sharpening. What belongs to the camera and the light (white balance, glare, sharpening) follows from their names, so
that a sequence does not flicker; the noise alone comes from the random numbers given.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tools.sicsg.assets import asset_rng
from tools.sicsg.scene import Light, SceneCamera

Image = NDArray[np.float32]

LUMA = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)
MIDDLE = 0.17
"""Exposed signal that a metered mean becomes."""
HIGHLIGHTS = {"indoor": 2.5, "backlight": 6.0, "overexposed": 2.5, "dusk": 4.0}
"""Where metering cuts off bright parts, in medians of the picture: late when the windows are what is metered."""
FULL_WELL = 9000.0
"""Electrons of the signal 1 at gain 1: a small sensor's pixel."""
READ_NOISE = 4.0
"""Electrons."""
BRIGHT_ENOUGH = 0.35
"""Exposure up to which no gain is needed: that of a normally lit room."""
WHITE = 1.4
"""Exposed signal that becomes white: three stops over the middle."""
MAX_GAIN = 6.0
"""In the darkest scenes; more, and the picture is of noise."""
KNEE = 1.7
"""Exponent of the curve's shoulder: its slope at black is KNEE / WHITE."""


@dataclass(frozen=True, slots=True)
class Habits:
    """What is always the same for a camera in a light."""

    balance: Image
    """(3,) white balance, RGB."""
    bloom: float
    """Share of the light that is spread over about two hundredths of the picture's width."""
    veil: float
    """Share of the light that is spread over all of it."""
    vignetting: float
    """Loss at the corners."""
    sharpening: float


def habits(light: Light, camera: SceneCamera) -> Habits:
    """By the names of the light and the camera."""
    rng = asset_rng("sensor", f"{light.name}/{camera.id}/{camera.coefficients}")
    lamps = [(np.array(lamp.colour), lamp.power) for lamp in light.lamps]
    tint = sum((colour * power for colour, power in lamps), np.array(light.ambient) + 1e-3)
    grey = (tint / tint.mean()) ** -rng.uniform(0.55, 0.95)
    balance = grey * np.exp(rng.normal(0, (0.035, 0.01, 0.045)))
    return Habits(
        balance=(balance / (balance @ LUMA)).astype(np.float32),
        bloom=float(rng.uniform(0.01, 0.05)),
        veil=float(rng.uniform(0.004, 0.025)),
        vignetting=float(rng.uniform(0.05, 0.35)),
        sharpening=float(rng.uniform(0.25, 0.9)),
    )


def metered_exposure(radiance: Image, light: Light, camera: SceneCamera) -> float:
    """Signal per radiance as the camera's automatic sets it: once for a sequence, which otherwise flickers.

    Args:
        radiance: (H, W, 3) linear RGB.
        light: the light rig, which says by how much the exposure is off.
        camera: the camera, likewise.
    """
    small = cv2.resize(radiance, (64, 36), interpolation=cv2.INTER_AREA) @ LUMA
    y, x = np.mgrid[-1:1:36j, -1:1:64j]
    weight = np.exp(-(x**2 + y**2))
    cut = np.minimum(small, HIGHLIGHTS[light.kind] * max(float(np.median(small)), 1e-4))
    metered = max(float((cut * weight).sum() / weight.sum()), 1e-4)
    return float(MIDDLE / metered * 2.0 ** (light.exposure_ev + camera.ev))


def expose(
    radiance: Image, light: Light, camera: SceneCamera, rng: np.random.Generator, *, exposure: float | None = None
) -> NDArray[np.uint8]:
    """(H, W, 3) BGR of linear radiance (H, W, 3) RGB.

    Args:
        radiance: what reaches the sensor.
        light: the light rig.
        camera: the camera.
        rng: makes the noise.
        exposure: of :func:`metered_exposure`; by default metered from this picture.
    """
    given = metered_exposure(radiance, light, camera) if exposure is None else exposure
    habit = habits(light, camera)
    signal = _glare(radiance, habit) * (_vignette(radiance.shape, habit)[:, :, None] * np.float32(given))
    gain = float(np.clip(given / BRIGHT_ENOUGH, 1.0, MAX_GAIN)) * camera.gain
    noisy = _noise(np.minimum(signal, WHITE), gain, rng) * habit.balance
    return _developed(noisy, habit)


def _glare(radiance: Image, habit: Habits) -> Image:
    height, width = radiance.shape[:2]
    small = cv2.resize(radiance, (max(width // 8, 1), max(height // 8, 1)), interpolation=cv2.INTER_AREA)
    spread = 0.7 * cv2.GaussianBlur(small, (0, 0), width / 8 * 0.008) + 0.3 * cv2.GaussianBlur(
        small, (0, 0), width / 8 * 0.04
    )
    veil = small.reshape(-1, 3).mean(axis=0) * habit.veil
    light = cv2.resize(spread * habit.bloom + veil, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(radiance * np.float32(1 - habit.bloom - habit.veil) + light, np.float32)


def _vignette(shape: tuple[int, ...], habit: Habits) -> Image:
    y, x = np.ogrid[-1 : 1 : shape[0] * 1j, -1 : 1 : shape[1] * 1j]
    return np.asarray(1.0 - habit.vignetting * ((x * x + y * y) / 2.0) ** 1.3, np.float32)


def _noise(signal: Image, gain: float, rng: np.random.Generator) -> Image:
    """With shot and read noise, of brightness at full and of colour at half size, as denoisers leave it."""
    height, width = signal.shape[:2]
    level = np.maximum(signal @ LUMA, 0.0)
    sigma = np.sqrt(level * np.float32(gain / FULL_WELL) + np.float32((READ_NOISE * gain / FULL_WELL) ** 2))
    white = rng.standard_normal((height, width), dtype=np.float32)
    grain = 0.55 * white + 1.1 * cv2.GaussianBlur(white, (0, 0), 0.8)
    colour = rng.standard_normal(((height + 1) // 2, (width + 1) // 2, 3), dtype=np.float32)
    blotches = cv2.resize(cv2.GaussianBlur(colour, (0, 0), 1.0), (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(signal + sigma[:, :, None] * (grain[:, :, None] + 0.6 * blotches), np.float32)


def _developed(signal: Image, habit: Habits) -> NDArray[np.uint8]:
    """Filmic curve, sRGB, sharpening, 8 bits."""
    encoded = _curve(signal)
    luma = encoded @ LUMA
    detail = luma - cv2.GaussianBlur(luma, (0, 0), 1.1)
    sharp = encoded + np.float32(habit.sharpening) * detail[:, :, None]
    return np.ascontiguousarray(np.clip(sharp * 255.0 + 0.5, 0, 255).astype(np.uint8)[:, :, ::-1])


def _curve(signal: Image) -> Image:
    """sRGB values 0..1 of exposed signals, by a table: highlights are rolled off to ``WHITE``."""
    steps = np.linspace(0.0, 1.0, 4096)
    linear = WHITE * steps**2
    rolled = 1.0 - (1.0 - linear / WHITE) ** KNEE
    srgb = np.where(rolled <= 0.0031308, 12.92 * rolled, 1.055 * np.maximum(rolled, 1e-9) ** (1 / 2.4) - 0.055)
    index = np.sqrt(np.clip(signal / np.float32(WHITE), 0.0, 1.0)) * np.float32(4095)
    return srgb.astype(np.float32)[(index + np.float32(0.5)).astype(np.int32)]
