"""The pose of one camera relative to another from the boards that both saw: the paper's extrinsics.

Every shared view proposes a relative pose, in each combination of the two planar solutions of either camera and with
each corner order that the board allows (:mod:`rigcal.order`). The proposal that explains the most views wins, the views
then say which order each of them has, and a solve with the lenses held gives the pose, its covariance and its RMSE.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, product

import numpy as np

from rigcal.agreement import Names
from rigcal.board import Board
from rigcal.boardpose import board_poses
from rigcal.bundle import Freedom, State, rmse_px
from rigcal.camera import Camera
from rigcal.corners import Observations
from rigcal.detections import BoardView, Instants
from rigcal.geometry import Floats, Ints, Pose
from rigcal.intrinsics import IntrinsicsResult
from rigcal.order import corner_orders, reordered
from rigcal.outliers import RejectionRule
from rigcal.robust import solve_robustly

MIN_SHARED_VIEWS = 2
"""Shared views below which two cameras are not joined: one view alone cannot be checked by another."""


@dataclass(frozen=True, slots=True)
class PairwiseOptions:
    """How pairs are solved."""

    proposals: int = 15
    """Views that propose a pose."""
    judges: int = 40
    """Views that judge the proposals."""
    clip_px: float = 20.0
    """Error at which a view counts as not explained."""
    agree_px: float = 5.0
    """Error at which a view agrees with a proposal well enough to start from."""
    enough: float = 0.9
    """Share of agreeing views that ends the search."""
    rule: RejectionRule = field(default_factory=RejectionRule)


@dataclass(frozen=True, slots=True, eq=False)
class PairPose:
    """Two cameras joined by shared board views."""

    first: int
    """Index of one camera."""
    second: int
    """Index of the other camera."""
    second_from_first: Pose
    covariance: Floats
    """(6, 6) of ``second_from_first``, rotation (rad) then translation (m)."""
    board_distance_m: float
    """Mean distance of the boards from the second camera: where the pair was measured."""
    views: int
    """Shared views that were used."""
    rmse_px: float
    """Over the used corners of both cameras, lenses held."""
    turned: tuple[int, ...]
    """Instants at which the corner orders of the two cameras differ by a turn of the board."""

    def inverse(self) -> PairPose:
        """The same pair from the other camera."""
        R, t = self.second_from_first.rotation, self.second_from_first.translation_m
        change = np.zeros((6, 6))  # of the inverse's left perturbation by the pose's own
        change[:3, :3] = change[3:, 3:] = -R.T
        change[3:, :3] = R.T @ np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
        return replace(
            self,
            first=self.second,
            second=self.first,
            second_from_first=self.second_from_first.inverse(),
            covariance=change @ self.covariance @ change.T,
        )

    @property
    def point_variance_m2(self) -> float:
        """Variance that the pair adds to the place of a point at the boards' distance: the chain's edge weight."""
        rotation, translation = np.trace(self.covariance[:3, :3]), np.trace(self.covariance[3:, 3:])
        return float(translation + self.board_distance_m**2 * rotation)


def solve_pair(
    board: Board,
    cameras: tuple[Camera, Camera],
    shared: Sequence[tuple[int, BoardView, BoardView]],
    indices: tuple[int, int],
    options: PairwiseOptions,
) -> PairPose | None:
    """Solve one pair.

    Args:
        board: The board.
        cameras: The lenses of both.
        shared: (instant, view of the first, view of the second).
        indices: Which cameras of the rig they are.
        options: Limits.

    Returns:
        The pair; None where fewer than :data:`MIN_SHARED_VIEWS` views agree on a pose.
    """
    corners = board.corners_in_board
    orders = corner_orders(board)
    posed = _posed(corners, cameras, shared, orders)
    if len(posed) < MIN_SHARED_VIEWS:
        return None
    start = _consensus(corners, cameras[1], posed, orders, options)
    errors = np.stack([_errors(corners, cameras[1], posed, start, order) for order in orders])  # (O, V)
    order_of = errors.argmin(axis=0)
    agreeing = np.flatnonzero(errors.min(axis=0) < options.clip_px)
    if len(agreeing) < MIN_SHARED_VIEWS:
        return None
    entries, boards = [], []
    for board_idx, v in enumerate(agreeing):
        view = posed[v]
        second = reordered(view.second, orders[order_of[v]])
        entries += [(0, board_idx, view.first), (1, board_idx, second)]
        boards.append(_better_pose(corners, cameras[1], view, start, second))
    state = State(cameras, (Pose.identity(), start), tuple(boards))
    no_lens = tuple(np.zeros(len(camera.params), dtype=bool) for camera in cameras)
    frames = tuple(str(i) for i in range(1 + max(view.frame_idx for _, _, view in entries)))
    solved = solve_robustly(
        Observations.of(corners, entries),
        state,
        Freedom(no_lens, np.array([False, True])),
        Names(("first", "second"), (frames, frames)),
        options.rule,
    )
    solution, kept = solved.solution, solved.observations
    both = set(kept.board_idx[kept.camera_idx == 0].tolist()) & set(kept.board_idx[kept.camera_idx == 1].tolist())
    if len(both) < MIN_SHARED_VIEWS:
        return None
    second_from_first = solution.state.cam_from_rig[1]
    centres = [solution.state.rig_from_board[b].apply(corners.mean(axis=0)) for b in sorted(both)]
    return PairPose(
        *indices,
        second_from_first,
        solution.camera_covariance(1, range(6)),
        float(np.linalg.norm(second_from_first.apply(np.array(centres)), axis=1).mean()),
        len(both),
        rmse_px(solution.residuals_px) or 0.0,
        tuple(posed[v].instant for v in agreeing if order_of[v]),
    )


@dataclass(frozen=True, slots=True)
class Pairs:
    """What every two cameras tell of each other."""

    solved: tuple[PairPose, ...]
    unexplained: Mapping[tuple[int, int], int]
    """Of cameras that saw the board together though no pose of theirs explains it: in how many views."""


def solve_pairs(
    board: Board, lenses: Sequence[IntrinsicsResult], instants: Instants, options: PairwiseOptions
) -> Pairs:
    """Solve every two cameras that share views; ``lenses`` (per camera) bring the views that survived their own."""
    by_frame = [{view.frame_idx: view for view in lens.views} for lens in lenses]
    solved, unexplained = [], {}
    for one, two in combinations(range(len(lenses)), 2):
        shared = [
            (instant, by_frame[one][int(row[one])], by_frame[two][int(row[two])])
            for instant, row in enumerate(instants.frame_idx)
            if int(row[one]) in by_frame[one] and int(row[two]) in by_frame[two]
        ]
        pair = solve_pair(board, (lenses[one].camera, lenses[two].camera), shared, (one, two), options)
        if pair is not None:
            solved.append(pair)
        elif len(shared) >= MIN_SHARED_VIEWS:
            unexplained[one, two] = len(shared)
    return Pairs(tuple(solved), unexplained)


@dataclass(frozen=True, slots=True, eq=False)
class _Posed:
    instant: int
    first: BoardView
    second: BoardView
    first_from_board: tuple[Pose, ...]
    second_from_board: tuple[tuple[Pose, ...], ...]  # per corner order


def _posed(
    corners: Floats,
    cameras: tuple[Camera, Camera],
    shared: Sequence[tuple[int, BoardView, BoardView]],
    orders: Sequence[Ints],
) -> list[_Posed]:
    def poses(camera: Camera, view: BoardView) -> tuple[Pose, ...]:
        return tuple(candidate.cam_from_board for candidate in board_poses(camera, corners, view))

    found = []
    for instant, first, second in shared:
        first_from_board = poses(cameras[0], first)
        second_from_board = tuple(poses(cameras[1], reordered(second, order)) for order in orders)
        if first_from_board and all(second_from_board):
            found.append(_Posed(instant, first, second, first_from_board, second_from_board))
    return found


def _consensus(
    corners: Floats, camera: Camera, posed: Sequence[_Posed], orders: Sequence[Ints], options: PairwiseOptions
) -> Pose:
    """The proposal with the least clipped error over the judging views, or the first that nearly all agree with."""
    judges = [posed[i] for i in _spread(len(posed), options.judges)]
    best: tuple[float, Pose] | None = None
    for i in _spread(len(posed), options.proposals):
        view = posed[i]
        for seconds, first in product(view.second_from_board, view.first_from_board):
            for second in seconds:
                proposal = second @ first.inverse()
                errors = np.stack([_errors(corners, camera, judges, proposal, order) for order in orders]).min(axis=0)
                score = float(np.minimum(errors, options.clip_px).sum())
                if best is None or score < best[0]:
                    best = (score, proposal)
                if np.mean(errors < options.agree_px) >= options.enough:
                    return proposal
    if best is None:
        raise ValueError("no view proposed a pose")
    return best[1]


def _errors(corners: Floats, camera: Camera, views: Sequence[_Posed], pose: Pose, order: Ints) -> Floats:
    """(V,) RMSE of each view in the second camera when the first camera places the board, best of its solutions."""
    errors = np.full(len(views), np.inf)
    for solution in range(2):
        rows = [v for v, view in enumerate(views) if len(view.first_from_board) > solution]
        if not rows:
            continue
        seen = [reordered(views[v].second, order) for v in rows]
        points = [
            views[v].first_from_board[solution].apply(corners[view.corner_ids])
            for v, view in zip(rows, seen, strict=True)
        ]
        gap = camera.project(pose.apply(np.concatenate(points))) - np.concatenate([view.corners_px for view in seen])
        squared = np.where(np.isfinite(gap).all(axis=1), (gap**2).sum(axis=1), 1e12)
        starts = np.concatenate([[0], np.cumsum([len(view.corner_ids) for view in seen])[:-1]])
        mean = np.add.reduceat(squared, starts) / [len(view.corner_ids) for view in seen]
        errors[rows] = np.minimum(errors[rows], np.sqrt(mean))
    return errors


def _better_pose(corners: Floats, camera: Camera, view: _Posed, second_from_first: Pose, second: BoardView) -> Pose:
    """Of the first camera's planar solutions, the one that the second camera confirms."""

    def error(first_from_board: Pose) -> float:
        gap = camera.project((second_from_first @ first_from_board).apply(corners[second.corner_ids]))
        return float(np.nan_to_num(np.abs(gap - second.corners_px), nan=1e6).mean())

    return min(view.first_from_board, key=error)


def _spread(count: int, most: int) -> list[int]:
    """At most ``most`` indices spread evenly over ``count``."""
    return [int(i) for i in np.unique(np.linspace(0, count - 1, min(most, count)).round())]
