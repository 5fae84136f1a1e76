"""Parallel projection of lines in 3D, as they stand on the page and as a script turns them.

The picture is complete as it stands, for print and for readers without scripts. ``turn.js`` draws the same points from
another side while they are dragged, by the same formula as :class:`Aspect`; so each element carries its points in 3D
beside its drawn path.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigcal.geometry import Floats
from rigcal.report.svgpath import polyline

HALF_WIDTH, HALF_HEIGHT = 290.0, 210.0
"""Half the size of what is drawn to scale, in the figure's units."""
RADIUS = 1000.0
"""Horizontal distance of the farthest point from the middle, in the units of the points in 3D."""


@dataclass(frozen=True, slots=True)
class Aspect:
    """From where a scene is seen, and how large: points in 3D to the figure's units, y down."""

    turn_deg: float
    tilt_deg: float
    rise: float
    """Half the height of the scene in the units of its points."""

    @property
    def scale(self) -> float:
        """The largest at which the scene, turned anyhow, stays within the figure."""
        tilt = np.deg2rad(self.tilt_deg)
        return float(min(HALF_WIDTH / RADIUS, HALF_HEIGHT / (RADIUS * np.sin(tilt) + self.rise * np.cos(tilt))))

    @property
    def turning(self) -> str:
        """What the script needs: turn and tilt in radians, rise, half the figure's size, radius."""
        angles = f"{np.deg2rad(self.turn_deg):.4f} {np.deg2rad(self.tilt_deg):.4f}"
        return f"{angles} {self.rise:.0f} {HALF_WIDTH:g} {HALF_HEIGHT:g} {RADIUS:g}"

    def __call__(self, points: Floats) -> Floats:
        """Points (..., 3) of the scene in the figure's units (..., 2)."""
        turn, tilt = np.deg2rad(self.turn_deg), np.deg2rad(self.tilt_deg)
        x, y, z = np.moveaxis(points, -1, 0)
        across, depth = np.cos(turn) * x + np.sin(turn) * y, np.cos(turn) * y - np.sin(turn) * x
        return np.stack([across, -np.cos(tilt) * z - np.sin(tilt) * depth], axis=-1) * self.scale


@dataclass(frozen=True, slots=True)
class Lines:
    """Lines of one kind."""

    kind: str
    """Class of the element."""
    points: str
    """Points in 3D, ``x y z x y z``, lines apart by ``;``."""
    path: str
    """The same as they stand."""


@dataclass(frozen=True, slots=True)
class Mark:
    """A named place."""

    label: str
    point: str
    """``x y z``."""
    x: float
    y: float


def lines_of(aspect: Aspect, kind: str, lines: Sequence[Floats]) -> Lines:
    """Lines, each (n, 3) in the units of the scene."""
    rounded = [np.rint(line) for line in lines]
    return Lines(kind, ";".join(map(_numbers, rounded)), "".join(polyline(aspect(line)) for line in rounded))


def mark_of(aspect: Aspect, label: str, point: Floats) -> Mark:
    """A name at a point (3,) in the units of the scene."""
    x, y = aspect(point).tolist()
    return Mark(label, _numbers(np.rint(point)), x, y)


def _numbers(points: Floats) -> str:
    return " ".join(str(int(value)) for value in points.ravel())
