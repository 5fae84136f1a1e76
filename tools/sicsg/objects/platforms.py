"""What people stand on: work platforms and scaffolds. Their long side lies along x, the way up is at +x."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tools.sicsg.catalog_types import Item
from tools.sicsg.mesh import Material, Mesh, join
from tools.sicsg.objects.kit import Draw, Pair, Point, make_item, mirrored
from tools.sicsg.shapes import beam, box, cylinder, lathe, place


def deck_corners(length_m: float, width_m: float, height_m: float) -> list[Point]:
    """Counter-clockwise from above, from the corner at +x, +y."""
    x, y = length_m / 2, width_m / 2
    return [(x, y, height_m), (-x, y, height_m), (-x, -y, height_m), (x, -y, height_m)]


def platform(draw: Draw) -> Item:
    """A work platform: a deck on splayed folding legs, rungs between the legs at both ends."""
    height, length, width = draw.between(0.4, 0.9), draw.between(1.2, 1.8), draw.between(0.5, 0.8)
    kind = draw.one_of("aluminium", "aluminium", "painted", "wood")
    if kind == "wood":
        leg, deck = draw.timber(), draw.timber("plywood")
    else:
        leg = draw.aluminium() if kind == "aluminium" else draw.paint(draw.one_of("e0a818", "c8321e", "2f6cb0"))
        deck = draw.aluminium() if draw.chance(0.5) else draw.timber("plywood")
    corners = deck_corners(length, width, height)
    parts = _deck(draw, length, width, height, deck, leg)
    legs, steps = _legs(draw, length, width, height, leg)
    parts += legs
    return make_item(draw, parts, keypoints_m=corners, deck_m=corners, steps_m=np.reshape(steps, (-1, 2, 3)))


def _deck(draw: Draw, length: float, width: float, height: float, deck: Material, rim: Material) -> list[Mesh]:
    """The sheet within its rim, or planks; a coloured strip warns of the edge on some."""
    thick, rim_depth = 0.03, draw.between(0.05, 0.08)
    parts = []
    planks = draw.count(1, 3)
    broad = width / planks
    for i in range(planks):
        y = -width / 2 + (i + 0.5) * broad
        parts.append(box((length, broad - 0.006 * (planks > 1), thick), deck, centre_m=(0, y, height - thick / 2)))
    z = height - thick - rim_depth / 2 + 0.01
    for y in (-1, 1):
        side = y * (width / 2 - 0.016)
        parts.append(beam((-length / 2, side, z), (length / 2, side, z), 0.03, rim_depth, rim))
    for x in (-1, 1):
        end = x * (length / 2 - 0.016)
        parts.append(beam((end, -width / 2, z), (end, width / 2, z), 0.03, rim_depth, rim))
    if draw.chance(0.4):
        warning = draw.plain(draw.one_of("f2c81e", "d8301e", "1c1c1c"))
        for x in (-1, 1):
            centre = (x * (length / 2 - 0.03), 0, height - 0.0005)
            parts.append(box((0.05, width * 0.98, 0.001), warning, centre_m=centre))
    return parts


def _legs(draw: Draw, length: float, width: float, height: float, leg: Material) -> tuple[list[Mesh], list[Pair]]:
    """Two legs with rungs at each end, flatter ones with treads; the ends of those at +x, which are the steps."""
    stepped = draw.chance(0.35)
    inset, splay = draw.between(0.03, 0.12), draw.between(0.18, 0.26) if stepped else draw.between(0.02, 0.1)
    tread = 0.09 if stepped else 0.045
    head_half = width / 2 - 0.05
    foot_half = head_half + draw.between(0.0, 0.06)
    thick = draw.between(0.035, 0.05)
    rungs = max(1, round((height - 0.1) / 0.28) - 1)
    parts: list[Mesh] = []
    steps: list[Pair] = []
    shoe = draw.rubber()
    for sign in (1.0, -1.0):

        def at(z: float, sign: float = sign) -> Point:
            share = z / height
            x = sign * (length / 2 - inset + splay * (1 - share))
            return x, foot_half + (head_half - foot_half) * share, z

        for foot, head in zip(mirrored(at(0.02)), mirrored(at(height - 0.04)), strict=True):
            parts.append(beam(foot, head, thick, thick * 0.7, leg, up=(1, 0, 0)))
            parts.append(box((thick + 0.015, thick + 0.015, 0.04), shoe, centre_m=(foot[0], foot[1], 0.02)))
        levels = [mirrored(at(height * (i + 1) / (rungs + 1))) for i in range(rungs)]
        parts += [beam(*pair, tread, 0.028, leg) for pair in levels]
        steps = steps or [mirrored(np.add(right, (0, 0, 0.014))) for _, right in levels]
        parts += _stays(draw, at, length, height, leg)
    return parts, steps


def _stays(draw: Draw, at: Callable[[float], Point], length: float, height: float, leg: Material) -> list[Mesh]:
    """Slanted bars from the legs to the deck that hold the legs open."""
    starts = mirrored(at(height * draw.between(0.35, 0.5)))
    inward = -np.sign(starts[0][0]) * length * draw.between(0.18, 0.26)
    return [beam((x, y, z), (x + inward, y, height - 0.05), 0.01, 0.025, leg) for x, y, z in starts]


def scaffold(draw: Draw) -> Item:
    """A small mobile tower: two ladder frames, beams and braces between them, a deck, castors; a guard rail on some."""
    height, length, width = draw.between(1.0, 1.9), draw.between(1.3, 1.9), draw.between(0.6, 0.85)
    kind = draw.one_of("galvanised", "yellow", "red", "blue", "rusty")
    colours = {"yellow": "e0aa14", "red": "b8281e", "blue": "2a58a0"}
    pipe = draw.paint(colours[kind]) if kind in colours else draw.aluminium() if kind == "galvanised" else draw.rust()
    guarded = draw.chance(0.5)
    top = height + (draw.between(0.85, 1.0) if guarded else draw.between(0.02, 0.3))
    radius, x, y = draw.between(0.018, 0.025), length / 2 - 0.03, width / 2 - 0.03
    foot = 0.16 if draw.chance(0.7) else 0.03
    parts: list[Mesh] = []
    for sign in (1, -1):
        parts += _end_frame(sign * x, y, foot, height, top, radius, pipe, guarded)
    parts += _bracing(draw, x, y, height, radius, pipe)
    parts += _rails(x, y, height, top, radius, pipe) if guarded else []
    support = _castor(draw) if foot > 0.1 else _base_plate(pipe)
    parts += [support.moved(place((cx, cy, 0.0))) for cx in (-x, x) for cy in (-y, y)]
    deck = draw.timber("plywood") if draw.chance(0.6) else draw.aluminium()
    parts.append(box((length, width, 0.045), deck, centre_m=(0, 0, height - 0.0225)))
    corners = deck_corners(length, width, height)
    steps = [mirrored((x, y, z + radius)) for z in _rung_heights(foot, height)]
    return make_item(draw, parts, keypoints_m=corners, deck_m=corners, steps_m=steps)


def _rung_heights(foot: float, height: float) -> list[float]:
    """Every 0.3 m from above the castors to below the deck."""
    return np.arange(foot + 0.2, height - 0.12, 0.3).tolist()


def _end_frame(
    x: float, y: float, foot: float, height: float, top: float, radius: float, pipe: Material, guarded: bool
) -> list[Mesh]:
    """Two posts with rungs between them; over the deck of a guarded one two more."""
    parts = [cylinder((x, side, foot), (x, side, top), radius, pipe, sides=8) for side in (-y, y)]
    levels = [*_rung_heights(foot, height), height - 0.06]
    levels += [height + 0.5 * (top - height), top - 0.02] if guarded else []
    parts += [cylinder((x, -y, z), (x, y, z), radius * 0.85, pipe, sides=8) for z in levels]
    return parts


def _bracing(draw: Draw, x: float, y: float, height: float, radius: float, pipe: Material) -> list[Mesh]:
    """On both sides a beam under the deck, one near the floor on some, and one brace or two crossed ones."""
    crossed, low = draw.chance(0.5), 0.28
    parts = []
    for side in (-y, y):
        parts.append(cylinder((-x, side, height - 0.06), (x, side, height - 0.06), radius, pipe, sides=8))
        ends = [((-x, side, low), (x, side, height - 0.15)), ((x, side, low), (-x, side, height - 0.15))]
        for start, end in ends[: 2 if crossed else 1]:
            parts.append(cylinder(start, end, radius * 0.65, pipe, sides=6))
    if draw.chance(0.5):
        parts += [cylinder((-x, side, low), (x, side, low), radius * 0.85, pipe, sides=8) for side in (-y, y)]
    return parts


def _rails(x: float, y: float, height: float, top: float, radius: float, pipe: Material) -> list[Mesh]:
    """Hand rail and knee rail along both long sides, and toe boards."""
    levels = (top - 0.02, height + 0.5 * (top - height))
    return [cylinder((-x, side, z), (x, side, z), radius * 0.85, pipe, sides=8) for side in (-y, y) for z in levels]


def _castor(draw: Draw) -> Mesh:
    """A wheel of 0.16 m height in its fork."""
    tyre = draw.rubber()
    wheel = lathe([(0.02, -0.02), (0.066, -0.02), (0.075, -0.012), (0.075, 0.012), (0.066, 0.02), (0.02, 0.02)], tyre)
    fork = draw.steel()
    return join(
        [
            wheel.moved(place((0.02, 0, 0.075), (np.pi / 2, 0, 0))),
            box((0.05, 0.056, 0.03), fork, centre_m=(0.01, 0, 0.155)),
            box((0.03, 0.006, 0.1), fork, centre_m=(0.015, 0.026, 0.11)),
            box((0.03, 0.006, 0.1), fork, centre_m=(0.015, -0.026, 0.11)),
        ]
    )


def _base_plate(pipe: Material) -> Mesh:
    return box((0.12, 0.12, 0.03), pipe, centre_m=(0, 0, 0.015))
