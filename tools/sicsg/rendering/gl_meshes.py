"""Meshes and textures in the renderer's memory, kept for as long as they come back."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import moderngl
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from tools.sicsg.mesh import Material, Mesh

Tiles = Callable[[str], NDArray[np.uint8]]
KEPT_MESHES = 300
"""Meshes kept at most: a scene has about fifty, and four workers of 0.7 MB are new in every frame."""
KEPT_TILES = 96
"""Textures kept at most, 1.4 MB each."""
TILE_PX = 512
MATTE, GLOSSY, GLASS = range(3)
MATTE_FROM = 0.62
"""Roughness from which no lamp's reflection is drawn."""
_SHAPE = {"in_position": 3, "in_normal": 3}
_SURFACE = {"in_uv": 2, "in_colour": 4, "in_finish": 4}


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """What stays the same while vertices move: which corners there are, and their surfaces."""

    parts: tuple[object, ...]
    """The arrays that it was made from; held, so that no other object takes their identity."""
    corners: NDArray[np.int32]
    """(3 F,) vertex of each corner; matte faces first, then glossy ones, then glass."""
    faces: NDArray[np.int32]
    """(F, 3) vertices of each face, in the same order."""
    smooth: NDArray[np.bool_]
    """(3 F,) whether the corner's normal is interpolated."""
    around: csr_matrix
    """(V, F) the smooth faces around each vertex."""
    matte: int
    """Number of corners of matte faces."""
    opaque: int
    """Number of corners that are not glass."""
    surfaces: moderngl.Buffer
    albedo: NDArray[np.float32]
    """(F, 3) linear RGB of each face."""

    @property
    def identity(self) -> tuple[int, ...]:
        """Of the arrays that it was made from."""
        return tuple(id(part) for part in self.parts)

    def shape(self, vertices_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """(3 F, 6) position and normal of each corner."""
        points = vertices_m[self.faces]
        of_face = _normals(points)
        of_vertex = np.asarray(self.around @ of_face, dtype=np.float32)
        normals = np.where(self.smooth[:, None], of_vertex[self.corners], np.repeat(of_face, 3, axis=0))
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        return np.hstack([points.reshape(-1, 3), normals / np.maximum(length, 1e-20)]).astype(np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class GpuMesh:
    """A mesh that programs can draw."""

    layout: Layout
    shape: moderngl.Buffer
    arrays: dict[moderngl.Program, moderngl.VertexArray]
    painted_m2: NDArray[np.float64]
    """(4,) area times albedo, and area."""
    low_m: NDArray[np.float32]
    """(3,) least coordinates in its own frame."""
    high_m: NDArray[np.float32]
    """(3,) greatest coordinates in its own frame."""

    @property
    def box_m(self) -> NDArray[np.float32]:
        """(8, 3) corners of its box in its own frame."""
        return np.array(list(product(*zip(self.low_m, self.high_m, strict=True))), dtype=np.float32)

    def array(self, context: moderngl.Context, program: moderngl.Program) -> moderngl.VertexArray:
        """Its corners as the program reads them."""
        if program not in self.arrays:
            parts = ((self.shape, _SHAPE), (self.layout.surfaces, _SURFACE))
            content = [(buffer, *_read_by(program, columns)) for buffer, columns in parts]
            self.arrays[program] = context.vertex_array(program, [part for part in content if len(part) > 2])
        return self.arrays[program]

    def release(self) -> None:
        """Give its memory back."""
        for array in self.arrays.values():
            array.release()
        self.shape.release()


class MeshStore:
    """Meshes by identity. One whose vertices moved but whose other arrays are the same objects keeps its surfaces."""

    def __init__(self, context: moderngl.Context, tiles: TileStore) -> None:
        self._context, self._tiles = context, tiles
        self._meshes: OrderedDict[Mesh, GpuMesh] = OrderedDict()
        self._layouts: OrderedDict[tuple[int, ...], Layout] = OrderedDict()

    def get(self, meshes: Sequence[Mesh]) -> list[GpuMesh]:
        """The meshes of a picture, uploaded if they are new.

        Raises:
            ValueError: when they have more than ``KEPT_TILES`` textures.
        """
        fresh = [mesh for mesh in meshes if mesh not in self._meshes]
        names = {material.texture for mesh in fresh for material in mesh.materials if material.texture is not None}
        if not self._tiles.fits(names):
            self._forget()
            return self.get(meshes)
        found = [self._get(mesh) for mesh in meshes]
        while len(self._meshes) > max(KEPT_MESHES, len(found)):
            self._meshes.popitem(last=False)[1].release()
        while len(self._layouts) > max(KEPT_MESHES, len(found)):
            self._layouts.popitem(last=False)[1].surfaces.release()
        return found

    def _get(self, mesh: Mesh) -> GpuMesh:
        if mesh not in self._meshes:
            layout = self._layout(mesh)
            shape = self._context.buffer(layout.shape(mesh.vertices_m).tobytes())
            low, high = mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)
            area = np.linalg.norm(_normals(mesh.vertices_m[layout.faces]), axis=1) / 2
            painted = np.append(area @ layout.albedo, area.sum())
            self._meshes[mesh] = GpuMesh(layout, shape, {}, painted, low, high)
        self._meshes.move_to_end(mesh)
        self._layouts.move_to_end(self._meshes[mesh].layout.identity)
        return self._meshes[mesh]

    def _forget(self) -> None:
        for mesh in self._meshes.values():
            mesh.release()
        for layout in self._layouts.values():
            layout.surfaces.release()
        self._meshes.clear()
        self._layouts.clear()
        self._tiles.forget()

    def _layout(self, mesh: Mesh) -> Layout:
        parts = (mesh.faces, mesh.face_material, mesh.materials, mesh.smooth, mesh.corner_uv_m)
        key = tuple(id(part) for part in parts)
        if key not in self._layouts:
            self._layouts[key] = self._new_layout(mesh, parts)
        return self._layouts[key]

    def _new_layout(self, mesh: Mesh, parts: tuple[object, ...]) -> Layout:
        group = np.array([_group(material) for material in mesh.materials])[mesh.face_material]
        order = np.argsort(group, kind="stable")
        faces, smooth = mesh.faces[order], mesh.smooth[order]
        columns = np.repeat(np.flatnonzero(smooth), 3)
        around = csr_matrix(
            (np.ones(len(columns), np.float32), (faces[smooth].ravel(), columns)),
            shape=(len(mesh.vertices_m), len(faces)),
        )
        surfaces = self._context.buffer(self._surfaces(mesh)[order].reshape(-1, 10).tobytes())
        albedo = np.array([m.colour * self._tiles.mean(m.texture) for m in mesh.materials], np.float32)
        matte, opaque = (3 * int(np.count_nonzero(group <= last)) for last in (MATTE, GLOSSY))
        return Layout(
            parts,
            faces.ravel(),
            faces,
            np.repeat(smooth, 3),
            around,
            matte,
            opaque,
            surfaces,
            albedo[mesh.face_material][order],
        )

    def _surfaces(self, mesh: Mesh) -> NDArray[np.float32]:
        """(F, 3, 10) texture coordinates, colour, emission, roughness, metallic, transmission and layer of corners."""
        table = np.array(
            [
                (
                    1.0 / m.texture_m,
                    *m.colour,
                    m.emission,
                    m.roughness,
                    m.metallic,
                    m.transmission,
                    -1.0 if m.texture is None else self._tiles.layer(m.texture),
                )
                for m in mesh.materials
            ],
            dtype=np.float32,
        )[mesh.face_material]
        uv = mesh.corner_uv_m * table[:, None, :1]
        return np.concatenate([uv, np.repeat(table[:, None, 1:], 3, axis=1)], axis=2).astype(np.float32)


class TileStore:
    """Image textures as the layers of one array; square roots of linear RGB, so that 8 bits do."""

    def __init__(self, context: moderngl.Context, tiles: Tiles) -> None:
        self._tiles = tiles
        self._layers: dict[str, int] = {}
        self._means: dict[str, NDArray[np.float64]] = {}
        self.array = context.texture_array((TILE_PX, TILE_PX, KEPT_TILES), 3)
        self.array.repeat_x = self.array.repeat_y = True
        self._stale = True

    def fits(self, names: set[str]) -> bool:
        """Whether these textures have a place beside those that are there.

        Raises:
            ValueError: when they would not have one alone either.
        """
        if len(names) > KEPT_TILES:
            raise ValueError(
                f"a picture of {len(names)} textures; the renderer takes {KEPT_TILES}: use fewer materials"
            )
        return len(names | self._layers.keys()) <= KEPT_TILES

    def forget(self) -> None:
        """Make place for others."""
        self._layers.clear()

    def layer(self, name: str) -> int:
        """The texture's layer, uploaded if it is new."""
        if name not in self._layers:
            self._layers[name] = len(self._layers)
            encoded = _square_root(self._tiles(name))[::-1]  # the lowest row first
            self._means[name] = ((encoded[::8, ::8] / 255.0) ** 2).mean(axis=(0, 1))
            self.array.write(encoded.tobytes(), viewport=(0, 0, self._layers[name], TILE_PX, TILE_PX, 1))
            self._stale = True
        return self._layers[name]

    def mean(self, name: str | None) -> NDArray[np.float64]:
        """(3,) mean linear RGB of a texture that has a layer; white of none."""
        return np.ones(3) if name is None else self._means[name]

    def ready(self) -> moderngl.TextureArray:
        """The array with its smaller levels made."""
        if self._stale:
            self.array.build_mipmaps()
            self.array.filter = moderngl.LINEAR_MIPMAP_NEAREST, moderngl.LINEAR
            self._stale = False
        return self.array


def _read_by(program: moderngl.Program, columns: dict[str, int]) -> list[str]:
    """Format of a buffer and the names of those columns that the program reads."""
    layout = " ".join(f"{n}f" if name in program else f"{4 * n}x" for name, n in columns.items())
    return [layout, *(name for name in columns if name in program)]


def _normals(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """(F, 3) normals of triangles (F, 3, 3), twice as long as the triangles are large."""
    return np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])


def _group(material: Material) -> int:
    if material.transmission > 0:
        return GLASS
    return GLOSSY if material.roughness < MATTE_FROM or material.metallic > 0 else MATTE


def _square_root(srgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    steps = np.arange(256) / 255.0
    linear = np.where(steps <= 0.04045, steps / 12.92, ((steps + 0.055) / 1.055) ** 2.4)
    return np.round(255.0 * np.sqrt(linear)).astype(np.uint8)[srgb]
