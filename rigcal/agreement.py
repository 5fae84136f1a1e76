"""Of the views of one board at one instant that disagree, which are not to be believed.

A stiff board has one pose, so all cameras that see it at an instant must agree on it. Where they do not, the culprit is
looked for in this order:

1. its own residual: a view that no pose of the board explains in its own camera is wrong whatever the others say;
2. the other cameras: of three or more views, those are believed that agree with each other, the view whose absence
   mends the most being left out first;
3. its neighbours in time: a board moves smoothly, so a view that lies off the place between its neighbours in the same
   camera is wrong, if the other view does not lie off its own;
4. where nothing can tell (two views, no neighbours), both are left out, and named as a pair.

Cameras are held while this is judged: it stands between a robust solve and the final one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from rigcal.boardpose import board_poses
from rigcal.bundle import Freedom, Solution, SolveOptions, State, solve
from rigcal.corners import Observations
from rigcal.detections import BoardView
from rigcal.geometry import Floats, Pose

MEDIAN_OF_SQUARE = 2 * np.log(2)
"""Median of the squared length of a residual over the variance per axis, for Gaussian noise."""
NEIGHBOUR_FRAMES = 3
"""How far away, in frames, a neighbour in time may be."""


@dataclass(frozen=True, slots=True)
class Names:
    """What cameras and frames are called in findings."""

    camera_ids: tuple[str, ...]
    frames: tuple[tuple[str, ...], ...]
    """Per camera the names of its frames."""


def view_sigmas(observations: Observations, residuals_px: Floats) -> Floats:
    """(W,) noise per axis of each view, from the median of its corners: a few wild corners do not move it."""
    squared = observations.weights * (residuals_px**2).sum(axis=1)
    bounds = np.append(observations.view_starts, len(observations))
    medians = [np.median(squared[a:b]) for a, b in pairwise(bounds)]
    return np.asarray(np.sqrt(np.array(medians) / MEDIAN_OF_SQUARE))


def disagreeing_views(
    observations: Observations, state: State, limits_px: Floats, suspects: Sequence[int], names: Names
) -> dict[int, str]:
    """Judge the boards of suspect views.

    Args:
        observations: Every corner.
        state: Cameras and boards after a robust solve.
        limits_px: (C,) sigma above which a view of a camera does not fit.
        suspects: Views (as in ``view_starts``) that do not fit the board where the robust solve left it.
        names: For the reasons.

    Returns:
        Views not to be believed, each with the reason.
    """
    court = _Court(observations, state, limits_px, names)
    boards = sorted({int(court.board[v]) for v in suspects})
    groups = [court.views_of(b) for b in boards]
    verdicts: dict[int, str] = {}
    groups = court.by_own_residual([group for group in groups if len(group) > 1], verdicts)
    while groups:
        groups = court.by_other_cameras(groups, verdicts)
    return verdicts


class _Court:
    """Views, their own poses, and fits of groups of them with the cameras held."""

    def __init__(self, observations: Observations, state: State, limits_px: Floats, names: Names) -> None:
        self.obs, self.state, self.limits, self.names = observations, state, limits_px, names
        starts = observations.view_starts
        self.bounds = np.append(starts, len(observations))
        self.camera, self.board = observations.camera_idx[starts], observations.board_idx[starts]
        self.frame = observations.frame_idx[starts]
        self.own: dict[int, Pose] = {}

    def views_of(self, board: int) -> list[int]:
        return [int(v) for v in np.flatnonzero(self.board == board)]

    def view(self, v: int) -> BoardView:
        rows = slice(int(self.bounds[v]), int(self.bounds[v + 1]))
        return BoardView(int(self.frame[v]), self.obs.corner_ids[rows], self.obs.pixels[rows])

    def frame_name(self, v: int) -> str:
        return self.names.frames[int(self.camera[v])][int(self.frame[v])]

    def by_own_residual(self, groups: Sequence[list[int]], verdicts: dict[int, str]) -> list[list[int]]:
        """Each view's best pose by itself; those that have none are out."""
        jobs, starts = [], []
        for v in (v for group in groups for v in group):
            rig_from_cam = self.state.cam_from_rig[self.camera[v]].inverse()
            found = board_poses(self.state.cameras[self.camera[v]], self.obs.corners_in_board, self.view(v))
            for start in (
                self.state.rig_from_board[self.board[v]],
                *(rig_from_cam @ pose.cam_from_board for pose in found),
            ):
                jobs.append([v])
                starts.append(start)
        best: dict[int, float] = {}
        for (v,), pose, (sigma,) in zip(jobs, *self._fit(jobs, starts), strict=True):
            if sigma < best.get(v, np.inf):
                best[v], self.own[v] = sigma, pose
        for v, sigma in best.items():
            if sigma > self.limits[self.camera[v]]:
                verdicts[v] = f"residual {sigma:.2f} px per axis in its own camera alone"
        kept = [[v for v in group if v not in verdicts] for group in groups]
        return [group for group in kept if len(group) > 1]

    def by_other_cameras(self, groups: Sequence[list[int]], verdicts: dict[int, str]) -> list[list[int]]:
        """Groups that agree are done; of the others the view is left out without which the rest agrees best."""
        _, sigmas = self._fit_best(groups)
        at_odds = [group for group, s in zip(groups, sigmas, strict=True) if self._excess(group, s) > 1]
        for one, two in (group for group in at_odds if len(group) == 2):
            self._by_neighbours(one, two, verdicts)
        larger = [group for group in at_odds if len(group) > 2]
        trials = [[v for v in group if v != out] for group in larger for out in group]
        if not trials:
            return []
        _, sigmas = self._fit_best(trials)
        left: list[list[int]] = []
        at = 0
        for group in larger:
            excess = [self._excess(trials[at + i], sigmas[at + i]) for i in range(len(group))]
            at += len(group)
            out = group[int(np.argmin(excess))]
            rest = [v for v in group if v != out]
            others = ", ".join(self.names.camera_ids[self.camera[v]] for v in rest)
            if len(rest) > 1 and min(excess) <= 1:
                verdicts[out] = f"{self._gap_px(out, rest):.1f} px off from where {others} see the board"
            elif len(rest) > 1 and len(group) > 3:
                verdicts[out] = f"agrees least with {others}"
                left.append(rest)
            else:
                verdicts |= dict.fromkeys(group, "disagrees with the board's other views, and they with each other")
        return left

    def _by_neighbours(self, one: int, two: int, verdicts: dict[int, str]) -> None:
        gaps = {one: self._gap_px(one, [two]), two: self._gap_px(two, [one])}
        off = {v: self._off_neighbours_px(v) for v in (one, two)}
        for v, other in ((one, two), (two, one)):
            if off[v] > gaps[v] / 2 and off[other] < gaps[other] / 4:
                partner = self.names.camera_ids[self.camera[other]]
                verdicts[v] = (
                    f"{gaps[v]:.1f} px off from where {partner} sees the board, and {off[v]:.1f} px off from where "
                    "it was in the frames before and after"
                )
                return
        for v, other in ((one, two), (two, one)):
            partner = self.names.camera_ids[self.camera[other]]
            verdicts[v] = (
                f"disagrees with {partner} frame {self.frame_name(other)} by {gaps[v]:.1f} px, and nothing tells which "
                "of the two is wrong: both left out"
            )

    def _fit_best(self, groups: Sequence[list[int]]) -> tuple[list[Pose], list[Floats]]:
        """Each group's pose and sigmas from the best of its views' own poses."""
        jobs = [group for group in groups for _ in group]
        starts = [self.own[v] for group in groups for v in group]
        poses, sigmas = self._fit(jobs, starts)
        best_poses, best_sigmas, at = [], [], 0
        for group in groups:
            excess = [self._excess(group, s) for s in sigmas[at : at + len(group)]]
            best = at + int(np.argmin(excess))
            best_poses.append(poses[best])
            best_sigmas.append(sigmas[best])
            at += len(group)
        return best_poses, best_sigmas

    def _fit(self, jobs: Sequence[Sequence[int]], starts: Sequence[Pose]) -> tuple[list[Pose], list[Floats]]:
        """Least squares of each job's board pose over its views, and the sigma of each of them."""
        if not jobs:
            return [], []
        placed = self.obs.placed(jobs)
        solution = self._solve(placed, starts)
        by_view = dict(zip(_keys(placed), view_sigmas(placed, solution.residuals_px), strict=True))
        return list(solution.state.rig_from_board), [
            np.array([by_view[int(self.camera[v]), b] for v in views]) for b, views in enumerate(jobs)
        ]

    def _solve(self, placed: Observations, starts: Sequence[Pose]) -> Solution:
        held = Freedom(
            tuple(np.zeros(len(c.params), dtype=bool) for c in self.state.cameras),
            np.zeros(len(self.state.cameras), dtype=bool),
        )
        start = State(self.state.cameras, self.state.cam_from_rig, tuple(starts))
        return solve(placed, start, held, SolveOptions(max_iterations=30, tolerance=1e-6, covariance=False))

    def _excess(self, group: Sequence[int], sigmas: Floats) -> float:
        """The worst view's sigma over its limit."""
        return float((sigmas / self.limits[self.camera[list(group)]]).max())

    def _gap_px(self, v: int, others: Sequence[int]) -> float:
        """Root-mean-square distance of a view's corners from where the other views together put them.

        The view itself takes part with a thousandth of its weight, so that directions which the others leave open
        (the distance of a far board) do not count against it.
        """
        placed = self.obs.placed([[v, *others]])
        mine = placed.camera_idx == self.camera[v]
        placed = replace(placed, weights=np.where(mine, 1e-3, 1.0) * placed.weights)
        residuals = self._solve(placed, [self.own[others[0]]]).residuals_px[mine]
        return float(np.sqrt((residuals**2).sum(axis=1).mean()))

    def _off_neighbours_px(self, v: int) -> float:
        """How far a view's corners are from the place between its neighbours in time; NaN without such neighbours."""
        mine = np.flatnonzero(self.camera == self.camera[v])
        order = mine[np.argsort(self.frame[mine])]
        at = int(np.flatnonzero(order == v)[0])
        if not 0 < at < len(order) - 1:
            return float("nan")
        before, after = self.view(order[at - 1]), self.view(order[at + 1])
        view = self.view(v)
        steps = (view.frame_idx - before.frame_idx, after.frame_idx - view.frame_idx)
        common = np.intersect1d(np.intersect1d(view.corner_ids, before.corner_ids), after.corner_ids)
        if max(steps) > NEIGHBOUR_FRAMES or not len(common):
            return float("nan")
        b, m, a = (w.corners_px[np.searchsorted(w.corner_ids, common)] for w in (before, view, after))
        between = b + (a - b) * steps[0] / sum(steps)
        return float(np.sqrt(((m - between) ** 2).sum(axis=1).mean()))


def _keys(observations: Observations) -> list[tuple[int, int]]:
    """(camera, board) of each view."""
    starts = observations.view_starts
    return list(zip(observations.camera_idx[starts].tolist(), observations.board_idx[starts].tolist(), strict=True))
