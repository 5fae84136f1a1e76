"""Instances with their uploaded meshes, and how they are drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from tools.sicsg.mesh import Instance, View
from tools.sicsg.rendering.gl_meshes import GpuMesh, MeshStore
from tools.sicsg.rendering.gl_shaders import assign

Floats = NDArray[np.float64]
OUTDOORS_M = 45.0
"""What is larger than it is no room."""
Part = tuple[int, int]
"""First corner and number of corners."""


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """An instance that is ready to be drawn."""

    instance: Instance
    mesh: GpuMesh
    placed: bytes
    """``world_from_mesh`` as OpenGL reads it."""
    turned: bytes
    """Likewise for normals."""
    box_m: Floats
    """(8, 3) corners of its box in the world."""

    @property
    def whole(self) -> Part:
        """All of it."""
        return 0, len(self.mesh.layout.corners)

    @property
    def opaque(self) -> Part:
        """What is not glass."""
        return 0, self.mesh.layout.opaque

    @property
    def matte(self) -> Part:
        """What reflects no lamp."""
        return 0, self.mesh.layout.matte

    @property
    def glossy(self) -> Part:
        """What is neither matte nor glass."""
        return self.mesh.layout.matte, self.mesh.layout.opaque - self.mesh.layout.matte

    @property
    def glass(self) -> Part:
        """What is glass."""
        return self.mesh.layout.opaque, len(self.mesh.layout.corners) - self.mesh.layout.opaque

    @property
    def outdoors(self) -> bool:
        """Whether it is the surroundings of a building, which reach farther than any room."""
        return bool(np.ptp(self.box_m, axis=0).max() > OUTDOORS_M)

    def draw(self, context: moderngl.Context, program: moderngl.Program, part: Part) -> None:
        """Draw a part of it with the program."""
        first, count = part
        if count:
            assign(program, world_from_mesh=self.placed, world_from_normal=self.turned)
            self.mesh.array(context, program).render(vertices=count, first=first)


def drawn_near_first(instances: Sequence[Instance], view: View, meshes: MeshStore) -> list[Drawn]:
    """What belongs to an entity by the distance of its middle, then the rest, which is large."""
    full = [instance for instance in instances if len(instance.mesh.faces)]
    uploaded = meshes.get([instance.mesh for instance in full])
    ready = [_ready(instance, mesh) for instance, mesh in zip(full, uploaded, strict=True)]
    row = view.cam_from_world[2]

    def order(thing: Drawn) -> tuple[bool, float]:
        return thing.instance.entity == 0, float(row[:3] @ thing.box_m.mean(axis=0) + row[3])

    return sorted(ready, key=order)


def _ready(instance: Instance, mesh: GpuMesh) -> Drawn:
    matrix = instance.world_from_mesh
    box = np.asarray(mesh.box_m @ matrix[:3, :3].T + matrix[:3, 3], dtype=np.float64)
    return Drawn(instance, mesh, columns(matrix), columns(np.linalg.inv(matrix[:3, :3]).T), box)


def in_view(things: Sequence[Drawn], clip_from_world: Floats) -> list[Drawn]:
    """Those of which the box is not beyond one of the view's sides."""
    kept = []
    for thing in things:
        clip = thing.box_m @ clip_from_world[:, :3].T + clip_from_world[:, 3]
        x, y, w = clip[:, 0], clip[:, 1], clip[:, 3]
        if not any(beyond.all() for beyond in (x < -w, x > w, y < -w, y > w, w < 0)):
            kept.append(thing)
    return kept


def start(context: moderngl.Context, target: moderngl.Framebuffer) -> None:
    """Draw into a picture from now on, what is nearest."""
    target.use()
    context.enable_only(moderngl.DEPTH_TEST)
    context.depth_func = "<"


def columns(matrix: Floats) -> bytes:
    """A matrix as OpenGL reads it: float32, column after column."""
    return np.ascontiguousarray(matrix.T, dtype=np.float32).tobytes()
