"""What the keypoints of objects mean, and which of their orders look the same.

A network that was asked for the left and the right foot of a ladder names them as they lie in its image: the left foot
of one camera is the right one of the camera opposite. An order of a class's symmetries may therefore have been given
by each view, and an object has its keypoints in one of them, the same as long as it is followed.

The bundled networks were taught these keypoints by these names. A network of another origin that uses a class's name
must mean the same by it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True, slots=True)
class Keypoints:
    """The keypoints of a class of objects."""

    names: tuple[str, ...]
    """In the order of the class; left and right are those of somebody before the object who looks at its front."""
    symmetries: tuple[tuple[int, ...], ...]
    """Orders of the keypoints that a picture cannot tell apart: a group, the identity first."""


_LADDER = Keypoints(("foot_left", "foot_right", "top_left", "top_right"), ((0, 1, 2, 3), (1, 0, 3, 2)))
_DECK = Keypoints(("near_right", "far_right", "far_left", "near_left"), ((0, 1, 2, 3), (2, 3, 0, 1)))
_PANE = Keypoints(
    ("top_left", "top_right", "bottom_right", "bottom_left"),
    ((0, 1, 2, 3), (2, 3, 0, 1), (1, 0, 3, 2), (3, 2, 1, 0)),
)
KEYPOINTS_OF: Mapping[str, Keypoints] = MappingProxyType(
    {
        "hard_hat": Keypoints(("centre",), ((0,),)),
        "ladder": _LADDER,
        "step_ladder": _LADDER,
        "platform": _DECK,
        "scaffold": _DECK,
        "large_window": _PANE,
        "small_window": _PANE,
    }
)
"""Of every class that has any. A ladder is alike from before and behind, and a step ladder its own mirror image; a deck
may be turned by half a turn about the vertical; a pane of glass may be turned by half a turn about each of its axes."""
