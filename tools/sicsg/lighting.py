"""Light rigs: lamps, sun and sky by name, for a room and one of four kinds of light.

Strengths follow from what arrives in the middle of the room, 1 m above the floor (a white surface there that faces up
has the radiance 1 under 500 lux); the ambient light from what the surfaces of the room send on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.assets import asset_rng
from tools.sicsg.mesh import Instance, Material, join
from tools.sicsg.rooms import installation, is_door, prop_bounds
from tools.sicsg.rooms.walls import WALLS, Wall, quad
from tools.sicsg.scene import Lamp, Light, LightKind, Room
from tools.sicsg.shapes import box, cylinder

Floats = NDArray[np.float64]
Range = tuple[float, float]
Rgb = tuple[float, float, float]

_BELOW_CEILING_M = 0.3
"""Lower than joists and beams."""
_FIXTURES_M = ((0.6, 0.6), (1.2, 0.3), (1.2, 0.15), (0.14, 0.14), (0.3, 0.3))
_REFLECTED = 0.4
"""Share of the light that a room's surfaces send on, on the average."""
_SKYLIGHT, _SUNLIGHT = np.array([0.88, 0.97, 1.1]), np.array([1.0, 0.93, 0.82])
_GLOW = 3.0
"""Radiance that the face of a lamp shows: white in any picture, and little beside what the lamp gives."""


@dataclass(frozen=True, slots=True)
class _Rig:
    """What a kind of light draws from."""

    lamps: tuple[int, int]
    level: Range
    """Radiance of a white surface in the middle of the room under the lamps."""
    kelvin: Range
    sky: Range
    sun: Range
    exposure_ev: Range
    behind: bool = False
    """Whether the sun stands behind the scene as the front camera sees it."""


_RIGS: dict[LightKind, _Rig] = {
    "indoor": _Rig((2, 6), (0.6, 1.2), (2900, 6500), (0.5, 3.0), (0.0, 0.0), (-0.3, 0.3)),
    "backlight": _Rig((1, 3), (0.04, 0.2), (3000, 6500), (5.0, 12.0), (5.0, 14.0), (-0.9, -0.3), behind=True),
    "overexposed": _Rig((2, 6), (0.8, 2.0), (3500, 6500), (3.0, 9.0), (3.0, 12.0), (1.2, 2.2)),
    "dusk": _Rig((1, 2), (0.06, 0.2), (2400, 3400), (0.02, 0.1), (0.0, 0.0), (-0.9, -0.2)),
}


def light(name: str, room: Room, kind: LightKind) -> Light:
    """The light rig of this name, hung up in a room.

    Raises:
        ValueError: for an unknown kind.
    """
    if kind not in _RIGS:
        raise ValueError(f"light {name}: unknown kind {kind!r}; one of {', '.join(_RIGS)}")
    rig, rng = _RIGS[kind], asset_rng("light", name)
    lamps = _lamps(room, rig, rng)
    sky, sun = float(rng.uniform(*rig.sky)), float(rng.uniform(*rig.sun))
    direction = _sun_direction(room, rng, behind=rig.behind)
    ambient = _ambient(room, lamps, sky, sun, direction)
    return Light(
        name=name,
        kind=kind,
        lamps=lamps,
        sun_direction=_vector(direction),
        sun=round(sun, 4),
        sky=round(sky, 4),
        ambient=_vector(ambient),
        exposure_ev=round(float(rng.uniform(*rig.exposure_ev)), 3),
    )


def lamp_instances(light: Light, room: Room) -> list[Instance]:
    """The lamps as one sees them: a housing, a glowing face, a rod to the ceiling; entity 0."""
    pieces = []
    for lamp in light.lamps:
        (x, y, z), (length, width) = lamp.position_m, lamp.size_m
        case = Material((0.6, 0.6, 0.6), 0.4, 0.3)
        glow = Material(lamp.colour, 0.5, emission=_GLOW)
        pieces.append(box((length + 0.04, width + 0.04, 0.05), case, centre_m=(x, y, z + 0.035)))
        sides = ((-1, -1), (1, -1), (1, 1), (-1, 1))
        face = np.array([(x + sx * length / 2, y + sy * width / 2, z + 0.006) for sx, sy in sides])
        pieces.append(quad(face, np.array([0.0, 0.0, -1.0]), glow))
        pieces.append(cylinder((x, y, z + 0.06), (x, y, room.size_m[2]), 0.012, case, sides=6))
    return [Instance(join(pieces), np.eye(4), 0)] if pieces else []


def _lamps(room: Room, rig: _Rig, rng: np.random.Generator) -> tuple[Lamp, ...]:
    """Lamps of one make in a row or two, powered for the rig's level in the middle of the room."""
    count = int(rng.integers(rig.lamps[0], rig.lamps[1] + 1))
    size = _FIXTURES_M[int(rng.integers(len(_FIXTURES_M)))]
    height = room.size_m[2] - _BELOW_CEILING_M
    rows = 2 if count >= 4 else 1
    columns = math.ceil(count / rows)
    grid = [(2 * c + 1 - columns, 2 * r + 1 - rows) for r in range(rows) for c in range(columns)][:count]
    spread = np.array(room.size_m[:2]) / 2 / (columns, max(rows, 1)) * rng.uniform(0.8, 1.0)
    places = [_free(room, np.array(cell) * spread + rng.normal(0, 0.15, 2), size, height) for cell in grid]
    shares = rng.uniform(0.7, 1.0, count)
    arriving = sum(s * _arriving(place, height) for s, place in zip(shares, places, strict=True))
    power = rng.uniform(*rig.level) / arriving
    kelvin = rng.uniform(*rig.kelvin)
    colours = [_lamp_colour(kelvin + rng.normal(0, 150)) for _ in places]
    return tuple(
        Lamp(position_m=(*np.round(at, 3).tolist(), round(height, 3)), size_m=size, power=round(power * s, 4), colour=c)
        for at, s, c in zip(places, shares, colours, strict=True)
    )


def _arriving(place: Floats, height: float) -> float:
    """Radiance of a white surface in the middle of the room 1 m above the floor, under a lamp of power 1."""
    above = max(height - 1.0, 0.5)
    distance2 = float(place @ place) + above**2
    return 4.0 / distance2 * above**2 / distance2


def _free(room: Room, place: Floats, size: tuple[float, float], height: float) -> Floats:
    """The place, or the nearest one beside ducts and pillars, inside the room."""
    limit = np.array(room.size_m[:2]) / 2 - np.array(size) / 2 - 0.15
    half = np.array(size) / 2 + 0.05
    bounds = prop_bounds(room)
    high = bounds[bounds[:, 1, 2] > height - 0.1][:, :, :2]
    steps = sorted(((dx, dy) for dx in range(-8, 9) for dy in range(-8, 9)), key=lambda step: math.hypot(*step))
    for step in steps:
        moved = np.clip(place + 0.3 * np.array(step), -limit, limit)
        if not ((high[:, 0] < moved + half) & (high[:, 1] > moved - half)).all(axis=1).any():
            return moved
    raise ValueError(f"room {room.name}: no place for a lamp near {place.tolist()} m among its ducts; hang fewer ducts")


def _lamp_colour(kelvin: float) -> Rgb:
    """Linear RGB of a lamp between candle light and daylight, its brightest channel 1."""
    share = float(np.clip((kelvin - 2400) / (6600 - 2400), 0, 1))
    warm, cold = np.array([1.0, 0.58, 0.24]), np.array([1.0, 0.98, 1.0])
    return _vector(warm + (cold - warm) * share**0.6)


def _sun_direction(room: Room, rng: np.random.Generator, *, behind: bool) -> Floats:
    """Towards the sun: through the wall with the installation opening, or another one with windows."""
    walls = {opening.wall for opening in room.openings if not is_door(opening)}
    others = sorted(walls - {installation(room).wall}) or sorted(walls)
    wall = installation(room).wall if behind else others[int(rng.integers(len(others)))]
    outward = Wall.of(room, wall).outward
    azimuth = math.atan2(outward[1], outward[0]) + rng.uniform(-0.6, 0.6)
    elevation = rng.uniform(0.3, 0.8)
    flat = math.cos(elevation)
    return np.array([flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation)])


def _ambient(room: Room, lamps: tuple[Lamp, ...], sky: float, sun: float, direction: Floats) -> Floats:
    """(3,) what the surfaces send on of the light that enters: its flux, spread over them (the integrating sphere).

    A lamp of power 1 gives the flux 4 pi^2, a window of area a lets in pi a sky (half of what it sees is ground) and
    pi a sun cos of the sun; the ambient radiance is flux / (pi area) times r / (1 - r).
    """
    x, y, z = room.size_m
    area = 2 * (x * y + y * z + z * x)
    entering = 4 * np.pi * sum((lamp.power * np.array(lamp.colour) for lamp in lamps), np.zeros(3))
    outward = {name: Wall.of(room, name).outward for name in WALLS}
    for opening in room.openings:
        if not is_door(opening):
            glass = opening.size_m[0] * opening.size_m[1]
            entering += glass * 0.6 * sky * _SKYLIGHT
            entering += glass * sun * max(float(outward[opening.wall] @ direction), 0.0) * _SUNLIGHT
    return np.asarray(entering / area * (_REFLECTED / (1 - _REFLECTED)))


def _vector(values: Floats) -> Rgb:
    a, b, c = np.round(values, 4).tolist()
    return a, b, c
