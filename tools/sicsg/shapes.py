"""Solids to build assets from: everything is closed, faces outwards and carries texture coordinates in metres.

Most of them are lofts: rings of points joined one after the other. A ring that shrinks to a point ends the solid there.
Where a round side meets a flat end the vertices are doubled, so that shading does not bleed over the edge: a solid is
closed by the positions of its vertices, not by their numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from tools.sicsg.mesh import Floats, Material, Mesh, build, join

CREASE_RAD = np.deg2rad(35.0)
"""A profile that turns more sharply has an edge there, not a rounding."""


def place(position_m: ArrayLike, rotvec: ArrayLike = (0.0, 0.0, 0.0)) -> Floats:
    """A (4, 4) transform: turn by a rotation vector in radians, then move."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(np.asarray(rotvec, dtype=np.float64)).as_matrix()
    matrix[:3, 3] = np.asarray(position_m, dtype=np.float64)
    return matrix


def circle(radius_m: float, sides: int = 12) -> Floats:
    """(sides, 2) points of a circle."""
    angles = np.arange(sides) * (2 * np.pi / sides)
    return radius_m * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def rectangle(width_m: float, height_m: float, corner_m: float = 0.0, segments: int = 3) -> Floats:
    """(P, 2) outline of a rectangle about the origin, its corners rounded by ``corner_m``."""
    half = np.array([width_m, height_m]) / 2
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    if corner_m == 0.0:
        return signs * half
    turns = np.linspace(0.0, np.pi / 2, segments + 1)
    angles = turns[None, :] + np.arange(4)[:, None] * (np.pi / 2)
    arcs = corner_m * np.stack([np.cos(angles), np.sin(angles)], axis=2)
    return (arcs + (signs * (half - corner_m))[:, None, :]).reshape(-1, 2)


def rounded(path_m: ArrayLike, radius_m: float, segments: int = 4) -> Floats:
    """A polyline whose inner corners are cut by ``radius_m`` and rounded (a quadratic curve per corner)."""
    points = np.asarray(path_m, dtype=np.float64)
    out = [points[:1]]
    for before, corner, after in zip(points, points[1:], points[2:], strict=False):
        start, end = (corner + (other - corner) * _share(other - corner, radius_m) for other in (before, after))
        t = np.linspace(0.0, 1.0, segments + 1)[:, None]
        out.append((1 - t) ** 2 * start + 2 * t * (1 - t) * corner + t**2 * end)
    return np.concatenate([*out, points[-1:]])


def loft(rings_m: ArrayLike, material: Material, *, closed: bool = False, smooth: bool = False) -> Mesh:
    """Rings (S, P, 3) of points joined one after the other.

    Args:
        closed: the last ring is joined to the first one; otherwise both ends are covered (their rings are convex).
    """
    rings = np.asarray(rings_m, dtype=np.float64)
    pieces = [_strip(rings, material, closed=closed, smooth=smooth)]
    if not closed:
        fan = np.array([(0, i, i + 1) for i in range(1, rings.shape[1] - 1)])
        ends = [(rings[0], fan[:, ::-1]), (rings[-1], fan)]
        pieces += [build(ring, faces, material) for ring, faces in ends if np.ptp(ring, axis=0).max() > 1e-9]
    return outward(join(pieces))


def sweep(
    path_m: ArrayLike,
    section_m: ArrayLike,
    material: Material,
    *,
    up: ArrayLike = (0.0, 0.0, 1.0),
    scale: ArrayLike = 1.0,
    closed: bool = False,
    smooth: bool = False,
) -> Mesh:
    """A section drawn along a path; corners are mitred, so that a straight part keeps its section.

    Args:
        path_m: (S, 3); ``closed``: a planar loop that returns to its first point.
        section_m: (P, 2) a convex outline, its second coordinate along ``up`` as far as the path allows.
        scale: of the section at each point of the path.
    """
    path = np.asarray(path_m, dtype=np.float64)
    section = np.asarray(section_m, dtype=np.float64)
    scales = np.broadcast_to(np.asarray(scale, dtype=np.float64), (len(path),))
    steps = np.diff(path, axis=0, append=path[:1]) if closed else np.diff(path, axis=0)
    directions = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    axes = _carried_axes(directions, np.asarray(up, dtype=np.float64))
    rings = []
    for i, point in enumerate(path):
        own = max(i - 1, 0)
        before, after = directions[i - 1 if closed else own], directions[min(i, len(directions) - 1)]
        offsets = section @ axes[own] * scales[i]
        mitre = before + after
        rings.append(point + offsets - np.outer(offsets @ mitre, directions[own]) / (directions[own] @ mitre))
    return loft(rings, material, closed=closed, smooth=smooth)


def beam(
    start_m: ArrayLike,
    end_m: ArrayLike,
    width_m: float,
    depth_m: float,
    material: Material,
    *,
    up: ArrayLike = (0.0, 0.0, 1.0),
) -> Mesh:
    """A straight bar between two points, ``depth_m`` thick along ``up`` and ``width_m`` across."""
    return sweep(np.array([start_m, end_m], dtype=np.float64), rectangle(width_m, depth_m), material, up=up)


def tube(path_m: ArrayLike, radius_m: float, material: Material, *, sides: int = 8, closed: bool = False) -> Mesh:
    """A round bar along a polyline, its ends covered."""
    return sweep(path_m, circle(radius_m, sides), material, closed=closed, smooth=True)


def cylinder(
    start_m: ArrayLike,
    end_m: ArrayLike,
    radius_m: float,
    material: Material,
    *,
    end_radius_m: float | None = None,
    sides: int = 12,
) -> Mesh:
    """A cylinder between two points; with ``end_radius_m`` a truncated cone, with 0 a cone."""
    ratio = 1.0 if end_radius_m is None else end_radius_m / radius_m
    return sweep(
        np.array([start_m, end_m], dtype=np.float64), circle(radius_m, sides), material, scale=(1.0, ratio), smooth=True
    )


def lathe(profile_m: ArrayLike, material: Material, *, sides: int = 16, closed: bool = False) -> Mesh:
    """A profile (P, 2) of radius and height, revolved about z; sharp corners stay sharp.

    Args:
        closed: the profile is a loop beside the axis (a ring); otherwise its ends are led to the axis.
    """
    profile = np.asarray(profile_m, dtype=np.float64)
    if closed:
        profile = np.concatenate([profile, profile[:1]])
    else:
        ends = [end * [0.0, 1.0] for end in (profile[:1], profile[-1:])]
        ends = [end if radius > 0 else end[:0] for end, radius in zip(ends, profile[[0, -1], 0], strict=True)]
        profile = np.concatenate([ends[0], profile, ends[1]])
    unit = circle(1.0, sides)
    rings = np.empty((len(profile), sides, 3))
    rings[..., :2] = profile[:, None, :1] * unit
    rings[..., 2] = profile[:, None, 1]
    return outward(join([_strip(rings[run], material, closed=False, smooth=True) for run in _runs(profile)]))


def ellipsoid(
    radii_m: ArrayLike, material: Material, *, centre_m: ArrayLike = (0.0, 0.0, 0.0), sides: int = 12
) -> Mesh:
    """An ellipsoid; its axes are the world's."""
    angles = np.linspace(-np.pi / 2, np.pi / 2, sides // 2 + 1)
    profile = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    profile[[0, -1], 0] = 0.0
    matrix = place(centre_m)
    matrix[:3, :3] = np.diag(np.asarray(radii_m, dtype=np.float64))
    return lathe(profile, material, sides=sides).moved(matrix)


def ring(radius_m: float, thickness_m: float, material: Material, *, sides: int = 16, section_sides: int = 8) -> Mesh:
    """A torus about z at the origin; ``thickness_m`` is the radius of its section."""
    loop = np.concatenate([circle(radius_m, sides), np.zeros((sides, 1))], axis=1)
    return tube(loop, thickness_m, material, sides=section_sides, closed=True)


def frame(size_m: tuple[float, float], border_m: float, depth_m: float, material: Material) -> Mesh:
    """A mitred rectangular frame in the y-z plane about the origin; ``size_m``: its outer width (y) and height (z)."""
    corners = rectangle(size_m[0] - border_m, size_m[1] - border_m)
    path = np.concatenate([np.zeros((4, 1)), corners], axis=1)
    return sweep(path, rectangle(border_m, depth_m), material, up=(1.0, 0.0, 0.0), closed=True)


def prism(outline_m: ArrayLike, thickness_m: float, material: Material) -> Mesh:
    """A simple outline (P, 2), convex or not, extruded along z from 0 to ``thickness_m``."""
    outline = np.asarray(outline_m, dtype=np.float64)
    low = np.concatenate([outline, np.zeros((len(outline), 1))], axis=1)
    high = low + [0.0, 0.0, thickness_m]
    faces = triangulate(outline)
    side = _strip(np.stack([low, high]), material, closed=False, smooth=False)
    if _area(outline) < 0:
        side = replace(side, faces=side.faces[:, ::-1], corner_uv_m=side.corner_uv_m[:, ::-1])
    return join([side, build(low, faces[:, ::-1], material), build(high, faces, material)])


def hull(points_m: ArrayLike, material: Material) -> Mesh:
    """The convex hull of points, flat-sided."""
    points = np.asarray(points_m, dtype=np.float64)
    found = ConvexHull(points)
    corners = points[found.simplices]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("fa,fa->f", normal, found.equations[:, :3]) < 0
    faces = np.where(inward[:, None], found.simplices[:, ::-1], found.simplices)
    return build(points, faces, material)


def box(size_m: ArrayLike, material: Material, *, centre_m: ArrayLike = (0.0, 0.0, 0.0), bevel_m: float = 0.0) -> Mesh:
    """A box along the axes, its edges cut by ``bevel_m``."""
    half = np.asarray(size_m, dtype=np.float64) / 2
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
    kept = np.eye(3) if bevel_m > 0 else np.ones((1, 3))
    points = np.concatenate([signs * (half - bevel_m * (1 - axis)) for axis in kept])
    return hull(points + np.asarray(centre_m, dtype=np.float64), material)


def triangulate(outline_m: Floats) -> NDArray[np.int64]:
    """(P - 2, 3) counter-clockwise triangles of a simple outline (P, 2), by cutting off ears.

    Raises:
        ValueError: the outline crosses or touches itself.
    """
    crossing = _crosses_itself(outline_m)
    left = list(range(len(outline_m)))
    if _area(outline_m) < 0:
        left.reverse()
    faces: list[tuple[int, int, int]] = []
    while len(left) > 3:
        ear = next((i for i in range(len(left)) if _is_ear(outline_m, left, i)), None)
        if ear is None or crossing:
            raise ValueError(f"outline of {len(outline_m)} points crosses or touches itself; give a simple polygon")
        faces.append((left[ear - 1], left[ear], left[(ear + 1) % len(left)]))
        del left[ear]
    return np.array([*faces, tuple(left)])


def outward(mesh: Mesh) -> Mesh:
    """The closed mesh with its faces turned outwards: its signed volume is positive."""
    if signed_volume(mesh) >= 0:
        return mesh
    return replace(mesh, faces=mesh.faces[:, ::-1].copy(), corner_uv_m=mesh.corner_uv_m[:, ::-1].copy())


def signed_volume(mesh: Mesh) -> float:
    """Cubic metres inside a closed mesh; negative when its faces look inwards."""
    corners = (mesh.vertices_m - mesh.vertices_m.mean(axis=0)).astype(np.float64)[mesh.faces]
    return float(np.einsum("fa,fa->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6)


def _strip(rings: Floats, material: Material, *, closed: bool, smooth: bool) -> Mesh:
    """The quads between successive rings; u runs around the rings, v along them."""
    count, sides = rings.shape[:2]
    numbers = np.arange(count * sides).reshape(count, sides)
    point = np.ptp(rings, axis=1).max(axis=1) < 1e-9
    numbers[point] = numbers[point, :1]
    around = np.linalg.norm(np.roll(rings, -1, axis=1) - rings, axis=2).max(axis=0)
    along = np.linalg.norm(np.roll(rings, -1, axis=0) - rings, axis=2).mean(axis=1)
    u, v = np.concatenate([[0.0], np.cumsum(around)]), np.concatenate([[0.0], np.cumsum(along)])
    s, p = (a.ravel() for a in np.meshgrid(np.arange(count - (not closed)), np.arange(sides), indexing="ij"))
    places = [(s, p), (s, p + 1), (s + 1, p + 1), (s + 1, p)]
    corners = np.stack([numbers[a % count, b % sides] for a, b in places], axis=1)
    uv = np.stack([np.stack([u[b], v[a]], axis=1) for a, b in places], axis=1)
    faces = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    uvs = np.concatenate([uv[:, [0, 1, 2]], uv[:, [0, 2, 3]]])
    real = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return build(rings.reshape(-1, 3), faces[real], material, smooth=smooth, uv_m=uvs[real])


def _runs(profile: Floats) -> list[slice]:
    """The parts of a profile between its sharp corners; neighbours share the corner."""
    steps = np.diff(profile, axis=0)
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    turns = np.abs((np.diff(headings) + np.pi) % (2 * np.pi) - np.pi)
    cuts = [0, *(np.flatnonzero(turns > CREASE_RAD) + 1).tolist(), len(profile) - 1]
    return [slice(a, b + 1) for a, b in pairwise(cuts)]


def _carried_axes(directions: Floats, up: Floats) -> Floats:
    """(S, 2, 3) two axes across each part of a path, turned along with it as little as possible.

    On the first part the second axis is as near to ``up`` as can be.
    """
    if np.linalg.norm(np.cross(directions[0], up)) < 1e-6:
        up = np.array([1.0, 0.0, 0.0]) if abs(directions[0, 0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    across = np.cross(up, directions[0])
    across /= np.linalg.norm(across)
    axes = [np.stack([across, np.cross(directions[0], across)])]
    for before, after in pairwise(directions):
        half = before + after
        axes.append(axes[-1] - np.outer(axes[-1] @ half, half) * (2 / (half @ half)))
    return np.array(axes)


def _is_ear(outline: Floats, left: Sequence[int], i: int) -> bool:
    """Whether the corner bulges outwards and no other corner lies in its triangle."""
    a, b, c = (outline[left[(i + k) % len(left)]] for k in (-1, 0, 1))
    others = np.array([outline[j] for k, j in enumerate(left) if (k - i) % len(left) not in (0, 1, len(left) - 1)])
    if _cross(b - a, c - a) <= 0:
        return False
    inside = (_cross(b - a, others - a) >= 0) & (_cross(c - b, others - b) >= 0) & (_cross(a - c, others - c) >= 0)
    return not inside.any()


def _crosses_itself(outline: Floats) -> bool:
    """Whether two sides have their ends on different sides of each other."""
    ends = np.roll(outline, -1, axis=0)
    along = (ends - outline)[:, None]
    apart = _cross(along, outline[None] - outline[:, None]) * _cross(along, ends[None] - outline[:, None]) < -1e-15
    return bool((apart & apart.T).any())


def _cross(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _area(outline: Floats) -> float:
    return float(_cross(outline, np.roll(outline, -1, axis=0)).sum() / 2)


def _share(leg: Floats, length_m: float) -> float:
    """A length as a share of a leg, at the most half of it."""
    return min(length_m / float(np.linalg.norm(leg)), 0.5)
