"""Which views and corners are not to be believed: one stated rule for every solve.

The spread of a camera's residuals is measured robustly: for Gaussian noise of ``sigma`` per axis the squared length of
a residual has the median ``2 ln 2 sigma^2`` and the 90th percentile ``2 ln 10 sigma^2``. A view whose own sigma (from
its median corner) is more than :attr:`RejectionRule.view_ratio` times the median over the camera's views is dropped; of
the others, a corner further off than :attr:`RejectionRule.corner_sigmas` (from the 90th percentile, since the tails of
real corners are heavier than a Gaussian's) is dropped.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigcal.agreement import Names, view_sigmas
from rigcal.corners import Observations
from rigcal.detections import Finding
from rigcal.geometry import Bools, Floats

_NINE_TENTHS_OF_SQUARE = 2 * np.log(10)


@dataclass(frozen=True, slots=True)
class RejectionRule:
    """Limits of the rule, in multiples of the camera's own spread."""

    view_ratio: float = 3.0
    """A view's sigma over the median view's."""
    corner_sigmas: float = 6.0
    """A corner's distance over its camera's sigma: for Gaussian noise one corner in 65 million is that far off."""
    pull_ratio: float = 6.0
    """How hard a board may pull at the cameras, over the median board: for Gaussian noise about one in a million pulls
    harder. Such a board fits well enough, but only because lenses and poses bend to it."""
    floor_px: float = 0.1
    """Spread below which nothing is rejected: a detector's own noise on a sharp board."""


@dataclass(frozen=True, slots=True, eq=False)
class Rejection:
    """What the rule kept."""

    keep: Bools
    """(N,) rows to be kept."""
    findings: tuple[tuple[int, Finding], ...]
    """(camera index, finding) for each view that lost corners."""


def view_limits_px(observations: Observations, sigmas_px: Floats, rule: RejectionRule) -> Floats:
    """(C,) sigma above which a view of each camera is not believed; ``sigmas_px`` (W,) are those of its views."""
    of_view = observations.camera_idx[observations.view_starts]
    count = int(of_view.max(initial=-1)) + 1
    typical = [float(np.median(sigmas_px[of_view == c])) if (of_view == c).any() else 0.0 for c in range(count)]
    return rule.view_ratio * np.maximum(typical, rule.floor_px)


def reject(observations: Observations, residuals_px: Floats, names: Names, rule: RejectionRule) -> Rejection:
    """Apply the rule to residuals (N, 2) of observations."""
    squared = observations.weights * (residuals_px**2).sum(axis=1)
    keep = np.ones(len(observations), dtype=bool)
    findings: list[tuple[int, Finding]] = []
    starts = observations.view_starts
    ends = np.append(starts[1:], len(observations))
    cameras = observations.camera_idx[starts]
    sigmas = view_sigmas(observations, residuals_px)
    limits_px = view_limits_px(observations, sigmas, rule)
    for camera in np.unique(cameras):
        mine = np.flatnonzero(cameras == camera)
        good = mine[sigmas[mine] <= limits_px[camera]]
        rows = np.concatenate([np.arange(starts[v], ends[v]) for v in good] or [np.zeros(0, dtype=np.int64)])
        spread = rule.floor_px
        if len(rows):
            spread = max(float(np.sqrt(np.quantile(squared[rows], 0.9) / _NINE_TENTHS_OF_SQUARE)), rule.floor_px)
        for v in mine:
            view = slice(int(starts[v]), int(ends[v]))
            frame = names.frames[int(camera)][int(observations.frame_idx[starts[v]])]
            if sigmas[v] > limits_px[camera]:
                keep[view] = False
                error = float(np.sqrt(squared[view].mean()))
                times = rule.view_ratio * sigmas[v] / limits_px[camera]
                reason = f"residual {error:.2f} px, {times:.1f} times the camera's median view"
                findings.append((int(camera), Finding(frame, "dropped", reason)))
                continue
            far = squared[view] > (rule.corner_sigmas * spread) ** 2
            if far.any():
                keep[view] = ~far
                worst = float(np.sqrt(squared[view].max()))
                reason = f"{int(far.sum())} of {len(far)} corners, residual up to {worst:.2f} px"
                findings.append((int(camera), Finding(frame, "downweighted", reason)))
    return Rejection(keep, tuple(findings))
