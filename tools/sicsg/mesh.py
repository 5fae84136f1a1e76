"""Triangles with materials: what every maker of assets gives and both renderers draw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Material:
    """A surface. Colours are linear RGB, 0..1."""

    colour: tuple[float, float, float]
    """Albedo; where there is a texture, it multiplies it."""
    roughness: float = 0.7
    metallic: float = 0.0
    transmission: float = 0.0
    """1: clear glass. Opaque in the id and depth passes."""
    emission: float = 0.0
    """Radiance that it sends out, relative to a white wall under 500 lux (1.0)."""
    texture: str | None = None
    """``"kind/name"`` of ``textures.py``, for example ``"plywood/0003"``."""
    texture_m: float = 1.0
    """Metres that one tile of the texture covers."""


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles, counter-clockwise seen from outside."""

    vertices_m: NDArray[np.float32]
    """(V, 3)."""
    faces: NDArray[np.int32]
    """(F, 3) vertex indices."""
    face_material: NDArray[np.int32]
    """(F,) index into ``materials``."""
    materials: tuple[Material, ...]
    smooth: NDArray[np.bool_]
    """(F,) whether normals are interpolated over the face."""
    corner_uv_m: NDArray[np.float32]
    """(F, 3, 2) texture coordinates of each corner in metres on the surface."""

    def __post_init__(self) -> None:
        count = len(self.faces)
        shapes = (self.vertices_m.shape[1:], self.faces.shape, self.corner_uv_m.shape)
        shapes += (self.face_material.shape, self.smooth.shape)
        if shapes != ((3,), (count, 3), (count, 3, 2), (count,), (count,)):
            raise ValueError(f"mesh: arrays do not fit each other: {shapes}")

    def moved(self, transform: ArrayLike) -> Mesh:
        """The mesh under a (4, 4) transform."""
        matrix = np.asarray(transform, dtype=np.float64)
        return replace(self, vertices_m=(self.vertices_m @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32))


def build(
    vertices_m: ArrayLike, faces: ArrayLike, material: Material, *, smooth: bool = False, uv_m: ArrayLike | None = None
) -> Mesh:
    """A mesh of one material; without ``uv_m`` textures are projected along the nearest axis (:func:`box_uv`)."""
    vertices = np.asarray(vertices_m, dtype=np.float32).reshape(-1, 3)
    corners = np.asarray(faces, dtype=np.int32).reshape(-1, 3)
    uv = box_uv(vertices, corners) if uv_m is None else np.asarray(uv_m, dtype=np.float32)
    count = len(corners)
    return Mesh(vertices, corners, np.zeros(count, np.int32), (material,), np.full(count, smooth), uv)


def box_uv(vertices_m: NDArray[np.float32], faces: NDArray[np.int32]) -> NDArray[np.float32]:
    """(F, 3, 2) coordinates in metres, projected along the axis that each face's normal is nearest to."""
    corners = vertices_m[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    axis = np.abs(normal).argmax(axis=1)
    kept = np.array([[1, 2], [0, 2], [0, 1]])[axis]
    return np.take_along_axis(corners, np.repeat(kept[:, None, :], 3, axis=1), axis=2).astype(np.float32)


def join(meshes: Sequence[Mesh]) -> Mesh:
    """Several meshes as one; equal materials become one."""
    materials: list[Material] = []
    vertices, faces, indices, smooth, uv, start = [], [], [], [], [], 0
    for mesh in meshes:
        for material in mesh.materials:
            if material not in materials:
                materials.append(material)
        places = np.array([materials.index(material) for material in mesh.materials], dtype=np.int32)
        vertices.append(mesh.vertices_m)
        faces.append(mesh.faces + start)
        indices.append(places[mesh.face_material])
        smooth.append(mesh.smooth)
        uv.append(mesh.corner_uv_m)
        start += len(mesh.vertices_m)
    return Mesh(
        np.concatenate(vertices),
        np.concatenate(faces).astype(np.int32),
        np.concatenate(indices).astype(np.int32),
        tuple(materials),
        np.concatenate(smooth),
        np.concatenate(uv),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Instance:
    """A mesh in the world. Renderers may keep what they made of a mesh for as long as the same object comes back."""

    mesh: Mesh
    world_from_mesh: Floats
    """(4, 4)."""
    entity: int
    """Number in the id pass; 0 for what belongs to no worker and no object."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A pinhole camera. Pixel (0, 0) is the centre of the top-left pixel; x right, y down, z forward."""

    size_wh: tuple[int, int]
    matrix: Floats
    """(3, 3) K in pixels."""
    cam_from_world: Floats
    """(4, 4)."""
