"""How lenses, pairs and rigs are all solved: robustly, then judged, then by least squares over what was believed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from rigcal.agreement import MEDIAN_OF_SQUARE, Names, disagreeing_views, view_sigmas
from rigcal.bundle import Freedom, Solution, SolveOptions, State, solve
from rigcal.corners import Observations
from rigcal.detections import Finding
from rigcal.geometry import Ints
from rigcal.outliers import RejectionRule, reject, view_limits_px

FEW_ALONE = 0.05
"""Share of a camera's views (and two in any case) that may pull at its lens and be wrong. On a real capture the only
three views near the edge of a webcam's image pulled 16 to 21 times as hard as the median, and told the truth."""
_ROBUST = SolveOptions(robust=True, tolerance=1e-6, covariance=False)  # its residuals are judged, nothing else
_EXACT_PX = 0.01  # a detector is never nearer: below it, what pulls at the cameras is rounding


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
    robust = solve(observations, start, freedom, _ROBUST)
    believed, disagreements = _believed(observations, robust, names, rule)
    state, residuals = robust.state, robust.residuals_px
    if disagreements:
        near = solve(believed, state, _held(state), replace(_ROBUST, robust=False))  # a board may start far off
        settled = solve(believed, near.state, _held(state), _ROBUST)
        state, residuals = settled.state, settled.residuals_px
    rejection = reject(believed, residuals, names, rule)
    kept = believed.subset(rejection.keep)
    squared = kept.weights * (residuals[rejection.keep] ** 2).sum(axis=1)
    noise_px = float(np.sqrt(np.median(squared) / MEDIAN_OF_SQUARE)) if len(squared) else 0.0
    options = SolveOptions(sigma_px=max(noise_px, 0.01))
    final = solve(kept, state, freedom, options)
    believed, pulling = _without_pulling_views(kept, final, names, rule)
    if pulling:
        kept, final = believed, solve(believed, final.state, freedom, options)
    return RobustSolution(final, kept, (*disagreements, *rejection.findings, *pulling))


def _without_pulling_views(
    observations: Observations, solution: Solution, names: Names, rule: RejectionRule
) -> tuple[Observations, list[tuple[int, Finding]]]:
    """The observations without boards that bend the cameras to fit, and what to tell of those.

    Of a board that several cameras saw, the views that are at fault are looked for again, by half the limits; where
    none is found, none is believed. Of boards that one camera alone saw, a few may be wrong; where many pull, it is the
    lens model that does not fit where they are, and they stay.
    """
    starts = observations.view_starts
    board = observations.board_idx[starts]
    pull = solution.pull[board]
    ratios = pull / max(float(np.median(pull[pull > 0])) if (pull > 0).any() else 1.0, 1.0)
    suspects = np.flatnonzero(ratios > rule.pull_ratio)
    if solution.sigma_px < _EXACT_PX or _most(observations, suspects):
        return observations, []
    suspects = _few_alone(observations, suspects)
    if not len(suspects):
        return observations, []
    limits = view_limits_px(observations, view_sigmas(observations, solution.residuals_px), rule) / 2
    verdicts = disagreeing_views(observations, solution.state, limits, suspects.tolist(), names)
    settled = {int(board[v]) for v in verdicts}
    for v in suspects:
        if int(board[v]) not in settled:
            verdicts[int(v)] = f"pulls at the cameras {ratios[v]:.0f} times as hard as the median view"
    return _dropped(observations, verdicts, names)


def _dropped(
    observations: Observations, verdicts: Mapping[int, str], names: Names
) -> tuple[Observations, list[tuple[int, Finding]]]:
    """The observations without the views of ``verdicts``, and those as findings."""
    starts = observations.view_starts
    camera, frame = observations.camera_idx[starts], observations.frame_idx[starts]
    view_of = np.repeat(np.arange(len(starts)), np.diff(np.append(starts, len(observations))))
    findings = [
        (int(camera[v]), Finding(names.frames[camera[v]][frame[v]], "dropped", reason))
        for v, reason in sorted(verdicts.items())
    ]
    return observations.subset(~np.isin(view_of, list(verdicts))), findings


def _believed(
    observations: Observations, robust: Solution, names: Names, rule: RejectionRule
) -> tuple[Observations, list[tuple[int, Finding]]]:
    """The observations without views that disagree with others of their board, and what to tell of those."""
    sigmas = view_sigmas(observations, robust.residuals_px)
    limits = view_limits_px(observations, sigmas, rule)
    suspects = np.flatnonzero(sigmas > limits[observations.camera_idx[observations.view_starts]])
    if _most(observations, suspects):
        return observations, []
    verdicts = disagreeing_views(observations, robust.state, limits, suspects.tolist(), names)
    return _dropped(observations, verdicts, names)


def _few_alone(observations: Observations, suspects: Ints) -> Ints:
    """The suspects without those of a camera's own boards where they are more than :data:`FEW_ALONE` of its views."""
    starts = observations.view_starts
    camera, board = observations.camera_idx[starts], observations.board_idx[starts]
    alone = suspects[np.bincount(board)[board[suspects]] == 1]
    counts, views = np.bincount(camera[alone], minlength=int(camera.max()) + 1), np.bincount(camera)
    many = counts > np.maximum(2, FEW_ALONE * views)
    return np.asarray(suspects[~(np.isin(suspects, alone) & many[camera[suspects]])])


def _most(observations: Observations, suspects: Ints) -> bool:
    """Whether suspect views are of more than half of the boards that several cameras saw, if of any of those.

    Then there is no culprit: the cameras are not exposed together, or the boards are not one board.
    """
    board = observations.board_idx[observations.view_starts]
    shared = np.bincount(board) > 1
    suspect = np.isin(np.arange(len(shared)), board[suspects])
    return bool((suspect & shared).sum() > 0.5 * shared.sum() > 0)


def _held(state: State) -> Freedom:
    """Everything held but the boards."""
    none = np.zeros(len(state.cameras), dtype=bool)
    return Freedom(tuple(np.zeros(len(c.params), dtype=bool) for c in state.cameras), none)
