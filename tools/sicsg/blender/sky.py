"""What lies outside, as the fast path has it (``rendering/sky.glsl``): sky, glow about the sun, ground."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from tools.sicsg.blender.materials import set_pixels

_SIZE_WH = (128, 64)
"""Of the panorama: 2.8 degrees a pixel, as nothing in it is sharper than the horizon."""
_HIGH, _LOW = np.array([0.55, 0.75, 1.1]), np.array([1.0, 1.0, 0.98])
_NEAR, _FAR = np.array([0.30, 0.29, 0.27]), np.array([0.42, 0.40, 0.36])
_GLOW = 0.15 * np.array([1.0, 0.9, 0.75])
_GLOW_EXPONENT = 8.0


class Sky:
    """A world of Blender's that shines from a panorama."""

    def __init__(self) -> None:
        self.world = bpy.data.worlds.new("sky")
        self.world.cycles.sampling_method = "MANUAL"  # the automatic one spends 1.5 s on a finer map than the panorama
        self.world.cycles.sample_map_resolution = _SIZE_WH[0]
        tree = self.world.node_tree
        self._panorama = tree.nodes.new("ShaderNodeTexEnvironment")
        tree.links.new(self._panorama.outputs["Color"], tree.nodes["Background"].inputs["Color"])

    def set(self, light: dict[str, Any]) -> None:
        """Shine as the fields of ``tools.sicsg.scene.Light`` say."""
        radiance = outside(_directions(), light["sky"], light["sun"], np.array(light["sun_direction"]))
        old = self._panorama.image
        # a new image, since Cycles' persistent data does not notice new pixels
        image = bpy.data.images.new("sky", *_SIZE_WH, float_buffer=True)
        image.colorspace_settings.name = "Linear Rec.709"
        set_pixels(image, radiance.astype(np.float32))
        self._panorama.image = image
        if old is not None:
            bpy.data.images.remove(old)


def outside(
    directions: NDArray[np.float64], sky: float, sun: float, sun_direction: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Radiance (..., 3) from unit directions (..., 3), without the sun's disc."""
    z = directions[..., 2:]
    above = _LOW + (_HIGH - _LOW) * _smoothstep(z / 0.7)
    below = _FAR + (_NEAR - _FAR) * _smoothstep(z / -0.4)
    colour = below + (above - below) * _smoothstep((z + 0.01) / 0.02)
    glow = np.maximum(directions @ sun_direction, 0.0)[..., None] ** _GLOW_EXPONENT
    return sky * colour + sun * glow * _GLOW


def _smoothstep(share: NDArray[np.float64]) -> NDArray[np.float64]:
    t = np.clip(share, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def _directions() -> NDArray[np.float64]:
    """(H, W, 3) where each pixel of a panorama looks; the middle column along +x, the top row up."""
    width, height = _SIZE_WH
    azimuth = (0.5 - (np.arange(width) + 0.5) / width) * 2 * np.pi
    elevation = (0.5 - (np.arange(height) + 0.5) / height) * np.pi
    flat, up = np.cos(elevation)[:, None], np.sin(elevation)[:, None]
    return np.stack(np.broadcast_arrays(flat * np.cos(azimuth), flat * np.sin(azimuth), up), axis=-1)
