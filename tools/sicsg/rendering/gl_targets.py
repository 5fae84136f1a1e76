"""The pictures that the renderer draws into."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import moderngl

SAMPLES = 4
"""Samples per pixel along edges; llvmpipe has 4."""


@dataclass(frozen=True, slots=True, eq=False)
class Radiance:
    """For the radiance: the light at half size, surfaces at full size."""

    size_wh: tuple[int, int]
    geometry: moderngl.Framebuffer
    """Normal, roughness and depth, at half size."""
    visible: moderngl.Framebuffer
    """Of three lights and of the hemisphere, at half size."""
    smoothed: moderngl.Framebuffer
    """While the former is smoothed."""
    light: moderngl.Framebuffer
    """That arrives: at a white surface, and at a mirror; at half size."""
    drawn: moderngl.Framebuffer
    """Surfaces, with ``SAMPLES``."""
    resolved: moderngl.Framebuffer
    """The mean of these."""

    @classmethod
    def new(cls, context: moderngl.Context, size_wh: tuple[int, int]) -> Self:
        """New pictures of this size."""
        half = ((size_wh[0] + 1) // 2, (size_wh[1] + 1) // 2)
        geometry = context.framebuffer([_data(context, half, 4, "f4")], context.depth_renderbuffer(half))
        visible, smoothed = (context.framebuffer([_data(context, half, 4, "f1")]) for _ in range(2))
        light = context.framebuffer([_data(context, half, 4, "f2") for _ in range(2)])
        for texture in light.color_attachments:
            texture.filter = moderngl.LINEAR, moderngl.LINEAR
        drawn = context.framebuffer(
            [context.renderbuffer(size_wh, 4, samples=SAMPLES, dtype="f2")],
            context.depth_renderbuffer(size_wh, samples=SAMPLES),
        )
        resolved = context.framebuffer([context.renderbuffer(size_wh, 4, dtype="f2")])
        return cls(size_wh, geometry, visible, smoothed, light, drawn, resolved)

    def release(self) -> None:
        """Give the memory back."""
        for framebuffer in (self.geometry, self.visible, self.smoothed, self.light, self.drawn, self.resolved):
            _release(framebuffer)


@dataclass(frozen=True, slots=True, eq=False)
class PassesTarget:
    """For int32 entities and float32 depths."""

    drawn: moderngl.Framebuffer

    @classmethod
    def new(cls, context: moderngl.Context, size_wh: tuple[int, int]) -> Self:
        """New pictures of this size."""
        attachments = [context.renderbuffer(size_wh, 1, dtype="i4"), context.renderbuffer(size_wh, 1, dtype="f4")]
        return cls(context.framebuffer(attachments, context.depth_renderbuffer(size_wh)))

    def release(self) -> None:
        """Give the memory back."""
        _release(self.drawn)


def shadow_target(context: moderngl.Context, edge_px: int) -> moderngl.Framebuffer:
    """A new square picture of depths as colours."""
    return context.framebuffer([_data(context, (edge_px,) * 2, 1, "f4")], context.depth_renderbuffer((edge_px,) * 2))


def _release(framebuffer: moderngl.Framebuffer) -> None:
    for attachment in (*framebuffer.color_attachments, framebuffer.depth_attachment):
        if attachment is not None:
            attachment.release()
    framebuffer.release()


def _data(context: moderngl.Context, size_wh: tuple[int, int], components: int, dtype: str) -> moderngl.Texture:
    texture = context.texture(size_wh, components, dtype=dtype)
    texture.filter = moderngl.NEAREST, moderngl.NEAREST
    texture.repeat_x = texture.repeat_y = False
    return texture
