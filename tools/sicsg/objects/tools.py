"""What stands about or is used: cones, drills, saw horses, wheelbarrows."""

from __future__ import annotations

import numpy as np

from tools.sicsg.catalog_types import Item
from tools.sicsg.mesh import Material, Mesh
from tools.sicsg.objects.kit import Draw, make_item, mirrored
from tools.sicsg.shapes import beam, box, cylinder, lathe, loft, place, prism, rectangle, rounded, tube

_MAKERS = ("0f8f8a", "f0c020", "c8281e", "2f7f3a", "1f5fb4", "e8641a")


def cone(draw: Draw) -> Item:
    """A traffic cone with reflective bands on its square foot."""
    height, base = draw.between(0.45, 0.75), draw.between(0.28, 0.4)
    skin = draw.plastic(draw.one_of("f4581a", "f4581a", "ee6a10", "e8441c", "d8e020"))
    foot = draw.rubber() if draw.chance(0.45) else skin
    low, high, floor = base * 0.38, draw.between(0.022, 0.035), 0.03

    def radius(z: float) -> float:
        return low + (high - low) * (z - floor) / (height - floor)

    inside = [(high - 0.006, height), (high - 0.006, height - 0.04)]
    parts = [
        loft([np.column_stack([rectangle(base * s, base * s, base * 0.1), np.full(16, z)]) for s, z in
              ((1.0, 0.0), (1.0, 0.02), (0.94, floor))], foot),
        lathe([(low + 0.015, floor - 0.004), (low + 0.015, floor), (low, floor + 0.012), (high, height), *inside],
              skin, sides=20),
    ]  # fmt: skip
    band = draw.plain(draw.one_of("f4f4f2", "f4f4f2", "e6e6e6"), 0.35)
    count = draw.count(1, 2)
    for start, share in ((0.5, 0.2), (0.26, 0.14))[:count]:
        z0, z1 = start * height, (start + share) * height
        out = 0.0025
        profile = [(radius(z0), z0), (radius(z0) + out, z0), (radius(z1) + out, z1), (radius(z1), z1)]
        parts.append(lathe(profile, band, sides=20, closed=True))
    return make_item(draw, parts)


def drill(draw: Draw) -> Item:
    """A cordless drill: the hand at the origin around the grip, the chuck towards +x, the battery below."""
    maker, dark = draw.plastic(draw.one_of(*_MAKERS)), draw.plastic("26282b")
    steel = draw.steel()
    top, low = draw.between(0.075, 0.09), -draw.between(0.075, 0.09)
    radius, rear, front = draw.between(0.028, 0.034), -draw.between(0.05, 0.07), draw.between(0.07, 0.09)
    lean = draw.between(-0.015, 0.01)
    grip = np.array([(-0.03, top), (0.024, top), (0.017, 0.02), (lean + 0.02, low), (lean - 0.024, low), (-0.024, 0.0)])
    thick = 0.036
    handle = prism(grip, thick, dark if draw.chance(0.6) else maker)
    parts = [handle.moved(place((0, thick / 2, 0), (np.pi / 2, 0, 0)))]
    body = [(radius * 0.7, rear), (radius, rear + 0.015), (radius, front - 0.025), (radius * 0.85, front)]
    chuck = [(0.022, front), (0.024, front + 0.02), (0.021, front + 0.035), (0.009, front + 0.055)]
    along = place((0, 0, top), (0, np.pi / 2, 0))
    collar = [(radius * 0.75, rear - 0.006), (radius * 0.9, rear - 0.004), (radius * 1.02, rear + 0.02)]
    parts += [lathe(body, maker).moved(along), lathe(chuck, dark).moved(along), lathe(collar, dark).moved(along)]
    bit = draw.between(0.05, 0.11)
    parts.append(cylinder((front + 0.05, 0, top), (front + 0.05 + bit, 0, top), 0.004, steel, sides=6))
    battery = (draw.between(0.09, 0.12), draw.between(0.06, 0.075), draw.between(0.04, 0.06))
    parts.append(
        box((battery[0] + 0.008, battery[1] + 0.004, 0.018), maker, centre_m=(lean + 0.012, 0, low), bevel_m=0.004)
    )
    parts.append(box(battery, dark, centre_m=(lean + 0.012, 0, low - battery[2] / 2 - 0.004), bevel_m=0.008))
    parts.append(box((0.012, 0.014, 0.03), dark, centre_m=(0.024, 0, top - radius - 0.012), bevel_m=0.003))
    if draw.chance(0.4):
        parts.append(lathe([(radius + 0.002, 0.03), (radius + 0.002, 0.045)], dark).moved(along))
    return make_item(draw, parts, grips_m=[(0.0, 0.0, 0.0)])


def saw_horse(draw: Draw) -> Item:
    """A bar along y on two pairs of splayed legs, each with its crosspiece; some carry a board."""
    height, length = draw.between(0.65, 0.85), draw.between(0.7, 1.1)
    kind = draw.one_of("wood", "wood", "steel", "plastic")
    hue = draw.one_of("f0b41e", "e8641a", "26282b", "1f5fb4")
    material = draw.timber() if kind == "wood" else draw.paint(hue) if kind == "steel" else draw.plastic(hue)
    bar, leg = (0.09, 0.05, 0.075) if kind == "wood" else (0.07, 0.04, 0.045), draw.between(0.18, 0.26)
    y_head, y_foot = length / 2 - draw.between(0.08, 0.15), length / 2 - draw.between(-0.02, 0.06)
    thick = bar[1] if kind != "plastic" else 0.06
    parts = [box((bar[0], length, bar[2]), material, centre_m=(0, 0, height - bar[2] / 2), bevel_m=0.004)]

    def on_leg(z: float) -> tuple[float, float, float]:
        share = z / height
        return leg + (0.03 - leg) * share, y_foot + (y_head - y_foot) * share, z

    for sign in (1, -1):
        for (x0, y0, z0), (x1, y1, z1) in zip(mirrored(on_leg(0.006)), mirrored(on_leg(height - 0.02)), strict=True):
            parts.append(beam((sign * x0, y0, z0), (sign * x1, y1, z1), thick, thick * 0.6, material, up=(1, 0, 0)))
        if kind != "wood":
            parts += [
                box((0.06, 0.07, 0.03), draw.rubber(), centre_m=(sign * leg, y, 0.015)) for y in (-y_foot, y_foot)
            ]
    x, y, z = on_leg(height * draw.between(0.3, 0.5))
    parts += [beam((-x, side, z), (x, side, z), 0.025, 0.06, material) for side in (-y, y)]
    if draw.chance(0.3):
        board, overhang = draw.timber(), draw.between(1.2, 1.5)
        centre = (draw.between(-0.02, 0.02), draw.between(-0.1, 0.1), height + 0.015)
        parts.append(box((0.16, length * overhang, 0.03), board, centre_m=centre))
    return make_item(draw, parts)


def wheelbarrow(draw: Draw) -> Item:
    """A tray on two long handles, the wheel at the front, two legs behind; some are loaded."""
    hue = draw.one_of("2f7f4a", "c8281e", "1f5fb4", "26282b", "e8841a", "zinc")
    tray = draw.aluminium() if hue == "zinc" else draw.paint(hue)
    pipe = draw.timber() if draw.chance(0.3) else draw.paint(draw.one_of("26282b", "55595e", "c8281e"))
    radius, wide = draw.between(0.17, 0.2), draw.between(0.6, 0.7)
    long, deep, floor = draw.between(0.8, 0.95), draw.between(0.2, 0.28), 2 * radius - draw.between(0.0, 0.06)
    parts = [_tray(long, wide, deep, floor, tray)]
    axle, back = long / 2 + 0.12, -long / 2 - draw.between(0.4, 0.5)
    under, grip = floor - 0.03, draw.rubber()
    for side in (-1, 1):
        path = [(axle, side * 0.06, radius), (0.25 * long, side * 0.14, under), (-0.35 * long, side * 0.24, under)]
        end = np.array([back, side * 0.3, floor + deep * 0.75])
        parts.append(tube(rounded(np.array([*path, end]), 0.15), 0.019, pipe))
        parts.append(cylinder(end + (0.13, -side * 0.01, -0.025), end, 0.023, grip))
        leg = [(0.02, side * 0.19, under), (-0.2 * long, side * 0.23, 0.02), (-0.38 * long, side * 0.24, under)]
        parts.append(tube(rounded(leg, 0.06), 0.016, pipe))
    parts += _wheel(draw, radius, axle, draw.rubber())
    if draw.chance(0.4):
        parts.append(_load(draw, long, wide, floor + deep * 0.75))
    handles = [(back + 0.05, side * 0.295, floor + deep * 0.72) for side in (1, -1)]
    return make_item(draw, parts, grips_m=handles)


def _tray(long: float, wide: float, deep: float, floor: float, material: Material) -> Mesh:
    """A basin of sheet, longer and wider at its rim, its front flatter than its back."""
    rim, bed = rectangle(long, wide, 0.1), rectangle(long * 0.55, wide * 0.7, 0.07)
    levels = [(bed, -0.06, 0.0), (rim, 0.0, deep), (rim * 1.03, 0.0, deep), (rim * 1.03, 0.0, deep + 0.012)]
    levels += [(rim * 0.98, 0.0, deep + 0.012), (bed * 0.97, -0.06, 0.01)]
    rings = [np.column_stack([outline, np.full(len(outline), floor + z)]) + (x, 0, 0) for outline, x, z in levels]
    return loft(rings, material)


def _wheel(draw: Draw, radius: float, x: float, tyre: Material) -> list[Mesh]:
    """Tyre and hub on their axle."""
    half = draw.between(0.035, 0.045)
    profile = [(radius * 0.55, -half * 0.8), (radius * 0.85, -half), (radius, -half * 0.5), (radius, half * 0.5)]
    profile += [(radius * 0.85, half), (radius * 0.55, half * 0.8)]
    hub = draw.paint(draw.one_of("f0c020", "c8281e", "d8d8d4", "1f5fb4"))
    upright = place((x, 0, radius), (np.pi / 2, 0, 0))
    return [
        lathe(profile, tyre, sides=20, closed=True).moved(upright),
        lathe([(radius * 0.56, -half * 0.5), (radius * 0.56, half * 0.5)], hub).moved(upright),
        cylinder((x, -0.08, radius), (x, 0.08, radius), 0.012, draw.steel()),
    ]


def _load(draw: Draw, long: float, wide: float, z: float) -> Mesh:
    """A heap of sand, soil or mortar."""
    heap = draw.plain(draw.one_of("b49a6a", "5a4632", "8e8c86"), 0.95)
    outline = rectangle(long * 0.8, wide * 0.85, 0.09)
    rise = draw.between(0.06, 0.14)
    levels = [(0.8, -0.05), (1.0, 0.0), (0.7, rise * 0.6), (0.3, rise)]
    rings = [np.column_stack([outline * s, np.full(len(outline), z + dz)]) for s, dz in levels]
    return loft(rings, heap)
