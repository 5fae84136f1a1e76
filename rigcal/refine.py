"""The joint solve: every camera and every board at once, which removes the error that compounds along the chain.

Boards seen by several cameras at an instant share one pose; boards seen by one camera still hold its lens. It starts
from the chain, solves robustly, rejects by the rule of :mod:`rigcal.outliers`, and ends with least squares over the
rest, whose covariance is the rig's.

Where cameras are not exposed together and boards move, views of one instant contradict each other by more than their
own noise, and alike over all corners of a view; a lens that is free bends to please them. So a camera whose residuals
grow by more than :attr:`RefineOptions.noisy_ratio` keeps the lens of its calibration alone, and the rest is solved
again.
(On a capture of four webcams up to 43 ms apart, free lenses moved by up to 6 sigma and put two of six camera distances
4-6 % off, under the prior of their own covariance still 4-6 %; held, all six are within 2.4 %.)

An instant's board starts at whichever single-camera pose all its cameras together agree with best (both planar
solutions of each are tried), which settles the planar ambiguity and is not led astray by one bad view.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rigcal.board import Board, Checkerboard
from rigcal.boardpose import board_poses
from rigcal.bundle import Freedom, Observations, Solution, State, rmse_px
from rigcal.camera import Camera
from rigcal.detections import BoardView, Finding, Instants
from rigcal.geometry import Floats, Pose
from rigcal.intrinsics import IntrinsicsResult, lens_freedom, solve_and_reject
from rigcal.outliers import RejectionRule
from rigcal.pairwise import turned_findings, turned_view

_EXACT_PX = 0.01  # a detector is never nearer: below it, growth of a residual is rounding


@dataclass(frozen=True, slots=True)
class RefineOptions:
    """How the joint solve is done."""

    free_lenses: bool = True
    """Whether the lenses move too; held when they were given from another capture."""
    noisy_ratio: float = 1.5
    """Joint residual over that of the camera alone at which its lens is not judged by shared views."""
    clip_px: float = 20.0
    """Error at which a view does not count when a board's starting pose is chosen."""
    rule: RejectionRule = field(default_factory=RejectionRule)


@dataclass(frozen=True, slots=True, eq=False)
class JointResult:
    """The solved rig and its evidence."""

    solution: Solution
    """State, covariance and residuals; board ``b`` of the state is ``boards[b]``."""
    observations: Observations
    """Corners that were used."""
    freedom: Freedom
    """What was free: for solving parts of it again."""
    start: State
    """Where the solve began: the chain and the lenses calibrated alone."""
    findings: tuple[tuple[int, Finding], ...]
    """(camera index, what was done)."""
    noisy: tuple[int, ...]
    """Cameras whose lens was held at its own calibration, since shared views contradict it."""

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The lenses."""
        return self.solution.state.cameras

    @property
    def cam_from_rig(self) -> tuple[Pose, ...]:
        """The poses; the first is the identity."""
        return self.solution.state.cam_from_rig

    def residuals_of(self, camera_idx: int) -> Floats:
        """(n, 2) residuals of one camera's used corners."""
        return np.asarray(self.solution.residuals_px[self.observations.camera_idx == camera_idx])


def refine_rig(
    board: Board,
    lenses: Sequence[IntrinsicsResult],
    frames: Sequence[tuple[str, ...]],
    instants: Instants,
    cam_from_rig: Sequence[Pose],
    options: RefineOptions,
) -> JointResult:
    """Solve the whole rig.

    Args:
        board: The board.
        lenses: Per camera its lens, and the views that survived its own calibration.
        frames: Per camera the names of its frames.
        instants: Which frames belong together.
        cam_from_rig: Starting poses, the first the identity.
        options: Limits.
    """
    corners = board.corners_in_board
    cameras = tuple(lens.camera for lens in lenses)
    turns = (False, True) if isinstance(board, Checkerboard) else (False,)
    entries: list[tuple[int, int, BoardView]] = []
    boards: list[Pose] = []
    turned: list[tuple[int, Finding]] = []
    for group in _groups(lenses, instants):
        start = _starting_pose(corners, cameras, cam_from_rig, group, turns, options.clip_px)
        if start is None:
            continue
        pose, flips = start
        for camera, view in group.items():
            if flips[camera]:
                partner = ", ".join(lenses[c].camera_id for c in group if not flips[c])
                turned += [(camera, f) for f in turned_findings(frames[camera], [view.frame_idx], partner)]
            entries.append((camera, len(boards), turned_view(view, len(corners)) if flips[camera] else view))
        boards.append(pose)
    observations = Observations.of(corners, entries)
    freedom = lens_freedom(cameras, poses_free=(False, *[True] * (len(cameras) - 1)))
    if not options.free_lenses:
        freedom = Freedom(tuple(np.zeros(len(c.params), dtype=bool) for c in cameras), freedom.poses)
    state = State(cameras, tuple(cam_from_rig), tuple(boards))
    solution, kept, findings = solve_and_reject(observations, state, freedom, tuple(frames), options.rule)
    noisy = _noisy(lenses, solution, kept, options.noisy_ratio) if options.free_lenses else ()
    if noisy:
        freedom = _with_held_lenses(freedom, noisy)
        solution, kept, findings = solve_and_reject(observations, state, freedom, tuple(frames), options.rule)
    return JointResult(solution, kept, freedom, state, (*turned, *findings), noisy)


def _noisy(lenses: Sequence[IntrinsicsResult], solution: Solution, kept: Observations, ratio: float) -> tuple[int, ...]:
    """Cameras whose residuals grew by more than ``ratio`` when they had to agree with the others."""
    return tuple(
        camera
        for camera, lens in enumerate(lenses)
        if (rmse_px(solution.residuals_px[kept.camera_idx == camera]) or 0.0) > ratio * max(lens.rmse_px, _EXACT_PX)
    )


def _with_held_lenses(freedom: Freedom, noisy: Sequence[int]) -> Freedom:
    """The same freedom, with the lenses of ``noisy`` cameras held."""
    return replace(freedom, params=tuple(free & (camera not in noisy) for camera, free in enumerate(freedom.params)))


def _groups(lenses: Sequence[IntrinsicsResult], instants: Instants) -> list[dict[int, BoardView]]:
    """Views of each instant by camera, in order of time."""
    by_frame = [{view.frame_idx: view for view in lens.views} for lens in lenses]
    groups = []
    for row in instants.frame_idx:
        group = {c: by_frame[c][int(f)] for c, f in enumerate(row) if int(f) in by_frame[c]}
        if group:
            groups.append(group)
    return groups


def _starting_pose(
    corners: Floats,
    cameras: Sequence[Camera],
    cam_from_rig: Sequence[Pose],
    group: Mapping[int, BoardView],
    turns: Sequence[bool],
    clip_px: float,
) -> tuple[Pose, dict[int, bool]] | None:
    """``rig_from_board`` that the group's views agree with best, and which of them are turned by 180 degrees."""
    best: tuple[float, Pose, dict[int, bool]] | None = None
    for proposer, view in group.items():
        rig_from_cam = cam_from_rig[proposer].inverse()
        for candidate in board_poses(cameras[proposer], corners, view):
            rig_from_board = rig_from_cam @ candidate.cam_from_board
            total, flips = 0.0, {}
            for camera, seen in group.items():
                points = (cam_from_rig[camera] @ rig_from_board).apply(corners)
                pixels = cameras[camera].project(points)
                errors = [_gap(pixels, turned_view(seen, len(corners)) if t else seen) for t in turns]
                flips[camera] = len(errors) > 1 and errors[1] < min(errors[0], clip_px)
                total += min(*errors, clip_px)
            if best is None or total < best[0]:
                best = (total, rig_from_board, flips)
    return best[1:] if best else None


def _gap(pixels: Floats, view: BoardView) -> float:
    gap = pixels[view.corner_ids] - view.corners_px
    return float(np.sqrt((gap**2).sum(axis=1).mean())) if np.isfinite(gap).all() else float("inf")
