"""What stands before the cameras: meshes by key, the objects that show them, lamps, sun and sky.

Things stay between jobs, so that Cycles only takes over what has changed.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from tools.sicsg.blender.materials import UV, make_material, texture_image
from tools.sicsg.blender.sky import Sky
from tools.sicsg.blender.wire import Arrays

LAMP_W = 4 * np.pi**2
"""Watts of a lamp of power 1. A lamp of radiance L and area A makes a white wall at 2 m, both facing each other, shine
with L A / (4 pi); this is 1 for the flux pi L A = 4 pi^2."""
SUN_W_M2 = np.pi
"""Irradiance at which a white surface has the radiance 1."""
SUN_COLOUR = (1.0, 0.93, 0.82)
"""As of the fast path."""
SUN_RAD = np.deg2rad(0.53)
"""Angle across the sun's disc."""


class Stage:
    """The content of the scenes."""

    def __init__(self) -> None:
        self.collection = bpy.data.collections.new("stage")
        self.sky = Sky()
        self._images: dict[str, bpy.types.Image] = {}
        self._materials: dict[str, bpy.types.Material] = {}
        self._meshes: dict[int, bpy.types.Mesh] = {}
        self._objects: list[bpy.types.Object] = []
        self._lamps: list[bpy.types.Object] = []
        self._light: dict[str, Any] = {}
        self.is_new = True
        """Whether more has changed than places and vertices since the owner last set it to False."""

    def add_texture(self, name: str, srgb: NDArray[np.uint8]) -> None:
        """Keep (H, W, 3) sRGB under a name."""
        self._images[name] = texture_image(name, srgb)

    def add_mesh(self, key: int, materials: list[dict[str, Any]], arrays: Arrays) -> None:
        """Keep a mesh under a key; arrays are the fields of ``tools.sicsg.mesh.Mesh``."""
        self.is_new = True
        count = len(arrays["faces"])
        mesh = bpy.data.meshes.new(str(key))
        mesh.vertices.add(len(arrays["vertices_m"]))
        mesh.loops.add(3 * count)
        mesh.polygons.add(count)
        mesh.vertices.foreach_set("co", arrays["vertices_m"].ravel())
        mesh.loops.foreach_set("vertex_index", arrays["faces"].ravel())
        mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * count, 3, dtype=np.int32))
        mesh.polygons.foreach_set("material_index", arrays["face_material"])
        mesh.polygons.foreach_set("use_smooth", arrays["smooth"])
        mesh.uv_layers.new(name=UV).uv.foreach_set("vector", arrays["corner_uv_m"].ravel())
        for surface in materials:
            mesh.materials.append(self._material(surface))
        mesh.update(calc_edges=True)
        self._meshes[key] = mesh

    def move_vertices(self, key: int, vertices_m: NDArray[np.float32]) -> None:
        """Give a kept mesh new vertices (V, 3)."""
        mesh = self._meshes[key]
        mesh.vertices.foreach_set("co", vertices_m.ravel())
        mesh.update()

    def drop_mesh(self, key: int) -> None:
        """Forget a mesh and the objects that show it."""
        self.is_new = True
        mesh = self._meshes.pop(key)
        for thing in [thing for thing in self._objects if thing.data == mesh]:
            self._objects.remove(thing)
            bpy.data.objects.remove(thing)
        bpy.data.meshes.remove(mesh)

    def place(self, keys: list[int], entities: list[int], world_from_mesh: NDArray[np.float64]) -> None:
        """Show exactly these meshes: (N,) keys, (N,) numbers for the id pass, (N, 4, 4) transforms."""
        self.is_new |= len(self._objects) != len(keys)
        while len(self._objects) > len(keys):
            bpy.data.objects.remove(self._objects.pop())
        for place, (key, entity) in enumerate(zip(keys, entities, strict=True)):
            if place == len(self._objects):
                self._objects.append(bpy.data.objects.new(str(place), self._meshes[key]))
                self.collection.objects.link(self._objects[place])
            thing, matrix = self._objects[place], world_from_mesh[place].T.astype(np.float32).tolist()
            if thing.data != self._meshes[key]:
                thing.data = self._meshes[key]
            if thing.pass_index != entity:
                thing.pass_index = entity
            if [list(column) for column in thing.matrix_world.col] != matrix:
                thing.matrix_world = matrix

    def light(self, light: dict[str, Any]) -> None:
        """Set lamps, sun and sky from the fields of ``tools.sicsg.scene.Light``."""
        if light == self._light:
            return
        self._light, self.is_new = light, True
        for lamp in self._lamps:
            bpy.data.lights.remove(lamp.data)  # takes the object along
        self._lamps = [self._lamp(lamp) for lamp in light["lamps"]]
        if light["sun"] > 0:
            self._lamps.append(self._sun(light["sun_direction"], light["sun"]))
        self.sky.set(light)

    def _lamp(self, lamp: dict[str, Any]) -> bpy.types.Object:
        data = bpy.data.lights.new("lamp", "AREA")
        data.shape, (data.size, data.size_y) = "RECTANGLE", lamp["size_m"]
        data.energy, data.color = LAMP_W * lamp["power"], lamp["colour"]
        thing = self._linked(data)
        thing.location = lamp["position_m"]
        return thing

    def _sun(self, direction: tuple[float, float, float], radiance: float) -> bpy.types.Object:
        data = bpy.data.lights.new("sun", "SUN")
        data.energy, data.color, data.angle = SUN_W_M2 * radiance, SUN_COLOUR, SUN_RAD
        thing = self._linked(data)
        thing.rotation_mode = "QUATERNION"
        x, y, z = direction
        half = np.array([1.0 + z, -y, x, 0.0]) if z > -1 else np.array([0.0, 1.0, 0.0, 0.0])  # turns +z to the sun
        thing.rotation_quaternion = half / np.linalg.norm(half)
        return thing

    def _linked(self, data: bpy.types.Light) -> bpy.types.Object:
        thing = bpy.data.objects.new(data.name, data)
        thing.visible_camera = False
        self.collection.objects.link(thing)
        return thing

    def _material(self, surface: dict[str, Any]) -> bpy.types.Material:
        name = str(sorted(surface.items()))
        if name not in self._materials:
            self._materials[name] = make_material(str(len(self._materials)), surface, self._images)
        return self._materials[name]
