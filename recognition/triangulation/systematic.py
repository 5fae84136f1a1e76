"""What a point's covariance owes to the rig: cameras whose poses and clocks are not exact.

A camera that is turned a little, or late, sees every point elsewhere, the same way at every instant, so that no
filter averages it out. Its variance across the ray is therefore kept out of the filter, and carried through the
solution of each instant: with ``L`` the information of all rays and ``M`` that of the rays whose weights are
multiplied by the variances, the point's share is ``L^-1 M L^-1``. Errors of different cameras are taken as independent.
"""

from __future__ import annotations

import numpy as np

from recognition.optics import Optics
from recognition.triangulation.fusion import Fused, normal_matrices
from rigcal.geometry import Floats

_FIRST, _SECOND = np.triu_indices(3)
_EYE = np.eye(3)


def systematic(optics: Optics, fused: Fused, factors: Floats, clock_bounds_s: Floats) -> Floats | None:
    """(N, 3, 3) covariance of points by the poses and clocks of the cameras that gave them; None where both are exact.

    Args:
        optics: Of the rig.
        fused: N points.
        factors: (4, V, N) of what was seen, see :class:`recognition.triangulation.fusion.Sights`.
        clock_bounds_s: (V,) half-widths of the intervals that hold the clocks' errors.
    """
    if optics.pose_doubt is None and not clock_bounds_s.any():
        return None
    variance = clock_bounds_s[:, None] ** 2 / 3 * (fused.motion.state[:, 3:] ** 2).sum(axis=1)
    if optics.pose_doubt is not None:
        place = fused.motion.state[:, :3].T
        monomials = np.concatenate([place[_FIRST] * place[_SECOND], place, np.ones((1, place.shape[1]))])
        variance = variance + optics.pose_doubt.T @ monomials
    spread = normal_matrices(optics, factors * (fused.weight * fused.weight * variance))
    inverse = np.linalg.inv(fused.information + _EYE)
    return np.asarray(inverse @ spread @ inverse)
