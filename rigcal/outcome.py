"""What a calibration becomes on disk: the rig file's content, and the evidence beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version

import numpy as np

from rigcal import __version__
from rigcal.board import board_to_dict
from rigcal.evidence import Evidence
from rigcal.intrinsics import undetermined
from rigcal.lensfile import findings_entries
from rigcal.pipeline import SiteCalibration, used_views
from rigcal.refine import JointResult
from rigcal.relative import solved_covariance_entry
from rigcal.residuals import residuals_of_all
from rigcal.rigdocument import PoseEntry, RigDocument
from rigcal.scene import ScenePoint
from rigcal.site import Site


def evidence_of(calibration: SiteCalibration) -> Evidence:
    """Every detected corner with its residual: the sidecar of the rig file."""
    detections, joint = calibration.detections, calibration.joint
    obs = joint.observations
    used = set(zip(obs.camera_idx.tolist(), obs.frame_idx.tolist(), obs.corner_ids.tolist(), strict=True))
    boards, board_of_row = np.unique(obs.board_idx, return_inverse=True)
    views = zip(obs.camera_idx.tolist(), obs.frame_idx.tolist(), strict=True)
    board_of_view = dict(zip(views, board_of_row.tolist(), strict=True))
    rows: list[tuple[int, int, int, bool, int]] = []
    pixels, residuals = [], []
    for camera in range(len(detections.cameras)):
        for view, gap in residuals_of_all(detections, joint, camera):
            key = camera, view.frame_idx
            rows += [(*key, c, (*key, c) in used, board_of_view.get(key, -1)) for c in view.corner_ids.tolist()]
            pixels.append(view.corners_px)
            residuals.append(gap)
    camera_idx, frame_idx, corner_ids, kept, board_idx = (np.array(column) for column in zip(*rows, strict=True))
    middle = detections.board.corners_in_board.mean(axis=0)
    rig_from_board = [joint.solution.state.rig_from_board[b] for b in boards.tolist()]
    return Evidence(
        detections.camera_ids,
        tuple(camera.frames for camera in detections.cameras),
        camera_idx,
        frame_idx,
        corner_ids,
        kept,
        np.concatenate(pixels),
        np.concatenate(residuals),
        np.array([pose.apply(middle) for pose in rig_from_board]),
        board_idx,
        np.array([pose.matrix[:3] for pose in rig_from_board]),
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
    detections = calibration.detections
    ids = detections.camera_ids
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
            "covariance": solved_covariance_entry(calibration.quality.covariance, ids),
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
            "extensions": {"rigcal": _more(calibration) | _declared(site)},
        }
    )


def _declared(site: Site | None) -> dict[str, object]:
    """What clocks are judged by later, where the site file says it."""
    if site is None:
        return {}
    motion = {"fastest_motion_m_per_s": site.fastest_motion_m_per_s, "clock_error_m": site.gates.clock_error_m}
    return {"site": motion}


def _more(calibration: SiteCalibration) -> dict[str, object]:
    """Figures for which the format has no key, by camera id: what the report shows beside the gates."""
    detections, joint, quality = calibration.detections, calibration.joint, calibration.quality
    ids, split = detections.camera_ids, calibration.quality.split_half
    more: dict[str, object] = {
        "instants": {
            "rule": detections.instants.rule,
            "spread_s": float(detections.instants.spread_s.max(initial=0.0)),
            "shared": _shared_instants(joint),
        },
        "lenses_held": [ids[camera] for camera in joint.noisy],
        "undetermined": {
            camera_id: list(names)
            for camera_id, camera, sigma in zip(ids, joint.cameras, quality.lens_sigma, strict=True)
            if (names := undetermined(camera, sigma))
        },
        "graph": _graph_entry(calibration),
        "scene": {
            "centre": _scene_entry(quality.scene_centre, ids) if quality.scene_centre else None,
            "edges": [_scene_entry(edge, ids) for edge in quality.scene_edges],
        },
        "split_half": None
        if split is None
        else {
            "gap": split.gap,
            "distance_percent": split.distance_percent,
            "cameras": [ids[c] for c in split.farthest],
        },
    }
    if joint.freedom.bow:
        bow = joint.solution.joint_covariance([(len(ids), 0), (len(ids), 1)])
        more["board_bow"] = {"bow_m": joint.solution.state.bow_m, "sigma_m": np.sqrt(np.diag(bow)).tolist()}
    if calibration.scale is not None:
        evidence = [asdict(item) for item in calibration.scale.evidence]
        more["scale"] = asdict(calibration.scale) | {"evidence": evidence}
    if calibration.sisters:
        more["sisters"] = [
            {"camera": ids[g.camera], "percent": g.percent, "sigmas": g.sigmas, "like": [ids[c] for c in g.sisters]}
            for g in calibration.sisters
        ]
    return more


def _scene_entry(point: ScenePoint, ids: Sequence[str]) -> dict[str, object]:
    return {
        "point_in_rig_m": point.point_in_rig_m.tolist(),
        "sigma_m": point.sigma_m,
        "cameras": [ids[camera] for camera in point.cameras],
    }


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


def _graph_entry(calibration: SiteCalibration) -> dict[str, object]:
    """What the loops of the pair graph say, and the pair that adds most to the place of a point."""
    ids, chain = calibration.detections.camera_ids, calibration.chain
    return {
        "weakest": [ids[chain.weakest.first], ids[chain.weakest.second]] if chain.weakest else None,
        "loops": [
            {
                "cameras": [ids[loop.first], ids[loop.second]],
                "path": [ids[c] for c in loop.path],
                "gap_m": loop.gap_m,
            }
            for loop in chain.loops
        ],
        "doubted": [{"cameras": [ids[pair.first], ids[pair.second]], "views": pair.views} for pair in chain.doubted],
    }
