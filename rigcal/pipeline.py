"""From detections to a judged rig: the only caller of the stages, in the order of the data.

Lenses one by one, pairs of cameras, the chain to the reference, the joint solve, the gates. Everything that the rig
file, the report and the terminal say comes from the one value returned here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rigcal.bundle import rmse_px
from rigcal.camera import MODELS
from rigcal.detections import Finding, SiteDetections, join_findings
from rigcal.errors import CalibrationError, OptionError
from rigcal.graph import Chain, chain_to_reference
from rigcal.intrinsics import IntrinsicsOptions, IntrinsicsResult, calibrate_camera, choose_model, hold_camera
from rigcal.lensfile import KnownLens
from rigcal.pairwise import PairPose, PairwiseOptions, solve_pair
from rigcal.quality import (
    CameraFigures,
    Gate,
    JointQuality,
    assess,
    judge,
    verdict,
)
from rigcal.refine import JointResult, RefineOptions, refine_rig
from rigcal.residuals import chained_rmse_px, rmse_of_all_px
from rigcal.selection import SelectionOptions, select_views
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
    gates: tuple[Gate, ...]
    verdict: str
    """``PASS`` or ``RECAPTURE``."""


def calibrate_lenses(
    detections: SiteDetections, site: Site | None, options: CalibrateOptions
) -> tuple[IntrinsicsResult, ...]:
    """Each camera's lens by itself.

    Raises:
        TooFewViewsError: for a camera with too few views of the board.
    """
    results = []
    for camera in select_views(detections, options.selection).cameras:
        declared = site.camera(camera.camera_id) if site else None
        model = declared.model if declared and declared.model else options.model
        if model == AUTO:
            model = choose_model(camera, detections.board, options.intrinsics)
        results.append(calibrate_camera(camera, detections.board, replace(options.intrinsics, model=model)))
    return tuple(results)


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
    return tuple(
        hold_camera(
            camera,
            detections.board,
            known[camera.camera_id].camera,
            known[camera.camera_id].rmse_px,
            options.intrinsics,
        )
        for camera in select_views(detections, options.selection).cameras
    )


def calibrate_site(
    detections: SiteDetections,
    limits: GateLimits,
    lenses: Sequence[IntrinsicsResult],
    options: CalibrateOptions,
) -> SiteCalibration:
    """Calibrate the rig of a capture.

    Args:
        detections: Board views of every camera; the first is the reference.
        limits: Limits of the gates.
        lenses: From :func:`calibrate_lenses` or :func:`hold_lenses`.
        options: Options of the stages.

    Raises:
        NotConnectedError: where shared views do not join every camera to the reference.
    """
    board, frames = detections.board, [camera.frames for camera in detections.cameras]
    pairs = _pairs(detections, lenses, options.pairwise)
    chain = chain_to_reference(detections.camera_ids, pairs, needed_views=int(limits.chain_overlap_views))
    joint = refine_rig(board, lenses, frames, detections.instants, chain.cam_from_rig, options.refine)
    quality = assess(joint, [lens.sigma for lens in lenses])
    rmse = tuple(_rmse(detections, lenses, chain, joint, quality, camera) for camera in range(len(lenses)))
    gates = judge(_figures(detections, chain, joint, rmse), quality, limits.model_dump())
    findings = tuple(
        join_findings(
            camera.findings,
            lens.findings,
            [finding for c, finding in joint.findings if c == index],
        )
        for index, (camera, lens) in enumerate(zip(detections.cameras, lenses, strict=True))
    )
    return SiteCalibration(
        detections, tuple(lenses), pairs, chain, joint, quality, rmse, findings, gates, verdict(gates)
    )


def _pairs(
    detections: SiteDetections, lenses: Sequence[IntrinsicsResult], options: PairwiseOptions
) -> tuple[PairPose, ...]:
    by_frame = [{view.frame_idx: view for view in lens.views} for lens in lenses]
    pairs = []
    for first in range(len(lenses)):
        for second in range(first + 1, len(lenses)):
            shared = [
                (instant, by_frame[first][int(row[first])], by_frame[second][int(row[second])])
                for instant, row in enumerate(detections.instants.frame_idx)
                if int(row[first]) in by_frame[first] and int(row[second]) in by_frame[second]
            ]
            cameras = (lenses[first].camera, lenses[second].camera)
            pair = solve_pair(detections.board, cameras, shared, (first, second), options)
            if pair is not None:
                pairs.append(pair)
    return tuple(pairs)


def _figures(
    detections: SiteDetections, chain: Chain, joint: JointResult, rmse: Sequence[CameraRmse]
) -> tuple[CameraFigures, ...]:
    ids = detections.camera_ids
    return tuple(
        CameraFigures(
            camera_id,
            ids[chain.paths[index][-2]] if index else None,
            rmse[index].intrinsic,
            rmse[index].pairwise,
            rmse[index].refined,
            used_views(joint, index),
            link.views if (link := chain.links[index]) else None,
        )
        for index, camera_id in enumerate(ids)
    )


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
