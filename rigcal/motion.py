"""Boards that move while the cameras of an instant are not exposed together.

A corner that moves at ``v`` px/s in a camera exposed ``dt`` away from its instant is ``v dt`` from where the other
cameras expect it. Up to a limit that counts as noise, and the view counts for less: its variance grows by
``(v dt)^2``. Beyond the limit the view says nothing of where the camera stands, only of its lens.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigcal.detections import BoardView
from rigcal.geometry import Floats

MOST_MOTION_PX = 1.0
"""Motion between exposures above which a view no longer belongs to its instant."""
_NEAR_S = 0.5  # neighbours further away in time say nothing of the speed at an instant


def corner_speeds_px_s(views: Sequence[BoardView], t_s: Floats) -> Floats:
    """(n,) speed of each view's corners in pixels per second, from the views before and after it.

    Args:
        views: Of one camera, in order of time.
        t_s: (n,) their times in seconds.

    Returns:
        Root-mean-square speeds; 0 for a view without a neighbour within half a second.
    """
    speeds = np.zeros(len(views))
    for i in range(len(views)):
        near = [j for j in (i - 1, i, i + 1) if 0 <= j < len(views) and abs(t_s[j] - t_s[i]) <= _NEAR_S]
        first, last = near[0], near[-1]
        elapsed_s = t_s[last] - t_s[first]
        common, one, two = np.intersect1d(views[first].corner_ids, views[last].corner_ids, return_indices=True)
        if elapsed_s > 0 and len(common):
            moved = views[last].corners_px[two] - views[first].corners_px[one]
            speeds[i] = float(np.sqrt((moved**2).sum(axis=1).mean())) / elapsed_s
    return speeds
