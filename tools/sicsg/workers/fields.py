"""Solids as signed distances: negative inside, about one metre per metre near the surface, and their triangles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator
from scipy.sparse import csr_array
from skimage.measure import marching_cubes

Floats = NDArray[np.float64]
UP = np.array([0.0, 0.0, 1.0])
FORWARD = np.array([1.0, 0.0, 0.0])
_GRADIENT_STEP_M = 1e-4


class Shape(Protocol):
    """Something with a distance."""

    def distance(self, points_m: Floats) -> Floats:
        """(N,) signed distances of (N, 3) points."""
        ...

    def bounds(self) -> tuple[Floats, Floats]:
        """Lowest and highest corner (3,) of a box that holds it."""
        ...


class Loft:
    """A tube about a straight axis whose section, a superellipse, changes along it."""

    def __init__(
        self, start_m: ArrayLike, axis: ArrayLike, front: ArrayLike, knots_m: ArrayLike, *, power: float = 2.0
    ) -> None:
        """``knots_m`` (K, 4): place along the axis, then radii to the front, to the back and to the sides."""
        self._start = np.asarray(start_m, dtype=np.float64)
        self._axis = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
        self._front = np.asarray(front, dtype=np.float64)
        self._side = np.cross(self._axis, self._front)
        self._knots = np.asarray(knots_m, dtype=np.float64)
        self._radii = PchipInterpolator(self._knots[:, 0], self._knots[:, 1:])
        self._power = power

    def distance(self, points_m: Floats) -> Floats:
        """(N,) signed distances: the section's to first order, rounded at both ends."""
        local = points_m - self._start
        along, front, side = local @ self._axis, local @ self._front, local @ self._side
        low, high = self._knots[0, 0], self._knots[-1, 0]
        radii = self._radii(np.clip(along, low, high))
        depth, width, p = np.where(front >= 0, radii[:, 0], radii[:, 1]), radii[:, 2], self._power
        u, v = np.abs(front) / depth + 1e-9, np.abs(side) / width + 1e-9
        norm = (u**p + v**p) ** (1 / p)
        slope = norm ** (1 - p) * np.hypot(u ** (p - 1) / depth, v ** (p - 1) / width)
        narrow = np.minimum(depth, width)
        section = np.maximum((norm - 1) / slope, -narrow)
        rounding = 0.5 * np.minimum(narrow, 0.04)
        a, b = section + rounding, np.maximum(low - along, along - high) + rounding
        return np.asarray(np.minimum(np.maximum(a, b), 0) + np.hypot(np.maximum(a, 0), np.maximum(b, 0)) - rounding)

    def side_radius_m(self, along_m: float) -> float:
        """Radius to the sides at a place along the axis."""
        return float(self._radii(along_m)[2])

    def bounds(self) -> tuple[Floats, Floats]:
        """A box about both ends and the largest radius."""
        ends = self._start + self._knots[[0, -1], :1] * self._axis
        reach = self._knots[:, 1:].max()
        return ends.min(axis=0) - reach, ends.max(axis=0) + reach


@dataclass(frozen=True, slots=True, eq=False)
class Capsule:
    """A round bar from one point to another, tapered."""

    start_m: Floats
    end_m: Floats
    start_radius_m: float
    end_radius_m: float

    def distance(self, points_m: Floats) -> Floats:
        """(N,) signed distances (exact where it does not taper)."""
        bar = self.end_m - self.start_m
        part = np.clip((points_m - self.start_m) @ bar / (bar @ bar), 0, 1)
        away = np.linalg.norm(points_m - self.start_m - part[:, None] * bar, axis=1)
        return np.asarray(away - (self.start_radius_m + part * (self.end_radius_m - self.start_radius_m)))

    def bounds(self) -> tuple[Floats, Floats]:
        """A box about both balls."""
        reach = max(self.start_radius_m, self.end_radius_m)
        return np.minimum(self.start_m, self.end_m) - reach, np.maximum(self.start_m, self.end_m) + reach


@dataclass(frozen=True, slots=True, eq=False)
class HalfSpace:
    """Everything beyond a plane; without bounds of its own, so it only cuts."""

    normal: Floats
    """(3,) unit vector into it."""
    start_m: float
    """``normal @ p`` on the plane."""

    def distance(self, points_m: Floats) -> Floats:
        """(N,) signed distances."""
        return self.start_m - points_m @ self.normal

    def bounds(self) -> tuple[Floats, Floats]:
        """All of space."""
        return np.full(3, -np.inf), np.full(3, np.inf)


@dataclass(frozen=True, slots=True, eq=False)
class Ellipsoid:
    """An ellipsoid along the axes."""

    centre_m: Floats
    radii_m: Floats

    def distance(self, points_m: Floats) -> Floats:
        """(N,) signed distances, to first order near the surface."""
        scaled = (points_m - self.centre_m) / self.radii_m
        norm = np.linalg.norm(scaled, axis=1) + 1e-9
        return np.asarray(norm * (norm - 1) / (np.linalg.norm(scaled / self.radii_m, axis=1) + 1e-9))

    def bounds(self) -> tuple[Floats, Floats]:
        """The box about it."""
        return self.centre_m - self.radii_m, self.centre_m + self.radii_m


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """Shapes blended together, grown, cut by half-spaces and carved by other solids."""

    parts: tuple[tuple[Shape, float], ...]
    """Each with the width in metres over which it blends with those before it."""
    grown_m: float = 0.0
    cuts: tuple[tuple[Floats, float], ...] = ()
    """Kept is where ``normal @ p <= limit`` for each (unit normal, limit)."""
    carved: tuple[Shape, ...] = ()
    relief: Callable[[Floats], Floats] | None = field(default=None)
    """Metres that the surface lies further out at each of (N, 3) points: folds of cloth, a widening hem."""

    def distance(self, points_m: Floats) -> Floats:
        """(N,) signed distances."""
        result = self.parts[0][0].distance(points_m)
        for shape, blend_m in self.parts[1:]:
            result = smooth_minimum(result, shape.distance(points_m), blend_m)
        result = result - self.grown_m
        if self.relief is not None:
            result = result - self.relief(points_m)
        for normal, limit in self.cuts:
            result = np.maximum(result, points_m @ normal - limit)
        for shape in self.carved:
            result = np.maximum(result, -shape.distance(points_m))
        return result

    def bounds(self) -> tuple[Floats, Floats]:
        """A box about all parts; cuts along an axis make it smaller."""
        boxes = [shape.bounds() for shape, _ in self.parts]
        reach = self.grown_m + 0.03
        low = np.min([box[0] for box in boxes], axis=0) - reach
        high = np.max([box[1] for box in boxes], axis=0) + reach
        for normal, limit in self.cuts:
            axis = int(np.abs(normal).argmax())
            if abs(normal[axis]) > 1 - 1e-9 and normal[axis] > 0:
                high[axis] = min(high[axis], limit)
            elif abs(normal[axis]) > 1 - 1e-9:
                low[axis] = max(low[axis], -limit)
        return low, high


def smooth_minimum(a: Floats, b: Floats, blend_m: float) -> Floats:
    """The smaller one, rounded where both are within ``blend_m`` of each other (Quilez' quadratic form)."""
    near = np.maximum(blend_m - np.abs(a - b), 0.0)
    return np.minimum(a, b) - near * near / (4 * max(blend_m, 1e-9))


def surface(shape: Shape, cell_m: ArrayLike) -> tuple[Floats, NDArray[np.int64]]:
    """Vertices (V, 3) and outward faces (F, 3) of the shape, from a grid with cells of ``cell_m`` (3,).

    The vertices of the marching cubes are spread evenly and put back on the surface, which makes the triangles fair.
    """
    cell = np.asarray(cell_m, dtype=np.float64)
    low, high = shape.bounds()
    first, last = np.floor(low / cell).astype(int) - 2, np.ceil(high / cell).astype(int) + 2
    axes = [cell[i] * np.arange(first[i], last[i] + 1) for i in range(3)]
    counts = last - first + 1
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    values = shape.distance(grid)
    least = 0.03 * cell.min()
    values = np.where(np.abs(values) < least, np.where(values < 0, -least, least), values).reshape(counts)
    corners, faces, _, _ = marching_cubes(  # type: ignore[no-untyped-call]
        values, 0.0, spacing=tuple(cell), gradient_direction="descent"
    )
    vertices = corners.astype(np.float64) + [axis[0] for axis in axes]
    mean = _neighbour_mean(faces, len(vertices))
    for _ in range(2):
        vertices = projected(shape, 0.4 * vertices + 0.6 * (mean @ vertices), 0.5 * float(cell.max()))
    return vertices, faces.astype(np.int64)


def _neighbour_mean(faces: NDArray[np.int32], count: int) -> csr_array:
    """(V, V) sparse matrix that gives the mean of each vertex's neighbours."""
    rows, columns = faces[:, [0, 1, 2]].ravel(), faces[:, [1, 2, 0]].ravel()
    degree = np.bincount(rows, minlength=count)
    return csr_array((1.0 / degree[rows], (rows, columns)), shape=(count, count))


def projected(shape: Shape, points_m: Floats, reach_m: float) -> Floats:
    """The points after one Newton step to the surface along the gradient."""
    value = shape.distance(points_m)
    steps = _GRADIENT_STEP_M * np.eye(3)
    slope = np.stack([(shape.distance(points_m + step) - value) / _GRADIENT_STEP_M for step in steps], axis=1)
    length = np.maximum((slope * slope).sum(axis=1), 0.25)
    return np.asarray(points_m - np.clip(value / length, -reach_m, reach_m)[:, None] * slope)
