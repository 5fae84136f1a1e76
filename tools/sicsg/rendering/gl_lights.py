"""Lamps and windows as rectangles that shine to one side, and the cameras of their shadow maps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from tools.sicsg.mesh import Instance, Mesh
from tools.sicsg.rendering.gl_shaders import MAX_RECTANGLES, WIDE
from tools.sicsg.scene import Lamp, Light

Floats = NDArray[np.float64]

SHADOW_NEAR_M = 0.12
"""Nothing nearer to a lamp throws a shadow: its own housing hangs there."""
SHADOW_FAR_M = 40.0
FAINT = 0.03
"""Share of the windows' light below which lamps cast no shadow."""
SKYLIGHT = np.array([0.88, 0.97, 1.1])
HAND_M = 0.1
PANE = 0.85
"""Share of the light that a pane lets through."""


@dataclass(frozen=True, slots=True, eq=False)
class Rectangle:
    """A rectangle that shines along its normal."""

    centre_m: Floats
    normal: Floats
    """(3,) unit vector to where it shines."""
    along_m: Floats
    """(3,) half of its longer edge."""
    across_m: Floats
    """(3,) half of its shorter edge."""
    strength: float
    """Radiance of a white surface that faces it 1 m away (far field), times m^2."""
    colour: Floats
    """(3,) linear RGB."""

    @property
    def spread_m2(self) -> float:
        """Its area over pi: a disc of this squared radius stands for it."""
        return 4.0 / np.pi * self.half_edges_m[0] * self.half_edges_m[1]

    @property
    def half_edges_m(self) -> tuple[float, float]:
        """Half of its longer and of its shorter edge."""
        return float(np.linalg.norm(self.along_m)), float(np.linalg.norm(self.across_m))

    def packed(self, channel: int) -> NDArray[np.float32]:
        """(24,) as the shader's ``struct Rectangle``, shadowed by a channel (0 to 3) of the visibility."""
        rows = [
            (*self.centre_m, self.strength),
            (*self.normal, self.spread_m2),
            (*self.along_m, self.half_edges_m[0]),
            (*self.across_m, self.half_edges_m[1]),
            (*self.colour, 0.0),
            np.eye(4)[channel],
        ]
        return np.array(rows, dtype=np.float32).ravel()

    def shadow_from_world(self) -> Floats:
        """(4, 4) of a wide pinhole camera at its centre that looks along its normal; clip coordinates."""
        side = self.along_m / np.linalg.norm(self.along_m)
        axes = np.stack([side, np.cross(self.normal, side), self.normal])
        view = np.eye(4)
        view[:3, :3], view[:3, 3] = axes, -axes @ self.centre_m
        return clip_from_cam(np.diag([1.0 / WIDE, 1.0 / WIDE, 1.0]), SHADOW_NEAR_M, SHADOW_FAR_M) @ view


def clip_from_cam(ndc_from_ray: Floats, near_m: float, far_m: float) -> Floats:
    """(4, 4) OpenGL's projection of camera coordinates (z forward), from the (3, 3) that gives x and y of the picture
    in -1..1 of (x/z, y/z, 1); w is the z-depth in metres."""
    matrix = np.zeros((4, 4))
    matrix[0, :3], matrix[1, :3] = ndc_from_ray[0], ndc_from_ray[1]
    matrix[2, 2:] = (far_m + near_m) / (far_m - near_m), -2.0 * far_m * near_m / (far_m - near_m)
    matrix[3, 2] = 1.0
    return matrix


def sun_from_world(direction: Floats, corners_m: Floats) -> Floats:
    """(4, 4) clip coordinates of a parallel projection along the sun's rays that holds all corners (N, 3)."""
    z = -np.asarray(direction) / np.linalg.norm(direction)
    x = np.cross(z, [0.0, 0.0, 1.0] if abs(z[2]) < 0.9 else [1.0, 0.0, 0.0])
    x /= np.linalg.norm(x)
    axes = np.stack([x, np.cross(z, x), z])
    seen = corners_m @ axes.T
    low, high = seen.min(axis=0) - 0.05, seen.max(axis=0) + 0.05
    matrix = np.eye(4)
    matrix[:3, :3] = axes * (2.0 / (high - low))[:, None]
    matrix[:3, 3] = -(high + low) / (high - low)
    return matrix


DARK = Rectangle(np.zeros(3), np.array([0, 0, -1.0]), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), 0.0, np.zeros(3))
"""A rectangle that does not shine."""


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """Rectangles that share a shadow map."""

    members: tuple[Rectangle, ...]
    whole: Rectangle
    """What the map is made for: the only member, or a rectangle about all of them."""


def groups(light: Light, windows: Sequence[Rectangle], maps: int) -> list[Group]:
    """Every rectangle that shines, in groups of which the first ``maps`` are to have a shadow map each.

    Those are lamps first, since what stands on the floor is grounded by the shadows that they throw, if they give more
    than ``FAINT`` of the light: the strongest one if there is a map to spare, and the others, which are many and alike,
    as one group. Then come the windows, the strongest first.

    Raises:
        ValueError: for more than ``MAX_RECTANGLES``.
    """
    lamps = sorted((_lamp(lamp) for lamp in light.lamps if lamp.power > 0), key=_strength, reverse=True)
    panes = sorted(windows, key=_strength, reverse=True)
    if len(lamps) + len(panes) > MAX_RECTANGLES:
        raise ValueError(
            f"light {light.name}: {len(lamps)} lamps and {len(panes)} windows; the renderer takes {MAX_RECTANGLES} "
            "in all: merge lamps that are near each other"
        )
    alone = 1 if maps > 2 or len(lamps) == 1 else 0
    of_lamps = [Group((one,), one) for one in lamps[:alone]]
    if lamps[alone:]:
        of_lamps.append(Group(tuple(lamps[alone:]), _about(lamps[alone:])))
    of_windows = [Group((one,), one) for one in panes]
    faint = sum(map(_strength, lamps)) < FAINT * sum(map(_strength, panes))
    return of_windows + of_lamps if faint else of_lamps + of_windows


def _strength(rectangle: Rectangle) -> float:
    return rectangle.strength * float(rectangle.colour.mean())


def windows(instances: Sequence[Instance], sky: float) -> list[Rectangle]:
    """The skylight that enters by each upright pane of glass in what belongs to no entity, shining to the middle."""
    if sky <= 0.0:
        return []
    return [
        _pane(corners, sky)
        for instance in instances
        if instance.entity == 0
        for corners in _panes(instance.mesh, instance.world_from_mesh)
        if _upright(corners)
    ]


def _lamp(lamp: Lamp) -> Rectangle:
    length, width = lamp.size_m
    along, across = np.array([length / 2, 0.0, 0.0]), np.array([0.0, width / 2, 0.0])
    if width > length:
        along, across = across, along
    strength = lamp.power * (4.0 + length * width / np.pi)
    return Rectangle(
        np.array(lamp.position_m), np.array([0.0, 0.0, -1.0]), along, across, strength, np.array(lamp.colour)
    )


def _about(lamps: Sequence[Rectangle]) -> Rectangle:
    """One rectangle about several that shine downwards."""
    corners = np.concatenate(
        [lamp.centre_m + np.array([lamp.along_m + lamp.across_m, -lamp.along_m - lamp.across_m]) for lamp in lamps]
    )
    low, high = corners.min(axis=0), corners.max(axis=0)
    half = (high - low) / 2
    edges = np.diag(half)[:2]
    return Rectangle((low + high) / 2, lamps[0].normal, edges[0], edges[1], 1.0, np.ones(3))


def _panes(mesh: Mesh, world_from_mesh: Floats) -> list[Floats]:
    """Corners (N, 3) in the world of each connected piece of glass."""
    glass = np.array([material.transmission > 0 for material in mesh.materials])[mesh.face_material]
    faces = mesh.faces[glass]
    if not len(faces):
        return []
    used, places = np.unique(mesh.vertices_m, axis=0, return_inverse=True)
    edges = places.ravel()[faces[:, [0, 1, 1, 2]]].reshape(-1, 2)
    graph = coo_matrix((np.ones(len(edges)), edges.T), shape=(len(used), len(used)))
    labels = connected_components(graph, directed=False)[1]
    world = used @ world_from_mesh[:3, :3].T + world_from_mesh[:3, 3]
    touched = np.unique(edges)
    return [world[touched[labels[touched] == label]] for label in np.unique(labels[touched])]


def _upright(corners_m: Floats) -> bool:
    """Whether it is flat, along a wall, and larger than a hand."""
    x, y, z = np.ptp(corners_m, axis=0)
    return bool(min(x, y) < HAND_M < min(max(x, y), z))


def _pane(corners_m: Floats, sky: float) -> Rectangle:
    low, high = corners_m.min(axis=0), corners_m.max(axis=0)
    centre, half = (low + high) / 2, (high - low) / 2
    thin = int(np.argmin(half[:2]))
    normal = np.zeros(3)
    normal[thin] = -np.sign(centre[thin]) or 1.0
    edges = [half[1 - thin] * np.eye(3)[1 - thin], half[2] * np.eye(3)[2]]
    across, along = sorted(edges, key=lambda edge: float(np.linalg.norm(edge)))
    spread = 4.0 * float(half[1 - thin] * half[2]) / np.pi
    return Rectangle(centre + 0.02 * normal, normal, along, across, PANE * sky * spread, SKYLIGHT)
