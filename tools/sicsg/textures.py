"""Image textures by name: each follows from its kind and number alone.

An image is 512 x 512 sRGB, repeats without a seam in both directions and covers ``TILE_M`` metres of surface, its top
row at the upper end of v (as Blender has it). The mean of its brightest channel is near ``LEVEL``, whatever it shows,
so that a :class:`~tools.sicsg.mesh.Material`'s colour multiplies it: ``LEVEL`` is 0.53 in linear light, hence an albedo
of 0.4 asks for a colour of 0.75. Kinds in ``HUED`` bring a hue of their own (brick is red, wood is brown) and want a
grey colour; all others are nearly grey and take any.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from tools.sicsg.assets import asset_rng

Image = NDArray[np.float32]
Rng = np.random.Generator

SIDE = 512
LEVEL = 192
"""sRGB mean of the brightest channel that every texture is brought to."""
HUED = (
    "brick", "wood", "plywood", "osb", "rust", "plaid", "camouflage", "cardboard", "insulation", "poster", "dirt",
)  # fmt: skip
TILE_M = {
    "concrete": 3.0, "plaster": 2.0, "drywall": 2.4, "brick": 1.0, "block": 1.6, "wood": 0.8, "plywood": 1.2,
    "osb": 1.2, "tiles": 1.2, "metal": 0.8, "rust": 0.8, "plastic": 0.6, "fabric": 0.5, "denim": 0.5, "plaid": 0.3,
    "camouflage": 0.6, "cardboard": 0.8, "insulation": 0.6, "poster": 1.0, "dirt": 3.0,
}  # fmt: skip
"""Metres that one image of the kind covers in nature (bricks of 25 cm): ``Material.texture_m``."""


@lru_cache(maxsize=512)
def texture(name: str) -> NDArray[np.uint8]:
    """The image (512, 512, 3) RGB of ``"kind/number"``; read-only, kept for the next caller.

    Raises:
        ValueError: for a name of another form or an unknown kind.
    """
    kind, _, number = name.partition("/")
    if kind not in _MAKERS or not (len(number) == 4 and number.isdecimal()):
        kinds = ", ".join(KINDS)
        raise ValueError(f"texture {name!r}: expected kind/number such as 'brick/0007'; kinds: {kinds}")
    rng = asset_rng(f"texture/{kind}", number)
    image = _levelled(_MAKERS[kind](rng) + 0.008 * rng.standard_normal((SIDE, SIDE, 1), dtype=np.float32))
    image.setflags(write=False)
    return image


def _levelled(image: Image) -> NDArray[np.uint8]:
    """The image brought to ``LEVEL``; twice, since bright spots are clipped."""
    for _ in range(2):
        image = np.clip(image * (LEVEL / 255.0 / image.mean(axis=(0, 1)).max()), 0.0, 1.0)
    return np.round(image * 255.0).astype(np.uint8)


def _blur(image: Image, sigma: float, sigma_y: float | None = None) -> Image:
    """Gaussian filter with wrap-around; ``sigma_y`` where it differs along the columns. Standard deviations in px."""
    tall = sigma if sigma_y is None else sigma_y
    pad = min(int(np.ceil(3 * max(sigma, tall))), SIDE)
    wide = cv2.copyMakeBorder(image, pad, pad, pad, pad, cv2.BORDER_WRAP)
    return np.asarray(cv2.GaussianBlur(wide, (0, 0), sigma, sigmaY=tall)[pad:-pad, pad:-pad], dtype=np.float32)


@lru_cache(maxsize=16)
def _enlarging(cells: int) -> Image:
    """(512, cells) weights of a cubic interpolation with wrap-around from so many values to 512."""
    step = SIDE // cells
    wide = cv2.copyMakeBorder(np.eye(cells, dtype=np.float32), 2, 2, 0, 0, cv2.BORDER_WRAP)
    large = cv2.resize(wide, (cells, (cells + 4) * step), interpolation=cv2.INTER_CUBIC)
    return np.asarray(large[2 * step : 2 * step + SIDE], dtype=np.float32)


def _value_noise(rng: Rng, columns: int, rows: int) -> Image:
    """(512, 512) smooth noise of unit deviation with this many cells across; both divide 512."""
    cells = rng.standard_normal((rows, columns), dtype=np.float32)
    return np.asarray(_enlarging(rows) @ cells @ _enlarging(columns).T, dtype=np.float32)


def _clouds(rng: Rng, cells: int, octaves: int = 4, stretch: int = 1) -> Image:
    """(512, 512) fractal noise of about unit deviation; ``stretch`` times longer along the columns."""
    total = np.zeros((SIDE, SIDE), np.float32)
    for octave in range(octaves):
        columns = min(cells * 2**octave, SIDE)
        total += 0.6**octave * _value_noise(rng, columns, max(columns // stretch, 1))
    return total / max(float(total.std()), 1e-6)


def _spots(rng: Rng, count: int, radius: tuple[float, float]) -> Image:
    """(512, 512) discs of 1 on 0, soft at the edge, across the seams too. Radii in px."""
    mask = np.zeros((SIDE, SIDE), np.float32)
    for x, y, r in zip(*rng.uniform(0, SIDE, (2, count)), rng.uniform(*radius, count), strict=True):
        for dx in (-SIDE, 0, SIDE):
            for dy in (-SIDE, 0, SIDE):
                cv2.circle(mask, (int(x) + dx, int(y) + dy), max(int(r), 1), 1.0, -1, cv2.LINE_AA)
    return _blur(mask, 1.0)


def _scratches(rng: Rng, count: int, length: float, spread_rad: float) -> Image:
    """(512, 512) thin lines of 1 on 0 about the direction of the columns, across the seams too. Length in px."""
    mask = np.zeros((SIDE, SIDE), np.float32)
    starts, angles = rng.uniform(0, SIDE, (count, 2)), rng.normal(0, spread_rad, count)
    ends = starts + length * rng.uniform(0.2, 1, (count, 1)) * np.stack([np.sin(angles), np.cos(angles)], axis=1)
    for dx in (-SIDE, 0, SIDE):
        for dy in (-SIDE, 0, SIDE):
            lines = np.stack([starts, ends], axis=1) + (dx, dy)
            cv2.polylines(mask, list(np.round(lines).astype(np.int32)), False, 1.0, 1, cv2.LINE_AA)
    return mask


def _tinted(value: Image, rgb: tuple[float, float, float]) -> Image:
    """A grey image (512, 512) in a colour, (512, 512, 3)."""
    return value[..., None] * np.array(rgb, np.float32)


def _mixed(first: Image, second: Image | Sequence[float], share: Image) -> Image:
    """From ``first`` to ``second`` as ``share`` (512, 512) goes from 0 to 1."""
    weight = np.clip(share, 0.0, 1.0)[..., None]
    return first * (1 - weight) + np.asarray(second, np.float32) * weight


def _filled(rgb: Sequence[float] | NDArray[np.float64]) -> Image:
    """(512, 512, 3) of one colour."""
    return np.full((SIDE, SIDE, 3), rgb, dtype=np.float32)


def _times(image: Image, value: Image) -> Image:
    """A colour image (512, 512, 3) made brighter and darker by (512, 512)."""
    return np.asarray(image * value[..., None], dtype=np.float32)


def _concrete(rng: Rng) -> Image:
    value = 0.75 + 0.05 * _clouds(rng, 4) + 0.02 * _clouds(rng, 64, 3)
    value -= 0.25 * _spots(rng, int(rng.integers(20, 120)), (1, 3))
    if rng.random() < 0.6:  # joints of the formwork
        period, y = SIDE // int(rng.integers(1, 3)), np.arange(SIDE)[:, None]
        value -= 0.12 * ((y + period // 2) % period < 3).astype(np.float32)
    stains = np.clip(_clouds(rng, 2, 5) - 1.0, 0, 1) * rng.uniform(0, 0.25)
    return _tinted(value - stains, (1.0, rng.uniform(0.97, 1.0), rng.uniform(0.92, 0.99)))


def _plaster(rng: Rng) -> Image:
    trowel = _blur(_clouds(rng, 32, 3), 3.0, 1.0)
    value = 0.8 + 0.03 * _clouds(rng, 2) + 0.02 * trowel - 0.1 * _scratches(rng, 6, 300, 1.5)
    return _tinted(value, (1.0, rng.uniform(0.96, 1.0), rng.uniform(0.9, 0.98)))


def _drywall(rng: Rng) -> Image:
    """Boards of 1.2 m, joints and screws filled with a paler compound."""
    x = np.arange(SIDE, dtype=np.float32)[None, :]
    seam = np.minimum(x % 256, 256 - x % 256) + 4 * _value_noise(rng, 8, 32)
    filled = (seam < rng.uniform(12, 22)).astype(np.float32)
    screws = np.zeros((SIDE, SIDE), np.float32)
    screws[16::64, 0::64] = screws[16::64, 1::64] = 1
    screws = (_blur(screws, 3.0) > 0.008).astype(np.float32)
    filler = _blur(np.maximum(filled, screws), 1.5) * rng.uniform(0.4, 1.0)
    paper = _tinted(0.72 + 0.015 * _clouds(rng, 4), (rng.uniform(0.93, 1.0), 1.0, rng.uniform(0.93, 1.0)))
    return _mixed(paper, (0.86, 0.85, 0.83), filler)


def _courses(rng: Rng, across: int, rows: int, mortar_px: float) -> tuple[Image, Image]:
    """A bond of bricks: a random number per brick and how much of a pixel is mortar, (512, 512) both."""
    y, x = np.mgrid[:SIDE, :SIDE].astype(np.float32) + 0.5
    wide, tall = SIDE / across, SIDE / rows
    row = np.floor(y / tall).astype(int)
    shifted = (x + wide / 2 * (row % 2)) % SIDE
    each = rng.normal(0, 1, (rows, across)).astype(np.float32)[row, np.floor(shifted / wide).astype(int)]
    to_edge = np.minimum(np.minimum(shifted % wide, wide - shifted % wide), np.minimum(y % tall, tall - y % tall))
    ragged = to_edge + 0.8 * _clouds(rng, 64, 2)
    return each, np.clip(mortar_px - ragged, 0, 1).astype(np.float32)


def _brick(rng: Rng) -> Image:
    each, mortar = _courses(rng, 4, 12, rng.uniform(2.0, 3.5))
    red = np.array([0.72, rng.uniform(0.38, 0.55), rng.uniform(0.28, 0.42)], np.float32)
    value = 0.9 + rng.uniform(0.04, 0.14) * each + 0.05 * _clouds(rng, 32, 3)
    return _mixed(value[..., None] * red, tuple(rng.uniform(0.5, 0.75) * np.array([1, 0.97, 0.92])), mortar)


def _block(rng: Rng) -> Image:
    each, mortar = _courses(rng, 4, 8, rng.uniform(1.5, 3.0))
    value = 0.72 + 0.03 * each + 0.04 * _clouds(rng, 64, 3) - 0.15 * _spots(rng, 150, (1, 2))
    smear = mortar + np.clip(_clouds(rng, 16) - 1.4, 0, 1) * 0.4
    return _mixed(_tinted(value, (1, 0.99, 0.96)), tuple(rng.uniform(0.6, 0.85, 1) * np.ones(3)), smear)


def _bump(centre: NDArray[np.float64], wide: float, tall: float) -> Image:
    """(512, 512) a Gaussian bell about a point (x, y), across the seams too. Standard deviations in px."""
    dx, dy = ((np.arange(SIDE) - c + SIDE / 2) % SIDE - SIDE / 2 for c in centre)
    return np.outer(np.exp(-0.5 * (dy / tall) ** 2), np.exp(-0.5 * (dx / wide) ** 2)).astype(np.float32)


def _grain(rng: Rng) -> tuple[Image, Image]:
    """Rings of wood along the columns, -1..1, and the knots in it, 0..1; (512, 512) both."""
    knots, bent = np.zeros((SIDE, SIDE), np.float32), 3.0 * _clouds(rng, 2, 2, 4)
    for _ in range(int(rng.integers(0, 5))):
        centre, radius = rng.uniform(0, SIDE, 2), float(rng.uniform(4, 9))
        knots += np.clip(3 * _bump(centre, radius, 1.3 * radius) - 1, 0, 1)
        bent += 5.0 * _bump(centre, 14, 40)
    rings = np.sin(2 * np.pi * int(rng.integers(3, 9)) * np.arange(SIDE, dtype=np.float32) / SIDE + bent)
    return (0.6 * rings + 0.5 * _clouds(rng, 128, 2, 64)).astype(np.float32), np.clip(knots, 0, 1)


def _wood(rng: Rng) -> Image:
    """Boards side by side."""
    grain, knots = _grain(rng)
    boards = int(rng.choice([4, 8]))
    each = rng.normal(0, 0.05, boards)[np.arange(SIDE) * boards // SIDE].astype(np.float32)
    gap = (np.arange(SIDE) % (SIDE // boards) < 3).astype(np.float32)
    value = 0.85 + 0.06 * grain + each - 0.5 * gap
    brown = (0.88, rng.uniform(0.66, 0.76), rng.uniform(0.44, 0.58))
    return _mixed(_tinted(value, brown), (0.4, 0.26, 0.16), knots)


def _plywood(rng: Rng) -> Image:
    grain, knots = _grain(rng)
    value = 0.85 + 0.05 * grain + 0.04 * _clouds(rng, 4) - 0.15 * _scratches(rng, 12, 120, 1.5)
    tan = (0.9, rng.uniform(0.74, 0.8), rng.uniform(0.54, 0.62))
    return _mixed(_tinted(value, tan), (0.5, 0.34, 0.22), 0.8 * knots)


def _osb(rng: Rng) -> Image:
    """Flakes of wood, pressed every way."""
    image = _filled((0.75, 0.58, 0.36))
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], np.float64)
    for _ in range(600):
        angle, centre, shade = rng.uniform(0, np.pi), rng.uniform(0, SIDE, 2), float(rng.normal(0.82, 0.09))
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        flake = corners * (rng.uniform(12, 30), rng.uniform(4, 10)) @ turn.T + centre
        colour = (shade, shade * float(rng.uniform(0.74, 0.82)), shade * 0.52)
        for dx in (-SIDE, 0, SIDE) if not 32 < centre[0] < SIDE - 32 else (0,):
            for dy in (-SIDE, 0, SIDE) if not 32 < centre[1] < SIDE - 32 else (0,):
                cv2.fillConvexPoly(image, np.round(flake + (dx, dy)).astype(np.int32), colour, cv2.LINE_AA)
    return _times(image, 1 + 0.04 * _clouds(rng, 64, 2))


def _tiles(rng: Rng) -> Image:
    count = int(rng.choice([2, 4, 8]))
    pitch = SIDE // count
    place = np.arange(SIDE) % pitch
    joint = np.maximum.outer(place < 4, place < 4).astype(np.float32)
    each = rng.normal(0, 0.02, (count, count)).astype(np.float32).repeat(pitch, 0).repeat(pitch, 1)
    value = 0.8 + each + rng.uniform(0.01, 0.04) * _clouds(rng, 4)
    return _mixed(_tinted(value, (1, 0.99, 0.97)), tuple(rng.uniform(0.4, 0.9, 1) * np.ones(3)), joint)


def _metal(rng: Rng) -> Image:
    brushed = _blur(rng.standard_normal((SIDE, SIDE), dtype=np.float32), 0.5, 30)
    value = 0.72 + 0.25 * brushed + 0.03 * _clouds(rng, 2) + 0.12 * _scratches(rng, 30, 90, 1.0)
    dull = np.clip(_clouds(rng, 4) - 1.2, 0, 1) * 0.2
    return _tinted(value - dull, (0.98, 0.99, 1.0))


def _rust(rng: Rng) -> Image:
    eaten = _clouds(rng, 4, 5) * 0.7 + rng.uniform(-0.2, 0.6)
    steel = _tinted(0.62 + 0.03 * _clouds(rng, 32, 2), (1, 0.99, 0.97))
    rust = _tinted(0.7 + 0.1 * _clouds(rng, 32, 3), (0.66, 0.46, 0.34))
    return _mixed(steel, rust, eaten)


def _plastic(rng: Rng) -> Image:
    value = 0.82 + 0.012 * _clouds(rng, 64, 2) + 0.02 * _clouds(rng, 2)
    return _tinted(value - 0.08 * _scratches(rng, 40, 60, 1.5) - 0.15 * _spots(rng, 8, (1, 3)), (1, 1, 1))


def _weave(rng: Rng, slant: int) -> Image:
    """Threads of cloth, diagonal where ``slant`` is 1, with creases and worn places; (512, 512)."""
    y, x = np.mgrid[:SIDE, :SIDE].astype(np.float32)
    threads = np.sin(2 * np.pi * (x + slant * y) / 4) * np.sin(2 * np.pi * (y - slant * x) / (4 if not slant else 512))
    creases = _blur(_clouds(rng, 4, 3, 2), 2.0)
    value = 0.78 + 0.04 * threads + 0.045 * creases + 0.02 * _clouds(rng, 128, 2)
    return np.asarray(value, dtype=np.float32)


def _fabric(rng: Rng) -> Image:
    soiled = np.clip(_clouds(rng, 4) - rng.uniform(0.8, 2.0), 0, 1) * 0.3
    return _tinted(_weave(rng, 0) - soiled, (1, 0.99, 0.97))


def _denim(rng: Rng) -> Image:
    faded = 0.06 * _clouds(rng, 2, 3) + 0.03 * _clouds(rng, 128, 2, 16)
    return _tinted(_weave(rng, 1) + faded, (0.96, 0.98, 1.0))


def _plaid(rng: Rng) -> Image:
    base, band, line = (_filled(rng.uniform(0.1, 0.7) + rng.uniform(0.0, 0.3, 3)) for _ in range(3))
    stripe = ((np.arange(SIDE) % 128) < int(rng.integers(40, 72))).astype(np.float32)
    thin = (np.abs(np.arange(SIDE) % 128 - int(rng.integers(84, 120))) < 4).astype(np.float32)
    for mask, colour in ((stripe, band), (thin, line)):
        base = _mixed(base, colour, np.asarray(np.add.outer(mask, mask) * 0.5, dtype=np.float32))
    return _times(base, _weave(rng, 0))


def _camouflage(rng: Rng) -> Image:
    hue = rng.uniform(0.93, 1.07, 3)
    colours = np.array([[0.72, 0.68, 0.53], [0.52, 0.54, 0.38], [0.5, 0.43, 0.34], [0.34, 0.33, 0.3]]) * hue
    image = _filled(colours[0])
    for colour in colours[1:]:
        patch = (_clouds(rng, 4, 2) > rng.uniform(0.4, 0.9)).astype(np.float32)
        image = _mixed(image, tuple(colour), _blur(patch, 0.7))
    return _times(image, _weave(rng, 0))


def _cardboard(rng: Rng) -> Image:
    value = 0.85 + 0.03 * _clouds(rng, 4) + 0.02 * _clouds(rng, 128, 1, 32)
    image = _tinted(value, (0.85, rng.uniform(0.66, 0.74), rng.uniform(0.46, 0.56)))
    tape = np.abs(np.arange(SIDE) - int(rng.integers(100, 400))) < 22
    image = _mixed(image, (0.8, 0.7, 0.5), np.broadcast_to(tape * np.float32(0.5), (SIDE, SIDE)))
    if rng.random() < 0.6:  # a printed mark
        x, y = (int(v) for v in rng.integers(60, 300, 2))
        cv2.rectangle(image, (x, y), (x + 120, y + 70), (0.35, 0.27, 0.2), 3)
        for row in range(3):
            cv2.line(image, (x + 14, y + 18 + 17 * row), (x + 104 - 20 * row, y + 18 + 17 * row), (0.35, 0.27, 0.2), 4)
    return image


def _insulation(rng: Rng) -> Image:
    hue = ((0.95, 0.86, 0.45), (0.95, 0.66, 0.7), (0.72, 0.66, 0.5))[int(rng.integers(3))]
    return _tinted(0.8 + 0.07 * _clouds(rng, 16, 5) + 0.05 * _clouds(rng, 128, 2), hue)


def _poster(rng: Rng) -> Image:
    """A sign or a paper on the wall: a frame, a pictogram, lines of text."""
    paper = tuple(float(v) for v in rng.choice([(0.95, 0.95, 0.92), (0.95, 0.8, 0.1), (0.92, 0.92, 0.95)]))
    inks = [(0.75, 0.1, 0.1), (0.1, 0.25, 0.6), (0.1, 0.45, 0.2), (0.12, 0.12, 0.12)]
    ink, text = inks[int(rng.integers(4))], (0.15, 0.15, 0.15)
    image = _filled(paper)
    cv2.rectangle(image, (18, 18), (SIDE - 19, SIDE - 19), ink, int(rng.integers(4, 20)))
    shape, centre = int(rng.integers(4)), (SIDE // 2, 190)
    if shape == 0:
        cv2.circle(image, centre, 110, ink, -1, cv2.LINE_AA)
        cv2.circle(image, centre, 60, paper, -1, cv2.LINE_AA)
    elif shape == 1:
        cv2.fillConvexPoly(image, np.array([[256, 70], [386, 300], [126, 300]]), ink, cv2.LINE_AA)
        cv2.line(image, (256, 140), (256, 230), paper, 22)
        cv2.circle(image, (256, 270), 13, paper, -1)
    elif shape == 2:
        cv2.rectangle(image, (60, 60), (SIDE - 60, 150), ink, -1)
    for y in range(340 if shape < 2 else 200, SIDE - 50, int(rng.integers(26, 44))):
        cv2.line(image, (70, y), (int(rng.integers(220, SIDE - 70)), y), text, int(rng.integers(5, 12)))
    return _times(image, 1 + 0.03 * _clouds(rng, 4))


def _dirt(rng: Rng) -> Image:
    """A floor under work: dust, puddles of dried plaster, dark stains, grit."""
    image = _tinted(0.7 + 0.06 * _clouds(rng, 4) + 0.03 * _clouds(rng, 64, 3), (1.0, 0.93, 0.84))
    image = _mixed(image, (0.42, 0.38, 0.33), 0.6 * (_clouds(rng, 4, 5) - 1.0))
    image = _mixed(image, (0.92, 0.9, 0.87), 0.7 * np.clip(3 * (_clouds(rng, 8, 4) - 1.5), 0, 1))
    return _times(image, 1 - 0.4 * _spots(rng, 120, (1, 3)))


_MAKERS: dict[str, Callable[[Rng], Image]] = {
    "concrete": _concrete, "plaster": _plaster, "drywall": _drywall, "brick": _brick, "block": _block, "wood": _wood,
    "plywood": _plywood, "osb": _osb, "tiles": _tiles, "metal": _metal, "rust": _rust, "plastic": _plastic,
    "fabric": _fabric, "denim": _denim, "plaid": _plaid, "camouflage": _camouflage, "cardboard": _cardboard,
    "insulation": _insulation, "poster": _poster, "dirt": _dirt,
}  # fmt: skip
KINDS = tuple(_MAKERS)
"""Every kind of texture."""
