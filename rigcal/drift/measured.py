"""Where new board views put the cameras: solved afresh, with the lenses of the rig file held.

The stages are those of a calibration (pairs, chain, joint solve), so that flipped corner orders and bad views are met
by the same rules, and a camera that moved far needs no guess of where it went. The rig file's poses take no part: what
it says of the cameras and what the new views say of them are two measurements, compared in :mod:`rigcal.drift.verdict`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from rigcal.bundle import POSE
from rigcal.detections import SiteDetections
from rigcal.geometry import Floats
from rigcal.graph import chain_to_reference
from rigcal.intrinsics import IntrinsicsResult
from rigcal.pairwise import MIN_SHARED_VIEWS, PairPose, Pairs, PairwiseOptions, solve_pairs
from rigcal.refine import JointResult, RefineOptions, refine_rig
from rigcal.relative import RelativePoses
from rigcal.rigviews import of_cameras

_POINTS = 400
"""Corners of a camera that stand for all of them when its movement is put into pixels."""


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredGroup:
    """Cameras that shared board views join, where the new views put them."""

    detections: SiteDetections
    """The group's part of the capture."""
    poses: RelativePoses
    """In the frame of the first camera of the group; covariance from the new views alone, lenses held."""
    joint: JointResult
    """The solve behind them."""
    pairs: tuple[PairPose, ...]
    """The pairs that joined them; indices into ``poses.ids``."""

    def points_seen_by(self, camera_id: str) -> Floats:
        """(n, 3) board corners that a camera saw, in the frame of the group, thinned evenly."""
        obs, boards = self.joint.observations, self.joint.solution.state.rig_from_board
        rows = np.flatnonzero(obs.camera_idx == self.poses.ids.index(camera_id))
        rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(_POINTS, len(rows))).astype(int))]
        points = obs.points_in_board[rows]
        return np.array([boards[b].apply(point) for b, point in zip(obs.board_idx[rows], points, strict=True)])

    def views_of(self, camera_id: str) -> int:
        """Views of a camera that were used."""
        obs = self.joint.observations
        return len(np.unique(obs.board_idx[obs.camera_idx == self.poses.ids.index(camera_id)]))


def measured_groups(detections: SiteDetections, lenses: Mapping[str, IntrinsicsResult]) -> tuple[MeasuredGroup, ...]:
    """Solve the cameras in ``lenses`` afresh, in groups that shared views join; cameras alone are in none."""
    ids = [camera_id for camera_id in detections.camera_ids if camera_id in lenses]
    part = of_cameras(detections, ids)
    pairs = solve_pairs(part.board, [lenses[camera_id] for camera_id in ids], part.instants, PairwiseOptions()).solved
    edges = np.array([(pair.first, pair.second) for pair in pairs], dtype=np.int64).reshape(-1, 2)
    joined = coo_array((np.ones(len(edges)), edges.T), shape=(len(ids), len(ids)))
    count, label = connected_components(joined, directed=False)
    members = [np.flatnonzero(label == group).tolist() for group in range(count)]
    return tuple(_solved(part, group, lenses, pairs) for group in members if len(group) > 1)


def _solved(
    detections: SiteDetections,
    members: Sequence[int],
    lenses: Mapping[str, IntrinsicsResult],
    pairs: Sequence[PairPose],
) -> MeasuredGroup:
    ids = tuple(detections.camera_ids[c] for c in members)
    part = of_cameras(detections, ids)
    place = {camera: index for index, camera in enumerate(members)}
    own_pairs = tuple(
        replace(pair, first=place[pair.first], second=place[pair.second]) for pair in pairs if pair.first in place
    )
    chain = chain_to_reference(ids, Pairs(own_pairs, {}), needed_views=MIN_SHARED_VIEWS)
    joint = refine_rig(
        part.board,
        [lenses[camera_id] for camera_id in ids],
        [camera.frames for camera in part.cameras],
        part.instants,
        chain.cam_from_rig,
        RefineOptions(free_lenses=False),
    )
    unknowns = [(c, u) for c in range(len(ids)) for u in range(POSE)]
    poses = RelativePoses(ids, joint.cam_from_rig, joint.solution.joint_covariance(unknowns))
    return MeasuredGroup(part, poses, joint, own_pairs)
