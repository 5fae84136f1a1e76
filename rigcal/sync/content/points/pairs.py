"""Whether pairs of cameras, each by itself, agree with one clock per camera."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np

from rigcal.sync.content.points.clocks import OFFSET
from rigcal.sync.content.points.equations import Comparison
from rigcal.sync.content.points.refine import Refined, refine


def pair_residual_s(comparison: Comparison, refined: Refined) -> float:
    """Root-mean-square offset by which pairs of cameras by themselves differ from the clocks of all together.

    Each pair counts by the inverse of its variance: two cameras that look along one another tell little.
    """
    square, weight = 0.0, 0.0
    for pair in combinations(range(len(comparison.cameras)), 2):
        chosen = list(pair)
        clocks = refined.clocks.only(chosen)
        sigma = np.zeros_like(clocks.values)
        sigma[1, OFFSET] = comparison.cameras[pair[1]].spacing_s
        alone = refine(
            replace(comparison, cameras=[comparison.cameras[c] for c in chosen], noise_px=comparison.noise_px[chosen]),
            clocks,
            sigma,
            rounds=2,
        )
        difference_s = alone.clocks.values[1, OFFSET] - clocks.values[1, OFFSET]
        information = 1 / max(alone.sigma[1, OFFSET], 1e-9) ** 2
        square, weight = square + information * difference_s**2, weight + information
    return float(np.sqrt(square / weight))
