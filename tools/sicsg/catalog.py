"""The catalogue: every category of objects that the networks learn, in the order of their outputs.

Left and right of keypoints are those of somebody before the object who looks at its front (a climber, a buyer of a
window). Symmetries list the orders of keypoints that a picture cannot tell apart:

- a ladder looks alike from before and behind; a step ladder is its own mirror image, so that its left follows only from
  which of its sides is the front: both allow left and right to be swapped;
- a deck may be turned by 180 degrees about the vertical, not mirrored: that would run around it the other way, and on
  which side of a deck one looks is plain;
- a window may be turned by 180 degrees about its normal, its upright and its level axis (upside down, from behind).

These are rotations of the object, or reflections that it has itself, hence each list is a group.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from tools.sicsg.catalog_types import Category, Item
from tools.sicsg.objects.containers import barrel, bucket, toolbox
from tools.sicsg.objects.hats import hard_hat
from tools.sicsg.objects.kit import Draw, drawing
from tools.sicsg.objects.ladders import ladder, step_ladder
from tools.sicsg.objects.placing import (
    against_wall_pose,
    footprint,
    leaning_pose,
    lying_pose,
    resting_pose,
    wall_distance_m,
)
from tools.sicsg.objects.platforms import platform, scaffold
from tools.sicsg.objects.tools import cone, drill, saw_horse, wheelbarrow
from tools.sicsg.objects.windows import large_window, small_window

__all__ = [
    "CATEGORIES",
    "CATEGORY_NAMES",
    "against_wall_pose",
    "canonical_order",
    "category",
    "footprint",
    "item",
    "leaning_pose",
    "lying_pose",
    "resting_pose",
    "wall_distance_m",
]

_LADDER = ("foot_left", "foot_right", "top_left", "top_right")
_DECK = ("near_right", "far_right", "far_left", "near_left")
_WINDOW = ("top_left", "top_right", "bottom_right", "bottom_left")
_SWAPPED = ((0, 1, 2, 3), (1, 0, 3, 2))
_HALF_TURN = ((0, 1, 2, 3), (2, 3, 0, 1))
_PANE = ((0, 1, 2, 3), (2, 3, 0, 1), (1, 0, 3, 2), (3, 2, 1, 0))

CATEGORIES: tuple[Category, ...] = (
    Category("hard_hat", ("centre",), ((0,),), critical=True),
    Category("ladder", _LADDER, _SWAPPED, critical=True),
    Category("step_ladder", _LADDER, _SWAPPED, critical=True),
    Category("platform", _DECK, _HALF_TURN, critical=True),
    Category("large_window", _WINDOW, _PANE, critical=True),
    Category("small_window", _WINDOW, _PANE),
    Category("toolbox"),
    Category("cone"),
    Category("bucket"),
    Category("drill"),
    Category("saw_horse"),
    Category("scaffold", _DECK, _HALF_TURN),
    Category("wheelbarrow"),
    Category("barrel"),
)
CATEGORY_NAMES: tuple[str, ...] = tuple(entry.name for entry in CATEGORIES)
_MAKERS: dict[str, Callable[[Draw], Item]] = {
    "hard_hat": hard_hat, "ladder": ladder, "step_ladder": step_ladder, "platform": platform,
    "large_window": large_window, "small_window": small_window, "toolbox": toolbox, "cone": cone, "bucket": bucket,
    "drill": drill, "saw_horse": saw_horse, "scaffold": scaffold, "wheelbarrow": wheelbarrow, "barrel": barrel,
}  # fmt: skip
_PLACES = {"left": (-1, 0), "right": (1, 0), "top": (0, -1), "far": (0, -1), "foot": (0, 1), "near": (0, 1)}
_PLACES |= {"bottom": (0, 1), "centre": (0, 0)}
"""Where in the image, x right and y down, each word of a keypoint's name asks it to be."""


def category(name: str) -> Category:
    """The category of this name.

    Raises:
        ValueError: there is none.
    """
    if name not in CATEGORY_NAMES:
        raise ValueError(f"category {name!r} is not in the catalogue; expected one of {', '.join(CATEGORY_NAMES)}")
    return CATEGORIES[CATEGORY_NAMES.index(name)]


@lru_cache(maxsize=1024)
def item(category_name: str, variant: str) -> Item:
    """A variant of a category; the same object for the same names, so that renderers can keep what they make of it.

    Raises:
        ValueError: for an unknown category, or a variant that is no name of four digits.
    """
    entry = category(category_name)
    if not (len(variant) == 4 and variant.isascii() and variant.isdigit()):
        raise ValueError(f"variant {variant!r} of {entry.name}: expected a name of four digits such as '0017'")
    return _MAKERS[entry.name](drawing(entry.name, variant))


def canonical_order(category_name: str, keypoints_px: ArrayLike) -> tuple[int, ...]:
    """Among a category's symmetries, the order that brings the keypoints nearest to their names in the image.

    Left ones to the left, top and far ones up, feet and near ones down: the sum of the displacements in these
    directions is the largest; of equal ones the first symmetry's. ``keypoints_px[list(order)]`` is the canonical
    figure, the same for whichever of the equivalent orders came in.

    Args:
        keypoints_px: (K, 2) of the category's keypoints in an image, also outside of its borders.

    Raises:
        ValueError: another shape, or values that are not finite (behind the camera: leave the object out).
    """
    entry = category(category_name)
    points = np.asarray(keypoints_px, dtype=np.float64)
    if points.shape != (len(entry.keypoints), 2) or not np.isfinite(points).all():
        raise ValueError(
            f"keypoints of {entry.name}: expected {len(entry.keypoints)} finite pixels, got an array {points.shape} "
            f"with {int((~np.isfinite(points)).sum())} values that are not finite"
        )
    if not entry.keypoints:
        return ()
    wanted = np.array([np.sum([_PLACES[word] for word in name.split("_")], axis=0) for name in entry.keypoints])
    scores = [float((points[list(order)] * wanted).sum()) for order in entry.symmetries]
    return entry.symmetries[int(np.argmax(scores))]
