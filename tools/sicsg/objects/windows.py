"""Windows as they are delivered: a frame with its pane, to be carried, stored and built in."""

from __future__ import annotations

import numpy as np

from tools.sicsg.catalog_types import Item
from tools.sicsg.mesh import Material, Mesh
from tools.sicsg.objects.kit import Draw, make_item
from tools.sicsg.shapes import beam, box, frame, place

_PANE_M = 0.024
"""Thickness of a double pane."""


def large_window(draw: Draw) -> Item:
    """A window that two people carry."""
    width, height = draw.between(1.2, 1.7), draw.between(1.3, 1.9)
    return _window(draw, width, height, border=draw.between(0.06, 0.09), depth=draw.between(0.06, 0.09))


def small_window(draw: Draw) -> Item:
    """A window that one person carries."""
    width, height = draw.between(0.4, 0.7), draw.between(0.4, 0.7)
    return _window(draw, width, height, border=draw.between(0.04, 0.06), depth=draw.between(0.05, 0.07))


def _window(draw: Draw, width: float, height: float, border: float, depth: float) -> Item:
    """The frame is mitred about the origin of the y-z plane and then lifted to stand on its lower edge."""
    profile = _profile(draw)
    inner = (width - 2 * border, height - 2 * border)
    parts = [frame((width, height), border, depth, profile)]
    parts += _sash(draw, inner, depth, profile) if draw.chance(0.5) else []
    parts += _mullion(draw, inner, depth, profile)
    parts.append(box((_PANE_M, inner[0] + 0.01, inner[1] + 0.01), _glass(draw)))
    parts += _on_the_pane(draw, inner)
    if draw.chance(0.35):
        parts += _corner_protectors(draw, width, height, depth)
    lift = place((0.0, 0.0, height / 2))
    half = width / 2
    return make_item(
        draw,
        [part.moved(lift) for part in parts],
        keypoints_m=[(0, -half, height), (0, half, height), (0, half, 0), (0, -half, 0)],
        grips_m=[(0, side * half, share * height) for side in (1, -1) for share in (0.3, 0.7)],
    )


def _profile(draw: Draw) -> Material:
    kind = draw.one_of("white", "white", "grey", "black", "wood", "brown")
    if kind == "wood":
        return draw.timber()
    return draw.plastic({"white": "e9e9e6", "grey": "6d7378", "black": "2a2c2f", "brown": "5a4030"}[kind])


def _glass(draw: Draw) -> Material:
    tint = draw.one_of("f4fbf8", "eaf5f0", "e6eff5")
    return Material(draw.colour(tint, 0.04), roughness=0.03, transmission=draw.between(0.86, 0.97))


def _sash(draw: Draw, inner: tuple[float, float], depth: float, profile: Material) -> list[Mesh]:
    """An opening wing inside the frame, with its handle on one side."""
    border = draw.between(0.03, 0.05)
    metal = draw.aluminium()
    y = float(draw.rng.choice([-1, 1])) * (inner[0] - border) / 2
    front = depth / 2 + 0.008
    wing = frame(inner, border, depth * 0.8, profile).moved(place((0.008, 0.0, 0.0)))
    return [
        wing,
        box((0.02, 0.025, 0.07), metal, centre_m=(front - 0.006, y, 0.0)),
        beam((front + 0.012, y, 0.0), (front + 0.012, y, -0.12), 0.02, 0.014, metal, up=(1.0, 0.0, 0.0)),
    ]


def _mullion(draw: Draw, inner: tuple[float, float], depth: float, profile: Material) -> list[Mesh]:
    """A post or a rail across the opening, both, or none."""
    kind = draw.one_of("none", "none", "post", "rail", "cross")
    broad = draw.between(0.035, 0.06)
    off = draw.between(-0.15, 0.15)
    y, z = inner[0] / 2, inner[1] / 2
    parts = []
    if kind in ("post", "cross"):
        parts.append(beam((0, 0, -z), (0, 0, z), broad, depth * 0.75, profile, up=(1, 0, 0)))
    if kind in ("rail", "cross"):
        parts.append(beam((0, -y, 2 * off * z), (0, y, 2 * off * z), broad, depth * 0.74, profile, up=(1, 0, 0)))
    return parts


def _on_the_pane(draw: Draw, inner: tuple[float, float]) -> list[Mesh]:
    """What a delivered pane carries: a maker's label, crossed tape, strips or a sheet of protective film."""
    x = _PANE_M / 2 + 0.001
    parts = []
    if draw.chance(0.6):
        y, z = (draw.between(0.25, 0.35) * inner[i] * (1 if draw.chance(0.5) else -1) for i in (0, 1))
        size = min(0.16, 0.3 * inner[0])
        label = draw.plain(draw.one_of("f5f5f2", "f2e94e", "d9e6f2"))
        parts.append(box((0.002, size, size * draw.between(0.6, 1.4)), label, centre_m=(x, y, z)))
    kind = draw.one_of("nothing", "nothing", "tape", "strips", "film")
    if kind == "tape":
        tape = draw.plain(draw.one_of("f0f0ea", "e8d44a", "c0392b", "3f7fd0"))
        corner = np.array([0.0, inner[0] / 2 * 0.97, inner[1] / 2 * 0.97])
        for lift, sign in ((0.0, 1.0), (0.001, -1.0)):
            end = corner * (1.0, sign, 1.0) + (x + lift, 0.0, 0.0)
            start = end * (1.0, -1.0, -1.0)
            parts.append(beam(start, end, 0.045, 0.001, tape, up=(1, 0, 0)))
    elif kind == "strips":
        tape = draw.plain(draw.one_of("4f8fd8", "e8e8e0", "3aa66a"))
        for z in np.linspace(-0.35, 0.35, 3) * inner[1]:
            parts.append(box((0.001, inner[0], 0.06), tape, centre_m=(x, 0.0, z)))
    elif kind == "film":
        film = Material(draw.colour("9cc4ee"), roughness=0.25, transmission=0.55)
        parts.append(box((0.001, inner[0] * 0.98, inner[1] * 0.98), film, centre_m=(x, 0.0, 0.0)))
    return parts


def _corner_protectors(draw: Draw, width: float, height: float, depth: float) -> list[Mesh]:
    """Foam or cardboard over the corners."""
    material = draw.plain(draw.one_of("c49a62", "2f6fc4", "e9e9e9"), 0.9)
    side, thick = draw.between(0.12, 0.18) * min(width, height, 0.8), 0.006
    parts = []
    for y in (-1, 1):
        for z in (-1, 1):
            centre = (0.0, y * (width - side) / 2, z * (height - side) / 2)
            size = (depth + 2 * thick, side + 2 * thick, side + 2 * thick)
            parts.append(box(size, material, centre_m=centre, bevel_m=0.004))
    return parts
