"""What a worker's mesh is sewn of: one closed solid per garment, over the parts of the body that stay bare."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.assets import asset_rng
from tools.sicsg.mesh import Material
from tools.sicsg.workers.body_shape import Figure
from tools.sicsg.workers.clothes import Clothes
from tools.sicsg.workers.cutting import Band
from tools.sicsg.workers.fields import FORWARD, UP, Ellipsoid, HalfSpace, Loft, Shape, Solid
from tools.sicsg.workers.heads import head_pieces
from tools.sicsg.workers.pieces import Piece

Floats = NDArray[np.float64]
Relief = Callable[[Floats], Floats]
LEFT = np.array([0.0, 1.0, 0.0])
_BODY_CELL = (0.027, 0.027, 0.036)
_BELT_CELL = (0.024, 0.024, 0.022)
_ARM_CELL = (0.015, 0.015, 0.020)
_HAND_CELL = (0.0135, 0.0135, 0.0135)
_BOOT_CELL = (0.022, 0.017, 0.020)
_TOP_GROWN_M = {"jacket": 0.021, "shirt": 0.014, "t_shirt": 0.012}
_TOP_HEM = {"jacket": -0.13, "shirt": -0.04, "t_shirt": -0.06}
"""Where the top's hem hangs: 0 at the hip joint, 1 at the shoulder joint."""
_SLEEVE = {"jacket": 1.96, "shirt": 1.92, "t_shirt": 0.62}
"""Where the sleeves end: 1 at the elbow, 2 at the wrist."""
_SPARE_M = 0.08
"""What a garment is made longer than its hem, where it is then cut off neatly: two cells and more."""
_VEST_HEM = 0.02
_VEST_OVER_M = 0.010
_STRIPE_M = 0.05
_FOLD_M = 0.0035
_DARK = Material((0.017, 0.022, 0.045), roughness=0.85)


def dressed(figure: Figure, clothes: Clothes, name: str) -> dict[str, Piece]:
    """All pieces by name; ``name`` is that of the clothes and fixes their folds."""
    folds = _folds(name)
    top = _top(figure, clothes, folds)
    over = _TOP_GROWN_M[clothes.top] + _VEST_OVER_M * (clothes.hi_vis == "vest")
    pieces = {"top": top}
    if clothes.hi_vis == "vest":
        pieces["vest"] = _vest(figure, clothes, top.solid, folds)
    if clothes.tool_belt:
        pieces["belt"] = _belt(figure, over)
    pieces["trousers"] = _trousers(figure, clothes, folds)
    return pieces | _feet(figure, clothes) | _arms(figure, clothes) | head_pieces(figure, clothes)


def _folds(name: str) -> Relief:
    """Shallow waves in four directions, as of cloth."""
    rng = asset_rng("clothes/folds", name)
    directions = rng.normal(size=(3, 4))
    waves = 2 * np.pi / rng.uniform(0.10, 0.24, 4) * directions / np.linalg.norm(directions, axis=0)
    phases = rng.uniform(0, 2 * np.pi, 4)
    return lambda points: _FOLD_M * 0.5 * np.asarray(np.sin(points @ waves + phases).sum(axis=1))


def _height(figure: Figure, place: float) -> float:
    """Height of a place on the torso: 0 at the hip joints, 1 at the shoulder joints."""
    hip, shoulder = figure.joint("left_thigh")[2], figure.joint("left_upper_arm")[2]
    return float(hip + place * (shoulder - hip))


def _along_arm(figure: Figure, side: int, place: float) -> float:
    """Distance along the arm's axis from the world's origin: place 0 shoulder, 1 elbow, 2 wrist."""
    name = ("left", "right")[side]
    joints = [figure.joint(f"{name}_{part}") for part in ("upper_arm", "forearm", "hand")]
    return float(np.interp(place, (0, 1, 2), [joint @ figure.arm_axis(side) for joint in joints]))


def _lower(figure: Figure) -> tuple[tuple[Shape, float], ...]:
    """Torso and legs as parts of a solid."""
    legs = Solid(((figure.legs[0], 0.0), (figure.legs[1], 0.008)))
    return ((figure.torso, 0.0), (legs, 0.04))


def _trunk(figure: Figure) -> tuple[tuple[Shape, float], ...]:
    """Legs, torso and shoulders as parts of a solid."""
    return (*_lower(figure), (figure.yokes[0], 0.05), (figure.yokes[1], 0.05))


def _sleeve(figure: Figure, side: int, place: float, spare_m: float) -> Solid:
    """An arm down to somewhat beyond the place."""
    end = _along_arm(figure, side, place) + spare_m
    return Solid(((figure.arms[side], 0.0),), cuts=((figure.arm_axis(side), end),))


def _hems(figure: Figure, clothes: Clothes, hem: float) -> tuple[tuple[Shape, Shape], ...]:
    """What is cut off the top: below its hem and beyond its cuffs."""
    arms = []
    for side, arm in enumerate(figure.arms):
        end = _along_arm(figure, side, _SLEEVE[clothes.top])
        arms.append(Solid(((arm, 0.0),), 0.06, ((-figure.arm_axis(side), -end),)))
    trunk = ((LEFT, 0.3 * figure.scale), (-LEFT, 0.3 * figure.scale))
    cuts = (*arms, Solid(((HalfSpace(-UP, -hem), 0.0),), cuts=trunk))
    bare = _bare(figure)
    return tuple((cut, bare) for cut in cuts)


def _bare(figure: Figure) -> Solid:
    """Body and hands, where the walls of hems end."""
    arms = [(part, 0.0) for part in (*figure.arms, *figure.hands, *figure.feet)]
    return Solid((*_lower(figure), *arms))


def _top(figure: Figure, clothes: Clothes, folds: Relief) -> Piece:
    """Jacket, shirt or t-shirt, with a collar unless it is a t-shirt."""
    grown, hem = _TOP_GROWN_M[clothes.top], _height(figure, _TOP_HEM[clothes.top])
    parts = _trunk(figure)
    parts += tuple((_sleeve(figure, side, _SLEEVE[clothes.top], _SPARE_M), 0.035) for side in (0, 1))
    if clothes.top != "t_shirt":
        tilt = np.array([0.35, 0.0, 0.94]) / np.hypot(0.35, 0.94)
        edge = tilt @ figure.joint("neck") + 0.022 * figure.scale
        parts += ((Solid(((figure.neck, 0.0),), cuts=((tilt, edge),)), 0.015),)

    def relief(points: Floats) -> Floats:
        lower = np.clip(1 - (points[:, 2] - hem) / 0.25, 0, 1) * (np.abs(points[:, 1]) < 0.27 * figure.scale)
        return folds(points) + 0.010 * lower

    hi_vis = clothes.hi_vis == "jacket"
    base = Material(clothes.hi_vis_colour, roughness=0.85) if hi_vis else clothes.top_material
    covers = ("trousers",) + ("vest",) * (clothes.hi_vis == "vest") + ("belt",) * clothes.tool_belt
    solid = Solid(parts, grown, ((-UP, _SPARE_M - hem),), relief=relief)
    hands = ("left_hand", "right_hand")
    bands = _jacket_bands(figure, clothes) if hi_vis else ()
    return Piece(solid, base, _BODY_CELL, bands, _hems(figure, clothes, hem), covers, hands)


def _stripe(clothes: Clothes) -> Material:
    return Material(clothes.stripe_colour, roughness=0.35)


def _torso_stripes(figure: Figure, clothes: Clothes, places: tuple[float, float]) -> tuple[Band, ...]:
    """Two braces over the shoulders and two rings about the trunk."""
    rings = [_height(figure, place) for place in places]
    y = 0.075 * figure.scale
    braces = [
        Band(_stripe(clothes), sign * LEFT, y, y + _STRIPE_M, ((UP, rings[0] + 0.5 * _STRIPE_M),))
        for sign in (1.0, -1.0)
    ]
    trunk = ((LEFT, -0.27 * figure.scale), (-LEFT, -0.27 * figure.scale))
    return (*braces, *(Band(_stripe(clothes), UP, z, z + _STRIPE_M, trunk) for z in rings))


def _jacket_bands(figure: Figure, clothes: Clothes) -> tuple[Band, ...]:
    """A hi-vis jacket's stripes and, on some, its dark lower part."""
    bands = _torso_stripes(figure, clothes, (0.10, 0.42))
    for side, sign in ((0, 1.0), (1, -1.0)):
        axis, outside = figure.arm_axis(side), ((sign * LEFT, 0.255 * figure.scale),)
        for place in (0.72, 1.45):
            start = _along_arm(figure, side, place)
            bands += (Band(_stripe(clothes), axis, start, start + _STRIPE_M, outside),)
        if clothes.dark_hem:
            bands = (Band(_DARK, axis, _along_arm(figure, side, 1.75), np.inf, outside), *bands)
    if clothes.dark_hem:
        trunk = ((LEFT, -0.27 * figure.scale), (-LEFT, -0.27 * figure.scale))
        bands = (Band(_DARK, UP, -np.inf, _height(figure, 0.10), trunk), *bands)
    return bands


def _vest(figure: Figure, clothes: Clothes, top: Solid, folds: Relief) -> Piece:
    """A vest over the top: armholes, a wide neck, on some an open front."""
    hem = _height(figure, _VEST_HEM)
    scale, neck = figure.scale, figure.joint("neck")
    trims: list[Shape] = [
        HalfSpace(-UP, -hem),
        Ellipsoid(neck + scale * np.array([0.01, 0.0, 0.03]), scale * np.array([0.13, 0.095, 0.095])),
        Ellipsoid(neck + scale * np.array([0.11, 0.0, -0.05]), scale * np.array([0.11, 0.060, 0.15])),
    ]
    section = np.array([(0.0, 0.17, 0.17, 0.175), (0.4, 0.17, 0.17, 0.175)]) * [1.0, scale, scale, scale]
    for bone, sign in (("left_upper_arm", 1.0), ("right_upper_arm", -1.0)):
        armhole = figure.joint(bone) * [1.0, 0.84, 1.0]
        trims.append(Loft(armhole, sign * LEFT, FORWARD, section))
    if clothes.open_front:
        middle = np.array([0.17, 0.0, _height(figure, 0.30)])
        trims.append(Ellipsoid(middle, figure.scale * np.array([0.14, 0.062, 0.52])))

    def relief(points: Floats) -> Floats:
        return folds(points) + 0.012 * np.clip(1 - (points[:, 2] - hem) / 0.2, 0, 1)

    whole = Solid(_trunk(figure) + tuple((_sleeve(figure, side, 0.15, 0.0), 0.035) for side in (0, 1)), top.grown_m)
    solid = Solid(((whole, 0.0),), _VEST_OVER_M, ((-UP, _SPARE_M - hem),), relief=relief)
    material = Material(clothes.hi_vis_colour, roughness=0.8)
    still = tuple(f"{side}_{part}" for side in ("left", "right") for part in ("hand", "forearm", "upper_arm"))
    bands = _torso_stripes(figure, clothes, (0.16, 0.44))
    return Piece(
        solid, material, _BODY_CELL, bands, tuple((shape, top) for shape in trims), covers=("top",), still=still
    )


def _belt(figure: Figure, over_m: float) -> Piece:
    """A tool belt with two pouches, of leather."""
    low, high = _height(figure, 0.055), _height(figure, 0.145)
    ring = Solid(_lower(figure), over_m + 0.022, ((UP, high), (-UP, -low)))
    pouch = figure.scale * np.array([(-0.15, 0.055, 0.055, 0.036), (0.03, 0.065, 0.065, 0.044)])
    half_width = figure.torso.side_radius_m(low - _height(figure, 0.0)) + over_m + 0.025
    pouches = [Loft((0.01, sign * half_width, low), UP, FORWARD, pouch, power=3.5) for sign in (1.0, -1.0)]
    solid = Solid(((ring, 0.0), (pouches[0], 0.01), (pouches[1], 0.01)))
    still = tuple(f"{side}_{part}" for side in ("left", "right") for part in ("thigh", "upper_arm"))
    return Piece(solid, Material((0.16, 0.075, 0.03), roughness=0.6), _BELT_CELL, covers=("top",), still=still)


def _trousers(figure: Figure, clothes: Clothes, folds: Relief) -> Piece:
    """Trousers from the waist to the boots; below the knee they hang straighter than the calf."""
    waist, hem = _height(figure, 0.2), 0.042 * figure.body.height_m
    hip, knee = figure.joint("left_thigh")[2], figure.joint("left_shin")[2]
    heights = np.array([hem, hem + 0.10, 0.6 * knee + 0.4 * hem, knee, hip - 0.15, hip - 0.05])
    stand_off = np.array([0.026, 0.018, 0.006, 0.002, 0.0, 0.0]) * figure.scale
    stand_off += np.array([1.0, 1.0, 1.0, 0.8, 0.9, 0.0]) * (clothes.trousers_loose_m - 0.006)

    def relief(points: Floats) -> Floats:
        return folds(points) + np.interp(points[:, 2], heights, stand_off)

    crotch = np.array([(hem - hip - 0.1, 0.4, 0.4, 0.004), (-0.12 * figure.scale, 0.4, 0.4, 0.004)])
    gap = Loft((0.0, 0.0, hip), UP, FORWARD, crotch)
    solid = Solid(_lower(figure), 0.006, ((UP, waist), (-UP, _SPARE_M - hem)), (gap,), relief)
    bands: tuple[Band, ...] = ()
    if clothes.trousers_stripes:
        low = [hem + place * (knee - hem) for place in (0.35, 0.65)]
        bands = tuple(Band(_stripe(clothes), UP, z, z + _STRIPE_M) for z in low)
    covers = ("top", "left_boot", "right_boot") + ("belt",) * clothes.tool_belt
    feet = ("left_foot", "right_foot")
    hems = ((HalfSpace(-UP, -hem), _bare(figure)),)
    return Piece(solid, clothes.trousers_material, _BODY_CELL, bands, hems, covers, feet)


def _feet(figure: Figure, clothes: Clothes) -> dict[str, Piece]:
    """Boots, their lowest part the sole."""
    sole = Band(Material(clothes.sole, roughness=0.9), UP, -np.inf, 0.032 * figure.scale)
    leather = Material(clothes.boots, roughness=0.55)
    return {
        f"{side}_boot": Piece(solid, leather, _BOOT_CELL, (sole,))
        for side, solid in zip(("left", "right"), figure.feet, strict=True)
    }


def _arms(figure: Figure, clothes: Clothes) -> dict[str, Piece]:
    """Hands, bare or gloved, and what the sleeves leave bare of the arms."""
    skin, pieces = Material(clothes.skin, roughness=0.55), {}
    for side, name in enumerate(("left", "right")):
        axis, arm = figure.arm_axis(side), figure.arms[side]
        cuff = _along_arm(figure, side, 1.75 if clothes.gloves else 1.88)
        hand = Solid(((figure.hands[side], 0.0), (arm, 0.012)), 0.003 if clothes.gloves else 0.0, ((-axis, -cuff),))
        material = Material(clothes.gloves, roughness=0.8) if clothes.gloves else skin
        pieces[f"{name}_hand"] = Piece(hand, material, _HAND_CELL)
        if clothes.top == "t_shirt":
            start = _along_arm(figure, side, _SLEEVE["t_shirt"] - 0.12)
            bare = Solid(((arm, 0.0),), cuts=((-axis, -start), (axis, _along_arm(figure, side, 2.0))))
            pieces[f"{name}_forearm"] = Piece(bare, skin, _ARM_CELL)
    return pieces
