"""A piece of a worker's mesh: a solid with a material."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.mesh import Material
from tools.sicsg.workers.cutting import Band
from tools.sicsg.workers.fields import Shape, Solid

Floats = NDArray[np.float64]
_EDGE_M = 0.025
"""What lies this near an edge may come to light when the piece below moves another way."""
_HIDDEN_M = 0.005
"""Less than the least distance between a vest and the top below it."""


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """One closed part of the mesh."""

    solid: Solid
    material: Material
    cell_m: tuple[float, float, float]
    """Cells of the grid that it is meshed on."""
    bands: tuple[Band, ...] = ()
    """Other materials on it."""
    trims: tuple[tuple[Shape, Shape], ...] = ()
    """What is cut out of it, each with the surface on which the walls of the cut end."""
    covers: tuple[str, ...] = ()
    """Names of the pieces worn over it: what lies well inside them is left out."""
    still: tuple[str, ...] = ()
    """Bones that it does not follow, :func:`weights.skin_weights`."""
    bone: str | None = None
    """The only bone that it follows; ``None``: those that are near."""

    def hidden(self, points_m: Floats) -> NDArray[np.bool_]:
        """(N,) which points lie so deep inside that nobody sees them."""
        inside = self.solid.distance(points_m) < -_HIDDEN_M
        for shape, _ in self.trims:
            inside &= shape.distance(points_m) > _EDGE_M
        return inside
