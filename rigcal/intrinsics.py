"""The lens of one camera from views of the board.

No guess of the focal length is needed: a list of focal lengths is tried without distortion, the one that explains the
boards best starts a robust solve, bad views and corners are rejected by the rule of :mod:`rigcal.outliers`, and least
squares over the rest gives the answer with its covariance (Zhang, A Flexible New Technique for Camera Calibration,
PAMI 2000, with a solver of our own).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from rigcal.agreement import Names
from rigcal.board import Board
from rigcal.boardpose import board_poses
from rigcal.bundle import POSE, Freedom, SolveOptions, State, rmse_px, solve
from rigcal.camera import MODELS, Camera
from rigcal.corners import Observations
from rigcal.detections import BoardDetections, BoardView, Finding
from rigcal.errors import ImageSizeError, OptionError, TooFewViewsError
from rigcal.geometry import Floats, Pose
from rigcal.outliers import RejectionRule
from rigcal.robust import RobustSolution, solve_robustly

MIN_VIEWS = 3
"""Views below which a lens with free centre and distortion is not determined (Zhang 2000, section 3.1)."""
PINHOLES, FISHEYE = ("opencv5", "opencv4"), "fisheye4"
"""Models that are chosen from: a pinhole lens, the first kept when in doubt, or a fisheye lens."""
FISHEYE_MARGIN = 0.5
"""Held-out error of the fisheye model relative to either pinhole's, below which it is chosen. Twelve simulated fisheye
lenses of 120 degrees have 0.05 to 0.31, twelve real cameras with ordinary lenses 0.74 and more."""
MODEL_VIEWS = 40
"""Views that choose the model, spread over all: what tells the models apart is far above what these leave open."""
HELD_SHARE = 0.7
"""One sigma over the prior's, above which a coefficient was not determined: the views told less than the prior."""


@dataclass(frozen=True, slots=True)
class IntrinsicsOptions:
    """How lenses are calibrated.

    Raises:
        OptionError: for an unknown model or too small a minimum.
    """

    model: str = "opencv5"
    """Lens model, one of :data:`rigcal.camera.MODELS`."""
    min_corners: int = 6
    """Corners that a view needs to take part."""
    rule: RejectionRule = field(default_factory=RejectionRule)

    def __post_init__(self) -> None:
        if self.model not in MODELS:
            raise OptionError("model", expected="one of " + ", ".join(MODELS), got=self.model)
        if self.min_corners < 4:
            raise OptionError("min_corners", expected="4 or more", got=self.min_corners)


@dataclass(frozen=True, slots=True, eq=False)
class IntrinsicsResult:
    """The lens of one camera and its evidence."""

    camera_id: str
    camera: Camera
    rmse_px: float
    """Over the corners that were used to calibrate the lens, in this capture or the one that it came from."""
    covariance: Floats
    """(P, P) of the coefficients; zeros where they were given, not estimated."""
    views: tuple[BoardView, ...]
    """Views that were used, with the corners that were kept."""
    cam_from_board: tuple[Pose, ...]
    """Where the board was in each used view."""
    observations: Observations
    """Corners that were used."""
    residuals_px: Floats
    """(N, 2) observed minus projected pixels of the used corners."""
    findings: tuple[Finding, ...]
    """Views and corners that were dropped, and why."""

    @property
    def sigma(self) -> Floats:
        """(P,) one sigma of each coefficient."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def calibrate_camera(detections: BoardDetections, board: Board, options: IntrinsicsOptions) -> IntrinsicsResult:
    """Calibrate one camera.

    Raises:
        TooFewViewsError: with fewer than :data:`MIN_VIEWS` usable views, before or after rejection.
    """
    corners = board.corners_in_board
    views = [view for view in detections.views if len(view.corner_ids) >= options.min_corners]
    _enough(detections.camera_id, len(views), 0)
    start = first_guess(options.model, detections.size_wh, corners, views)
    posed = [(view, poses[0].cam_from_board) for view in views if (poses := board_poses(start, corners, view))]
    _enough(detections.camera_id, len(posed), len(views) - len(posed))
    observations = Observations.of(corners, [(0, i, view) for i, (view, _) in enumerate(posed)])
    freedom = lens_freedom((start,), poses_free=(False,))
    state = State((start,), (Pose.identity(),), tuple(pose for _, pose in posed))
    focal_only = Freedom((np.arange(len(start.params)) < 2,), freedom.poses)
    quickly = SolveOptions(robust=True, max_iterations=30, covariance=False)
    state = solve(observations, state, focal_only, quickly).state
    solved = solve_robustly(observations, state, freedom, _names(detections), options.rule)
    used = np.unique(solved.observations.board_idx)
    _enough(detections.camera_id, len(used), len(views) - len(used))
    return _result(detections.camera_id, solved, rmse_px(solved.solution.residuals_px) or 0.0)


def _names(detections: BoardDetections) -> Names:
    return Names((detections.camera_id,), (detections.frames,))


def _result(camera_id: str, solved: RobustSolution, lens_rmse_px: float) -> IntrinsicsResult:
    solution, observations = solved.solution, solved.observations
    camera = solution.state.cameras[0]
    used = [int(board_idx) for board_idx in np.unique(observations.board_idx)]
    return IntrinsicsResult(
        camera_id,
        camera,
        lens_rmse_px,
        solution.camera_covariance(0, range(POSE, POSE + len(camera.params))),
        tuple(_kept_view(observations, board_idx) for board_idx in used),
        tuple(solution.state.rig_from_board[board_idx] for board_idx in used),
        observations,
        solution.residuals_px,
        tuple(finding for _, finding in solved.findings),
    )


def choose_model(detections: BoardDetections, board: Board, options: IntrinsicsOptions) -> str:
    """The model that best predicts views kept out of its solve: fisheye where it beats every pinhole clearly.

    A fitting error would favour the model with more coefficients; the error on views that were kept out does not. A
    fisheye may only seem the better one because few views do not hold all coefficients of a pinhole lens, so it must
    beat the pinhole with fewer ones too. With too few views to halve, the first pinhole is kept.
    """

    every = max(len(detections.views) // MODEL_VIEWS, 1)
    some = replace(detections, views=detections.views[::every])

    def error(model: str) -> float:
        return held_out_rmse_px(some, board, replace(options, model=model))

    fisheye = error(FISHEYE)
    return FISHEYE if all(fisheye < FISHEYE_MARGIN * error(pinhole) for pinhole in PINHOLES) else PINHOLES[0]


def held_out_rmse_px(detections: BoardDetections, board: Board, options: IntrinsicsOptions) -> float:
    """RMSE over each half of the views with the lens calibrated on the other half; infinite with too few views.

    A view counts for ``20 px`` at the most, so that one bad view decides nothing.
    """
    corners, errors = board.corners_in_board, []
    for part in (0, 1):
        try:
            half = calibrate_camera(replace(detections, views=detections.views[part::2]), board, options)
        except TooFewViewsError:
            return float("inf")
        for view in detections.views[1 - part :: 2]:
            poses = board_poses(half.camera, corners, view)
            errors.append(min(poses[0].rmse_px if poses else 20.0, 20.0))
    return float(np.sqrt(np.mean(np.square(errors))))


def hold_camera(
    detections: BoardDetections, board: Board, camera: Camera, lens_rmse_px: float, options: IntrinsicsOptions
) -> IntrinsicsResult:
    """Place the boards that a camera with a known lens saw: for lenses calibrated from another capture.

    Args:
        detections: Views of this capture.
        board: The board.
        camera: The lens, for images of the same size.
        lens_rmse_px: RMSE of the calibration that gave the lens.
        options: Limits; the model is the camera's.

    Raises:
        ImageSizeError: where the images have another size than the lens was calibrated for.
        TooFewViewsError: where no view is usable.
    """
    if detections.size_wh != camera.size_wh:
        raise ImageSizeError(
            detections.camera_id,
            where="this capture",
            expected_wh=camera.size_wh,
            got_wh=detections.size_wh,
            source="the capture that its lens was calibrated from",
        )
    corners = board.corners_in_board
    views = [view for view in detections.views if len(view.corner_ids) >= options.min_corners]
    posed = [(view, poses[0].cam_from_board) for view in views if (poses := board_poses(camera, corners, view))]
    if not posed:
        raise TooFewViewsError(detections.camera_id, views=0, needed=1, dropped=len(views))
    observations = Observations.of(corners, [(0, i, view) for i, (view, _) in enumerate(posed)])
    freedom = Freedom((np.zeros(len(camera.params), dtype=bool),), np.array([False]))
    state = State((camera,), (Pose.identity(),), tuple(pose for _, pose in posed))
    solved = solve_robustly(observations, state, freedom, _names(detections), options.rule)
    return _result(detections.camera_id, solved, lens_rmse_px)


def first_guess(
    model: str, size_wh: tuple[int, int], corners_in_board: Floats, views: list[BoardView], *, most: int = 12
) -> Camera:
    """A lens without distortion whose focal length explains the views best, its centre the image's.

    Tries 13 focal lengths from 0.25 to 8 times the image's longer side, a third apart, on at most ``most`` views. Of
    those within a tenth of the best the one is taken that is nearest to the image's longer side (a view of 53 degrees):
    boards that all face the camera are explained by any, and a solve that starts at an extreme one runs away.
    """
    longer = max(size_wh)
    chosen = [views[i] for i in np.unique(np.linspace(0, len(views) - 1, most).astype(int))]
    centre = [(size_wh[0] - 1) / 2, (size_wh[1] - 1) / 2]
    focals = np.geomspace(0.25, 8.0, 13) * longer
    cameras = [
        Camera(model, size_wh, np.array([focal, focal, *centre, *[0.0] * (len(MODELS[model]) - 4)])) for focal in focals
    ]
    scores = np.array(
        [
            np.median(
                [
                    poses[0].rmse_px if (poses := board_poses(camera, corners_in_board, view)) else float(longer)
                    for view in chosen
                ]
            )
            for camera in cameras
        ]
    )
    as_good = np.flatnonzero(scores <= 1.1 * scores.min())
    return cameras[int(as_good[np.abs(np.log(focals[as_good] / longer)).argmin()])]


def lens_freedom(cameras: tuple[Camera, ...], *, poses_free: tuple[bool, ...]) -> Freedom:
    """Every coefficient free, under weak priors that hold only what the views leave undetermined.

    The principal point lies within 5 % of the image's longer side of its centre (one sigma; the real captures at hand
    lie within 2.7 %), and no distortion term moves the image's corner by more than about 30 % (radial) or 1 %
    (tangential) of its distance from the centre. Views that determine a coefficient override its prior a hundredfold.
    """
    means, information = [], []
    for camera in cameras:
        width, height = camera.size_wh
        focal = float(camera.params[:2].mean())
        reach = np.hypot(width, height) / 2 / focal
        reach = min(reach, np.pi / 2) if camera.is_fisheye else reach
        power = {"k1": 2, "k2": 4, "k3": 6, "k4": 2, "k5": 4, "k6": 6, "p1": 1, "p2": 1}
        if camera.is_fisheye:
            power |= {"k4": 8}
        mean = np.zeros(len(camera.params))
        sigma = np.full(len(camera.params), np.inf)
        mean[2:4] = (width - 1) / 2, (height - 1) / 2
        sigma[2:4] = 0.05 * max(width, height)
        for i, name in enumerate(camera.names[4:], start=4):
            sigma[i] = (0.01 if name.startswith("p") else 0.3) / reach ** power[name]
        means.append(mean)
        information.append(np.diag(sigma**-2.0))
    free = tuple(np.ones(len(camera.params), dtype=bool) for camera in cameras)
    return Freedom(free, np.array(poses_free), tuple(means), tuple(information))


def undetermined(camera: Camera, sigma: Floats) -> tuple[str, ...]:
    """Coefficients that the views did not determine: their prior (:func:`lens_freedom`) holds them.

    Args:
        camera: The lens after the solve.
        sigma: (P,) one sigma of each coefficient after the solve, prior included.
    """
    information = np.diag(lens_freedom((camera,), poses_free=(False,)).prior_information[0])
    with np.errstate(divide="ignore"):
        prior_sigma = 1 / np.sqrt(information)
    return tuple(name for name, s, p in zip(camera.names, sigma, prior_sigma, strict=True) if s > HELD_SHARE * p)


def _enough(camera_id: str, views: int, dropped: int) -> None:
    if views < MIN_VIEWS:
        raise TooFewViewsError(camera_id, views=views, needed=MIN_VIEWS, dropped=dropped)


def _kept_view(observations: Observations, board_idx: int) -> BoardView:
    rows = observations.board_idx == board_idx
    return BoardView(int(observations.frame_idx[rows][0]), observations.corner_ids[rows], observations.pixels[rows])
