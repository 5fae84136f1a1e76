"""The path tracer: images with global illumination, by Blender's Cycles in a process of its own.

One unit of radiance is a white wall under normal room light, as in ``Light``; ``Light.ambient`` is not used, since
light that bounces is computed here. The index and depth passes serve to check those of the fast path.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.mesh import Instance, Mesh, View
from tools.sicsg.rendering.cycles_job import CyclesJob, blender_python
from tools.sicsg.scene import Light
from tools.sicsg.textures import texture

TIMEOUT_S = 600.0
"""Longest wait for one answer."""


class CyclesRenderer:
    """Renders instances by path tracing; a context manager. It keeps what stays the same between calls.

    Args:
        samples: light paths per pixel, before denoising.
        python: the Python that has bpy; by default what ``SICSG_BPY_PYTHON`` names, else that of ``.venv-sicsg``.
        timeout_s: longest wait for one answer.

    Raises:
        CyclesError: from every method, if Blender cannot be run or fails; it says what to do.
    """

    def __init__(self, *, samples: int = 4, python: Path | None = None, timeout_s: float = TIMEOUT_S) -> None:
        if samples < 1:
            raise ValueError(f"samples: expected at least 1 light path per pixel, got {samples}")
        self._samples = samples
        self._job = CyclesJob(python or blender_python(), timeout_s)
        self._shelf = _Shelf(self._job)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self._job.close()

    @property
    def device(self) -> str:
        """What renders: ``"CPU"``, ``"CUDA"`` or ``"OPTIX"``."""
        return self._job.device

    def render(self, instances: Sequence[Instance], light: Light, view: View) -> NDArray[np.float32]:
        """(H, W, 3) linear radiance, RGB."""
        return self.render_many(instances, light, (view,))[0]

    def render_many(
        self, instances: Sequence[Instance], light: Light, views: Sequence[View]
    ) -> list[NDArray[np.float32]]:
        """One (H, W, 3) linear radiance per view; what stands where is taken over once."""
        job, arrays = self._placed(instances)
        arrays["matrix"] = np.array([view.matrix for view in views], dtype=np.float64)
        arrays["cam_from_world"] = np.array([view.cam_from_world for view in views], dtype=np.float64)
        job |= {"sizes_wh": [view.size_wh for view in views], "light": light.model_dump(), "samples": self._samples}
        self._job.tell({**job, "do": "render"}, arrays)
        _, pictures = self._job.answer()
        return [pictures[str(place)] for place in range(len(views))]

    def passes(self, instances: Sequence[Instance], view: View) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """What each pixel's centre sees; glass is opaque.

        Returns:
            (H, W) entities, and (H, W) depth along the optical axis in metres, infinite where there is nothing.
        """
        job, arrays = self._placed(instances)
        arrays |= {"matrix": np.asarray(view.matrix, float), "cam_from_world": np.asarray(view.cam_from_world, float)}
        self._job.tell({**job, "do": "passes", "size_wh": view.size_wh}, arrays)
        _, found = self._job.answer()
        return found["ids"], found["depth_m"]

    def _placed(self, instances: Sequence[Instance]) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """The part of a job that says what stands where."""
        keys = self._shelf.keys([instance.mesh for instance in instances])
        entities = [instance.entity for instance in instances]
        matrices = np.array([instance.world_from_mesh for instance in instances], dtype=np.float64).reshape(-1, 4, 4)
        return {"keys": keys, "entities": entities}, {"world_from_mesh": matrices}


class _Shelf:
    """The meshes and textures that the process keeps.

    The same mesh object is sent once. A mesh that differs from a kept one in its vertices alone (a worker who moved)
    takes its place, and only the vertices are sent. What a call does not use is dropped.
    """

    def __init__(self, job: CyclesJob) -> None:
        self._job = job
        self._kept: dict[int, Mesh] = {}
        self._textures: set[str] = set()
        self._next_key = 0

    def keys(self, meshes: Sequence[Mesh]) -> list[int]:
        """The key of each mesh, after what is new has been sent."""
        distinct = list({id(mesh): mesh for mesh in meshes}.values())
        known = {id(mesh): key for key, mesh in self._kept.items()}
        free = {_shape(mesh): key for key, mesh in self._kept.items() if all(mesh is not one for one in distinct)}
        key_of = {id(mesh): known.get(id(mesh)) for mesh in distinct}
        for mesh in distinct:
            if key_of[id(mesh)] is None:
                key_of[id(mesh)] = self._sent(mesh, free.pop(_shape(mesh), None))
        for key in self._kept.keys() - set(key_of.values()):
            self._job.tell({"do": "drop", "key": key})
            del self._kept[key]
        return [key_of[id(mesh)] for mesh in meshes]

    def _sent(self, mesh: Mesh, key: int | None) -> int:
        vertices = {"vertices_m": mesh.vertices_m}
        if key is not None:
            self._job.tell({"do": "vertices", "key": key}, vertices)
        else:
            key, self._next_key = self._next_key, self._next_key + 1
            self._send_textures(mesh)
            rest = {name: getattr(mesh, name) for name in ("faces", "face_material", "smooth", "corner_uv_m")}
            materials = [asdict(material) for material in mesh.materials]
            self._job.tell({"do": "mesh", "key": key, "materials": materials}, vertices | rest)
        self._kept[key] = mesh
        return key

    def _send_textures(self, mesh: Mesh) -> None:
        for name in dict.fromkeys(material.texture for material in mesh.materials):
            if name is not None and name not in self._textures:
                self._job.tell({"do": "texture", "name": name}, {"srgb": texture(name)})
                self._textures.add(name)


def _shape(mesh: Mesh) -> tuple[object, ...]:
    """What two meshes have in common that differ in their vertices alone."""
    arrays = (mesh.faces, mesh.face_material, mesh.smooth, mesh.corner_uv_m)
    return (*(id(array) for array in arrays), mesh.materials)
