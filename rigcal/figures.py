"""From the results of the stages to the figures that the gates judge."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from rigcal.advice import CameraFigures, RigFigures, Sister
from rigcal.bundle import rmse_px
from rigcal.coverage import common_parts
from rigcal.detections import SiteDetections
from rigcal.graph import Chain
from rigcal.intrinsics import IntrinsicsResult
from rigcal.quality import JointQuality
from rigcal.refine import JointResult
from rigcal.scale import ScaleCheck
from rigcal.sisters import SisterGap


def camera_figures(
    ids: Sequence[str],
    lenses: Sequence[IntrinsicsResult],
    chain: Chain,
    joint: JointResult,
    quality: JointQuality,
    gaps: Sequence[SisterGap],
) -> tuple[CameraFigures, ...]:
    """Per camera what the gates judge; ``gaps`` are of the cameras that are declared alike."""
    figures = []
    for index, camera_id in enumerate(ids):
        coverage, path, link = quality.coverage[index], chain.paths[index], chain.links[index]
        weakest = max(pairwise(path), key=lambda ends: _added_variance(chain, ends[1]), default=None)
        gap = next((gap for gap in gaps if gap.camera == index), None)
        figures.append(
            CameraFigures(
                camera_id,
                lenses[index].rmse_px,
                rmse_px(joint.residuals_of(index)) or 0.0,
                quality.held_out_px[index],
                quality.focal_sigma_percent[index],
                _dropped_share(lenses[index], joint, index, coverage.views),
                coverage,
                parent_id=ids[path[-2]] if index else None,
                pairwise_rmse_px=link.rmse_px if link else None,
                position_sigma_m=quality.position_sigma_m[index] if index else None,
                chain_overlap_views=link.views if link else None,
                weakest=(ids[weakest[1]], ids[weakest[0]]) if weakest else None,
                common_parts=common_parts(joint, weakest[1], weakest[0], coverage.distances_m) if weakest else "",
                lens_agreement=quality.lens_agreement[index],
                sister=Sister(tuple(ids[c] for c in gap.sisters), gap.percent, gap.sigmas) if gap else None,
            )
        )
    return tuple(figures)


def rig_figures(
    detections: SiteDetections, chain: Chain, joint: JointResult, quality: JointQuality, scale: ScaleCheck | None
) -> RigFigures:
    """What the gates judge of the rig as a whole."""
    ids, obs = detections.camera_ids, joint.observations
    pairs = np.unique(np.stack([obs.board_idx, obs.camera_idx], axis=1), axis=0)
    links = [(link.views, c) for c, link in enumerate(chain.links) if link is not None]
    thinnest = min(links)[1] if links else None
    return RigFigures(
        ids,
        quality.scene_centre.sigma_m if quality.scene_centre else None,
        int((np.unique(pairs[:, 0], return_counts=True)[1] > 1).sum()),
        quality.split_half,
        quality.solver_agreement,
        scale,
        float(detections.instants.spread_s.max(initial=0.0)),
        (ids[thinnest], ids[chain.paths[thinnest][-2]]) if thinnest is not None else None,
    )


def _added_variance(chain: Chain, camera: int) -> float:
    link = chain.links[camera]
    return link.point_variance_m2 if link else 0.0


def _dropped_share(lens: IntrinsicsResult, joint: JointResult, camera: int, used: int) -> float:
    """Share of the views that some stage dropped as contradicting the rest; boards that moved contradict nothing."""
    findings = [*lens.findings, *(finding for c, finding in joint.contradictions if c == camera)]
    dropped = len({finding.frame for finding in findings if finding.action == "dropped"})
    return dropped / max(dropped + used, 1)
