"""Materials of rooms and props: textures by kind from the half of the names that may be used."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tools.sicsg.assets import Split, asset_rng, draw, is_sealed
from tools.sicsg.mesh import Material
from tools.sicsg.textures import TILE_M

Colour = tuple[float, float, float]

_ROUGHNESS = {"metal": 0.35, "plastic": 0.4, "tiles": 0.3, "rust": 0.8, "wood": 0.6, "plywood": 0.6}
_METALLIC = {"metal": 0.7, "rust": 0.3}
PAINTS: tuple[Colour, ...] = (
    (0.75, 0.1, 0.06), (0.85, 0.5, 0.05), (0.9, 0.75, 0.1), (0.1, 0.35, 0.12), (0.06, 0.16, 0.5), (0.03, 0.3, 0.4),
    (0.85, 0.85, 0.85), (0.3, 0.3, 0.32), (0.05, 0.05, 0.06),
)  # fmt: skip
"""Colours of painted and moulded things on a site."""


@dataclass(frozen=True, slots=True)
class Finish:
    """Draws materials of one asset: open assets from open textures, sealed from sealed."""

    rng: np.random.Generator
    split: Split

    @classmethod
    def of(cls, kind: str, name: str) -> Finish:
        """Of an asset by kind and name."""
        return cls(asset_rng(kind, name), "test" if is_sealed(name) else "train")

    def texture(self, kind: str) -> str:
        """The name of a texture of this kind."""
        return f"{kind}/{draw('texture', self.split, self.rng)}"

    def material(self, kind: str, colour: Colour = (1.0, 1.0, 1.0)) -> Material:
        """A surface with a texture of this kind in a colour."""
        return surface(self.texture(kind), colour)

    def grey(self, low: float, high: float) -> Colour:
        """Some grey, a little warm or cold."""
        value, warm = self.rng.uniform(low, high), self.rng.uniform(-0.04, 0.06)
        return tuple(float(np.clip(v, 0, 1)) for v in (value * (1 + warm), value, value * (1 - warm)))  # type: ignore[return-value]

    def paint(self) -> Colour:
        """Some colour of ``PAINTS``."""
        return PAINTS[int(self.rng.integers(len(PAINTS)))]


def surface(texture: str, colour: Colour) -> Material:
    """A surface of a named texture, in its natural size and shine."""
    kind = texture.partition("/")[0]
    roughness, metallic = _ROUGHNESS.get(kind, 0.85), _METALLIC.get(kind, 0.0)
    return Material(colour, roughness, metallic, texture=texture, texture_m=TILE_M[kind])
