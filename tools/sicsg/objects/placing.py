"""Poses of an object in a scene: standing, leaning, lying. All are (4, 4) ``world_from_item`` that touch the floor."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tools.sicsg.catalog_types import Item
from tools.sicsg.mesh import Floats
from tools.sicsg.shapes import place

STORED_LEAN_RAD = np.deg2rad(8.0)
"""How far a stored window leans."""


def footprint(item: Item) -> tuple[float, float]:
    """Half of the extent along x and along y of a rectangle about the origin that covers the upright item, metres."""
    half_x, half_y = np.abs(item.mesh.vertices_m[:, :2]).max(axis=0).tolist()
    return half_x, half_y


def resting_pose(item: Item, at_m: ArrayLike, yaw_rad: float) -> Floats:
    """Upright, the origin over ``at_m`` (3,), the lowest point at its height; for hats and tools too."""
    return _on_floor(item, _turn(yaw_rad, 0.0), at_m)


def leaning_pose(item: Item, foot_m: ArrayLike, yaw_rad: float, lean_rad: float) -> Floats:
    """Leaning backwards, as a ladder against a wall.

    Args:
        foot_m: (3,) between its feet, on the floor.
        yaw_rad: where its front looks, that is away from the wall.
        lean_rad: from the vertical; 15 degrees for a ladder at 75 degrees to the floor.
    """
    return _on_floor(item, _turn(yaw_rad, lean_rad), foot_m)


def wall_distance_m(item: Item, lean_rad: float) -> float:
    """How far before a wall the feet of a leaning item stand when its back touches the wall."""
    return -float((item.mesh.vertices_m @ _turn(0.0, lean_rad)[0, :3]).min())


def against_wall_pose(item: Item, at_m: ArrayLike, yaw_rad: float, lean_rad: float = STORED_LEAN_RAD) -> Floats:
    """Leaning on a wall whose foot is at ``at_m`` (3,); ``yaw_rad`` is the direction from the wall into the room."""
    away = wall_distance_m(item, lean_rad) * np.array([np.cos(yaw_rad), np.sin(yaw_rad), 0.0])
    return leaning_pose(item, np.asarray(at_m, dtype=np.float64) + away, yaw_rad, lean_rad)


def lying_pose(item: Item, at_m: ArrayLike, yaw_rad: float) -> Floats:
    """Flat on its back, its middle over ``at_m`` (3,), its top towards the opposite of ``yaw_rad``."""
    turn = _turn(yaw_rad, np.pi / 2)
    turned = item.mesh.vertices_m @ turn[:3, :3].T
    middle = (turned.min(axis=0) + turned.max(axis=0)) / 2 * (1.0, 1.0, 0.0)
    return _on_floor(item, turn, np.asarray(at_m, dtype=np.float64) - middle)


def _turn(yaw_rad: float, lean_rad: float) -> Floats:
    return place((0, 0, 0), (0, 0, yaw_rad)) @ place((0, 0, 0), (0, -lean_rad, 0))


def _on_floor(item: Item, turn: Floats, at_m: ArrayLike) -> Floats:
    lowest = float((item.mesh.vertices_m @ turn[2, :3]).min())
    pose = turn.copy()
    pose[:3, 3] = np.asarray(at_m, dtype=np.float64) - (0.0, 0.0, lowest)
    return pose
