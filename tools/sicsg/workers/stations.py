"""Where to stand to use a thing, and where hands and feet go on it. World coordinates, given the thing's pose (4, 4).

Sides are as the user sees them: who climbs a ladder faces the item's -x, so that their left is its -y.

A ladder that leans is held from its user's side (``front``: behind and below the climber; between ladder and wall is no
room at usual lengths) or from beside it, a little towards the wall, so that the arms pass behind the rungs. A step
ladder is held from its rear side (``front``) or from beside it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.catalog_types import Item
from tools.sicsg.skeleton import Body

Floats = NDArray[np.float64]
Station = tuple[Floats, float]
"""A point on the floor (3,) below the pelvis, and the direction that the worker faces, radians."""
HoldSide = Literal["left", "right", "front"]
CarrySide = Literal["left", "right", "alone"]

_LEANING_COS = math.cos(math.radians(4.0))
_BASE_M = 0.30
"""From the first step to the pelvis of somebody who is about to climb."""
_HOLD_M = {"beside": 0.22, "towards_wall": 0.20, "front": 0.56, "rear": 0.50}
_CARRY_M = {"end": 0.36, "alone": 0.30}
_ARMS_WIDE_M = 0.58
"""How far from the middle the hands of a lone carrier are at the most; wider windows are held on the pane."""
_ALONE_GRIP_M = 0.70
"""Height over a window's lower edge at which a lone carrier holds it."""
_HANDS_SHARE = 0.69
"""Height of the middle between low and high grips when a window is carried, relative to the carrier's height."""
_LOWER_EDGE_M = (0.30, 0.60)
_EDGE_M = 0.30


class StationError(ValueError):
    """A thing cannot be used in the way that is asked for."""


@dataclass(frozen=True, slots=True, eq=False)
class Ladder:
    """Steps and rails of a ladder (or of a platform's access) in the world, sides as the climber sees them."""

    left: Floats
    """(S, 3) left ends of the steps, from below."""
    right: Floats
    out: Floats
    """(3,) horizontal unit vector towards the climber's side."""
    top_z: float
    """Height at which the rails end."""

    @property
    def middles(self) -> Floats:
        """(S, 3) middles of the steps."""
        return (self.left + self.right) / 2

    @property
    def yaw(self) -> float:
        """The direction that the climber faces."""
        return math.atan2(-self.out[1], -self.out[0])

    def rail(self, side: int, z: float) -> Floats:
        """(3,) the point at this height on the left (0) or right (1) rail, which goes on straight beyond the steps."""
        ends = (self.left, self.right)[side]
        if len(ends) == 1:
            return np.array([ends[0, 0], ends[0, 1], z])
        first = int(np.clip(np.searchsorted(ends[:, 2], z) - 1, 0, len(ends) - 2))
        low, high = ends[first], ends[first + 1]
        return low + (high - low) * ((z - low[2]) / (high[2] - low[2]))


def ladder_of(item: Item, pose: Floats) -> Ladder:
    """The ladder that a thing is, or that leads up to it.

    Raises:
        StationError: It has no steps.
    """
    if len(item.steps_m) == 0:
        raise StationError(f"{item.category} {item.variant} has no steps; only things with steps_m can be climbed")
    steps = item.steps_m @ pose[:3, :3].T + pose[:3, 3]
    out = _level(pose[:3, 0])
    left = np.array([out[1], -out[0], 0.0])
    swap = (steps[:, 0] - steps[:, 1]) @ left > 0
    ends = np.where(swap[:, None, None], steps, steps[:, ::-1])
    points = np.concatenate([item.keypoints_m, item.steps_m.reshape(-1, 3), item.deck_m]) @ pose[:3, :3].T + pose[:3, 3]
    return Ladder(ends[:, 0], ends[:, 1], out, float(points[:, 2].max()))


def climb_base(item: Item, pose: Floats) -> Station:
    """On the floor before the first step, facing the ladder."""
    ladder = ladder_of(item, pose)
    at = ladder.middles[0] + _BASE_M * ladder.out
    return _floor(at), ladder.yaw


def hold_grips(item: Item, pose: Floats) -> Floats:
    """(2, 3) where the hands of somebody who holds a ladder are: its left and its right rail as the climber sees them.

    Raises:
        StationError: It has no two grips.
    """
    if len(item.grips_m) != 2:
        raise StationError(f"{item.category} {item.variant} has {len(item.grips_m)} grips; to be held it needs two")
    grips = item.grips_m @ pose[:3, :3].T + pose[:3, 3]
    out = _level(pose[:3, 0])
    left = np.array([out[1], -out[0], 0.0])
    return grips[np.argsort(-(grips @ left))]


def hold_station(item: Item, pose: Floats, side: HoldSide) -> Station:
    """Where a second worker stands to hold a ladder by both rails; see the module's text."""
    grips = hold_grips(item, pose)
    out = _level(pose[:3, 0])
    left = np.array([out[1], -out[0], 0.0])
    middle = grips.mean(axis=0)
    leans = pose[2, 2] < _LEANING_COS
    if side == "front":
        at = middle + (_HOLD_M["front"] * out if leans else -_HOLD_M["rear"] * out)
    else:
        sign = 1.0 if side == "left" else -1.0
        half = float(np.linalg.norm(grips[1] - grips[0])) / 2
        at = middle + sign * (half + _HOLD_M["beside"]) * left - _HOLD_M["towards_wall"] * out
    return _floor(at), _facing(at, middle)


def carry_grips(item: Item, side: CarrySide) -> Floats:
    """(2, 3) where the carrier's left and right hand hold a window, in its own frame.

    Raises:
        StationError: It has not the four grips of a window.
    """
    if len(item.grips_m) != 4:
        raise StationError(f"{item.category} {item.variant} has {len(item.grips_m)} grips; to be carried it needs four")
    left_low, left_high, right_low, right_high = item.grips_m
    if side == "left":
        return np.stack([left_high, left_low])
    if side == "right":
        return np.stack([right_low, right_high])
    z = float(np.clip(_ALONE_GRIP_M, left_low[2], left_high[2]))
    half = min(float(left_low[1]), _ARMS_WIDE_M)
    return np.array([[left_low[0], -half, z], [left_low[0], half, z]])


def carry_stations(item: Item, pose: Floats, side: CarrySide) -> Station:
    """Where the carrier's feet are: beyond the window's left or right end, facing it, or before its middle (alone)."""
    middle, along, ahead = pose[:3, 3], _level(pose[:3, 1]), _level(pose[:3, 0])
    if side == "alone":
        at = middle + _CARRY_M["alone"] * ahead
    else:
        sign = 1.0 if side == "left" else -1.0
        at = middle + sign * (float(np.abs(item.grips_m[:, 1]).max()) + _CARRY_M["end"]) * along
    return _floor(at), _facing(at, middle)


def carry_height_m(item: Item, body: Body) -> float:
    """Height of the thing's origin (a window's lower edge) when this worker carries it."""
    middle = float(item.grips_m[:, 2].mean())
    low, high = _LOWER_EDGE_M
    wanted = _HANDS_SHARE * body.height_m - middle
    return float(np.clip(wanted, low, high if item.size_m[2] > 1.0 else 1.0))


def deck_of(item: Item, pose: Floats) -> Floats:
    """(4, 3) corners of the deck in the world.

    Raises:
        StationError: It has no deck.
    """
    if len(item.deck_m) != 4:
        raise StationError(f"{item.category} {item.variant} has no deck; only things with deck_m can be mounted")
    return item.deck_m @ pose[:3, :3].T + pose[:3, 3]


def deck_entry(item: Item, pose: Floats, deck_point: Floats) -> tuple[Floats, Floats]:
    """Point on the deck (3,) that one steps onto first, and the horizontal unit vector (3,) from there off the deck."""
    deck = deck_of(item, pose)
    if len(item.steps_m):
        ladder = ladder_of(item, pose)
        toward, out = ladder.middles[-1], ladder.out
        edge = float(np.max((deck - toward) @ out))
        return _at_height(toward + (edge - _EDGE_M) * out, deck), out
    edges = np.roll(deck, -1, axis=0) - deck
    outs = np.array([_level(np.array([y, -x, 0.0])) for x, y, _ in edges])
    distances = np.einsum("ij,ij->i", deck - deck_point, outs)
    nearest = int(distances.argmin())
    return _at_height(deck_point + (distances[nearest] - _EDGE_M) * outs[nearest], deck), outs[nearest]


def mount_base(item: Item, pose: Floats, deck_point: Floats) -> Station:
    """On the floor before the steps, or before the edge that is nearest to the point on the deck; facing the deck."""
    entry, out = deck_entry(item, pose, np.asarray(deck_point, dtype=np.float64))
    before = ladder_of(item, pose).middles[0] if len(item.steps_m) else entry + _EDGE_M * out
    reach = max(float((before - entry) @ out), _EDGE_M) + _BASE_M
    return _floor(entry + reach * out), math.atan2(-out[1], -out[0])


def _level(vector: Floats) -> Floats:
    flat = np.array([vector[0], vector[1], 0.0])
    return flat / np.linalg.norm(flat)


def _floor(point: Floats) -> Floats:
    return np.array([point[0], point[1], 0.0])


def _at_height(point: Floats, deck: Floats) -> Floats:
    return np.array([point[0], point[1], float(deck[:, 2].mean())])


def _facing(at: Floats, towards: Floats) -> float:
    return math.atan2(towards[1] - at[1], towards[0] - at[0])
