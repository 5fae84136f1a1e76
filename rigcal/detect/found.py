"""What a finder returns for one image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import Floats, Ints

Grey: TypeAlias = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class FoundBoard:
    """A board in one image."""

    corner_ids: Ints
    """(n,) indices into ``board.corners_in_board``, ascending."""
    corners_px: Floats
    """(n, 2) pixels, origin at the centre of the top-left pixel."""
    turned: bool = False
    """Whether the finder gave the corners turned by 180 degrees, and they were put right by the squares' colours."""
    problem: str = ""
    """Why these corners must not be used; empty where they may."""
    blur_px: float = 0.0
    """Sigma of the blur of its edges in pixels, in the middle of its corners; 0: not measured."""
