"""The rig file's entries after cameras were placed again: poses, figures, pairs, gates and the corners behind them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rigcal.advice import CameraFigures, RigFigures
from rigcal.bundle import rmse_px
from rigcal.coverage import coverage_of
from rigcal.detections import join_findings
from rigcal.drift.replaced import Replaced
from rigcal.evidence import Evidence
from rigcal.gates import judge
from rigcal.geometry import Pose
from rigcal.lensfile import findings_entries
from rigcal.quality import JointQuality, assess
from rigcal.relative import covariance_entry
from rigcal.residuals import residuals_of_all, rmse_of_all_px
from rigcal.rigdocument import CameraEntry, GateEntry, PairEntry, PoseEntry, RigDocument, RmseEntry, ViewsEntry
from rigcal.site import GateLimits

_OF_THE_LENS = frozenset(
    {
        "intrinsic_rmse_px",
        "focal_sigma_percent",
        "tilt_spread_deg",
        "image_coverage",
        "lens_agreement",
        "sister_percent",
    }
)
"""Gates that judge a lens, which was held: they stay as the calibration left them."""


def rewritten(document: RigDocument, placed: Replaced) -> dict[str, Any]:
    """Top-level entries of the rig file that change: an imported file has no gates, and gets none."""
    exact = [np.zeros((len(camera.params),) * 2) for camera in placed.joint.cameras]
    quality = assess(placed.joint, exact) if document.gates else None
    cameras = tuple(_camera(document, camera, placed, quality) for camera in document.cameras)
    free = [camera_id for camera_id in document.camera_ids if camera_id != document.reference]
    world = document.world_from_rig
    return {
        "cameras": cameras,
        "pairs": _pairs(document, placed),
        "covariance": covariance_entry(
            free,
            placed.poses.of(free).covariance,
            placed.given_lenses.of(free).covariance if placed.given_lenses else None,
        ),
        "world_from_rig": PoseEntry.of(world.pose @ placed.newrig_from_oldrig.inverse()) if world else None,
        "gates": _gates(document.gates, cameras, placed, quality) if quality else (),
    }


def _camera(document: RigDocument, entry: CameraEntry, placed: Replaced, quality: JointQuality | None) -> CameraEntry:
    if entry.id not in placed.touched_ids:
        return entry
    changes: dict[str, Any] = {"cam_from_rig": PoseEntry.of(placed.poses.pose(entry.id))}
    if entry.sigma:
        position_m, rotation_deg = placed.sigmas(entry.id)
        changes["sigma"] = entry.sigma.model_copy(update={"position_m": position_m, "rotation_deg": rotation_deg})
    if entry.id in placed.moved_ids:
        changes |= _new_figures(document, entry, placed, quality)
    return entry.model_copy(update=changes)


def _new_figures(
    document: RigDocument, entry: CameraEntry, placed: Replaced, quality: JointQuality | None
) -> dict[str, Any]:
    index = placed.measured.poses.ids.index(entry.id)
    detections, joint = placed.measured.detections, placed.joint
    chain = _chain(document, entry, placed)
    found = join_findings(detections.cameras[index].findings, [f for c, f in joint.findings if c == index])
    return {
        "chain": chain,
        "rmse_px": RmseEntry(
            intrinsic=entry.rmse_px.intrinsic,
            pairwise=_pair_figures(placed, *chain[-2:])[1] if len(chain) > 1 else None,
            refined=rmse_px(joint.residuals_of(index)),
            held_out=quality.held_out_px[index] if quality else None,
            all=rmse_of_all_px(detections, joint, index),
        ),
        "views": ViewsEntry(
            frames=len(detections.cameras[index].frames),
            detected=len(detections.cameras[index].views),
            used=placed.measured.views_of(entry.id),
            findings=tuple(findings_entries(found)),
        ),
    }


def _chain(document: RigDocument, entry: CameraEntry, placed: Replaced) -> tuple[str, ...]:
    """The camera's chain as it was, or past the camera that shares the most new views with it."""
    if entry.id == document.reference or _pair_figures(placed, *entry.chain[-2:])[0]:
        return entry.chain
    others = [camera for camera in document.cameras if camera.id != entry.id and entry.id not in camera.chain]
    nearest = max(others, key=lambda camera: _pair_figures(placed, camera.id, entry.id)[0])
    return (*nearest.chain, entry.id)


def _pair_figures(placed: Replaced, one: str, two: str) -> tuple[int, float | None]:
    """Shared views and RMSE of a pair of cameras in the new capture."""
    ids = placed.measured.poses.ids
    for pair in placed.measured.pairs:
        if {ids[pair.first], ids[pair.second]} == {one, two}:
            return pair.views, pair.rmse_px
    return 0, None


def _pairs(document: RigDocument, placed: Replaced) -> tuple[PairEntry, ...]:
    """The calibration's pairs of cameras that stayed, the new capture's of those that moved."""
    ids, moved = placed.measured.poses.ids, set(placed.moved_ids)
    kept = [pair for pair in document.pairs if not moved & set(pair.cameras)]
    new = [
        PairEntry(cameras=(ids[pair.first], ids[pair.second]), views=pair.views, rmse_px=pair.rmse_px)
        for pair in placed.measured.pairs
        if moved & {ids[pair.first], ids[pair.second]}
    ]
    order = document.camera_ids.index
    return tuple(sorted((*kept, *new), key=lambda pair: [order(camera_id) for camera_id in pair.cameras]))


def _gates(
    gates: Sequence[GateEntry], cameras: Sequence[CameraEntry], placed: Replaced, quality: JointQuality
) -> tuple[GateEntry, ...]:
    """The gates of touched cameras with their new figures; those of lenses, of other cameras and of the rig as before.

    The gates of the whole rig (its halves, its second solver, its scene) speak of the calibration, and what a camera
    placed again may lack they do not see; its own gates do.
    """
    limits = GateLimits().model_dump() | {gate.name: gate.limit for gate in gates}
    by_id = {camera.id: camera for camera in cameras}
    figures = [_figures(by_id[camera_id], placed, quality) for camera_id in placed.moved_ids]
    spread_s = float(placed.measured.detections.instants.spread_s.max(initial=0.0))
    rig = RigFigures(placed.measured.poses.ids, None, 0, None, 0.0, spread_s=spread_s)
    new = {(gate.name, gate.camera): gate for gate in judge(figures, rig, limits) if gate.name not in _OF_THE_LENS}
    found = []
    for gate in gates:
        if gate.camera in placed.moved_ids and (gate.name, gate.camera) in new:
            found.append(GateEntry.model_validate(new[gate.name, gate.camera], from_attributes=True))
        elif gate.name == "position_sigma_m" and gate.camera in placed.touched_ids:
            found.append(gate.model_copy(update={"value": placed.sigmas(gate.camera)[0]}))
        else:
            found.append(gate)
    return tuple(found)


def _figures(camera: CameraEntry, placed: Replaced, quality: JointQuality) -> CameraFigures:
    """What the gates judge of one placed camera; what they judge of its lens is left out."""
    index = placed.measured.poses.ids.index(camera.id)
    parent = camera.chain[-2] if len(camera.chain) > 1 else None
    overlap, pairwise = _pair_figures(placed, parent, camera.id) if parent else (None, None)
    dropped = len({finding.frame for finding in camera.views.findings if finding.action == "dropped"})
    return CameraFigures(
        camera.id,
        None,
        camera.rmse_px.refined or 0.0,
        quality.held_out_px[index],
        None,
        dropped / max(dropped + camera.views.used, 1),
        coverage_of(placed.joint, index),
        parent_id=parent,
        pairwise_rmse_px=pairwise,
        position_sigma_m=placed.sigmas(camera.id)[0],
        chain_overlap_views=overlap,
        weakest=(camera.id, parent) if parent else None,
    )


def evidence_after(evidence: Evidence, placed: Replaced) -> Evidence:
    """The sidecar: corners of the placed cameras from the new views, of the others from the calibration.

    Boards of the calibration move with the rig frame; pictures of the placed cameras are of the old views and go.
    """
    ids = evidence.camera_ids
    moved = [ids.index(camera_id) for camera_id in placed.moved_ids]
    kept = ~np.isin(evidence.camera_idx, moved)
    boards = [placed.newrig_from_oldrig @ Pose(board[:, :3], board[:, 3]) for board in evidence.rig_from_board]
    new_boards = [placed.newrig_from_oldrig @ board for board in placed.joint.solution.state.rig_from_board]
    rows = [_new_rows(placed, camera_id, ids.index(camera_id), len(boards)) for camera_id in placed.moved_ids]
    camera_idx, frame_idx, corner_ids, used, pixels, residuals, board_idx = (
        np.concatenate(column) for column in zip(*rows, strict=True)
    )
    middle = placed.joint.observations.corners_in_board.mean(axis=0)
    frames = dict(zip(ids, evidence.frames, strict=True)) | {
        camera.camera_id: camera.frames
        for camera in placed.measured.detections.cameras
        if camera.camera_id in placed.moved_ids
    }
    has_boards = len(evidence.board_idx) > 0
    return Evidence(
        ids,
        tuple(frames[camera_id] for camera_id in ids),
        np.concatenate([evidence.camera_idx[kept], camera_idx]),
        np.concatenate([evidence.frame_idx[kept], frame_idx]),
        np.concatenate([evidence.corner_ids[kept], corner_ids]),
        np.concatenate([evidence.used[kept], used]),
        np.concatenate([evidence.pixels[kept], pixels]),
        np.concatenate([evidence.residuals_px[kept], residuals]),
        np.concatenate(
            [
                placed.newrig_from_oldrig.apply(evidence.board_centres_m),
                [board.apply(middle) for board in new_boards],
            ]
        ),
        np.concatenate([evidence.board_idx[kept], board_idx]) if has_boards else evidence.board_idx,
        np.array([board.matrix[:3] for board in (*boards, *new_boards)]) if has_boards else evidence.rig_from_board,
        tuple(picture for picture in evidence.pictures if picture.camera_idx not in moved),
    )


def _new_rows(placed: Replaced, camera_id: str, camera_idx: int, first_board: int) -> tuple[Any, ...]:
    """Columns of one placed camera's corners."""
    obs, index = placed.joint.observations, placed.measured.poses.ids.index(camera_id)
    mine = obs.camera_idx == index
    used = set(zip(obs.frame_idx[mine].tolist(), obs.corner_ids[mine].tolist(), strict=True))
    board_of = dict(zip(obs.frame_idx[mine].tolist(), obs.board_idx[mine].tolist(), strict=True))
    views = residuals_of_all(placed.measured.detections, placed.joint, index)
    frame_idx = np.concatenate([np.full(len(view.corner_ids), view.frame_idx) for view, _ in views])
    corner_ids = np.concatenate([view.corner_ids for view, _ in views])
    return (
        np.full(len(corner_ids), camera_idx),
        frame_idx,
        corner_ids,
        np.array([key in used for key in zip(frame_idx.tolist(), corner_ids.tolist(), strict=True)]),
        np.concatenate([view.corners_px for view, _ in views]),
        np.concatenate([residuals for _, residuals in views]),
        np.array([first_board + board_of[f] if f in board_of else -1 for f in frame_idx.tolist()]),
    )
