"""How far from the truth a point may be whose views err alike at every instant: told by how they disagree.

A detector that takes a wrong corner for the right one does so at instant after instant, so that no filter averages it
out, and by far more than it errs elsewhere. What the rays of an instant are away from the point, over what its three
coordinates leave of them, is the variance of that; a ray that is wrong counts as one that is just not yet wrong. Of two
rays that agree, among others that do not, little is known.
"""

from __future__ import annotations

import numpy as np

from recognition.optics import Optics
from recognition.triangulation.fusion import WRONG_SIGMAS, Fused, Sights, moved, residuals
from rigcal.geometry import Floats


def scatter(optics: Optics, fused: Fused, sights: Sights, share: float) -> Floats:
    """(N,) variance of each coordinate, m^2; infinite where fewer than two of several rays agree, NaN for one or none.

    Args:
        optics: Of the rig.
        fused: N points.
        sights: What was seen of them.
        share: Variance that rays have in any case, over that which ``sights`` gives them.
    """
    away = moved(optics, fused.motion, sights)
    square, variance, depth = residuals(optics, fused.motion.state[:, :3], sights, away)
    square_m2 = (np.minimum(square, WRONG_SIGMAS**2 * variance) + share * variance) * (depth * depth)
    count, free = np.add.reduce(sights.seen), 2.0 * fused.views - 3.0
    mean_m2 = np.add.reduce(square_m2 * sights.seen) / np.maximum(count, 1)
    return np.where(count < 2, np.nan, np.where(free > 0, mean_m2 / np.maximum(free, 1.0), np.inf))
