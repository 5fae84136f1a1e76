"""From detections to a judged rig: the only caller of the stages, in the order of the data.

Lenses one by one, pairs of cameras, the chain to the reference, the joint solve, the gates. Everything that the rig
file, the report and the terminal say comes from the one value returned here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import version

import numpy as np

from rigcal import __version__
from rigcal.board import Checkerboard, board_to_dict
from rigcal.boardpose import board_poses
from rigcal.bundle import rmse_px
from rigcal.camera import MODELS
from rigcal.detections import BoardView, Finding, SiteDetections, join_findings
from rigcal.errors import CalibrationError, OptionError
from rigcal.evidence import Evidence
from rigcal.geometry import Floats
from rigcal.graph import Chain, chain_to_reference
from rigcal.intrinsics import IntrinsicsOptions, IntrinsicsResult, calibrate_camera, choose_model, hold_camera
from rigcal.lensfile import KnownLens, findings_entries
from rigcal.pairwise import PairPose, PairwiseOptions, solve_pair, turned_view
from rigcal.quality import (
    CameraFigures,
    Gate,
    JointQuality,
    assess,
    joint_camera_covariance,
    judge,
    verdict,
)
from rigcal.refine import JointResult, RefineOptions, refine_rig
from rigcal.rigdocument import PoseEntry, RigDocument
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
        _chained_rmse(detections, lenses, chain, camera) if link else None,
        rmse_px(joint.residuals_of(camera)) or 0.0,
        quality.held_out_px[camera],
        _rmse_of_all(detections, joint, camera),
    )


def _chained_rmse(
    detections: SiteDetections, lenses: Sequence[IntrinsicsResult], chain: Chain, camera: int
) -> float | None:
    """Boards placed by the reference and seen through the chain: the error that compounds along it.

    Where a camera shares no view with the reference, the nearest camera to it on the chain that does places them.
    """
    corners, flippable = detections.board.corners_in_board, isinstance(detections.board, Checkerboard)
    mine = {view.frame_idx: view for view in lenses[camera].views}
    for placer in chain.paths[camera][:-1]:
        placed = dict(
            zip([view.frame_idx for view in lenses[placer].views], lenses[placer].cam_from_board, strict=True)
        )
        cam_from_placer = chain.cam_from_rig[camera] @ chain.cam_from_rig[placer].inverse()
        gaps = []
        for row in detections.instants.frame_idx:
            view = mine.get(int(row[camera]))
            if view is not None and int(row[placer]) in placed:
                pixels = lenses[camera].camera.project((cam_from_placer @ placed[int(row[placer])]).apply(corners))
                orders = (view, turned_view(view, len(corners))) if flippable else (view,)
                gaps.append(min((pixels[v.corner_ids] - v.corners_px for v in orders), key=_squared))
        if gaps:
            stacked = np.concatenate(gaps)
            return rmse_px(stacked[np.isfinite(stacked).all(axis=1)])
    return None


def _squared(gap: Floats) -> float:
    return float(np.nan_to_num(gap**2, nan=1e12).sum())


def _rmse_of_all(detections: SiteDetections, joint: JointResult, camera: int) -> float:
    residuals = [residual for _, residual in residuals_of_all(detections, joint, camera)]
    return rmse_px(np.concatenate(residuals)) or 0.0


def residuals_of_all(detections: SiteDetections, joint: JointResult, camera: int) -> list[tuple[BoardView, Floats]]:
    """Residuals (n, 2) of every detected view of one camera, rejected ones too.

    A view whose instant was used keeps that board's pose; any other is placed by itself. Corner orders that the joint
    solve turned are turned here.
    """
    obs, corners = joint.observations, detections.board.corners_in_board
    lens, cam_from_rig = joint.cameras[camera], joint.cam_from_rig[camera]
    boards = {(int(c), int(f)): int(b) for c, f, b in zip(obs.camera_idx, obs.frame_idx, obs.board_idx, strict=True)}
    instant_of = {int(row[camera]): row for row in detections.instants.frame_idx}
    turned = {(c, finding.frame) for c, finding in joint.findings if finding.action == "unflipped"}
    found = []
    for view in detections.cameras[camera].views:
        if (camera, detections.cameras[camera].frames[view.frame_idx]) in turned:
            view = turned_view(view, len(corners))  # noqa: PLW2901
        row = instant_of[view.frame_idx]
        board = next((boards[c, int(f)] for c, f in enumerate(row) if (c, int(f)) in boards), None)
        if board is not None:
            pose = cam_from_rig @ joint.solution.state.rig_from_board[board]
        elif candidates := board_poses(lens, corners, view):
            pose = candidates[0].cam_from_board
        else:
            continue
        found.append((view, view.corners_px - lens.project(pose.apply(corners[view.corner_ids]))))
    return [(view, gap) for view, gap in found if np.isfinite(gap).all()]


def evidence_of(calibration: SiteCalibration) -> Evidence:
    """Every detected corner with its residual: the sidecar of the rig file."""
    detections, joint = calibration.detections, calibration.joint
    obs = joint.observations
    used = set(zip(obs.camera_idx.tolist(), obs.frame_idx.tolist(), obs.corner_ids.tolist(), strict=True))
    rows: list[tuple[int, int, int, bool]] = []
    pixels, residuals = [], []
    for camera in range(len(detections.cameras)):
        for view, gap in residuals_of_all(detections, joint, camera):
            rows += [
                (camera, view.frame_idx, int(c), (camera, view.frame_idx, int(c)) in used) for c in view.corner_ids
            ]
            pixels.append(view.corners_px)
            residuals.append(gap)
    camera_idx, frame_idx, corner_ids, kept = (np.array(column) for column in zip(*rows, strict=True))
    middle = detections.board.corners_in_board.mean(axis=0)
    centres = [joint.solution.state.rig_from_board[int(b)].apply(middle) for b in np.unique(obs.board_idx)]
    return Evidence(
        detections.camera_ids,
        tuple(camera.frames for camera in detections.cameras),
        camera_idx,
        frame_idx,
        corner_ids,
        kept,
        np.concatenate(pixels),
        np.concatenate(residuals),
        np.array(centres),
    )


def document_of(
    calibration: SiteCalibration,
    *,
    site: Site | None,
    site_name: str,
    created_utc: str,
    command: str,
    options: Mapping[str, object],
) -> RigDocument:
    """The rig file's content for a calibration."""
    detections, joint = calibration.detections, calibration.joint
    ids = detections.camera_ids
    free, covariance = joint_camera_covariance(joint.solution)
    symmetric = (covariance + covariance.T) / 2
    return RigDocument.model_validate(
        {
            "site": site_name,
            "created_utc": created_utc,
            "reference": ids[0],
            "board": board_to_dict(detections.board),
            "cameras": [_camera_entry(calibration, site, index) for index in range(len(ids))],
            "pairs": [
                {"cameras": (ids[pair.first], ids[pair.second]), "views": pair.views, "rmse_px": pair.rmse_px}
                for pair in calibration.pairs
            ],
            "covariance": {
                "order": tuple(f"{ids[c]}.{part}" for c in free for part in ("rotation_rad", "translation_m")),
                "matrix": tuple(tuple(row) for row in symmetric.tolist()),
            }
            if free
            else None,
            "gates": [
                {
                    "name": gate.name,
                    "camera": gate.camera,
                    "value": gate.value,
                    "limit": gate.limit,
                    "passed": gate.passed,
                    "advice": gate.advice,
                }
                for gate in calibration.gates
            ],
            "verdict": calibration.verdict,
            "history": [{"command": command, "utc": created_utc, "parent_digest": None}],
            "provenance": {
                "rigcal": __version__,
                "inputs_sha256": detections.digest,
                "options": dict(options),
                "packages": {
                    name: version(name) for name in ("numpy", "opencv-contrib-python-headless", "pycolmap", "scipy")
                },
            },
            "extensions": {
                "rigcal": {
                    "instants": {
                        "rule": detections.instants.rule,
                        "spread_s": float(detections.instants.spread_s.max(initial=0.0)),
                        "shared": _shared_instants(joint),
                    },
                    "lenses_held": [ids[camera] for camera in joint.noisy],
                }
            },
        }
    )


def _shared_instants(joint: JointResult) -> int:
    pairs = np.unique(np.stack([joint.observations.board_idx, joint.observations.camera_idx], axis=1), axis=0)
    return int((np.unique(pairs[:, 0], return_counts=True)[1] > 1).sum())


def _camera_entry(calibration: SiteCalibration, site: Site | None, index: int) -> dict[str, object]:
    detections, quality, joint = calibration.detections, calibration.quality, calibration.joint
    camera, lens, rmse = detections.cameras[index], joint.cameras[index], calibration.rmse[index]
    declared = site.camera(camera.camera_id) if site else None
    fx, fy, cx, cy = quality.lens_sigma[index][:4].tolist()
    return {
        "id": camera.camera_id,
        "serial": declared.serial if declared else None,
        "size_wh": lens.size_wh,
        "model": lens.model,
        "coefficients": lens.coefficients,
        "cam_from_rig": PoseEntry.of(joint.cam_from_rig[index]),
        "rmse_px": {
            "intrinsic": rmse.intrinsic,
            "pairwise": rmse.pairwise,
            "chained": rmse.chained,
            "refined": rmse.refined,
            "held_out": rmse.held_out,
            "all": rmse.every,
        },
        "chain": tuple(detections.camera_ids[c] for c in calibration.chain.paths[index]),
        "sigma": {
            "fx_px": fx,
            "fy_px": fy,
            "cx_px": cx,
            "cy_px": cy,
            "position_m": quality.position_sigma_m[index],
            "rotation_deg": quality.rotation_sigma_deg[index],
        },
        "views": {
            "frames": len(camera.frames),
            "detected": len(camera.views),
            "used": used_views(joint, index),
            "findings": tuple(findings_entries(calibration.findings[index])),
        },
    }
