"""Placing again the cameras that moved, all others held: poses and covariances.

The cameras that stayed keep their poses to the last digit. What the rig file did not know of a lens it still does not
know, and that part of a pose's uncertainty stays; the rest follows from the new views and from the cameras held.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigcal.bundle import SolveOptions, solve
from rigcal.drift.measured import MeasuredGroup
from rigcal.drift.movement import comparable_poses, place_cameras
from rigcal.geometry import Floats, Pose
from rigcal.refine import JointResult
from rigcal.relative import RelativePoses, poses_given_lenses, poses_of
from rigcal.rigdocument import RigDocument
from rigcal.uncertainty import centre_by_pose


@dataclass(frozen=True, slots=True, eq=False)
class Replaced:
    """A rig with some cameras placed again."""

    measured: MeasuredGroup
    """The new views."""
    joint: JointResult
    """Their solve with the cameras that stayed held, in the rig frame as it was."""
    moved_ids: tuple[str, ...]
    newrig_from_oldrig: Pose
    """The identity, unless the reference moved."""
    poses: RelativePoses
    """Every camera, in the new rig frame."""
    given_lenses: RelativePoses | None
    """The same with the uncertainty that is left if the lenses are exact, where the rig file stated it."""

    @property
    def touched_ids(self) -> tuple[str, ...]:
        """Cameras whose pose in the rig frame changed: all but the reference, where that moved."""
        return self.poses.ids if self.newrig_from_oldrig.angle_rad else self.moved_ids

    def sigmas(self, camera_id: str) -> tuple[float, float]:
        """One sigma of a camera's position (m) and of its rotation (degrees) in the new rig frame."""
        rows = self.poses.rows([camera_id])
        covariance = self.poses.covariance[np.ix_(rows, rows)]
        by_pose = centre_by_pose(self.poses.pose(camera_id))
        position = float(np.sqrt(np.trace(by_pose @ covariance @ by_pose.T)))
        return position, float(np.rad2deg(np.sqrt(np.trace(covariance[:3, :3]))))


def replace_cameras(
    document: RigDocument, measured: MeasuredGroup, stayed: Sequence[str], moved: Sequence[str]
) -> Replaced:
    """Place ``moved`` cameras of a group by its views, the others held where the rig file has them."""
    known, anchor = poses_of(document), stayed[0]
    anchor_from_rig = known.pose(anchor)
    placement = place_cameras(measured.poses, comparable_poses(document, measured.poses), stayed, moved)
    start = {c: placement.poses.pose(c) @ anchor_from_rig if c in moved else known.pose(c) for c in known.ids}
    joint = _solved(measured, start, anchor_from_rig.inverse() @ measured.poses.pose(anchor), moved)
    in_old_rig = start | dict(zip(measured.poses.ids, joint.cam_from_rig, strict=True))
    newrig_from_oldrig = in_old_rig[document.reference] if document.reference in moved else Pose.identity()
    oldrig_from_newrig = newrig_from_oldrig.inverse()
    poses = tuple(Pose.identity() if c == document.reference else in_old_rig[c] @ oldrig_from_newrig for c in known.ids)

    def with_covariance(seen_from_anchor: Floats) -> RelativePoses:
        from_anchor = tuple(pose @ poses[known.ids.index(anchor)].inverse() for pose in poses)
        seen = RelativePoses(known.ids, from_anchor, seen_from_anchor).seen_from(document.reference)
        return RelativePoses(known.ids, poses, seen.covariance)

    done = (measured, joint, tuple(moved), newrig_from_oldrig)
    given = poses_given_lenses(document)
    if given is None:
        covariance = place_cameras(measured.poses, known, stayed, moved).poses.covariance
        return Replaced(*done, with_covariance(covariance), None)
    covariance = placement.poses.covariance
    by_lenses = known.seen_from(anchor).covariance - given.seen_from(anchor).covariance
    return Replaced(*done, with_covariance(covariance + by_lenses), with_covariance(covariance))


def _solved(
    measured: MeasuredGroup, cam_from_rig: Mapping[str, Pose], rig_from_group: Pose, moved: Sequence[str]
) -> JointResult:
    """The group's boards and moved cameras solved in the rig frame, from the joint solve that moved all of them."""
    joint, ids = measured.joint, measured.poses.ids
    boards = tuple(rig_from_group @ board for board in joint.solution.state.rig_from_board)
    start = replace(joint.solution.state, cam_from_rig=tuple(cam_from_rig[c] for c in ids), rig_from_board=boards)
    freedom = replace(joint.freedom, poses=np.array([c in moved for c in ids]))
    options = SolveOptions(sigma_px=max(joint.solution.sigma_px, 0.01))
    solution = solve(joint.observations, start, freedom, options)
    return replace(joint, solution=solution, freedom=freedom, start=start)
