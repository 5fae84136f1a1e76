"""From detections to a judged rig: the only caller of the stages, in the order of the data.

Lenses one by one, pairs of cameras, the chain to the reference, the joint solve, the gates. Everything that the rig
file, the report and the terminal say comes from the one value returned here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rigcal.bundle import POSE, rmse_px
from rigcal.camera import MODELS
from rigcal.detections import Finding, SiteDetections, join_findings
from rigcal.errors import CalibrationError, OptionError
from rigcal.figures import camera_figures, rig_figures
from rigcal.gates import Gate, judge, verdict
from rigcal.graph import Chain, chain_to_reference
from rigcal.intrinsics import IntrinsicsOptions, IntrinsicsResult, calibrate_camera, choose_model, hold_camera
from rigcal.lensfile import KnownLens
from rigcal.measured import MeasuredDistance, MeasuredLength
from rigcal.pairwise import PairPose, PairwiseOptions, solve_pairs
from rigcal.quality import JointQuality, assess
from rigcal.refine import JointResult, RefineOptions, refine_rig
from rigcal.residuals import chained_rmse_px, rmse_of_all_px
from rigcal.scale import ScaleCheck, check_scale
from rigcal.selection import SelectionOptions, select_views
from rigcal.sisters import (
    LensEstimate,
    LensPrior,
    SisterGap,
    check_alike,
    compare_sisters,
    informed_by_sisters,
    sister_priors,
)
from rigcal.site import GateLimits, Site

AUTO = "auto"


@dataclass(frozen=True, slots=True)
class CalibrateOptions:
    """Options of every stage.

    Raises:
        OptionError: for an unknown model.
    """

    model: str = "auto"
    """Lens model of cameras for which the site file names none; ``auto`` chooses each camera's by held-out error."""
    selection: SelectionOptions = field(default_factory=SelectionOptions)
    intrinsics: IntrinsicsOptions = field(default_factory=IntrinsicsOptions)
    pairwise: PairwiseOptions = field(default_factory=PairwiseOptions)
    refine: RefineOptions = field(default_factory=RefineOptions)

    def __post_init__(self) -> None:
        if self.model != AUTO and self.model not in MODELS:
            raise OptionError("model", expected="auto or one of " + ", ".join(MODELS), got=self.model)


@dataclass(frozen=True, slots=True)
class Known:
    """What is known of a site beside its images."""

    distances: tuple[MeasuredDistance, ...] = ()
    """Measured between cameras."""
    square: MeasuredLength | None = None
    """Measured on the printed board: a square's side, or a tag's."""
    sisters: tuple[tuple[str, ...], ...] = ()
    """Groups of cameras that are copies of one camera and lens."""


@dataclass(frozen=True, slots=True)
class CameraRmse:
    """Root-mean-square errors of one camera in pixels; None where one has no meaning."""

    intrinsic: float | None
    pairwise: float | None
    chained: float | None
    refined: float
    held_out: float | None
    every: float
    """Over every detected corner, rejected ones too."""


@dataclass(frozen=True, slots=True, eq=False)
class SiteCalibration:
    """A calibrated and judged rig with all its evidence."""

    detections: SiteDetections
    lenses: tuple[IntrinsicsResult, ...]
    pairs: tuple[PairPose, ...]
    chain: Chain
    joint: JointResult
    quality: JointQuality
    rmse: tuple[CameraRmse, ...]
    findings: tuple[tuple[Finding, ...], ...]
    """Per camera."""
    sisters: tuple[SisterGap, ...]
    """Each camera that is declared like others, beside them."""
    scale: ScaleCheck | None
    """The rig against lengths measured by hand; None where none was given."""
    gates: tuple[Gate, ...]
    verdict: str
    """``PASS`` or ``RECAPTURE``."""


def calibrate_lenses(
    detections: SiteDetections, site: Site | None, options: CalibrateOptions
) -> tuple[IntrinsicsResult, ...]:
    """Each camera's lens by itself; sisters get one model.

    Raises:
        TooFewViewsError: for a camera with too few views of the board.
        SisterError: for cameras that are declared alike, whose images or lens models differ.
    """
    board, chosen = detections.board, select_views(detections, options.selection).cameras
    groups = _groups(detections.camera_ids, site.sisters) if site else ()
    models = [_model(site, camera.camera_id, options) for camera in chosen]
    for index, camera in enumerate(chosen):
        if models[index] == AUTO:
            models[index] = choose_model(camera, board, options.intrinsics)
    for group in groups:  # copies of one lens have one model: the one that most views chose
        best = max(group, key=lambda index: len(chosen[index].views))
        for index in group:
            if _model(site, chosen[index].camera_id, options) == AUTO:
                models[index] = models[best]
    lenses = tuple(
        calibrate_camera(camera, board, replace(options.intrinsics, model=model))
        for camera, model in zip(chosen, models, strict=True)
    )
    check_alike(lenses, groups)
    return lenses


def _model(site: Site | None, camera_id: str, options: CalibrateOptions) -> str:
    declared = site.camera(camera_id) if site else None
    return declared.model if declared and declared.model else options.model


def _groups(camera_ids: Sequence[str], sisters: Sequence[Sequence[str]]) -> tuple[tuple[int, ...], ...]:
    """Groups of alike cameras as indices, over the cameras that the capture has."""
    groups = (tuple(camera_ids.index(one) for one in group if one in camera_ids) for group in sisters)
    return tuple(group for group in groups if len(group) > 1)


def hold_lenses(
    detections: SiteDetections, known: Mapping[str, KnownLens], options: CalibrateOptions
) -> tuple[IntrinsicsResult, ...]:
    """Lenses calibrated before, with the boards of this capture placed by them.

    Raises:
        CalibrationError: for a camera whose lens is not known.
        ImageSizeError: for a camera whose images have another size than its lens.
        TooFewViewsError: for a camera without a usable view.
    """
    missing = [camera_id for camera_id in detections.camera_ids if camera_id not in known]
    if missing:
        raise CalibrationError(
            f"no lens is known for {', '.join(missing)}",
            where="--intrinsics",
            expected=f"lenses of {', '.join(detections.camera_ids)}",
            got=f"lenses of {', '.join(known)}",
            do_next="name the cameras' folders or videos alike in both captures, or calibrate the missing lenses",
        )
    held = []
    for camera in select_views(detections, options.selection).cameras:
        lens = known[camera.camera_id]
        result = hold_camera(camera, detections.board, lens.camera, lens.rmse_px, options.intrinsics)
        held.append(result if lens.covariance is None else replace(result, covariance=lens.covariance))
    return tuple(held)


def calibrate_site(
    detections: SiteDetections,
    limits: GateLimits,
    lenses: Sequence[IntrinsicsResult],
    options: CalibrateOptions,
    *,
    known: Known | None = None,
) -> SiteCalibration:
    """Calibrate the rig of a capture.

    Args:
        detections: Board views of every camera; the first is the reference.
        limits: Limits of the gates.
        lenses: From :func:`calibrate_lenses` or :func:`hold_lenses`.
        options: Options of the stages.
        known: What is known of the site beside its images.

    Raises:
        NotConnectedError: where shared views do not join every camera to the reference.
        MeasuredLengthError: for a distance to a camera that the capture does not have.
    """
    board, frames = detections.board, [camera.frames for camera in detections.cameras]
    known = known or Known()
    groups = _groups(detections.camera_ids, known.sisters)
    priors: Sequence[LensPrior | None] = ()
    if options.refine.free_lenses:
        estimates = [LensEstimate(lens.camera, lens.covariance) for lens in lenses]
        priors = sister_priors(estimates, groups, limits.sister_percent)
        lenses = [informed_by_sisters(lens, prior) for lens, prior in zip(lenses, priors, strict=True)]
    pairs = solve_pairs(board, lenses, detections.instants, options.pairwise)
    chain = chain_to_reference(detections.camera_ids, pairs, needed_views=int(limits.chain_overlap_views))
    joint = refine_rig(board, lenses, frames, detections.instants, chain.cam_from_rig, options.refine, priors=priors)
    quality = assess(joint, [lens.covariance for lens in lenses], lenses_given=not options.refine.free_lenses)
    rmse = tuple(_rmse(detections, lenses, chain, joint, quality, camera) for camera in range(len(lenses)))
    scale = check_scale(
        board,
        detections.camera_ids,
        joint.cam_from_rig,
        quality.covariance,
        distances=known.distances,
        square=known.square,
    )
    gaps = compare_sisters(_lens_estimates(joint, quality), groups, limits.sister_percent)
    gates = judge(
        camera_figures(detections.camera_ids, lenses, chain, joint, quality, gaps),
        rig_figures(detections, chain, joint, quality, scale),
        limits.model_dump(),
    )
    findings = tuple(
        join_findings(
            camera.findings,
            lens.findings,
            [finding for c, finding in joint.findings if c == index],
        )
        for index, (camera, lens) in enumerate(zip(detections.cameras, lenses, strict=True))
    )
    return SiteCalibration(
        detections,
        tuple(lenses),
        pairs.solved,
        chain,
        joint,
        quality,
        rmse,
        findings,
        gaps,
        scale,
        gates,
        verdict(gates),
    )


def _lens_estimates(joint: JointResult, quality: JointQuality) -> list[LensEstimate]:
    return [
        LensEstimate(lens, quality.covariance.of([(c, POSE + p) for p in range(len(lens.params))]))
        for c, lens in enumerate(joint.cameras)
    ]


def used_views(joint: JointResult, camera: int) -> int:
    """Board views of one camera that the joint solve used."""
    return len(np.unique(joint.observations.board_idx[joint.observations.camera_idx == camera]))


def _rmse(
    detections: SiteDetections,
    lenses: Sequence[IntrinsicsResult],
    chain: Chain,
    joint: JointResult,
    quality: JointQuality,
    camera: int,
) -> CameraRmse:
    link = chain.links[camera]
    return CameraRmse(
        lenses[camera].rmse_px,
        link.rmse_px if link else None,
        chained_rmse_px(detections, lenses, chain, camera) if link else None,
        rmse_px(joint.residuals_of(camera)) or 0.0,
        quality.held_out_px[camera],
        rmse_of_all_px(detections, joint, camera),
    )
