"""Hard hats. Origin: the wearer's crown; the shell's inside clears it by 1.5 to 3 cm."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tools.sicsg.catalog_types import Item
from tools.sicsg.mesh import Floats, Material, Mesh
from tools.sicsg.objects.kit import Draw, make_item
from tools.sicsg.shapes import box, cylinder, ellipsoid, loft, place, ring, sweep, tube

COLOURS = ("f2f2ee", "f4c61c", "f07a18", "1f5fb4", "c8281e", "2f8f4a")
"""White, yellow, orange, blue, red, green."""
_SIDES = 36
_WALL_M = 0.004
_FULLNESS = 2.5
"""Exponent of the dome's height in its profile; 2 is an ellipsoid."""


@dataclass(frozen=True, slots=True)
class _Shell:
    """Measures of a shell, metres."""

    length: float
    """Half of the opening, front to back, outside."""
    width: float
    """Half of the opening, side to side, outside."""
    clearance: float
    """Inside of the top above the origin."""
    brim: float
    """Height of the opening's edge below the origin."""
    peak: float
    """How far the brim stands out at the front."""
    rim: float
    """How far it stands out elsewhere."""
    ridge: float
    """Height of the ridge from front to back."""

    @property
    def height(self) -> float:
        """From the opening's edge to the inside of the top."""
        return self.clearance + self.brim

    def radius(self, share: float) -> float:
        """Of a level of the dome, as a share of the opening's; fuller than an ellipsoid."""
        return float(max(1.0 - share**_FULLNESS, 0.0) ** 0.5)

    def outside(self, x: float, y: float) -> Floats:
        """(3,) the point of the dome's outside over x, y, the ridge left out."""
        radius = min(float(np.hypot(x / self.length, y / self.width)), 1.0)
        share = (1.0 - radius**2) ** (1 / _FULLNESS)
        return np.array([x, y, -self.brim + share * (self.height + _WALL_M)])

    def dome(self, share: float, wall: float) -> Floats:
        """(sides, 3) a level of the dome; ``share``: 0 at the edge, 1 at the top; ``wall``: thickness outside of it."""
        angle = np.arange(_SIDES) * (2 * np.pi / _SIDES)
        radius = self.radius(share)
        x = (self.length - _WALL_M + wall) * radius * np.cos(angle)
        y = (self.width - _WALL_M + wall) * radius * np.sin(angle)
        across = np.exp(-((y / 0.028) ** 6))
        z = -self.brim + share * (self.height + wall) + self.ridge * across * np.clip(2.5 * share - 0.4, 0, 1)
        return np.stack([x, y, np.broadcast_to(z, x.shape)], axis=1)

    def edge(self, out: float, drop: float) -> Floats:
        """(sides, 3) the brim's outline; ``out``: share of its breadth."""
        angle = np.arange(_SIDES) * (2 * np.pi / _SIDES)
        front = np.clip(np.cos(angle), 0, 1) ** 1.5
        breadth = out * (self.rim + (self.peak - self.rim) * front)
        x, y = (self.length + breadth) * np.cos(angle), (self.width + breadth) * np.sin(angle)
        return np.stack([x, y, -self.brim - drop - 0.012 * out * front], axis=1)


def hard_hat(draw: Draw) -> Item:
    """A hat of one of the usual colours."""
    colour = draw.one_of(*COLOURS)
    shell = _Shell(
        length=draw.between(0.122, 0.132),
        width=draw.between(0.102, 0.111),
        clearance=draw.between(0.02, 0.03),
        brim=draw.between(0.076, 0.088),
        peak=draw.between(0.03, 0.05),
        rim=draw.between(0.006, 0.016),
        ridge=draw.between(0.003, 0.009),
    )
    if draw.chance(0.15):  # full brim
        shell = replace(shell, peak=0.05, rim=0.04)
    skin = draw.plastic(colour)
    parts = [_body(shell, skin), *_suspension(draw, shell), *_ridges(draw, shell, skin)]
    parts += _badge(draw, shell) if draw.chance(0.5) else []
    extra = draw.one_of("nothing", "nothing", "nothing", "vents", "vents", "strap", "muffs", "lamp")
    if extra == "vents":
        parts += _vents(draw, shell)
    elif extra == "strap":
        parts.append(_strap(draw, shell))
    elif extra == "muffs":
        parts += _muffs(draw, shell)
    elif extra == "lamp":
        parts += _lamp(draw, shell)
    middle = (0.0, 0.0, (shell.clearance - shell.brim) / 2)
    return make_item(draw, parts, keypoints_m=[middle])


def _body(shell: _Shell, skin: Material) -> Mesh:
    """Outside from the top to the edge, out along the brim, back below it and up the inside."""
    shares = [*np.sin(np.linspace(np.pi / 2, 0.0, 9))[:-1], 0.0]
    outside = [shell.dome(share, _WALL_M) for share in shares]
    brim = [shell.edge(0.5, 0.001), shell.edge(1.0, 0.003), shell.edge(1.0, 0.007), shell.edge(0.3, 0.005)]
    inside = [shell.dome(share, 0.0) for share in reversed(shares)]
    return loft([*outside, *brim, *inside], skin, smooth=True)


def _ridges(draw: Draw, shell: _Shell, skin: Material) -> list[Mesh]:
    """On some a pair of ribs beside the middle."""
    if draw.chance(0.5):
        return []
    y = draw.between(0.035, 0.05)
    xs = np.linspace(-0.075, 0.075, 7)
    paths = [[shell.outside(x, side) for x in xs] for side in (-y, y)]
    return [tube(path, 0.005, skin, sides=6) for path in paths]


def _suspension(draw: Draw, shell: _Shell) -> list[Mesh]:
    """The band around the head and the straps over it, seen from below."""
    band = draw.plain(draw.one_of("2c2e30", "d8d6cc", "3a4a6a"), 0.8)
    head = ring(1.0, 0.06, band, sides=20, section_sides=5)
    scale = np.diag([shell.length - 0.018, shell.width - 0.016, 0.16, 1.0])
    scale[2, 3] = -shell.brim + 0.012
    straps = []
    for angle in (np.pi / 4, -np.pi / 4):
        x, y = 0.095 * np.cos(angle), 0.085 * np.sin(angle)
        path = [(-x, -y, -shell.brim + 0.02), (-0.6 * x, -0.6 * y, -0.004), (0, 0, 0.004)]
        path += [(-px, -py, pz) for px, py, pz in reversed(path[:2])]
        straps.append(sweep(path, [(0.012, 0.001), (-0.012, 0.001), (-0.012, -0.001), (0.012, -0.001)], band))
    return [head.moved(scale), *straps]


def _badge(draw: Draw, shell: _Shell) -> list[Mesh]:
    """A company's sticker over the peak."""
    spot = shell.outside(shell.length * 0.86, 0.0)
    material = draw.plain(draw.one_of("1d3f8a", "c8281e", "f4f4f0", "1c1c1e", "2f8f4a"))
    size = draw.between(0.035, 0.055)
    turn = place(spot, (0.0, -draw.between(0.45, 0.6), 0.0))
    return [box((0.012, size, size * 0.7), material, bevel_m=0.004).moved(turn)]


def _vents(draw: Draw, shell: _Shell) -> list[Mesh]:
    """Dark slots on both sides."""
    dark = draw.plain("18191b", 0.9)
    slots = []
    for side in (-1, 1):
        for x in (-0.045, -0.015, 0.015, 0.045):
            spot = shell.outside(x, side * shell.width * 0.74)
            slots.append(ellipsoid((0.005, 0.005, 0.016), dark, sides=6).moved(place(spot, (side * 0.75, 0, 0))))
    return slots


def _strap(draw: Draw, shell: _Shell) -> Mesh:
    """A chin strap stowed over the shell, from ear to ear across the front."""
    webbing = draw.plain(draw.one_of("1f2022", "2c3e66", "8a8d90"), 0.9)
    angles = np.linspace(-np.pi / 2, np.pi / 2, 11)
    points = []
    for angle in angles:
        level = 0.35 + 0.25 * float(np.cos(angle))
        radius = shell.radius(level)
        x, y = radius * shell.length * np.cos(angle), radius * shell.width * np.sin(angle)
        points.append((x * 0.98, y * 0.98, -shell.brim + level * (shell.height + _WALL_M)))
    return tube([(0.0, -shell.width, -shell.brim), *points, (0.0, shell.width, -shell.brim)], 0.006, webbing, sides=6)


def _muffs(draw: Draw, shell: _Shell) -> list[Mesh]:
    """Ear muffs on their arms, over the ears or folded up."""
    cup = draw.plastic(draw.one_of("1d1e20", "c8281e", "f0c020", "2f8f4a"))
    cushion, arm = draw.rubber(), draw.steel()
    y, z, tilt = (0.086, -0.125, 0.0) if draw.chance(0.6) else (shell.width + 0.002, -0.035, 0.5)
    hook = np.array([0.0, shell.width + 0.004, -shell.brim + 0.015])
    parts = []
    for side in (-1, 1):
        middle, out = np.array([0.0, side * y, z]), np.array([0.0, side * np.cos(tilt), np.sin(tilt)])
        parts.append(cylinder(middle - 0.01 * out, middle, 0.036, cushion))
        parts.append(cylinder(middle, middle + 0.03 * out, 0.038, cup, end_radius_m=0.028))
        start, end = hook * (1, side, 1), middle + 0.034 * out
        parts.append(tube([start, (start + end) / 2 + 0.012 * out, end], 0.005, arm, sides=6))
    return parts


def _lamp(draw: Draw, shell: _Shell) -> list[Mesh]:
    """A head lamp on its band around the shell."""
    strap, glass = draw.plain("1c1d1f", 0.85), draw.plain("f4f4ee", 0.2)
    levels = [0.30, 0.30, 0.38, 0.38]
    walls = [_WALL_M - 0.002, _WALL_M + 0.002, _WALL_M + 0.002, _WALL_M - 0.002]
    rings = [shell.dome(level, wall) for level, wall in zip(levels, walls, strict=True)]
    front = rings[2].max(axis=0)[0]
    z = float(rings[0][:, 2].mean()) + 0.01
    return [
        loft(rings, strap, closed=True, smooth=True),
        cylinder((front - 0.02, 0, z), (front + 0.022, 0, z), 0.022, strap),
        cylinder((front + 0.01, 0, z), (front + 0.024, 0, z), 0.018, glass),
    ]
