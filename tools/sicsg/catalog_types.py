"""What the catalogue says of an object: its mesh, its keypoints and where a worker can use it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.mesh import Mesh

Floats = NDArray[np.float64]


def _none() -> Floats:
    return np.zeros((0, 3))


@dataclass(frozen=True, slots=True)
class Category:
    """A kind of object that the networks learn."""

    name: str
    keypoints: tuple[str, ...] = ()
    """Names of its keypoints, in physical order."""
    symmetries: tuple[tuple[int, ...], ...] = ()
    """Orders of the keypoints that nobody can tell apart, the identity included."""
    critical: bool = False
    """Whether a rule depends on it."""


@dataclass(frozen=True, slots=True, eq=False)
class Item:
    """One variant of a category, in its own frame: metres, z up, +x its front, +y its left (as of a worker at rest).

    Who climbs a ladder stands at +x and faces -x; a window's glass faces +x. The origin lies on the floor below the
    middle; a hard hat's at the wearer's crown, a tool's where the hand grips it. A leaning ladder stands upright here,
    z along its rails; the scene's pose leans it, its top towards -x.
    """

    category: str
    variant: str
    mesh: Mesh
    size_m: tuple[float, float, float]
    keypoints_m: Floats = field(default_factory=_none)
    """(K, 3) in the category's order."""
    steps_m: Floats = field(default_factory=lambda: np.zeros((0, 2, 3)))
    """(S, 2, 3) left and right end of each rung or step, from below; a platform's access steps too."""
    deck_m: Floats = field(default_factory=_none)
    """(4, 3) corners of what one can stand on, counter-clockwise from above; empty where there is none."""
    grips_m: Floats = field(default_factory=_none)
    """(G, 3) where hands hold it: of windows left low, left high, right low, right high (edges y > 0 are left)."""
