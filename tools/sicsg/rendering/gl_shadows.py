"""Shadow maps of the strongest lights, kept while nothing moves: the views of one moment share them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from tools.sicsg.rendering.gl_draw import Drawn, columns, start
from tools.sicsg.rendering.gl_lights import DARK, groups, sun_from_world, windows
from tools.sicsg.rendering.gl_shaders import MAX_RECTANGLES, MAX_SHADOWED, ROUNDED, assign, compiled
from tools.sicsg.rendering.gl_targets import shadow_target
from tools.sicsg.scene import Light

Floats = NDArray[np.float64]
LAMP_PX, SUN_PX = 1024, 2048
"""Edges of the maps: 2 cm a pixel on the floor below a lamp, 1 cm under the sun."""
NOTHING_M = 1000.0
"""Depth where there is nothing."""
SUPPOSED = 0.4
"""Share of the light that a room's surfaces send on, as light rigs have it."""
LEFT = 0.88
"""Of the light that surfaces send on, what gaps and openings do not swallow; so set that the mean radiance of a room
under lamps is that of the path tracer."""
HEMISPHERE = 3
"""Channel of the visibility for what has no shadow map."""


@dataclass(frozen=True, slots=True, eq=False)
class Lit:
    """The lights of a moment."""

    light: Light
    ambient: tuple[float, float, float]
    """Radiance from everywhere, in the colour of the room."""
    rectangles: int
    """How many there are, dark ones included: a multiple of ``ROUNDED``."""
    shadowed: int
    """How many shadow maps there are, the sun's aside."""
    shadow_from_world: list[Floats]
    """Of each shadow map; the sun's comes last."""
    half_edges_m: list[tuple[float, float]]
    """Of the rectangle that each map is made for."""

    @property
    def sun(self) -> bool:
        """Whether the sun shines."""
        return self.light.sun > 0


class Shadows:
    """The shadow maps."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._program = compiled(context, "plain", "shadow")
        self._lamps = [shadow_target(context, LAMP_PX) for _ in range(MAX_SHADOWED)]
        self._sun = shadow_target(context, SUN_PX)
        self._rectangles = context.buffer(reserve=96 * MAX_RECTANGLES)
        self._key: object = None

    def cast(self, things: Sequence[Drawn], light: Light) -> Lit:
        """The lights, their maps made unless they are those of the same things under the same light."""
        key = (light, {(thing.instance.mesh, thing.instance.entity, thing.placed) for thing in things})
        if key != self._key:
            self._lit = self._cast(things, light)
            self._key = key
        return self._lit

    def bind(self, program: moderngl.Program, lit: Lit, first_unit: int) -> None:
        """Give a program the rectangles and the maps, these from a texture unit on."""
        maps = list(self._lamps)
        if lit.sun:
            maps[-1] = self._sun
        for i, target in enumerate(maps):
            target.color_attachments[0].use(first_unit + i)
            matrix, half_edges = columns(lit.shadow_from_world[i]), lit.half_edges_m[i]
            names = {f"shadow{i}": first_unit + i, f"shadow_from_world{i}": matrix, f"half_edges{i}": half_edges}
            assign(program, **names)
        if "Rectangles" in program:
            program["Rectangles"].binding = 0
            self._rectangles.bind_to_uniform_block(0)

    def _cast(self, things: Sequence[Drawn], light: Light) -> Lit:
        sun = light.sun > 0
        maps = MAX_SHADOWED - sun
        lit = groups(light, windows([thing.instance for thing in things], light.sky), maps)
        mapped = lit[:maps]
        packed = [
            member.packed(i if i < len(mapped) else HEMISPHERE)
            for i, group in enumerate(lit)
            for member in group.members
        ]
        packed += [DARK.packed(HEMISPHERE)] * (-len(packed) % ROUNDED)
        if packed:
            self._rectangles.write(np.concatenate(packed).tobytes())
        matrices, half_edges = [np.eye(4)] * MAX_SHADOWED, [(1.0, 1.0)] * MAX_SHADOWED
        for i, group in enumerate(mapped):
            matrices[i], half_edges[i] = group.whole.shadow_from_world(), group.whole.half_edges_m
            self._draw(things, self._lamps[i], matrices[i], matrices[i][3])
        if sun:
            indoors = [thing for thing in things if not thing.outdoors]
            corners = np.concatenate([thing.box_m for thing in indoors] or [np.zeros((1, 3))])
            matrices[-1] = sun_from_world(np.array(light.sun_direction), corners)
            self._draw(indoors, self._sun, matrices[-1], matrices[-1][2] * 0.5 + np.array([0, 0, 0, 0.5]))
        return Lit(light, bounced(things, light), len(packed), len(mapped), matrices, half_edges)

    def _draw(
        self, things: Sequence[Drawn], target: moderngl.Framebuffer, clip_from_world: Floats, depth_row: Floats
    ) -> None:
        start(self._context, target)
        target.clear(NOTHING_M)
        assign(self._program, clip_from_world=columns(clip_from_world), depth_row=tuple(depth_row))
        for thing in things:
            thing.draw(self._context, self._program, thing.opaque)


def bounced(things: Sequence[Drawn], light: Light) -> tuple[float, float, float]:
    """The ambient light in a room of these colours; the rig's is that of surfaces which send on ``SUPPOSED``.

    What enters is sent on again and again: r + r^2 + ... = r / (1 - r) of it (the integrating sphere).
    """
    painted = sum((t.mesh.painted_m2 for t in things if not t.outdoors), np.full(4, 1e-9))
    share = np.clip(LEFT * painted[:3] / painted[3], 0.05, 0.7)
    red, green, blue = np.array(light.ambient) * (share / (1 - share)) / (SUPPOSED / (1 - SUPPOSED))
    return float(red), float(green), float(blue)
