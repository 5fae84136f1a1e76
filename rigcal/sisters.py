"""Sister cameras: copies of one camera with copies of one lens, as the site file declares them.

Copies differ a little, by :data:`FOCAL_SPREAD` in the focal length and :data:`CENTRE_SPREAD` in the image's centre. So
sisters are judged by each other, and the sisters' lenses tell of a camera whose own views determine its lens poorly:
an empirical Bayes prior (Efron and Morris 1973), whose mean is what the other sisters say together, and whose
covariance is how well they say it and how much copies differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigcal.bundle import POSE, Freedom, SolveOptions, State, rmse_px, solve
from rigcal.camera import Camera
from rigcal.errors import SisterError
from rigcal.geometry import Floats, Pose, freeze
from rigcal.intrinsics import IntrinsicsResult, lens_freedom

FOCAL_SPREAD = 0.005
"""Standard deviation of the focal length between copies of a lens, relative: 0.1 % in four copies of one industrial
camera, 0.3 % and 0.5 % in two stereo pairs of webcam class."""
CENTRE_SPREAD = 0.015
"""The same of the image's centre, relative to the image's longer side: 0.1 %, 1.3 % and 1.7 % in the same cameras."""
DISTORTION_SPREAD = 0.01
"""The same of each distortion term: how far it moves the image's corner, relative to the corner's distance from the
centre. The four industrial copies lie within 0.3 %."""
DIFFERS_SIGMA = 4.0
"""A difference above which a camera is no copy of its sisters, and gets no prior from them."""


@dataclass(frozen=True, slots=True, eq=False)
class LensEstimate:
    """A lens and how surely it is known."""

    camera: Camera
    covariance: Floats
    """(P, P) of the coefficients."""

    @property
    def focal_sigma(self) -> float:
        """One sigma of the focal length, relative."""
        return float((np.sqrt(np.diag(self.covariance)[:2]) / self.camera.params[:2]).max())


@dataclass(frozen=True, slots=True, eq=False)
class LensPrior:
    """What is known of a lens before its own views are looked at."""

    mean: Floats
    """(P,) coefficients."""
    information: Floats
    """(P, P) inverse of the covariance."""

    def __post_init__(self) -> None:
        freeze(self, np.float64, mean=(None,))
        freeze(self, np.float64, information=(len(self.mean), len(self.mean)))


@dataclass(frozen=True, slots=True)
class SisterGap:
    """How far a camera's focal length lies from its sisters'."""

    camera: int
    percent: float
    """Signed: positive where it is longer than theirs."""
    sigmas: float
    """The difference over its own sigma, the spread between copies included."""
    sisters: tuple[int, ...]
    """The cameras that it was compared with."""


def check_alike(lenses: Sequence[IntrinsicsResult], groups: Sequence[Sequence[int]]) -> None:
    """Refuse sisters whose images or lens models differ.

    Raises:
        SisterError: naming the two cameras.
    """
    for group in groups:
        first = lenses[group[0]]
        for other in (lenses[c] for c in group[1:]):
            kinds = [f"{c.camera.size_wh[0]}x{c.camera.size_wh[1]} px, {c.camera.model}" for c in (first, other)]
            if kinds[0] != kinds[1]:
                raise SisterError(first.camera_id, other.camera_id, expected=kinds[0], got=kinds[1])


def compare_sisters(
    lenses: Sequence[LensEstimate], groups: Sequence[Sequence[int]], limit_percent: float
) -> tuple[SisterGap, ...]:
    """Each sister against the others of its group, in order of the cameras.

    Sisters that differ from the rest by more than ``limit_percent`` are taken out one after the other, the farthest
    first, while more than two are left; so that one odd camera does not make the others look odd.
    """
    gaps = []
    for group in groups:
        trusted = list(group)
        while len(trusted) > 2:
            worst = max(
                (_gap(lenses, camera, _without(trusted, camera)) for camera in trusted), key=lambda g: abs(g.percent)
            )
            if abs(worst.percent) <= limit_percent:
                break
            trusted.remove(worst.camera)
        gaps += [_gap(lenses, camera, _without(trusted, camera)) for camera in group]
    return tuple(sorted(gaps, key=lambda gap: gap.camera))


def sister_priors(
    lenses: Sequence[LensEstimate], groups: Sequence[Sequence[int]], limit_percent: float
) -> tuple[LensPrior | None, ...]:
    """Per camera what its sisters tell of its lens; None where its own views tell more, or where it is no copy.

    A camera whose focal length is known better than copies differ gains nothing from its sisters, and one that differs
    from them by more than ``limit_percent`` and :data:`DIFFERS_SIGMA` is left as it is.
    """
    priors: list[LensPrior | None] = [None] * len(lenses)
    for gap in compare_sisters(lenses, groups, limit_percent):
        known = lenses[gap.camera].focal_sigma < FOCAL_SPREAD
        differs = abs(gap.percent) > limit_percent and abs(gap.sigmas) > DIFFERS_SIGMA
        if not (known or differs):
            mean, covariance = _pooled(lenses, gap.sisters)
            information = np.linalg.inv(covariance + _spread(lenses[gap.sisters[0]].camera))
            priors[gap.camera] = LensPrior(mean, (information + information.T) / 2)
    return tuple(priors)


def with_priors(freedom: Freedom, priors: Sequence[LensPrior | None]) -> Freedom:
    """The same freedom with these priors beside its own, per camera: means are joined by their information."""
    means, information = list(freedom.prior_mean), list(freedom.prior_information)
    for camera, prior in enumerate(priors):
        if prior is not None:
            both = information[camera] + prior.information
            weighted = information[camera] @ means[camera] + prior.information @ prior.mean
            means[camera] = np.asarray(np.linalg.lstsq(both, weighted, rcond=None)[0], dtype=np.float64)
            information[camera] = both
    return replace(freedom, prior_mean=tuple(means), prior_information=tuple(information))


def informed_by_sisters(lens: IntrinsicsResult, prior: LensPrior | None) -> IntrinsicsResult:
    """The lens solved again from its own views and its sisters' word; the same where there is no prior."""
    if prior is None:
        return lens
    used = np.unique(lens.observations.board_idx)
    poses = dict(zip(used.tolist(), lens.cam_from_board, strict=True))
    boards = tuple(poses.get(board, Pose.identity()) for board in range(int(used[-1]) + 1))
    freedom = with_priors(lens_freedom((lens.camera,), poses_free=(False,)), [prior])
    start = State((lens.camera.with_params(prior.mean),), (Pose.identity(),), boards)
    focal_free = replace(freedom, params=(np.zeros(len(prior.mean), dtype=bool),))
    noise = SolveOptions(sigma_px=max(lens.rmse_px / np.sqrt(2), 0.01))
    start = solve(lens.observations, start, focal_free, noise).state  # the boards move to where this lens sees them
    solution = solve(lens.observations, start, freedom, noise)
    camera = solution.state.cameras[0]
    return replace(
        lens,
        camera=camera,
        rmse_px=rmse_px(solution.residuals_px) or 0.0,
        covariance=solution.camera_covariance(0, range(POSE, POSE + len(camera.params))),
        cam_from_board=tuple(solution.state.rig_from_board[board] for board in used.tolist()),
        residuals_px=solution.residuals_px,
    )


def _without(group: Sequence[int], camera: int) -> tuple[int, ...]:
    return tuple(c for c in group if c != camera)


def _gap(lenses: Sequence[LensEstimate], camera: int, sisters: tuple[int, ...]) -> SisterGap:
    mean, covariance = _pooled(lenses, sisters)
    total = covariance + lenses[camera].covariance + _spread(lenses[sisters[0]].camera)
    focal, theirs = (float(params[:2].mean()) for params in (lenses[camera].camera.params, mean))
    sigma = float(np.sqrt(total[:2, :2].mean()))  # of the mean of fx and fy
    return SisterGap(camera, 100 * (focal / theirs - 1), (focal - theirs) / max(sigma, 1e-12), sisters)


def _pooled(lenses: Sequence[LensEstimate], sisters: Sequence[int]) -> tuple[Floats, Floats]:
    """Mean of the sisters' lenses by information, each as a draw from copies that differ, and its covariance.

    Where the sisters differ by more than they should, the covariance grows by that ratio.
    """
    spread = _spread(lenses[sisters[0]].camera)
    information = [np.linalg.inv(lenses[c].covariance + spread) for c in sisters]
    params = [lenses[c].camera.params for c in sisters]
    covariance = np.linalg.inv(np.sum(information, axis=0))
    mean = covariance @ np.sum([w @ p for w, p in zip(information, params, strict=True)], axis=0)
    excess = 1.0
    if len(sisters) > 1:
        squared = sum(float((p - mean) @ w @ (p - mean)) for w, p in zip(information, params, strict=True))
        excess = max(1.0, squared / ((len(sisters) - 1) * len(mean)))
    return np.asarray(mean), np.asarray(covariance * excess)


def _spread(camera: Camera) -> Floats:
    """(P, P) covariance of a lens between copies of it; both focal lengths of a copy differ alike."""
    width_height, focal = camera.size_wh, float(camera.params[:2].mean())
    reach = min(float(np.hypot(*width_height)) / 2 / focal, np.pi / 2 if camera.is_fisheye else np.inf)
    power = {"k1": 2, "k2": 4, "k3": 6, "k4": 8 if camera.is_fisheye else 2, "k5": 4, "k6": 6, "p1": 1, "p2": 1}
    sigma = np.array([DISTORTION_SPREAD / reach ** power.get(name, 0) for name in camera.names])
    sigma[:2], sigma[2:4] = FOCAL_SPREAD * focal, CENTRE_SPREAD * max(width_height)
    covariance = np.diag(sigma**2)
    covariance[0, 1] = covariance[1, 0] = 0.99 * sigma[0] * sigma[1]  # pixels are square within a thousandth
    return covariance
