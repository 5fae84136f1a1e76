"""Painting bands on a mesh with crisp borders: its triangles are split where a border crosses them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.mesh import Material
from tools.sicsg.workers.fields import Shape, Solid, projected

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
_SNAP_M = 0.010
"""Vertices this near a border move onto it, a third of a cell: fewer and fairer triangles."""
_WALL_M = 0.05
"""Longest wall at an edge."""


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """Where another material lies: between two parallel planes."""

    material: Material
    normal: Floats
    """(3,) unit vector."""
    low_m: float
    """Painted is where ``low_m <= normal @ p < high_m``."""
    high_m: float
    within: tuple[tuple[Floats, float], ...] = ()
    """And only where ``direction @ p >= least`` for each (direction, least); that border follows the triangles."""


def paint(
    vertices_m: Floats, faces: Indices, base: Material, bands: tuple[Band, ...]
) -> tuple[Floats, Indices, tuple[Material, ...], NDArray[np.int32]]:
    """The mesh split along all borders, its materials and the material of each face; later bands cover earlier ones."""
    for band in bands:
        for limit in (band.low_m, band.high_m):
            if np.isfinite(limit):
                height = np.where(_inside(band, vertices_m), vertices_m @ band.normal - limit, -1.0)
                near = np.abs(height) < _SNAP_M
                vertices_m = vertices_m - np.where(near, height, 0.0)[:, None] * band.normal
                vertices_m, faces = split(vertices_m, faces, np.where(near, 0.0, height))
    centres = vertices_m[faces].mean(axis=1)
    chosen = np.zeros(len(faces), dtype=np.int32)
    for index, band in enumerate(bands, start=1):
        along = centres @ band.normal
        chosen[_inside(band, centres) & (along >= band.low_m) & (along < band.high_m)] = index
    return vertices_m, faces, (base, *(band.material for band in bands)), chosen


def _inside(band: Band, points_m: Floats) -> NDArray[np.bool_]:
    """(N,) which points the band may reach at all."""
    inside = np.ones(len(points_m), dtype=bool)
    for direction, least in band.within:
        inside &= points_m @ direction >= least
    return inside


def split(vertices_m: Floats, faces: Indices, height_m: Floats) -> tuple[Floats, Indices]:
    """The mesh with every triangle cut where the height (V,) of its corners passes 0.

    A triangle becomes two when a corner lies at 0, else three; neighbours share the new vertices, so no gap arises.
    """
    sign = np.sign(height_m)[faces].astype(np.int64)
    crossing = (sign.min(axis=1) < 0) & (sign.max(axis=1) > 0)
    through_corner = crossing & (sign == 0).any(axis=1)
    across = crossing & ~through_corner
    # First the corner at 0, or the one that is alone on its side.
    halved = _turned(faces[through_corner], (sign[through_corner] == 0).argmax(axis=1))
    lone = sign[across] == -np.sign(sign[across].sum(axis=1, keepdims=True))
    parted = _turned(faces[across], lone.argmax(axis=1))
    edges = np.sort(np.concatenate([halved[:, [1, 2]], parted[:, [0, 1]], parted[:, [0, 2]]]), axis=1)
    unique, place = np.unique(edges, axis=0, return_inverse=True)
    first, second = height_m[unique[:, 0]], height_m[unique[:, 1]]
    part = (first / (first - second))[:, None]
    added = (1 - part) * vertices_m[unique[:, 0]] + part * vertices_m[unique[:, 1]]
    new = place.ravel() + len(vertices_m)
    bc, ab, ac = np.split(new, [len(halved), len(halved) + len(parted)])
    (o, p, q), (a, b, c) = halved.T, parted.T
    pieces = [np.stack(corners, axis=1) for corners in ((o, p, bc), (o, bc, q), (a, ab, ac), (ab, b, c), (ab, c, ac))]
    return np.concatenate([vertices_m, added]), np.concatenate([faces[~crossing], *pieces])


def _turned(faces: Indices, first: NDArray[np.intp]) -> Indices:
    """(F, 3) the same faces, each from its corner ``first`` (F,) on."""
    order = (first[:, None] + np.arange(3)) % 3
    return np.take_along_axis(faces, order, axis=1)


def trim(vertices_m: Floats, faces: Indices, carved: Shape, under: Shape, tuck_m: float) -> tuple[Floats, Indices]:
    """The mesh without what is in ``carved``; walls go from the new edges to ``tuck_m`` below the surface ``under``."""
    distance = carved.distance(vertices_m)
    near = np.abs(distance) < _SNAP_M
    distance[near] = 0.0
    vertices_m, faces = split(vertices_m, faces, distance)
    distance = np.concatenate([distance, np.zeros(len(vertices_m) - len(distance))])
    border = distance == 0.0
    vertices_m[border] = projected(carved, vertices_m[border], 1.5 * _SNAP_M)
    kept = faces[distance[faces].max(axis=1) > 0]
    rim = _open_edges(kept)
    rim = rim[border[rim].all(axis=1)]
    ends, corner = np.unique(rim, return_inverse=True)
    first, second = (corner.reshape(rim.shape) + len(vertices_m)).T
    lowered = projected(Solid(((under, 0.0),), -tuck_m), vertices_m[ends], _WALL_M)
    walls = [np.stack(c, axis=1) for c in ((rim[:, 1], rim[:, 0], first), (rim[:, 1], first, second))]
    return np.concatenate([vertices_m, lowered]), np.concatenate([kept, *walls])


def _open_edges(faces: Indices) -> Indices:
    """(E, 2) edges with a face on one side only, in the direction of that face."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    _, place, count = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    return np.asarray(edges[count[place.ravel()] == 1])
