"""Whether people decide a camera's clock, and in words why not."""

from __future__ import annotations

import numpy as np

from rigcal.sync.content.people.search import Profile

NEAR_S = 0.2
"""Offsets nearer to the best than this are its own peak: limbs swing half way back in a quarter of a second."""
LEAST_AHEAD = 0.05
"""Share of the agreement by which the best must exceed every other offset, beside what half a step of the search may
cost it: 0.04 at the most on treadmills, where the rival is a whole stride away and exactly as right; 0.07 and more on
the shared captures."""
LEAST_LEAD = 3.0
"""Standard errors by which it must: 0 to 1.6, once 3.0 (then 0.05 ahead), where one simulated camera saw other people
altogether."""
LEAST_AGREEMENT = 0.35
"""Share of the joints that must lie on their epipolar lines at the best offset: 0.46 and more on the shared
captures."""
_STILL = 0.03
"""Spread of the agreement over all offsets that noise alone makes."""


def search_problem(profile: Profile, step_s: float, offset_s: float, search_s: float) -> str:
    """Why the search does not decide a camera's offset; empty where it does."""
    judged = np.isfinite(profile.agreement)
    middle = len(profile.change) // 2
    best = profile.agreement[middle]
    if not judged[middle - 1 : middle + 2].all():
        return (
            f"the best offset, {_ms(offset_s)}, is at the end of what can be compared: {search_s:g} s, or the overlap"
        )
    if best < LEAST_AGREEMENT:
        return (
            f"only {best:.0%} of the joints fit at the best offset: the cameras see different people, "
            "or the rig's calibration is not this site's"
        )
    far = np.flatnonzero(judged & (np.abs(profile.change) * step_s >= NEAR_S))
    if not len(far):
        return f"too few common frames: offsets {NEAR_S:g} s away cannot be compared"
    if best - profile.agreement[far].min() < _STILL + LEAST_AHEAD:
        return "the people hardly move: every offset fits alike"
    half_step = (2 * best - profile.agreement[middle - 1] - profile.agreement[middle + 1]) / 8
    lead = np.where(best - profile.agreement[far] < LEAST_AHEAD + half_step, 0.0, profile.lead[far])
    if lead.min() < LEAST_LEAD:
        rival_s = offset_s + step_s * float(profile.change[far][_rival(profile, far, lead)])
        return f"two offsets fit nearly alike, {_ms(offset_s)} and {_ms(rival_s)}: too little motion, or it repeats"
    return ""


def solution_problem(bound_s: float, moved_s: float, spacing_s: float) -> str:
    """Why the fine solution does not decide a camera's offset; empty where it does.

    Args:
        bound_s: of the fine solution.
        moved_s: from where the joints fit best to the fine solution, two ways to tell the offset.
        spacing_s: time from one frame to the next.
    """
    if bound_s > spacing_s / 2:
        return f"the motion tells the offset to {_ms(bound_s)} only, half a frame is {_ms(spacing_s / 2)}"
    if abs(moved_s) > max(bound_s, spacing_s / 2):
        return f"where most joints fit and where they fit best on average differ by {_ms(abs(moved_s))}"
    return ""


def _rival(
    profile: Profile,
    far: np.ndarray[tuple[int, ...], np.dtype[np.intp]],
    lead: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
) -> int:
    """Index into ``far`` of the offset that fits best of those that do not fall clearly behind."""
    return int(np.argmax(np.where(lead < LEAST_LEAD, profile.agreement[far], -np.inf)))


def _ms(seconds: float) -> str:
    return f"{seconds * 1e3:.3g} ms" if abs(seconds) < 0.1 else f"{seconds * 1e3:.0f} ms"
