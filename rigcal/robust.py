"""How lenses, pairs and rigs are all solved: robustly, then judged, then by least squares over what was believed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigcal.agreement import MEDIAN_OF_SQUARE, Names, disagreeing_views, view_sigmas
from rigcal.bundle import Freedom, Observations, Solution, SolveOptions, State, solve
from rigcal.detections import Finding
from rigcal.outliers import RejectionRule, reject, view_limits_px


@dataclass(frozen=True, slots=True, eq=False)
class RobustSolution:
    """A least-squares solution and what it did not believe."""

    solution: Solution
    observations: Observations
    """Corners that were used: rows of ``solution.residuals_px``."""
    findings: tuple[tuple[int, Finding], ...]
    """(camera index, what was rejected)."""


def solve_robustly(
    observations: Observations, start: State, freedom: Freedom, names: Names, rule: RejectionRule
) -> RobustSolution:
    """Solve under a robust loss; judge views that disagree; reject by the rule; least squares over the rest.

    Args:
        observations: Every corner.
        start: Where to begin.
        freedom: What may move.
        names: What cameras and frames are called in findings.
        rule: Limits of the rejection.
    """
    robust = solve(observations, start, freedom, SolveOptions(robust=True))
    believed, state, disagreements = _believed(observations, robust, names, rule)
    residuals = robust.residuals_px
    if disagreements:
        near = solve(believed, state, _held(state), SolveOptions(max_iterations=30))  # a board may start far off
        settled = solve(believed, near.state, _held(state), SolveOptions(robust=True, max_iterations=30))
        state, residuals = settled.state, settled.residuals_px
    rejection = reject(believed, residuals, names, rule)
    kept = believed.subset(rejection.keep)
    squared = kept.weights * (residuals[rejection.keep] ** 2).sum(axis=1)
    noise_px = float(np.sqrt(np.median(squared) / MEDIAN_OF_SQUARE)) if len(squared) else 0.0
    final = solve(kept, state, freedom, SolveOptions(sigma_px=max(noise_px, 0.01)))
    return RobustSolution(final, kept, (*disagreements, *rejection.findings))


def _believed(
    observations: Observations, robust: Solution, names: Names, rule: RejectionRule
) -> tuple[Observations, State, list[tuple[int, Finding]]]:
    """The observations without views that disagree with others of their board, and what to tell of those."""
    sigmas = view_sigmas(observations, robust.residuals_px)
    limits = view_limits_px(observations, sigmas, rule)
    starts = observations.view_starts
    camera, frame = observations.camera_idx[starts], observations.frame_idx[starts]
    suspects = np.flatnonzero(sigmas > limits[camera]).tolist()
    verdicts = disagreeing_views(observations, robust.state, limits, suspects, names)
    if not verdicts:
        return observations, robust.state, []
    view_of = np.repeat(np.arange(len(starts)), np.diff(np.append(starts, len(observations))))
    findings = [
        (int(camera[v]), Finding(names.frames[camera[v]][frame[v]], "dropped", reason))
        for v, reason in sorted(verdicts.items())
    ]
    return observations.subset(~np.isin(view_of, list(verdicts))), robust.state, findings


def _held(state: State) -> Freedom:
    """Everything held but the boards."""
    none = np.zeros(len(state.cameras), dtype=bool)
    return Freedom(tuple(np.zeros(len(c.params), dtype=bool) for c in state.cameras), none)
