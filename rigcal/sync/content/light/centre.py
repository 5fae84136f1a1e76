"""The likeliest clocks within what the light leaves open: the centroid of the polytope.

Whoever switches a lamp knows nothing of the frames, so every time of switching is as likely as any other, and all
values of the unknowns that contradict nothing are equally likely: the best guess in the mean square is their mean. It
is sampled by artificial centring hit-and-run (Kaufman and Smith, Operations Research 46, 1998), whose steps go along
directions in which earlier samples spread, from the corners that linear programs find. Beside the middles of the
intervals its error is a quarter to two thirds where a dozen changes leave several milliseconds open.
"""

from __future__ import annotations

import numpy as np

from rigcal.geometry import Floats
from rigcal.sync.content.light.intervals import Polytope, corner

_CORNERS, _SAMPLES, _SAMPLES_PER_UNKNOWN = 30, 1500, 40
_BURN_IN = 0.25  # share of the samples that still tell of where the walk began
_FLAT = 1e-9  # a step along a direction, or of a row against it, below this is rounding


def find_centre(polytope: Polytope, *, seed: int = 0) -> Floats:
    """(u,) mean of every unknown over a polytope; the same polytope and seed give the same."""
    rng = np.random.default_rng(seed)
    free = polytope.greatest > polytope.least
    points = [corner(polytope, np.where(free, rng.standard_normal(len(free)), 0.0))[free] for _ in range(_CORNERS)]
    eye = np.eye(int(free.sum()))
    rows = np.concatenate((polytope.matrix[:, free], eye, -eye))
    limits = np.concatenate((polytope.limit, polytope.greatest[free], -polytope.least[free]))
    centre = polytope.least.copy()
    centre[free] = _walk(rows, limits, points, rng).mean(axis=0)
    return centre


def _walk(rows: Floats, limits: Floats, points: list[Floats], rng: np.random.Generator) -> Floats:
    """(n, u) samples of ``rows @ x <= limits``, from corners of it."""
    count = _SAMPLES + _SAMPLES_PER_UNKNOWN * rows.shape[1]
    known = np.empty((len(points) + count, rows.shape[1]))
    known[: len(points)] = points
    here = centre = known[: len(points)].mean(axis=0)
    slack = np.maximum(limits - rows @ here, 0.0)
    for filled in range(len(points), len(known)):
        direction = known[rng.integers(filled)] - centre
        slope = rows @ direction
        near = slope < -_FLAT
        far = slope > _FLAT
        if far.any() and near.any():
            step = rng.uniform((slack[near] / slope[near]).max(), (slack[far] / slope[far]).min())
            here, slack = here + step * direction, np.maximum(slack - step * slope, 0.0)
        known[filled] = here
        centre = centre + (here - centre) / (filled + 1)
    return known[len(points) + int(_BURN_IN * count) :]
