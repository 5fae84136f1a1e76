"""The words of rules: classes and their shapes, points, measures, units, and what no measure can be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from types import MappingProxyType
from typing import Literal

from recognition.observations import JOINTS

Shape = Literal["ladder", "deck", "pane", "plain"]
"""What the keypoints of a class mean, in their order: ``ladder`` left and right foot, left and right top; ``deck`` the
corners of what one stands on, in turn; ``pane`` the corners of a window, in turn; ``plain`` none that rules use."""
SHAPES: tuple[Shape, ...] = ("ladder", "deck", "pane", "plain")

CLASSES: Mapping[str, Shape] = MappingProxyType(
    {
        "hard_hat": "plain",
        "ladder": "ladder",
        "step_ladder": "ladder",
        "platform": "deck",
        "large_window": "pane",
        "small_window": "pane",
        "toolbox": "plain",
        "cone": "plain",
        "bucket": "plain",
        "drill": "plain",
        "saw_horse": "plain",
        "scaffold": "deck",
        "wheelbarrow": "plain",
        "barrel": "plain",
    }
)
"""Classes of the bundled networks; a rule file adds those of others under ``[classes]``."""

HANDS = "hands"
"""Both wrists: what is nearest of the two counts."""
CROWN = "crown"
"""Where the middle of a hard hat is on a worker who wears one."""
BODY_POINTS = ("head", CROWN, "neck", "torso", "feet")
WORKER_POINTS = (*BODY_POINTS, HANDS, *JOINTS)
OBJECT_POINTS = ("centre", "bottom")
AXIS, FOOTPRINT, TOP, EXTENT = "axis", "footprint", "top", "extent"
SHAPES_OF_PART: Mapping[str, tuple[Shape, ...]] = MappingProxyType(
    {AXIS: ("ladder",), FOOTPRINT: ("deck",), TOP: ("deck",), EXTENT: SHAPES}
)
"""Parts of objects that are no points, and the shapes that have them."""
WAYS_OF_PART: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {AXIS: ("3d", "xy"), FOOTPRINT: ("xy",), TOP: ("z",), EXTENT: ("3d",)}
)
"""How a distance to each can be measured."""
WAYS = ("3d", "xy", "z")

MEASURES = ("dist", "clearance", "speed")
PREDICATES = ("visible", "inside", "mounted")
RESERVED = frozenset(
    {"and", "or", "not", "each", "exists", "count", "in", "of", "exit", "H", *WAYS, *MEASURES, *PREDICATES}
)
"""Words that cannot name a variable, definition or zone."""

UNITS: Mapping[str, tuple[str, float]] = MappingProxyType(
    {
        "m": ("length", 1.0),
        "cm": ("length", 0.01),
        "mm": ("length", 0.001),
        "H": ("length", 1.0),
        "m/s": ("speed", 1.0),
        "km/h": ("speed", 1 / 3.6),
    }
)
"""What each unit measures, and how many metres, or metres per second, it is; ``H`` is the height of a worker."""
LEAST_LENGTH_M, MOST_LENGTH_M, MOST_HEIGHTS = 0.005, 50.0, 10.0
"""Limits outside cannot be meant: the first is below what a rig places, the others (metres, and body heights) beyond
what it sees."""
MOST_SPEED_M_PER_S = 15.0
"""Nobody runs faster, and nothing on a site is carried faster."""
MOST_COUNT = 100


def alike(word: str, known: Sequence[str]) -> str:
    """`` (did you mean ...?)`` where a known word is spelled nearly so, else nothing."""
    near = get_close_matches(word, known, n=1, cutoff=0.6)
    return f" (did you mean {near[0]}?)" if near else ""
