"""What every maker of objects needs: numbers drawn from a variant's name, and materials of a site."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tools.sicsg.assets import POOL, SEALED_FROM, asset_rng, is_sealed
from tools.sicsg.catalog_types import Item
from tools.sicsg.mesh import Floats, Material, Mesh, join
from tools.sicsg.textures import LEVEL, TILE_M

Point = tuple[float, float, float]
Pair = tuple[Point, Point]
SEALED_TEXTURES = max(8, POOL["texture"] // 4)
"""How many sealed names textures have; see ``assets.POOL``."""
_WEAR_GAIN = ((LEVEL / 255 + 0.055) / 1.055) ** -2.4
"""What makes up for a texture's mean brightness in linear light."""


@dataclass(frozen=True, slots=True)
class Draw:
    """Random choices of one variant; the same name gives the same choices in the same order."""

    category: str
    variant: str
    rng: np.random.Generator

    def between(self, low: float, high: float) -> float:
        """A number, evenly distributed."""
        return float(self.rng.uniform(low, high))

    def chance(self, share: float) -> bool:
        """True in this share of the cases."""
        return bool(self.rng.random() < share)

    def count(self, low: int, high: int) -> int:
        """A whole number from ``low`` to ``high``, both included."""
        return int(self.rng.integers(low, high + 1))

    def one_of(self, *options: str) -> str:
        """One of the options, all as likely."""
        return options[int(self.rng.integers(len(options)))]

    def texture(self, kind: str) -> str:
        """Name of a texture of this kind that the variant's split may use."""
        if is_sealed(self.variant):
            return f"{kind}/{SEALED_FROM + self.count(0, SEALED_TEXTURES - 1):04d}"
        return f"{kind}/{self.count(0, POOL['texture'] - 1):04d}"

    def colour(self, hex_srgb: str, spread: float = 0.12) -> tuple[float, float, float]:
        """Linear RGB near ``"rrggbb"``: brighter or darker by up to ``spread``, each channel a little on its own."""
        srgb = np.array([int(hex_srgb[i : i + 2], 16) for i in (0, 2, 4)]) / 255
        linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
        linear = linear * (1 + self.between(-spread, spread)) * (1 + self.rng.uniform(-spread, spread, 3) / 3)
        red, green, blue = np.clip(linear, 0.004, 0.95).tolist()
        return red, green, blue

    def worn(self, kind: str, hex_srgb: str, roughness: float, metallic: float = 0.0) -> Material:
        """A surface of this colour under a texture's stains and scratches."""
        red, green, blue = (value * _WEAR_GAIN for value in self.colour(hex_srgb))
        return Material((red, green, blue), roughness, metallic, texture=self.texture(kind), texture_m=TILE_M[kind])

    def plastic(self, hex_srgb: str) -> Material:
        """Coloured plastic."""
        return self.worn("plastic", hex_srgb, self.between(0.3, 0.6))

    def paint(self, hex_srgb: str) -> Material:
        """Painted metal."""
        return self.worn("metal", hex_srgb, self.between(0.35, 0.6))

    def aluminium(self) -> Material:
        """Bare aluminium or galvanised steel."""
        return self.worn("metal", self.one_of("c9ccce", "b9bcc0", "d8dadb"), self.between(0.35, 0.55), 0.7)

    def steel(self) -> Material:
        """Plain dark steel."""
        return self.worn("metal", self.one_of("8b8e92", "77797c"), self.between(0.4, 0.6), 0.6)

    def rust(self) -> Material:
        """Rusty steel."""
        return Material((0.8, 0.8, 0.8), 0.85, 0.1, texture=self.texture("rust"), texture_m=TILE_M["rust"])

    def timber(self, kind: str = "wood") -> Material:
        """Timber, or with ``"plywood"`` a sheet of it; some paler, some darker."""
        grey = self.between(0.6, 1.2)
        return Material((grey, grey * 0.97, grey * 0.92), 0.75, texture=self.texture(kind), texture_m=TILE_M[kind])

    def rubber(self) -> Material:
        """Black rubber."""
        return Material(self.colour("242426"), 0.85)

    def plain(self, hex_srgb: str, roughness: float = 0.6, emission: float = 0.0) -> Material:
        """A clean surface: stickers, reflective film."""
        return Material(self.colour(hex_srgb, 0.06), roughness, emission=emission)


def drawing(category: str, variant: str) -> Draw:
    """The choices of a variant of a category."""
    return Draw(category, variant, asset_rng(f"variant/{category}", variant))


def make_item(draw: Draw, parts: Sequence[Mesh], **places: ArrayLike) -> Item:
    """An item of joined parts; its size is the extent of its mesh, ``places`` are Item's ``*_m`` fields."""
    mesh = join(parts)
    size_x, size_y, size_z = np.ptp(mesh.vertices_m, axis=0).astype(np.float64).tolist()
    arrays: dict[str, Floats] = {name: np.array(value, dtype=np.float64) for name, value in places.items()}
    for array in arrays.values():
        array.setflags(write=False)
    return Item(draw.category, draw.variant, mesh, (size_x, size_y, size_z), **arrays)


def mirrored(point: ArrayLike) -> Pair:
    """A point with y < 0 and its mirror image with y > 0: left and right of somebody who faces -x."""
    x, y, z = (float(value) for value in np.asarray(point))
    return (x, -abs(y), z), (x, abs(y), z)
