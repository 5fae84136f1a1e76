"""The pieces above the collar: skin, hair, beard, eyes, glasses."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.mesh import Material
from tools.sicsg.skeleton import rest_coco
from tools.sicsg.workers.body_shape import Figure
from tools.sicsg.workers.clothes import Clothes, Colour
from tools.sicsg.workers.fields import UP, Capsule, Ellipsoid, Loft, Shape, Solid, projected
from tools.sicsg.workers.pieces import Piece

Floats = NDArray[np.float64]
_HEAD_CELL = (0.0125, 0.0125, 0.0135)
_HAIR_CELL = (0.018, 0.018, 0.018)
_FINE_CELL = (0.008, 0.008, 0.006)
_EYES: Colour = (0.05, 0.035, 0.03)
_HAIR_M = {"short": 0.006, "full": 0.011, "tied": 0.007, "long": 0.010}
# Hairline: height above the joint of the head for places from the back of the head to the forehead, metres.
_HAIRLINE = np.array([(-0.10, 0.000), (-0.06, 0.005), (-0.02, 0.035), (0.012, 0.075), (0.045, 0.118), (0.10, 0.142)])
# Upper edge of a beard, likewise.
_BEARD_LINE = np.array([(-0.005, -0.06), (0.0, 0.050), (0.02, 0.035), (0.06, 0.012), (0.10, 0.012)])


def head_pieces(figure: Figure, clothes: Clothes) -> dict[str, Piece]:
    """Head and neck, and what is on them."""
    skin = Material(clothes.skin, roughness=0.55)
    hair = Material(clothes.hair_colour, roughness=0.6)
    neck_end = figure.joint("neck")[2] - 0.05 * figure.scale
    head = Solid((*figure.head.parts, (figure.neck, 0.02)), cuts=((-UP, -neck_end),))
    worn = ("top", "hair") if clothes.hair != "bald" else ("top",)
    pieces = {"head": Piece(head, skin, _HEAD_CELL, covers=worn)}
    if clothes.hair != "bald":
        pieces["hair"] = Piece(_hair(figure, _HAIR_M[clothes.hair]), hair, _HAIR_CELL, bone="head")
    if clothes.hair in ("tied", "long"):
        pieces["strands"] = Piece(_strands(figure, clothes.hair), hair, _HAIR_CELL, bone="head")
    if clothes.beard:
        pieces["beard"] = Piece(_beard(figure), hair, _HAIR_CELL, bone="head")
    return pieces | _features(figure, clothes)


def _bare(figure: Figure) -> tuple[tuple[Shape, float], ...]:
    """Skull and face without nose, brow and ears."""
    return figure.head.parts[:2]


def _edge(figure: Figure, line: Floats, thickness_m: float, sign: float) -> Callable[[Floats], Floats]:
    """A relief that stands out by the thickness above (sign 1) or below (-1) a line and sinks in beyond it."""
    origin, scale = figure.joint("head"), figure.scale

    def relief(points: Floats) -> Floats:
        local = (points - origin) / scale
        return np.clip(sign * (local[:, 2] - np.interp(local[:, 0], line[:, 0], line[:, 1])), -0.02, thickness_m)

    return relief


def _hair(figure: Figure, thickness_m: float) -> Solid:
    return Solid(_bare(figure), relief=_edge(figure, _HAIRLINE, thickness_m, 1.0))


def _beard(figure: Figure) -> Solid:
    return Solid(_bare(figure), relief=_edge(figure, _BEARD_LINE, 0.006, -1.0))


def _strands(figure: Figure, kind: str) -> Solid:
    """A bun in the neck, or hair down to the shoulders."""
    at, scale = figure.joint("head"), figure.scale
    if kind == "tied":
        return Solid(
            ((Ellipsoid(at + scale * np.array([-0.112, 0, 0.045]), scale * np.array([0.034, 0.036, 0.034])), 0.0),)
        )
    knots = scale * np.array([
        (-0.13, 0.012, 0.030, 0.070), (-0.08, 0.014, 0.034, 0.082), (0.0, 0.020, 0.046, 0.086),
        (0.06, 0.030, 0.058, 0.084), (0.11, 0.035, 0.055, 0.072),
    ])  # fmt: skip
    return Solid(((Loft(at + scale * np.array([-0.055, 0, 0]), UP, np.array([1.0, 0, 0]), knots, power=2.4), 0.0),))


def _on_face(figure: Figure, eye: Floats, side: float, forward_m: float, out_m: float, up_m: float) -> Floats:
    """(3,) a place on the skin, from an eye: outwards on its side, up, and ``forward_m`` out of the surface."""
    scale = figure.scale
    place = (eye + scale * np.array([0.0, side * out_m, up_m]))[None]
    grown = Solid(((figure.head, 0.0),), forward_m)
    for _ in range(4):
        place = projected(grown, place, 0.02)
    return np.asarray(place[0])


def _features(figure: Figure, clothes: Clothes) -> dict[str, Piece]:
    """Eyes, brows, lips, glasses: small, but seen from a few metres."""
    scale, coco = figure.scale, rest_coco(figure.body)
    eyes, brows, mouth = [], [], []
    for eye, side in ((coco[1], 1.0), (coco[2], -1.0)):
        eyes.append(Ellipsoid(_on_face(figure, eye, side, -0.005, 0.0, 0.0), scale * np.array([0.010, 0.016, 0.0085])))
        brow = [_on_face(figure, eye, side, 0.0, out_m, 0.019) for out_m in (-0.017, 0.002, 0.018)]
        brows += [Capsule(brow[i], brow[i + 1], 0.007 * scale, 0.006 * scale) for i in (0, 1)]
        lip = [_on_face(figure, eye, side, -0.002, out_m, -0.072) for out_m in (-0.030, -0.012)]
        mouth.append(Capsule(lip[0], lip[1], 0.0075 * scale, 0.0065 * scale))
    red, green, blue = clothes.skin
    parts: dict[str, tuple[tuple[Shape, ...], Colour]] = {
        "eyes": (tuple(eyes), _EYES),
        "brows": (tuple(brows), clothes.hair_colour),
        "lips": (tuple(mouth), (0.8 * red, 0.55 * green, 0.6 * blue)),
    }
    if clothes.glasses != "none":
        parts["glasses"] = _glasses(figure, dark=clothes.glasses == "dark")
    return {
        name: Piece(
            Solid(tuple((shape, 0.0) for shape in shapes)), Material(colour, roughness=0.4), _FINE_CELL, bone="head"
        )
        for name, (shapes, colour) in parts.items()
    }


def _glasses(figure: Figure, *, dark: bool) -> tuple[tuple[Shape, ...], Colour]:
    """Safety glasses: temples to the ears, a bar above the eyes and, when dark, lenses (clear ones are not seen)."""
    scale, coco = figure.scale, rest_coco(figure.body)
    shapes: list[Shape] = []
    for eye, ear, sign in ((coco[1], coco[3], 1.0), (coco[2], coco[4], -1.0)):
        corner = eye + scale * np.array([-0.006, 0.034 * sign, 0.010])
        middle = np.array([eye[0] + 0.012 * scale, 0.0, eye[2] + 0.012 * scale])
        temple = ear + scale * np.array([0.0, 0.004 * sign, 0.026])
        shapes += [
            Capsule(middle, corner, 0.0070 * scale, 0.0070 * scale),
            Capsule(corner, temple, 0.0068 * scale, 0.0060 * scale),
        ]
        if dark:
            shapes.append(
                Ellipsoid(
                    eye + scale * np.array([0.002, 0.002 * sign, -0.006]), scale * np.array([0.010, 0.029, 0.021])
                )
            )
    return tuple(shapes), (0.02, 0.02, 0.022)
