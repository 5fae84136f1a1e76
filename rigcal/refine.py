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
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from rigcal.agreement import Names
from rigcal.board import Board
from rigcal.bundle import Freedom, Solution, State, rmse_px
from rigcal.camera import Camera
from rigcal.corners import Observations
from rigcal.detections import Finding, Instants
from rigcal.errors import CalibrationError
from rigcal.geometry import Floats, Pose
from rigcal.intrinsics import IntrinsicsResult, lens_freedom
from rigcal.outliers import RejectionRule
from rigcal.placing import Groups, PlacedBoards, groups_of_views, place_boards
from rigcal.robust import RobustSolution, solve_robustly
from rigcal.sisters import LensPrior, with_priors

_EXACT_PX = 0.01  # a detector is never nearer: below it, growth of a residual is rounding


@dataclass(frozen=True, slots=True)
class RefineOptions:
    """How the joint solve is done."""

    free_lenses: bool = True
    """Whether the lenses move too; held when they were given from another capture."""
    bow: bool = False
    """Whether to estimate how the board bends."""
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
    contradictions: tuple[tuple[int, Finding], ...]
    """Those of them that say that a view contradicts others, or is wrong by itself."""
    noisy: tuple[int, ...]
    """Cameras whose lens was held at its own calibration, since shared views contradict it."""
    order_of: Mapping[tuple[int, int], int]
    """Corner order (index into :func:`rigcal.order.corner_orders`) of each (camera, frame) that was numbered anew."""

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
    *,
    priors: Sequence[LensPrior | None] = (),
) -> JointResult:
    """Solve the whole rig.

    Args:
        board: The board.
        lenses: Per camera its lens, and the views that survived its own calibration.
        frames: Per camera the names of its frames.
        instants: Which frames belong together.
        cam_from_rig: Starting poses, the first the identity.
        options: Limits.
        priors: Per camera what its sisters tell of its lens.
    """
    cameras = tuple(lens.camera for lens in lenses)
    names = Names(tuple(lens.camera_id for lens in lenses), tuple(frames))
    groups = groups_of_views(lenses, instants, names)
    placed = place_boards(board, cameras, cam_from_rig, groups.views, names, options.clip_px)
    observations = Observations.of(board.corners_in_board, placed.entries, _weights(groups, placed, lenses))
    freedom = with_priors(lens_freedom(cameras, poses_free=(False, *[True] * (len(cameras) - 1))), priors)
    if not options.free_lenses:
        freedom = Freedom(tuple(np.zeros(len(c.params), dtype=bool) for c in cameras), freedom.poses)
    freedom = replace(freedom, bow=options.bow)
    start = State(cameras, tuple(cam_from_rig), placed.rig_from_board)
    solved = solve_robustly(observations, start, freedom, names, options.rule)
    noisy = _noisy(lenses, solved, options.noisy_ratio) if options.free_lenses else ()
    if noisy:
        freedom = _with_held_lenses(freedom, noisy)
        solved = solve_robustly(observations, start, freedom, names, options.rule)
    _require_joined(solved, names)
    findings = (*groups.findings, *placed.findings, *solved.findings)
    return JointResult(
        solved.solution, solved.observations, freedom, start, findings, solved.findings, noisy, placed.order_of
    )


def _require_joined(solved: RobustSolution, names: Names) -> None:
    """Refuse a rig that falls apart once its bad views are out."""
    seen = np.zeros((len(names.camera_ids), int(solved.observations.board_idx.max(initial=-1)) + 1))
    seen[solved.observations.camera_idx, solved.observations.board_idx] = 1
    _, label = connected_components(csr_array(seen @ seen.T), directed=False)
    apart = [camera for camera, group in enumerate(label) if group != label[0]]
    if not apart:
        return
    lost = [sum(c == camera and f.action == "dropped" for c, f in solved.findings) for camera in apart]
    ids = [names.camera_ids[camera] for camera in apart]
    raise CalibrationError(
        f"every view that joined {', '.join(ids)} to {names.camera_ids[0]} was rejected",
        where="the joint solve",
        expected="views of one board that agree on where it was",
        got=", ".join(f"{n} dropped views of {camera_id}" for n, camera_id in zip(lost, ids, strict=True)),
        do_next="check that the images were taken at the same time, that no camera moved and that there is one board; "
        f"then show it, held still, to {ids[0]} and a neighbour together in 10 or more positions",
    )


def _weights(groups: Groups, placed: PlacedBoards, lenses: Sequence[IntrinsicsResult]) -> dict[tuple[int, int], float]:
    """Weight by (camera, board) of views whose board moved between the exposures of its instant."""
    weights = {}
    for board_idx, group in enumerate(placed.group_of):
        for camera, moved_px in groups.moved_px[group].items():
            variance = max(lenses[camera].rmse_px, _EXACT_PX) ** 2 / 2
            weights[camera, board_idx] = variance / (variance + moved_px**2)
    return weights


def _noisy(lenses: Sequence[IntrinsicsResult], solved: RobustSolution, ratio: float) -> tuple[int, ...]:
    """Cameras whose residuals grew by more than ``ratio`` when they had to agree with the others."""
    camera_idx, residuals = solved.observations.camera_idx, solved.solution.residuals_px
    return tuple(
        camera
        for camera, lens in enumerate(lenses)
        if (rmse_px(residuals[camera_idx == camera]) or 0.0) > ratio * max(lens.rmse_px, _EXACT_PX)
    )


def _with_held_lenses(freedom: Freedom, noisy: Sequence[int]) -> Freedom:
    """The same freedom, with the lenses of ``noisy`` cameras held."""
    return replace(freedom, params=tuple(free & (camera not in noisy) for camera, free in enumerate(freedom.params)))
