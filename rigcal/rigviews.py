"""Board views of cameras whose rig is calibrated: for what is measured with a rig afterwards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from rigcal.detections import Instants, SiteDetections
from rigcal.intrinsics import IntrinsicsOptions, IntrinsicsResult, hold_camera
from rigcal.rigdocument import RigDocument
from rigcal.rigfile import rig_of

_OPTIONS = IntrinsicsOptions()


def held_lenses(detections: SiteDetections, document: RigDocument) -> dict[str, IntrinsicsResult]:
    """The usable views of each camera that has any, its boards placed by the rig file's lens.

    Args:
        detections: The capture; every camera is one of the rig's, its images of the same size.
        document: The rig file.
    """
    held = {}
    for camera in detections.cameras:
        if any(len(view.corner_ids) >= _OPTIONS.min_corners for view in camera.views):
            entry = next(entry for entry in document.cameras if entry.id == camera.camera_id)
            noise_px = entry.rmse_px.intrinsic or entry.rmse_px.refined or 0.0
            lens = rig_of(document).camera(camera.camera_id).camera
            held[camera.camera_id] = hold_camera(camera, detections.board, lens, noise_px, _OPTIONS)
    return held


def of_cameras(detections: SiteDetections, camera_ids: Sequence[str]) -> SiteDetections:
    """The part of a capture that these cameras saw, in their order."""
    columns = [detections.camera_ids.index(camera_id) for camera_id in camera_ids]
    instants = detections.instants
    chosen = Instants(instants.rule, instants.frame_idx[:, columns], instants.t_s, instants.offset_s[:, columns])
    return replace(detections, cameras=tuple(detections.cameras[c] for c in columns), instants=chosen)
