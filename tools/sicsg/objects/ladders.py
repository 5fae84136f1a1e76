"""Ladders that lean, and step ladders that stand."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from tools.sicsg.catalog_types import Item
from tools.sicsg.mesh import Floats, Material, Mesh
from tools.sicsg.objects.kit import Draw, Pair, Point, make_item, mirrored
from tools.sicsg.shapes import beam, box, cylinder, rectangle, rounded, sweep, tube

Line = Callable[[float], Point]
"""A leg's point with y > 0 at a height."""
RUNG_M = 0.28
"""From one rung to the next (EN 131: 0.25 to 0.30 m)."""
GRIP_M = 1.2
"""Height at which somebody holds a ladder."""
_FIBREGLASS = ("f07818", "f0b41e", "f06a10", "d8d23c", "2d6fb5")


def ladder(draw: Draw) -> Item:
    """A single ladder, or an extension ladder of two sections; its rails and rungs are as upright as the frame's z."""
    length, half = draw.between(2.4, 3.6), draw.between(0.19, 0.24)
    kind = draw.one_of("aluminium", "aluminium", "fibreglass", "wood")
    rail = {"aluminium": draw.aluminium, "wood": draw.timber}.get(
        kind, lambda: draw.plastic(draw.one_of(*_FIBREGLASS))
    )()
    rung = draw.timber() if kind == "wood" else draw.aluminium()
    section = (draw.between(0.026, 0.036), draw.between(0.06, 0.085))
    extended = kind != "wood" and draw.chance(0.45)
    if extended:
        parts, rungs, top = _two_sections(draw, length, half, section, rail, rung)
    else:
        parts, rungs = _section(half, (0.0, length), 0.0, section, rail, rung, draw)
        top = (0.0, half, length)
    parts += _feet(draw, half, section)
    if draw.chance(0.6):
        label = draw.plain(draw.one_of("f2f2f2", "f2d21e", "d83a2e"))
        z = draw.between(0.9, 1.5)
        parts += [
            box((section[1] * 0.7, 0.002, 0.16), label, centre_m=(0, y * (half + section[0] / 2 + 0.001), z))
            for y in (-1, 1)
        ]
    return make_item(
        draw,
        parts,
        keypoints_m=mirrored((0.0, half, 0.0)) + mirrored(top),
        steps_m=rungs,
        grips_m=mirrored((0.0, half + section[0] / 2, GRIP_M)),
    )


def _section(
    half: float,
    span_m: tuple[float, float],
    x: float,
    section: tuple[float, float],
    rail: Material,
    rung: Material,
    draw: Draw,
) -> tuple[list[Mesh], list[Pair]]:
    """Two rails from ``span_m[0]`` to ``span_m[1]`` with the rungs between, and the rungs' ends."""
    low, high = span_m
    parts = [beam((x, y, low), (x, y, high), section[0], section[1], rail, up=(1, 0, 0)) for y in (-half, half)]
    first = RUNG_M * np.ceil((low + 0.1) / RUNG_M)
    ends = [mirrored((x, half, z)) for z in np.arange(first, high - 0.08, RUNG_M)]
    flat = draw.chance(0.3)
    outline = rectangle(0.03, 0.032, 0.006, 2) if flat else rectangle(0.034, 0.034, 0.0169, 3)
    parts += [sweep(pair, outline, rung, smooth=not flat) for pair in ends]
    return parts, ends


def _two_sections(
    draw: Draw, length: float, half: float, section: tuple[float, float], rail: Material, rung: Material
) -> tuple[list[Mesh], list[Pair], Point]:
    """A base section behind and a narrower one that slides before it, on the climber's side, pushed up a little."""
    base_top = round(length * draw.between(0.66, 0.8) / RUNG_M) * RUNG_M + 0.12
    fly_foot = round(length * draw.between(0.25, 0.4) / RUNG_M) * RUNG_M - 0.12
    x, inner = section[1] + 0.004, half - section[0] - 0.004
    parts, rungs = _section(half, (0.0, base_top), 0.0, section, rail, rung, draw)
    more, upper = _section(inner, (fly_foot, length), x, section, rail, rung, draw)
    hooks = draw.steel()
    for y in (-inner, inner):
        parts.append(box((section[1] * 1.3, 0.02, 0.12), hooks, centre_m=(x * 0.6, y, fly_foot + 0.1)))
        parts.append(box((section[1] * 2.1, 0.05, 0.05), hooks, centre_m=(x / 2, np.sign(y) * half, base_top - 0.03)))
    climbed = [pair for pair in rungs if pair[0][2] < upper[0][0][2] - 0.01] + upper
    if draw.chance(0.5):
        rope = draw.plain(draw.one_of("e6e2d0", "f0a030", "3060c0"), 0.9)
        parts.append(tube([(x - 0.04, 0.06, 0.5), (x - 0.04, 0.05, base_top)], 0.006, rope, sides=5))
    return parts + more, climbed, (x, inner, length)


def _feet(draw: Draw, half: float, section: tuple[float, float]) -> list[Mesh]:
    """Rubber shoes; some ladders stand on a broad bar."""
    rubber = draw.rubber()
    shoes = [
        box((section[1] + 0.016, section[0] + 0.014, 0.07), rubber, centre_m=(0, y, 0.035), bevel_m=0.004)
        for y in (-half, half)
    ]
    if draw.chance(0.3):
        reach = half + draw.between(0.15, 0.25)
        shoes.append(beam((0, -reach, 0.11), (0, reach, 0.11), 0.04, 0.07, draw.aluminium()))
        shoes += [box((0.06, 0.05, 0.16), rubber, centre_m=(0, y * reach, 0.08), bevel_m=0.004) for y in (-1, 1)]
    return shoes


def step_ladder(draw: Draw) -> Item:
    """Two legs with treads before, two braced legs behind, opened; narrower towards its top."""
    height = draw.between(1.2, 2.4)
    front, rear, top = height * draw.between(0.2, 0.25), height * draw.between(0.24, 0.32), draw.between(0.04, 0.08)
    foot_half, top_half = draw.between(0.21, 0.27) + 0.02 * height, draw.between(0.15, 0.19)
    kind = draw.one_of("aluminium", "aluminium", "fibreglass", "wood", "painted")
    rail, rung = _step_ladder_materials(draw, kind)
    thick = (0.026, draw.between(0.05, 0.075))

    def on_front(z: float) -> Point:
        share = z / height
        return front + (top - front) * share, foot_half + (top_half - foot_half) * share, z

    def on_rear(z: float) -> Point:
        share = z / height
        return -rear + (rear - top) * share, foot_half + 0.02 + (top_half - foot_half - 0.02) * share, z

    parts = []
    for line in (on_front, on_rear):
        for foot, head in zip(mirrored(line(0.0)), mirrored(line(height)), strict=True):
            depth = thick[1] if line is on_front else 0.04
            parts.append(beam(_shoe_top(foot, head), head, thick[0], depth, rail, up=(1, 0, 0)))
            parts.append(box((0.075, 0.045, 0.05), draw.rubber(), centre_m=(foot[0], foot[1], 0.025), bevel_m=0.004))
    spacing = height / round(height / draw.between(0.24, 0.29))
    steps = [mirrored(on_front(z)) for z in np.arange(spacing, height - 0.5 * spacing, spacing)]
    tread = draw.between(0.075, 0.11)
    for left, right in steps:
        parts.append(beam(_down(left), _down(right), tread, 0.03, rung))
    parts += _braces(draw, on_rear, height, rail if kind == "wood" else draw.aluminium())
    parts += _spreaders(draw, on_front(height * 0.45), on_rear(height * 0.45))
    parts += _top(draw, height, top, top_half, rail)
    hold = min(GRIP_M, 0.85 * height)
    return make_item(
        draw,
        parts,
        keypoints_m=mirrored(on_front(0.0)) + mirrored(on_front(height)),
        steps_m=steps,
        grips_m=mirrored(on_front(hold)),
    )


def _step_ladder_materials(draw: Draw, kind: str) -> tuple[Material, Material]:
    """Of rails and of treads."""
    if kind == "wood":
        return draw.timber(), draw.timber()
    if kind == "fibreglass":
        return draw.plastic(draw.one_of(*_FIBREGLASS)), draw.aluminium()
    if kind == "painted":
        return draw.paint(draw.one_of("2f5fa8", "b8322a", "d9a520", "3c3f42")), draw.aluminium()
    return draw.aluminium(), draw.aluminium()


def _shoe_top(foot: Point, head: Point) -> Floats:
    """(3,) where a slanted leg begins inside its shoe, so that its end stays above the floor."""
    return np.array(foot) + 0.03 / head[2] * (np.array(head) - foot)


def _down(point: Point) -> Point:
    """A tread's axis lies half its thickness under what one steps on."""
    return point[0], point[1], point[2] - 0.015


def _braces(draw: Draw, on_rear: Line, height: float, material: Material) -> list[Mesh]:
    """Bars between the rear legs, level or crossed."""
    levels = [height * share for share in ((0.12, 0.4, 0.7) if height < 1.7 else (0.1, 0.32, 0.55, 0.78))]
    parts = [beam(*mirrored(on_rear(z)), 0.02, 0.03, material) for z in levels]
    if draw.chance(0.5):
        for z0, z1 in pairwise(levels):
            left, right = mirrored(on_rear(z0))[0], mirrored(on_rear(z1))[1]
            parts.append(beam(left, right, 0.012, 0.02, material))
    return parts


def _spreaders(draw: Draw, before: Point, behind: Point) -> list[Mesh]:
    """The bars that keep the legs apart, one on each side, bent a little downwards."""
    metal = draw.steel()
    parts = []
    for start, end in zip(mirrored(before), mirrored(behind), strict=True):
        middle = (np.array(start) + end) / 2 - (0, 0, draw.between(0.0, 0.05))
        parts.append(sweep(np.array([start, middle, end]), rectangle(0.006, 0.025), metal))
    return parts


def _top(draw: Draw, height: float, top: float, half: float, rail: Material) -> list[Mesh]:
    """A cap, or a small platform with a loop to hold on to."""
    cap = draw.plastic(draw.one_of("e8641a", "2b2d30", "f0b41e", "c42a22", "2a62b0")) if draw.chance(0.7) else rail
    depth = 2 * top + draw.between(0.08, 0.14)
    parts = [box((depth, 2 * half + 0.04, 0.05), cap, centre_m=(0, 0, height - 0.015), bevel_m=0.01)]
    if draw.chance(0.35):
        rise, loop = draw.between(0.5, 0.65), draw.aluminium()
        feet = [(-top, y, height - 0.05) for y in (-half, half)]
        heads = [(-top - 0.04, y, height + rise) for y in (-half, half)]
        parts.append(tube(rounded([feet[0], heads[0], heads[1], feet[1]], 0.08), 0.014, loop))
        if draw.chance(0.5):
            tray_z = height + 0.55 * rise
            parts.append(box((0.16, 2 * half, 0.03), cap, centre_m=(-top + 0.03, 0, tray_z), bevel_m=0.006))
    elif draw.chance(0.4):
        parts.append(cylinder((0, half * 0.5, height), (0, half * 0.5, height + 0.12), 0.05, draw.plastic("d8d8d4")))
    return parts
