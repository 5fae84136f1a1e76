"""Convex polygons in the plane: what half-planes leave of them, and their centroid."""

from __future__ import annotations

import numpy as np

from rigcal.geometry import Floats


def clip(corners: Floats, normal: Floats, limit: float) -> Floats:
    """The part of a convex polygon where ``normal @ point <= limit`` (Sutherland and Hodgman, 1974).

    Args:
        corners: (k, 2) in order around the polygon; none for an empty one.
        normal: (2,).
        limit: Of the half-plane.

    Returns:
        (j, 2) corners in the same order; none where nothing is left.
    """
    beyond = corners @ normal - limit
    if (beyond <= 0).all():
        return corners
    points, distances = corners.tolist(), beyond.tolist()
    left = []
    for (x, y), (x_next, y_next), here, there in zip(
        points, points[1:] + points[:1], distances, distances[1:] + distances[:1], strict=True
    ):
        if here <= 0:
            left.append((x, y))
        if (here <= 0) != (there <= 0):
            share = here / (here - there)
            left.append((x + (x_next - x) * share, y + (y_next - y) * share))
    return np.array(left).reshape(-1, 2)


def centroid(corners: Floats) -> Floats:
    """(2,) centroid of the area of a convex polygon; the mean of its (k, 2) corners where it has none."""
    middle = corners.mean(axis=0)
    x, y = (corners - middle).T
    x_next, y_next = np.roll(x, -1), np.roll(y, -1)
    twice_area = x * y_next - x_next * y
    if twice_area.sum() == 0:
        return np.asarray(middle)
    moments = np.array([(x + x_next) @ twice_area, (y + y_next) @ twice_area])
    return np.asarray(middle + moments / (3 * twice_area.sum()))
