"""What workers wear, by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, TypeVar

import numpy as np

from tools.sicsg.assets import POOL, SEALED_FROM, asset_rng, is_sealed
from tools.sicsg.mesh import Material
from tools.sicsg.textures import TILE_M

_T = TypeVar("_T")
Colour = tuple[float, float, float]
Top = Literal["jacket", "shirt", "t_shirt"]
HiVis = Literal["none", "vest", "jacket"]
Glasses = Literal["none", "clear", "dark"]
Hair = Literal["bald", "short", "full", "tied", "long"]

_SKIN = ((0.66, 0.42, 0.31), (0.58, 0.34, 0.23), (0.45, 0.24, 0.15), (0.31, 0.15, 0.085), (0.17, 0.078, 0.044),
         (0.075, 0.035, 0.021))  # fmt: skip
"""From the lightest to the darkest human skin; tones between neighbours are mixed."""
_HAIR = ((0.012, 0.010, 0.009), (0.030, 0.018, 0.012), (0.075, 0.038, 0.018), (0.16, 0.085, 0.035),
         (0.33, 0.22, 0.10), (0.30, 0.30, 0.30))  # fmt: skip
_YELLOW_VEST, _ORANGE_VEST, _RED_VEST = (0.56, 0.86, 0.035), (0.95, 0.15, 0.018), (0.78, 0.035, 0.025)
_HI_VIS_COLOURS = (_YELLOW_VEST,) * 5 + (_ORANGE_VEST,) * 4 + (_RED_VEST,)
_HI_VIS_KINDS: tuple[HiVis, ...] = ("none",) * 7 + ("vest",) * 9 + ("jacket",) * 4
_TOP_KINDS: tuple[Top, ...] = ("jacket",) * 4 + ("shirt",) * 3 + ("t_shirt",) * 3
_SHORT_HAIR: tuple[Hair, ...] = ("bald", "short", "short", "full")
_LONG_HAIR: tuple[Hair, ...] = ("tied", "long", "full")
_GLASSES: tuple[Glasses, ...] = ("none",) * 6 + ("clear",) * 3 + ("dark",)
_NAVY, _GREY, _BLACK, _KHAKI = (0.016, 0.026, 0.075), (0.13, 0.135, 0.14), (0.016, 0.016, 0.018), (0.30, 0.22, 0.12)
_ORANGE, _WHITE, _GREEN, _BROWN = (0.75, 0.16, 0.03), (0.70, 0.69, 0.66), (0.05, 0.11, 0.06), (0.13, 0.07, 0.035)
_RED, _BLUE, _SAND = (0.33, 0.03, 0.03), (0.05, 0.12, 0.33), (0.42, 0.34, 0.23)
_TROUSERS = (_NAVY, _NAVY, _GREY, _GREY, _BLACK, _BLACK, _KHAKI, _KHAKI, _BROWN, _ORANGE, _GREEN, _WHITE)
_TOPS = (_NAVY, _NAVY, _GREY, _GREY, _BLACK, _KHAKI, _WHITE, _WHITE, _ORANGE, _GREEN, _RED, _BLUE, _BLUE, _SAND)

_BOOTS = (_BROWN, _BLACK, _KHAKI, (0.20, 0.11, 0.045))
_SOLES = ((0.02, 0.02, 0.02), (0.02, 0.02, 0.02), (0.28, 0.21, 0.12))
_GLOVES = ((0.45, 0.30, 0.12), (0.05, 0.05, 0.055), (0.30, 0.31, 0.32), (0.55, 0.08, 0.02), (0.05, 0.13, 0.3))
_PATTERNED = {
    "denim": ((0.045, 0.075, 0.16), (0.08, 0.13, 0.24), (0.03, 0.04, 0.07), (0.16, 0.21, 0.30)),
    "plaid": ((0.42, 0.10, 0.09), (0.14, 0.22, 0.42), (0.36, 0.36, 0.36), (0.16, 0.33, 0.18), (0.38, 0.28, 0.17)),
    "camouflage": ((0.27, 0.27, 0.25), (0.20, 0.22, 0.18)),
}
_TEXTURE_LEVEL = 0.53
"""Mean of a texture's brightest channel in linear light (``textures.LEVEL``)."""


@dataclass(frozen=True, slots=True)
class Clothes:
    """Skin, hair and clothing of a worker; colours are linear RGB."""

    skin: Colour
    hair: Hair
    hair_colour: Colour
    beard: bool
    glasses: Glasses
    top: Top
    top_material: Material
    open_front: bool
    """Whether a vest hangs open over the top."""
    trousers_material: Material
    trousers_loose_m: float
    """How far the trousers stand off the legs."""
    trousers_stripes: bool
    hi_vis: HiVis
    hi_vis_colour: Colour
    stripe_colour: Colour
    """Of the reflective stripes."""
    dark_hem: bool
    """Whether the lower part of a hi-vis jacket is dark."""
    gloves: Colour | None
    """``None``: bare hands."""
    boots: Colour
    sole: Colour
    tool_belt: bool


@lru_cache(maxsize=512)
def clothes(name: str) -> Clothes:
    """The clothes of this asset name; a sealed name uses only sealed textures."""
    rng = asset_rng("clothes", name)
    skin = _between(_SKIN, rng)
    long_hair = bool(rng.random() < 0.25)
    hair = _one(_LONG_HAIR if long_hair else _SHORT_HAIR, rng)
    shades = _HAIR if sum(skin) > 0.75 else _HAIR[:2]
    top = _one(_TOP_KINDS, rng)
    hi_vis = _one(_HI_VIS_KINDS, rng)
    vivid, dull = _one(_HI_VIS_COLOURS, rng), float(rng.uniform(0.75, 1.0))
    return Clothes(
        skin=skin,
        hair=hair,
        hair_colour=_varied(_one(shades, rng), rng),
        beard=not long_hair and bool(rng.random() < 0.3),
        glasses=_one(_GLASSES, rng),
        top="jacket" if hi_vis == "jacket" else top,
        top_material=_cloth(name, rng, _TOPS, {"plaid": 0.3, "camouflage": 0.04} if top == "shirt" else {}),
        open_front=bool(rng.random() < 0.3),
        trousers_material=_cloth(name, rng, _TROUSERS, {"denim": 0.28, "camouflage": 0.05}),
        trousers_loose_m=float(rng.uniform(0.008, 0.022)),
        trousers_stripes=bool(rng.random() < 0.15),
        hi_vis=hi_vis,
        hi_vis_colour=(vivid[0] * dull, vivid[1] * dull, vivid[2] * dull),
        stripe_colour=_varied((0.62, 0.63, 0.64), rng),
        dark_hem=bool(rng.random() < 0.5),
        gloves=_gloves(rng),
        boots=_varied(_one(_BOOTS, rng), rng),
        sole=_varied(_one(_SOLES, rng), rng),
        tool_belt=bool(rng.random() < 0.25),
    )


def _one(options: Sequence[_T], rng: np.random.Generator) -> _T:
    """One of the options; what stands there twice comes twice as often."""
    return options[int(rng.integers(len(options)))]


def _between(row: tuple[Colour, ...], rng: np.random.Generator) -> Colour:
    """A colour somewhere along the row."""
    place = float(rng.uniform(0, len(row) - 1))
    first = min(int(place), len(row) - 2)
    part = place - first
    mixed = [(1 - part) * a + part * b for a, b in zip(row[first], row[first + 1], strict=True)]
    return mixed[0], mixed[1], mixed[2]


def _varied(colour: Colour, rng: np.random.Generator) -> Colour:
    """The colour, lighter or darker by up to a third and slightly shifted."""
    factors = np.clip(rng.uniform(0.72, 1.3) * rng.uniform(0.93, 1.07, 3) * colour, 0.005, 0.9)
    return float(factors[0]), float(factors[1]), float(factors[2])


def _cloth(name: str, rng: np.random.Generator, colours: tuple[Colour, ...], patterns: dict[str, float]) -> Material:
    """Plain fabric of one of the colours or, with the given chances, a pattern."""
    pool = range(SEALED_FROM, SEALED_FROM + max(8, POOL["texture"] // 4)) if is_sealed(name) else range(POOL["texture"])
    kinds = ["fabric", *patterns]
    kind = str(rng.choice(kinds, p=[1 - sum(patterns.values()), *patterns.values()]))
    choices = colours if kind == "fabric" else _PATTERNED[kind]
    wanted = np.array(_varied(_one(choices, rng), rng)) / _TEXTURE_LEVEL
    red, green, blue = (float(channel) for channel in np.minimum(wanted, 1.0))
    number = f"{_one(pool, rng):04d}"
    return Material((red, green, blue), roughness=0.9, texture=f"{kind}/{number}", texture_m=TILE_M[kind])


def _gloves(rng: np.random.Generator) -> Colour | None:
    """The colour of the gloves, or none."""
    return _varied(_one(_GLOVES, rng), rng) if rng.random() < 0.5 else None
