"""Which rays of a point meet: every two are an hypothesis, and the one that most rays agree with wins.

For the few points of an instant whose rays contradict each other or what was known before.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from recognition.optics import MIN_PARALLAX_RAD, NEAREST_M, Optics, midpoints, pairs
from rigcal.geometry import Bools, Floats

if TYPE_CHECKING:
    from recognition.triangulation.fusion import Sights


def consensus(optics: Optics, sights: Sights, sigmas: float) -> tuple[Floats, Bools]:
    """Places (N, 3) that most rays agree with, and which do (V, N); none where no two rays meet.

    Args:
        optics: Of the rig.
        sights: What was seen of N points, at the common time.
        sigmas: How many standard deviations a ray may be away.
    """
    views, count = sights.seen.shape
    first, second = pairs(views)
    x, y = sights.factors[1], sights.factors[2]
    xy = np.stack([x, y], axis=-1)
    rays = optics.rays(xy, np.arange(views))
    place, parallax = midpoints(optics.centre_m[first, None], rays[first], optics.centre_m[second, None], rays[second])
    usable = sights.seen[first] & sights.seen[second] & (parallax > MIN_PARALLAX_RAD)
    in_cam = optics.in_cameras(place.reshape(-1, 3)).reshape(3, views, len(first), count)
    depth = np.maximum(in_cam[2], NEAREST_M)
    dx, dy = in_cam[0] / depth - x[:, None], in_cam[1] / depth - y[:, None]
    variance = sights.angle_var[:, None] + sights.spread_var[:, None] / (depth * depth)
    share = (dx * dx + dy * dy) / (sigmas * sigmas * variance)
    agree = sights.seen[:, None] & (share < 1.0) & (in_cam[2] > NEAREST_M)
    good = np.where(usable, (agree * (2.0 - np.minimum(share, 1.0))).sum(axis=0), 0.0)
    best = good.argmax(axis=0)
    column = np.arange(count)
    return place[best, column], np.asarray(agree[:, best, column] & (good[best, column] > 0))
