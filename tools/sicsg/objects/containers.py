"""What holds things: tool boxes, buckets, barrels."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from tools.sicsg.catalog_types import Item
from tools.sicsg.mesh import Material, Mesh
from tools.sicsg.objects.kit import Draw, Point, make_item
from tools.sicsg.shapes import beam, box, cylinder, lathe, loft, place, rectangle, ring, rounded, tube

_HUES = ("c8281e", "1f5fb4", "f0b41e", "2b2d30", "2f7f4a", "e8641a", "55595e", "0f8f8a")


def toolbox(draw: Draw) -> Item:
    """A box with lid, latches and handle; a metal one with trays; or an open tote."""
    length, depth, height = draw.between(0.4, 0.6), draw.between(0.2, 0.28), draw.between(0.2, 0.28)
    kind = draw.one_of("plastic", "plastic", "metal", "case", "tote")
    if kind == "metal":
        parts, handle = _metal_box(draw, length, depth, height)
    elif kind == "tote":
        parts, handle = _tote(draw, length, depth, height * 0.75)
    elif kind == "case":
        parts, handle = _case(draw, length, depth * 0.7, height)
    else:
        parts, handle = _plastic_box(draw, length, depth, height)
    return make_item(draw, parts, grips_m=[handle])


def _plastic_box(draw: Draw, length: float, depth: float, height: float) -> tuple[list[Mesh], Point]:
    """A tapered body under a lid of another colour, two latches at the front."""
    body, lid = draw.plastic(draw.one_of("26282b", "3a3d41", *_HUES)), draw.plastic(draw.one_of(*_HUES))
    clip = draw.plastic(draw.one_of("f0b41e", "d8d8d4", "1c1d1f", "c8281e"))
    seam = height * draw.between(0.6, 0.75)
    outline = rectangle(depth, length, 0.025)
    parts = [
        loft(_stack(outline, [(0.9, 0.0), (0.93, 0.01), (0.98, seam)]), body),
        loft(_stack(outline, [(1.02, seam), (1.02, seam + 0.02), (0.97, height - 0.02), (0.9, height)]), lid),
    ]
    for y in (-0.28, 0.28):
        centre = (depth * 0.51, y * length, seam)
        parts.append(box((0.014, 0.05, 0.06), clip, centre_m=centre, bevel_m=0.004))
    parts.append(_arch(length * 0.45, height - 0.01, 0.055, 0.013, clip if draw.chance(0.4) else lid))
    return parts, (0.0, 0.0, height + 0.045)


def _metal_box(draw: Draw, length: float, depth: float, height: float) -> tuple[list[Mesh], Point]:
    """A cantilever box: a body and two pairs of trays folded over it, with bars at both ends."""
    skin, bar = draw.paint(draw.one_of("c8281e", "1f5fb4", "2f7f4a", "55595e")), draw.steel()
    levels = np.linspace(0.0, height, 4)
    parts = [box((depth, length, levels[1] + 0.03), skin, centre_m=(0, 0, (levels[1] + 0.03) / 2), bevel_m=0.008)]
    for low, high in pairwise((levels[1:] + 0.03).tolist()):
        size = (depth / 2 - 0.004, length, high - low - 0.005)
        for middle in (-depth / 4, depth / 4):
            parts.append(box(size, skin, centre_m=(middle, 0, (low + high) / 2), bevel_m=0.006))
    top = height + 0.03
    for y in (-1, 1):
        for x in (-1, 1):
            side = y * (length / 2 + 0.004)
            parts.append(beam((x * depth * 0.4, side, 0.07), (x * 0.04, side, top - 0.02), 0.004, 0.02, bar))
    for aside in (-0.03, 0.03):
        parts.append(_arch(length * 0.7, top - 0.01, 0.06, 0.009, bar).moved(place((aside, 0, 0))))
    return parts, (0.0, 0.0, top + 0.05)


def _case(draw: Draw, length: float, depth: float, height: float) -> tuple[list[Mesh], Point]:
    """A machine's case standing on its edge: two shells, ribs, handle on top."""
    skin, grip = draw.plastic(draw.one_of(*_HUES)), draw.plastic("26282b")
    outline = rectangle(height, length, 0.03)
    shell = loft(_stack(outline, [(0.92, 0.0), (1.0, 0.02), (1.0, depth - 0.02), (0.92, depth)]), skin)
    parts = [shell.moved(place((-depth / 2, 0, height / 2), (0, np.pi / 2, 0)))]
    parts.append(box((0.012, length + 0.004, height + 0.004), grip, centre_m=(0, 0, height / 2 + 0.002), bevel_m=0.003))
    for y in (-0.3, 0.3):
        parts.append(box((0.05, 0.04, 0.02), grip, centre_m=(0, y * length, height), bevel_m=0.005))
    parts.append(_arch(0.15, height - 0.005, 0.045, 0.013, grip))
    label = draw.plain(draw.one_of("f2f2ee", "1c1c1e", "f0c020"))
    parts.append(box((0.003, length * 0.4, height * 0.3), label, centre_m=(depth / 2, 0, height * 0.55)))
    return parts, (0.0, 0.0, height + 0.035)


def _tote(draw: Draw, length: float, depth: float, height: float) -> tuple[list[Mesh], Point]:
    """An open tray between two gables that carry a round bar, with tools that stick out."""
    skin = draw.timber() if draw.chance(0.5) else draw.plastic(draw.one_of(*_HUES))
    wall, rise = 0.016, height * 1.75
    parts = [box((depth, length, wall), skin, centre_m=(0, 0, wall / 2))]
    parts += [box((wall, length, height * 0.7), skin, centre_m=(x * depth / 2, 0, height * 0.35)) for x in (-1, 1)]
    gable = [(-depth / 2, 0), (depth / 2, 0), (depth / 2, height * 0.7), (0.03, rise), (-0.03, rise)]
    gable.append((-depth / 2, height * 0.7))
    for y in (-1, 1):
        end = _upright(gable, wall, skin).moved(place((0, y * length / 2 + wall / 2, 0)))
        parts.append(end)
    bar = rise - 0.03
    parts.append(cylinder((0, -length / 2, bar), (0, length / 2, bar), 0.015, draw.timber()))
    parts += _stuff(draw, length, depth, height)
    return parts, (0.0, 0.0, bar)


def _stuff(draw: Draw, length: float, depth: float, height: float) -> list[Mesh]:
    """Handles of tools that lean in a tray."""
    parts = []
    for _ in range(draw.count(2, 5)):
        x, y = draw.between(-0.3, 0.3) * depth, draw.between(-0.4, 0.4) * length
        lean = (x * 0.6, y + draw.between(-0.06, 0.06), height * draw.between(0.9, 1.3))
        parts.append(cylinder((x, y, 0.02), lean, 0.013, draw.plastic(draw.one_of(*_HUES)), sides=8))
    return parts


def bucket(draw: Draw) -> Item:
    """A bucket with rim and bail, empty or with something in it."""
    top, height = draw.between(0.13, 0.165), draw.between(0.26, 0.38)
    bottom = top * draw.between(0.72, 0.88)
    metal = draw.chance(0.25)
    wall = draw.aluminium() if metal else draw.plastic(draw.one_of("26282b", "e9e9e4", "f0b41e", *_HUES))
    inside = [(top - 0.004, height), (bottom - 0.004, 0.006)]
    rim = [(top, height - 0.02), (top + 0.008, height - 0.02), (top + 0.008, height)]
    parts = [lathe([(bottom, 0.0), *rim, *inside], wall, sides=20)]
    if not metal and draw.chance(0.5):
        z, radius = height * 0.8, bottom + (top - bottom) * 0.8
        parts.append(ring(radius + 0.001, 0.006, wall, sides=20, section_sides=6).moved(place((0, 0, z))))
    if draw.chance(0.5):
        share = draw.between(0.4, 0.85)
        radius = bottom + (top - bottom) * share - 0.003
        content = draw.plain(draw.one_of("9a968e", "e6e2d8", "6a5a48", "b8b4aa", "4a4c50"), 0.95)
        parts.append(cylinder((0, 0, height * share - 0.02), (0, 0, height * share), radius, content, sides=20))
    wire, raised = draw.steel(), draw.chance(0.6)
    parts += _bail(draw, top + 0.006, height - 0.03, raised, wire)
    grip = height + top * 0.85 if raised else height
    return make_item(draw, parts, grips_m=[(0.0, 0.0, grip)] if raised else [(top, 0.0, grip)])


def _bail(draw: Draw, radius: float, z: float, raised: bool, wire: Material) -> list[Mesh]:
    """The wire from ear to ear, upright or fallen to the front, with a grip in its middle."""
    angles = np.linspace(0.0, np.pi, 13)
    tilt = np.pi / 2 - 0.1 if raised else -0.12
    arc = radius * np.stack([np.sin(angles) * np.cos(tilt), np.cos(angles), np.sin(angles) * np.sin(tilt)], axis=1)
    arc += (0, 0, z)
    handle = draw.plastic(draw.one_of("26282b", "e9e9e4"))
    parts = [tube(arc, 0.003, wire, sides=6), cylinder(arc[5], arc[7], 0.011, handle)]
    parts += [box((0.03, 0.014, 0.04), wire, centre_m=(0, side * (radius - 0.002), z)) for side in (-1, 1)]
    return parts


def barrel(draw: Draw) -> Item:
    """A drum of steel with rolling hoops, or one of plastic, closed or open."""
    radius, height = draw.between(0.27, 0.3), draw.between(0.8, 0.95)
    if draw.chance(0.6):
        hue = draw.one_of("1f4f9a", "2b2d30", "c8281e", "2f7f4a", "e08a1a", "rust")
        skin = draw.rust() if hue == "rust" else draw.paint(hue)
        profile = _drum_profile(radius, height, hoops=(0.33, 0.66))
    else:
        skin = draw.plastic(draw.one_of("1f5fb4", "26282b", "e9e6da", "2a6fc8"))
        profile = _keg_profile(radius, height)
    if draw.chance(0.3):  # open, half full
        level = height * draw.between(0.5, 0.9)
        water = draw.plain(draw.one_of("3a4038", "6b6558", "201f1d"), 0.3)
        profile = [*profile, (radius * 0.88, height), (radius * 0.88, 0.03)]
        parts = [lathe(profile, skin, sides=24)]
        parts.append(cylinder((0, 0, level - 0.03), (0, 0, level), radius * 0.88 + 0.002, water, sides=24))
    else:
        parts = [lathe([*profile, (radius * 0.93, height), (radius * 0.92, height - 0.018)], skin, sides=24)]
        plug = draw.steel()
        for x, y, size in ((0.6, 0.15, 0.035), (-0.55, -0.2, 0.02)):
            spot = (x * radius, y * radius)
            parts.append(cylinder((*spot, height - 0.02), (*spot, height - 0.004), size, plug))
    if draw.chance(0.4):
        parts.append(
            _belt(radius * 1.004, height * draw.between(0.4, 0.5), draw.plain(draw.one_of("f2f2ee", "f0c81e")))
        )
    return make_item(draw, parts)


def _drum_profile(radius: float, height: float, hoops: tuple[float, ...]) -> list[tuple[float, float]]:
    profile = [(radius * 0.97, 0.0), (radius * 1.02, 0.0), (radius * 1.02, 0.02), (radius, 0.025)]
    for share in hoops:
        z = share * height
        profile += [(radius, z - 0.03), (radius * 1.035, z - 0.01), (radius * 1.035, z + 0.01), (radius, z + 0.03)]
    return [*profile, (radius, height - 0.025), (radius * 1.02, height - 0.02), (radius * 1.02, height)]


def _keg_profile(radius: float, height: float) -> list[tuple[float, float]]:
    return [
        (radius * 0.86, 0.0), (radius * 0.96, 0.03), (radius, 0.1), (radius * 1.02, height * 0.45),
        (radius, height * 0.8), (radius * 0.94, height * 0.88), (radius * 0.9, height * 0.9),
        (radius * 0.9, height * 0.93), (radius * 0.98, height * 0.935), (radius * 0.98, height),
    ]  # fmt: skip


def _belt(radius: float, z: float, material: Material) -> Mesh:
    """A label all around."""
    profile = [(radius - 0.01, z - 0.07), (radius, z - 0.07), (radius, z + 0.07), (radius - 0.01, z + 0.07)]
    return lathe(profile, material, sides=24, closed=True)


def _stack(outline: np.ndarray, levels: list[tuple[float, float]]) -> np.ndarray:
    """(S, P, 3) an outline at several heights, scaled."""
    return np.array([np.column_stack([outline * scale, np.full(len(outline), z)]) for scale, z in levels])


def _arch(span: float, z: float, rise: float, radius: float, material: Material) -> Mesh:
    """A handle along y that stands on z."""
    path = [(0, -span / 2, z), (0, -span / 2, z + rise), (0, span / 2, z + rise), (0, span / 2, z)]
    return tube(rounded(path, rise * 0.6), radius, material)


def _upright(outline: list[tuple[float, float]], thickness: float, material: Material) -> Mesh:
    """An outline in x and z, extruded towards -y."""
    points = np.array(outline, dtype=np.float64)
    low = np.column_stack([points[:, 0], np.zeros(len(points)), points[:, 1]])
    return loft([low, low - (0, thickness, 0)], material)
