"""The stages of a picture: geometry and light at half size, surfaces at full size, sky, glass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import moderngl
import numpy as np
from numpy.typing import NDArray

from tools.sicsg.mesh import View
from tools.sicsg.rendering.gl_draw import Drawn, columns, start
from tools.sicsg.rendering.gl_lights import SKYLIGHT, clip_from_cam
from tools.sicsg.rendering.gl_shaders import assign, compiled, light_macros
from tools.sicsg.rendering.gl_shadows import Lit, Shadows
from tools.sicsg.rendering.gl_targets import Radiance

Floats = NDArray[np.float64]

NEAR_M, FAR_M = 0.05, 120.0
OUTDOORS = 2.0
"""Added to the roughness of what lies under the open sky, so that the light can tell."""
SECOND_OUTPUT = 0x88F9
"""OpenGL's GL_SRC1_COLOR: what is behind is multiplied by the shader's second output."""


class Shading:
    """The programs of all stages."""

    def __init__(self, context: moderngl.Context, shadows: Shadows) -> None:
        self._context, self._shadows = context, shadows
        self._corners = context.buffer(np.array([-1, -1, 3, -1, -1, 3], np.float32).tobytes())
        self._geometry = compiled(context, "geometry", "geometry")
        self._smooth, self._sky = self._screen("smooth"), self._screen("sky")
        self._matte = compiled(context, "surface", "surface")
        self._glossy = compiled(context, "surface", "surface", {"GLOSSY": 1})
        self._glass = compiled(context, "surface", "glass")
        self._lit: dict[tuple[int, int, bool], tuple[moderngl.VertexArray, moderngl.VertexArray]] = {}

    def light(self, things: Sequence[Drawn], lit: Lit, view: View, target: Radiance) -> None:
        """What light arrives at each pixel, at half size."""
        start(self._context, target.geometry)
        target.geometry.clear(color=(0.0, 0.0, FAR_M, FAR_M))
        row = tuple(view.cam_from_world[2])
        assign(self._geometry, clip_from_world=columns(clip_from_world(view)), depth_row=row)
        for thing in things:
            assign(self._geometry, outdoors=OUTDOORS * thing.outdoors)
            thing.draw(self._context, self._geometry, thing.opaque)
        self._context.enable_only(moderngl.NOTHING)
        seeing, lighting = self._lit_programs(lit)
        target.geometry.color_attachments[0].use(0)
        self._fill(seeing, target.visible, lit, view)
        for source, result, along in (
            (target.visible, target.smoothed, (1, 0)),
            (target.smoothed, target.visible, (0, 1)),
        ):
            source.color_attachments[0].use(1)
            assign(self._smooth.program, geometry=0, seen=1, along=along)
            result.use()
            self._smooth.render()
        target.visible.color_attachments[0].use(1)
        self._fill(lighting, target.light, lit, view)

    def surfaces(
        self, things: Sequence[Drawn], lit: Lit, view: View, target: Radiance, tiles: moderngl.TextureArray
    ) -> None:
        """Surfaces under this light, the sky where there are none, and glass before them."""
        start(self._context, target.drawn)
        target.drawn.clear()
        for unit, texture in enumerate((target.geometry.color_attachments[0], *target.light.color_attachments, tiles)):
            texture.use(unit)
        seen = _seen_from(view, lit)
        for program in (self._matte, self._glossy):
            assign(program, geometry=0, white=1, mirrored=2, tiles=3, picture=target.size_wh, **seen)
        for thing in things:
            thing.draw(self._context, self._matte, thing.matte)
            thing.draw(self._context, self._glossy, thing.glossy)
        self._context.depth_func = "<="
        assign(self._sky.program, **seen)
        self._sky.render()
        self._panes(things, seen, target)

    def _panes(self, things: Sequence[Drawn], seen: Mapping[str, object], target: Radiance) -> None:
        assign(self._glass, **seen)
        self._context.enable_only(moderngl.DEPTH_TEST | moderngl.BLEND)
        self._context.blend_func = moderngl.ONE, SECOND_OUTPUT
        target.drawn.depth_mask = False
        for thing in reversed(things):
            thing.draw(self._context, self._glass, thing.glass)
        target.drawn.depth_mask = True
        self._context.blend_func = moderngl.DEFAULT_BLENDING  # Mesa refuses to draw two pictures while it is set

    def _fill(self, screen: moderngl.VertexArray, result: moderngl.Framebuffer, lit: Lit, view: View) -> None:
        rays = ray_from_place(view)
        self._shadows.bind(screen.program, lit, 2)
        assign(
            screen.program,
            geometry=0,
            visible=1,
            cam_from_world=columns(view.cam_from_world),
            world_from_cam=columns(np.linalg.inv(view.cam_from_world)),
            rays=(rays[0, 2], rays[1, 2], rays[0, 0], rays[1, 1]),
            focal=float(view.matrix[1, 1]) / view.size_wh[1],
            **_seen_from(view, lit),
        )
        result.use()
        screen.render()

    def _screen(self, fragment: str, macros: Mapping[str, str | int] | None = None) -> moderngl.VertexArray:
        program = compiled(self._context, "screen", fragment, macros)
        return self._context.vertex_array(program, self._corners, "in_place")

    def _lit_programs(self, lit: Lit) -> tuple[moderngl.VertexArray, moderngl.VertexArray]:
        key = (lit.rectangles, lit.shadowed, lit.sun)
        if key not in self._lit:
            macros = light_macros(*key)
            self._lit[key] = self._screen("visibility", macros), self._screen("light", macros)
        return self._lit[key]


def clip_from_world(view: View) -> Floats:
    """(4, 4) of a view; the image's first row comes first."""
    return clip_from_cam(ndc_from_ray(view), NEAR_M, FAR_M) @ view.cam_from_world


def ndc_from_ray(view: View) -> Floats:
    """(3, 3) places -1..1 of (x/z, y/z, 1); the outer edges of the picture lie half a pixel beyond pixels' centres."""
    width, height = view.size_wh
    ndc_from_px = np.array([[2 / width, 0, 1 / width - 1], [0, 2 / height, 1 / height - 1], [0, 0, 1.0]])
    return ndc_from_px @ view.matrix


def ray_from_place(view: View) -> Floats:
    """(3, 3) (x/z, y/z, 1) of places 0..1 of the picture."""
    return np.linalg.inv(ndc_from_ray(view)) @ np.array([[2.0, 0, -1], [0, 2, -1], [0, 0, 1]])


def _seen_from(view: View, lit: Lit) -> dict[str, object]:
    """Uniforms of camera and light."""
    world_from_cam = np.linalg.inv(view.cam_from_world)
    light = lit.light
    return {
        "clip_from_world": columns(clip_from_world(view)),
        "world_from_place": columns(world_from_cam[:3, :3] @ ray_from_place(view)),
        "eye": tuple(world_from_cam[:3, 3]),
        "ambient": lit.ambient,
        "skylight": tuple(light.sky * SKYLIGHT),
        "sky": light.sky,
        "sun": light.sun,
        "sun_direction": light.sun_direction,
    }
