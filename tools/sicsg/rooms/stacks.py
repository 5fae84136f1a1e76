"""Props that are stored material: boards, sheets, pallets, bags, boxes, rolls, pipes, blocks, a shelf."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tools.sicsg.mesh import Material, Mesh, join
from tools.sicsg.rooms.finish import Finish
from tools.sicsg.shapes import box, cylinder, place, ring

_DECK_M = 0.144
"""Height of a pallet."""


def _pallet(finish: Finish) -> Mesh:
    """A pallet of 0.8 x 1.2 m."""
    wood = finish.material("wood", finish.grey(0.6, 1.0))
    pieces = [box((0.1, 1.2, 0.1), wood, centre_m=(x, 0, 0.072)) for x in (-0.35, 0, 0.35)]
    pieces += [box((0.8, 0.12, 0.022), wood, centre_m=(0, y, 0.133)) for y in np.linspace(-0.54, 0.54, 7)]
    return join(pieces + [box((0.8, 0.1, 0.022), wood, centre_m=(0, y, 0.011)) for y in (-0.55, 0, 0.55)])


def _pallets(finish: Finish) -> Mesh:
    count = int(finish.rng.integers(1, 7))
    turns = finish.rng.normal(0, 0.03, count)
    one = _pallet(finish)
    return join([one.moved(place((0, 0, i * _DECK_M), (0, 0, turn))) for i, turn in enumerate(turns)])


def _lumber(finish: Finish) -> Mesh:
    """Planks in layers on two battens."""
    rng, wood = finish.rng, finish.material("wood", finish.grey(0.75, 1.0))
    length, wide, thick = float(rng.uniform(1.8, 3.6)), float(rng.uniform(0.08, 0.2)), float(rng.uniform(0.025, 0.1))
    across, layers = int(rng.integers(2, 6)), int(rng.integers(1, 7))
    pieces = [box((across * wide, 0.08, 0.06), wood, centre_m=(0, s * length * 0.35, 0.03)) for s in (-1, 1)]
    for layer in range(layers):
        for column in range(across):
            centre = ((column - (across - 1) / 2) * wide, rng.normal(0, 0.04), 0.06 + (layer + 0.5) * thick)
            pieces.append(box((wide * 0.96, length * rng.uniform(0.9, 1.0), thick * 0.94), wood, centre_m=centre))
    return join(pieces)


def _sheets(finish: Finish) -> Mesh:
    """Boards lying on each other."""
    rng, kind = finish.rng, ("drywall", "plywood", "osb", "insulation")[int(finish.rng.integers(4))]
    board = finish.material(kind, finish.grey(0.8, 1.0))
    thick, wood = (0.08 if kind == "insulation" else 0.022), finish.material("wood")
    depth, length = float(rng.choice([0.6, 1.0])), float(rng.uniform(1.8, 2.5))
    pieces = [box((depth, 0.09, 0.08), wood, centre_m=(0, y * length, 0.04)) for y in (-0.4, 0, 0.4)]
    for layer in range(int(rng.integers(3, 14))):
        centre = (*rng.normal(0, 0.008, 2), 0.08 + (layer + 0.5) * thick)
        pieces.append(box((depth, length, thick * 0.93), board, centre_m=centre))
    return join(pieces)


def _leaning(finish: Finish) -> Mesh:
    """Boards, doors or bars that lean at the wall."""
    rng, kind = finish.rng, ("drywall", "plywood", "osb", "wood", "metal")[int(finish.rng.integers(5))]
    height, tilt = float(rng.uniform(1.4, 2.5)), float(rng.uniform(0.1, 0.22))
    width = float(rng.uniform(0.06, 0.12) if kind == "metal" else rng.uniform(0.5, 1.25))
    board, pieces, thick = finish.material(kind, finish.grey(0.7, 1.0)), [], 0.018
    for index in range(int(rng.integers(2, 7))):
        part = box((thick, width, height * rng.uniform(0.9, 1.0)), board, centre_m=(0, 0, 0))
        part = part.moved(place((0, 0, -float(part.vertices_m[:, 2].min()))))
        foot = (height * np.sin(tilt) + index * thick * 1.15, rng.normal(0, 0.06), 0.0)
        pieces.append(part.moved(place(foot, (0, -tilt, 0))))
    whole = join(pieces)
    low, high = whole.vertices_m.min(axis=0), whole.vertices_m.max(axis=0)
    return whole.moved(place((-(low[0] + high[0]) / 2, 0, -low[2])))


def _bag(material: Material) -> Mesh:
    """A full paper bag of 0.4 x 0.6 x 0.12 m."""
    return box((0.4, 0.6, 0.12), material, centre_m=(0, 0, 0.06), bevel_m=0.04)


def _cement_bags(finish: Finish) -> Mesh:
    rng, colour = finish.rng, finish.paint() if finish.rng.random() < 0.3 else finish.grey(0.5, 1.0)
    bag = _bag(finish.material(("cardboard", "plastic", "fabric")[int(rng.integers(3))], colour))
    pieces = [_pallet(finish)]
    for layer in range(int(rng.integers(1, 6))):
        for x in (-0.2, 0.2):
            for y in (-0.3, 0.3):
                if layer == 0 or rng.random() < 0.9:
                    at = (x + rng.normal(0, 0.01), y + rng.normal(0, 0.015), _DECK_M + layer * 0.115)
                    pieces.append(bag.moved(place(at, (0, 0, rng.normal(0, 0.05)))))
    return join(pieces)


def _cardboard_boxes(finish: Finish) -> Mesh:
    rng, y, pieces = finish.rng, -0.7, []
    while y < 0.7:
        material = finish.material("cardboard", finish.grey(0.7, 1.0))
        depth, width, z = float(rng.uniform(0.3, 0.6)), float(rng.uniform(0.3, 0.6)), 0.0
        for _level in range(int(rng.integers(1, 4))):
            height = float(rng.uniform(0.2, 0.5))
            part = box((depth, width, height), material, centre_m=(0, 0, height / 2))
            pieces.append(part.moved(place((0, y + width / 2, z), (0, 0, rng.normal(0, 0.08)))))
            z, depth, width = z + height, depth * 0.92, width * 0.92
        y += width + float(rng.uniform(0.08, 0.5))
    return join(pieces)


def _insulation_rolls(finish: Finish) -> Mesh:
    rng, wool = finish.rng, finish.material("insulation")
    radius, length = float(rng.uniform(0.2, 0.3)), float(rng.uniform(0.6, 1.2))
    band, pieces = Material(finish.paint(), 0.4), []
    count = int(rng.integers(1, 4))
    for index in range(count):  # standing side by side
        y = (index - (count - 1) / 2) * radius * 2.1
        pieces.append(cylinder((0, y, 0), (0, y, length), radius, wool, sides=20))
        pieces.append(cylinder((0, y, length * 0.3), (0, y, length * 0.45), radius * 1.01, band, sides=20))
        pieces.append(ring(radius * 0.5, 0.012, band, sides=16, section_sides=4).moved(place((0, y, length))))
    return join(pieces)


def _pipes(finish: Finish) -> Mesh:
    """Pipes or bars lying beside each other."""
    rng, radius = finish.rng, float(finish.rng.choice([0.015, 0.03, 0.055]))
    colour = ((0.5, 0.5, 0.52), (0.7, 0.32, 0.12), (0.85, 0.45, 0.1), (0.75, 0.75, 0.72))[int(rng.integers(4))]
    material = finish.material(("plastic", "metal", "rust")[int(rng.integers(3))], colour)
    length, across = float(rng.uniform(1.5, 3.5)), int(rng.integers(3, 8))
    one, pieces = cylinder((0, -length / 2, 0), (0, length / 2, 0), radius, material, sides=10), []
    for layer in range(int(rng.integers(1, 4))):
        for column in range(max(across - layer, 1)):
            x, z = (column - (across - layer - 1) / 2) * 2 * radius, radius * (1 + 1.74 * layer)
            pieces.append(one.moved(place((x, rng.normal(0, 0.06), z))))
    return join(pieces)


def _blocks(finish: Finish) -> Mesh:
    """Masonry blocks on a pallet."""
    rng, pieces = finish.rng, [_pallet(finish)]
    material = finish.material(("concrete", "plaster", "brick")[int(rng.integers(3))], finish.grey(0.6, 1.0))
    one, levels = box((0.39, 0.28, 0.195), material), int(rng.integers(1, 5))
    for level in range(levels):
        for x in (-0.2, 0.2):
            for y in np.linspace(-0.45, 0.45, 4):
                if level < levels - 1 or rng.random() < 0.7:
                    pieces.append(one.moved(place((x + rng.normal(0, 0.006), y, _DECK_M + 0.1 + 0.2 * level))))
    return join(pieces)


def _shelf(finish: Finish) -> Mesh:
    """A rack with boxes, cans and sacks."""
    rng, steel = finish.rng, Material(finish.paint(), 0.4, 0.3)
    width, depth, height = float(rng.uniform(0.9, 1.8)), 0.45, float(rng.uniform(1.4, 2.1))
    pieces = [box((0.04, 0.04, height), steel, centre_m=(x, y, height / 2))
              for x in (-depth / 2, depth / 2) for y in (-width / 2, width / 2)]  # fmt: skip
    for z in np.linspace(0.15, height - 0.05, int(rng.integers(3, 5))):
        pieces.append(box((depth, width, 0.025), finish.material("plywood"), centre_m=(0, 0, z)))
        y = -width / 2 + 0.15
        while y < width / 2 - 0.15:
            wide, tall = float(rng.uniform(0.12, 0.3)), float(rng.uniform(0.1, 0.32))
            if rng.random() < 0.6:
                cover = finish.material("cardboard") if rng.random() < 0.5 else Material(finish.paint(), 0.5)
                pieces.append(box((0.28, wide, tall), cover, centre_m=(0, y, z + 0.0125 + tall / 2)))
            else:
                base, can = (0.0, y, z + 0.0125), Material(finish.paint(), 0.4)
                pieces.append(cylinder(base, (0.0, y, z + tall * 0.8), wide * 0.4, can))
            y += wide + float(rng.uniform(0.03, 0.2))
    return join(pieces)


STACKS: dict[str, Callable[[Finish], Mesh]] = {
    "pallets": _pallets, "lumber": _lumber, "sheets": _sheets, "leaning_boards": _leaning,
    "cement_bags": _cement_bags, "cardboard_boxes": _cardboard_boxes, "insulation_rolls": _insulation_rolls,
    "pipes": _pipes, "blocks": _blocks, "shelf": _shelf,
}  # fmt: skip
