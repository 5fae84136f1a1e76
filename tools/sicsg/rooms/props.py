"""Meshes of props: what lies, stands and hangs about on a site and belongs to no category.

A prop's origin lies on the floor below its middle; its back (-x) goes against a wall, +x looks into the room. What
hangs has its origin where it is fastened.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np

from tools.sicsg.mesh import Material, Mesh, build, join
from tools.sicsg.rooms.finish import Finish
from tools.sicsg.rooms.hanging import BETWEEN_WALLS, ON_WALL, hanging_cable
from tools.sicsg.rooms.stacks import STACKS
from tools.sicsg.shapes import box, cylinder, lathe, place, tube

Size = tuple[float, float, float]


def prop_mesh(kind: str, variant: str, room_size_m: Size) -> Mesh:
    """The mesh of a prop, the same object for the same prop; what reaches from wall to wall fits the room's size.

    Raises:
        ValueError: for an unknown kind.
    """
    if kind in _FITTED:
        return _fitted(kind, variant, room_size_m)
    if kind not in _FREE:
        raise ValueError(f"prop {kind!r}, variant {variant}: unknown kind; one of {', '.join(KINDS)}")
    return _free(kind, variant)


@lru_cache(maxsize=1024)
def _free(kind: str, variant: str) -> Mesh:
    return _FREE[kind](Finish.of(f"variant/{kind}", variant))


@lru_cache(maxsize=256)
def _fitted(kind: str, variant: str, room_size_m: Size) -> Mesh:
    return _FITTED[kind](Finish.of(f"variant/{kind}", variant), room_size_m)


def _pillar(finish: Finish, room_size_m: Size) -> Mesh:
    height, wide = room_size_m[2], float(finish.rng.uniform(0.2, 0.5))
    material = finish.material(("concrete", "brick", "rust", "metal")[int(finish.rng.integers(4))], finish.grey(0.6, 1))
    if finish.rng.random() < 0.3:
        shaft = cylinder((0, 0, 0), (0, 0, height), wide / 2, material, sides=20)
    else:
        shaft = box((wide, wide * float(finish.rng.uniform(0.7, 1.2)), height), material, centre_m=(0, 0, height / 2))
    if finish.rng.random() < 0.4:  # a painted foot
        return join([shaft, cylinder((0, 0, 0), (0, 0, 1.0), wide * 0.75, Material(finish.paint(), 0.5), sides=4)])
    return shaft


def _cable_reel(finish: Finish) -> Mesh:
    rng, wood = finish.rng, finish.material("wood", finish.grey(0.7, 1.0))
    radius, half = float(rng.uniform(0.25, 0.55)), float(rng.uniform(0.15, 0.35))
    cable = Material(finish.paint(), 0.5)
    drum = [cylinder((0, -half, radius), (0, half, radius), radius * 0.7, cable, sides=20)]
    for y in (-half - 0.04, half):
        drum.append(cylinder((0, y, radius), (0, y + 0.04, radius), radius, wood, sides=24))
    return join(drum)


def _radiator(finish: Finish) -> Mesh:
    rng, enamel = finish.rng, Material((0.82, 0.82, 0.8), 0.35)
    width, height = float(rng.uniform(0.6, 1.8)), float(rng.uniform(0.4, 0.7))
    ribs = np.arange(-width / 2, width / 2, 0.06)
    rib = box((0.05, 0.045, height), enamel, centre_m=(0.05, 0, 0.12 + height / 2), bevel_m=0.008)
    pieces = [rib.moved(place((0, y, 0))) for y in ribs]
    pieces += [tube([(0.05, -width / 2, z), (0.05, width / 2, z)], 0.02, enamel) for z in (0.16, 0.08 + height)]
    return join(pieces)


def _debris(finish: Finish) -> Mesh:
    """A heap of offcuts and rubble."""
    rng = finish.rng
    kinds = [
        finish.material(kind, finish.grey(0.6, 1.0)) for kind in ("concrete", "wood", "brick", "drywall", "plastic")
    ]
    radius = float(rng.uniform(0.3, 0.6))
    pieces = []
    for _piece in range(int(rng.integers(18, 40))):
        at = np.clip(rng.normal(0, radius / 2, 2), -radius, radius)
        size = rng.uniform(0.03, 0.1, 3) * (rng.choice([1, 1, 4]), 1, 0.8)
        lift = 0.35 * radius * np.exp(-2 * (at @ at) / radius**2) + size[2] / 2
        turned = place((*at, lift), rng.normal(0, 0.4, 3) + (0, 0, rng.uniform(0, 3)))
        pieces.append(box(size, kinds[int(rng.integers(len(kinds)))]).moved(turned))
    return _on_floor(join(pieces))


def _tarpaulin(finish: Finish) -> Mesh:
    """A sheet thrown over something."""
    rng, cells = finish.rng, 18
    length, depth, height = rng.uniform(1.0, 2.4), rng.uniform(0.7, 1.1), rng.uniform(0.3, 1.1)
    x, y = np.meshgrid(np.linspace(-1, 1, cells), np.linspace(-1, 1, cells), indexing="ij")
    body = np.clip(1.25 - np.maximum(np.abs(x), np.abs(y)) ** 4 * 1.25, 0, 1)
    folds = 0.06 * np.sin(rng.uniform(4, 9) * np.arctan2(y, x) + rng.uniform(0, 6)) * np.hypot(x, y)
    z = height * body * (1 + 0.12 * np.sin(2.2 * x + rng.uniform(0, 6)) * np.cos(2.7 * y)) + np.abs(folds) * body
    vertices = np.stack([x * depth / 2, y * length / 2, np.maximum(z, 0.005)], axis=-1).reshape(-1, 3)
    at = np.arange(cells * cells).reshape(cells, cells)
    a, b, c, d = (part.ravel() for part in (at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return build(vertices, faces, finish.material("fabric", finish.paint()), smooth=True)


def _barrel(finish: Finish) -> Mesh:
    radius, height = float(finish.rng.uniform(0.22, 0.3)), float(finish.rng.uniform(0.6, 0.9))
    profile = [(radius, 0.0)]
    for z in (0.33, 0.66):
        profile += [(radius, height * z - 0.03), (radius + 0.012, height * z), (radius, height * z + 0.03)]
    profile += [(radius, height), (radius - 0.02, height), (radius - 0.02, height - 0.02)]
    return lathe(profile, finish.material(("metal", "plastic", "rust")[int(finish.rng.integers(3))], finish.paint()))


def _gas_bottle(finish: Finish) -> Mesh:
    radius, height = float(finish.rng.uniform(0.11, 0.17)), float(finish.rng.uniform(0.5, 1.3))
    paint, brass = Material(finish.paint(), 0.35), Material((0.5, 0.38, 0.15), 0.35, 0.8)
    shoulder = [(radius * np.cos(a), height + radius * np.sin(a)) for a in np.linspace(0, 1.4, 5)]
    bottle = lathe([(radius * 0.95, 0), (radius, 0.03), *shoulder], paint)
    valve = cylinder((0, 0, height + radius), (0, 0, height + radius + 0.09), 0.03, brass)
    return join([bottle, valve])


def _rubbish_bags(finish: Finish) -> Mesh:
    """Full sacks, tied at the top, each slumped in its own way."""
    rng = finish.rng
    colour = ((0.03, 0.03, 0.035), (0.05, 0.12, 0.4), (0.6, 0.6, 0.58), (0.3, 0.26, 0.2))[int(rng.integers(4))]
    skin, pieces = finish.material("plastic", colour), []
    outline = np.array(
        [(0.7, 0), (0.95, 0.08), (1, 0.3), (0.85, 0.58), (0.45, 0.8), (0.12, 0.87), (0.1, 0.9), (0.3, 1)]
    )
    for y in np.arange(int(rng.integers(1, 5))) * 0.42 - 0.4:
        sack = lathe(outline * rng.uniform((0.2, 0.5), (0.28, 0.75)), skin, sides=18)
        x_y, z = sack.vertices_m[:, :2], sack.vertices_m[:, 2:]
        around = np.arctan2(x_y[:, 1:], x_y[:, :1])
        creases = 1 + 0.1 * np.sin(rng.integers(3, 7) * around + 9 * z) + 0.08 * np.sin(2 * around + rng.uniform(0, 6))
        slumped = replace(sack, vertices_m=np.hstack([x_y * creases, z]).astype(np.float32))
        pieces.append(slumped.moved(place((rng.uniform(-0.1, 0.1), y, 0), rng.normal(0, 0.1, 3))))
    return _on_floor(join(pieces))


def _site_cabinet(finish: Finish) -> Mesh:
    """A distribution board with sockets on a stand."""
    rng, case = finish.rng, Material(finish.paint(), 0.4)
    width, height, foot = float(rng.uniform(0.4, 0.8)), float(rng.uniform(0.5, 0.9)), float(rng.uniform(0.2, 0.6))
    steel = finish.material("metal", (0.6, 0.6, 0.6))
    pieces = [box((0.25, width, height), case, centre_m=(0, 0, foot + height / 2), bevel_m=0.01)]
    pieces += [box((0.3, 0.04, foot), steel, centre_m=(0, y, foot / 2)) for y in (-width / 2 + 0.03, width / 2 - 0.03)]
    for place_y in np.arange(-width / 2 + 0.1, width / 2 - 0.05, 0.13):
        socket = Material(((0.6, 0.04, 0.03), (0.05, 0.1, 0.5))[int(rng.integers(2))], 0.5)
        pieces.append(cylinder((0.12, place_y, foot + 0.15), (0.19, place_y, foot + 0.13), 0.045, socket, sides=10))
    return join(pieces)


def _floor_sheet(finish: Finish) -> Mesh:
    """Something flat that protects the floor."""
    kind = ("cardboard", "plywood", "fabric", "drywall")[int(finish.rng.integers(4))]
    size = (float(finish.rng.uniform(0.6, 1.3)), float(finish.rng.uniform(1.0, 2.4)), 0.006)
    return box(size, finish.material(kind, finish.grey(0.5, 1.0)), centre_m=(0, 0, 0.003))


def _on_floor(mesh: Mesh) -> Mesh:
    """Lowered or lifted until it touches the floor."""
    return mesh.moved(place((0, 0, -float(mesh.vertices_m[:, 2].min()))))


FLAT = ("floor_sheet",)
"""What lies so flat that one walks over it."""
STANDING = {
    "cable_reel": _cable_reel, "debris": _debris, "tarpaulin": _tarpaulin, "barrel": _barrel, "gas_bottle": _gas_bottle,
    "rubbish_bags": _rubbish_bags, "site_cabinet": _site_cabinet, **STACKS,
}  # fmt: skip
_FREE: dict[str, Callable[[Finish], Mesh]] = {
    **STANDING, **ON_WALL, "radiator": _radiator, "floor_sheet": _floor_sheet, "hanging_cable": hanging_cable,
}  # fmt: skip
_FITTED: dict[str, Callable[[Finish, Size], Mesh]] = {**BETWEEN_WALLS, "pillar": _pillar}
KINDS = (*_FREE, *_FITTED)
"""Every kind of prop."""
