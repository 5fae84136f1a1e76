"""Whether the content decides a camera's clock, and in words why not."""

from __future__ import annotations

import numpy as np
from scipy import stats

from rigcal.sync.content.points.search import Found
from rigcal.sync.content.points.seen import SeenPoints, noise_px

CLEAR_LEAD = 4.0
"""Standard errors by which the best offset must lead before its rival."""
LEAST_BLOCKS = 3.0
"""Blocks of motion below which the scatter between them says too little."""
LEAST_MOTION_S = 1.2
"""Motion below which a hand has not turned often enough to tell a clock from a calibration that is off."""
_FLAT = 0.9  # of the median cost: the best offset of a still board, or of motion along the lines
_ALIKE, _UNCLEAR = 0.25, 0.5  # of the way from the best cost to the median one
_LEAST_MOTION_PX = 1.0
_THREE_SIGMA = float(stats.norm.cdf(3.0))


def bound_factor(blocks: float) -> float:
    """Standard deviations that hold the truth as surely as three of a normal distribution do, for few blocks."""
    return float(stats.t.ppf(_THREE_SIGMA, max(blocks - 1, 1.0)))


def search_problem(found: Found | None, seen: SeenPoints, search_s: float) -> str:
    """Why the search does not decide; empty where it does."""
    if not np.isfinite(seen.px).any():
        return "no points were found in its frames"
    if found is None:
        return "too little overlap: no other camera saw the same points at the same time"
    if not _moves(seen):
        return "nothing moves"
    if found.depth > _FLAT:
        return "nothing moves across the epipolar lines, so that every offset fits alike"
    unclear = found.rival_height < _UNCLEAR and found.lead < CLEAR_LEAD
    if found.rival_s is not None and (unclear or found.rival_height < _ALIKE):
        return f"the best two offsets are alike: {_ms(found.offset_s)} and {_ms(found.rival_s)}"
    if found.at_edge:
        return f"the best offset, {_ms(found.offset_s)}, is at an end of the search, {search_s:g} s either way"
    return ""


def solution_problem(bound_s: float, blocks: float, block_s: float, spacing_s: float, *, settled: bool) -> str:
    """Why the solution does not decide; empty where it does."""
    least_s = max(LEAST_BLOCKS * block_s, LEAST_MOTION_S)
    if blocks * block_s < least_s:
        return f"too little motion: it all lies within {blocks * block_s:.1f} s, at least {least_s:.1f} s are needed"
    if not settled:
        return "the solution does not come to rest: the tracks contradict one another, or the rig"
    if bound_s > spacing_s / 2:
        return f"the motion tells the offset to {_ms(bound_s)} only, half a frame is {_ms(spacing_s / 2)}"
    return ""


def _moves(seen: SeenPoints) -> bool:
    """Whether points wander by more than their noise."""
    followed = seen.px[:, np.isfinite(seen.px).all(axis=-1).sum(axis=0) > 1]
    spread = np.nanstd(followed, axis=0).max(initial=0.0)
    return bool(spread > _LEAST_MOTION_PX + 1.5 * noise_px(seen))


def _ms(seconds: float) -> str:
    return f"{seconds * 1e3:.3g} ms" if abs(seconds) < 0.1 else f"{seconds * 1e3:.0f} ms"
