"""Which camera moved since the calibration, and how far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from rigcal.bundle import rmse_px
from rigcal.detections import SiteDetections
from rigcal.drift.consensus import find_stayed
from rigcal.drift.lens import LensChange, lens_change
from rigcal.drift.measured import MeasuredGroup, measured_groups
from rigcal.drift.movement import Movement, Placement, comparable_poses, misfit, place_cameras
from rigcal.errors import DriftError, OptionError
from rigcal.pairwise import MIN_SHARED_VIEWS
from rigcal.relative import RelativePoses
from rigcal.rig import Rig
from rigcal.rigdocument import RigDocument
from rigcal.rigfile import rig_of
from rigcal.rigviews import held_lenses

Status: TypeAlias = Literal["stayed", "moved", "suspect", "lens changed", "not judged"]

SIGMAS = 4.0
"""Movement over its uncertainty, as root mean square over six degrees of freedom, from which it is real. Of simulated
cameras that stayed the greatest of 80 is 1.6; of a real rig of four webcams, exposed up to 43 ms apart, 1.3 between
alternate halves of its capture and 3.9 between the first half and the last."""
BLIND = 2.0
"""Uncertainty of a camera's shift, over the limit, from which it is not judged: its movement would go unseen."""
GROWN = 2.0
"""Residual over the calibrated one from which something else than the pose changed."""


@dataclass(frozen=True, slots=True)
class DriftOptions:
    """What counts as a movement.

    Raises:
        OptionError: for a limit that is not positive.
    """

    limit_px: float = 0.5
    """Shift in the camera's image that is tolerated."""

    def __post_init__(self) -> None:
        if not self.limit_px > 0:
            raise OptionError("limit_px", expected="a number of pixels above 0", got=self.limit_px)

    def exceeded_by(self, movement: Movement) -> bool:
        """Whether a movement is both real and too large."""
        return movement.sigmas > SIGMAS and movement.shift_px > self.limit_px


@dataclass(frozen=True, slots=True)
class CameraDrift:
    """What the new views say of one camera."""

    camera_id: str
    status: Status
    reason: str
    """Why, in words; what to do where something is to be done."""
    views: int = 0
    """Board views that were used."""
    remark: str = ""
    """What else was noticed."""
    movement: Movement | None = None
    """Against the cameras that stayed; None where it was not measured."""
    lens: LensChange | None = None
    rmse_px: float | None = None
    """Residual with the camera's pose free."""
    calibrated_rmse_px: float | None = None
    """Residual of the calibration."""


@dataclass(frozen=True, slots=True, eq=False)
class GroupDrift:
    """Cameras that shared board views join."""

    measured: MeasuredGroup
    old: RelativePoses
    """What the rig file says of all cameras, with the uncertainty that matters to the comparison."""
    stayed: tuple[str, ...]
    """Cameras that are taken to have stayed."""
    alternatives: tuple[tuple[str, ...], ...]
    """Other sets of cameras that may as well have stayed instead."""
    placement: Placement | None
    """The others placed against them; None where all stayed."""


@dataclass(frozen=True, slots=True, eq=False)
class Drift:
    """Every camera of the rig, and the groups in which they were compared."""

    cameras: tuple[CameraDrift, ...]
    """In rig order."""
    groups: tuple[GroupDrift, ...]
    limit_px: float

    def with_status(self, *statuses: Status) -> tuple[str, ...]:
        """Cameras of these statuses."""
        return tuple(camera.camera_id for camera in self.cameras if camera.status in statuses)

    @property
    def unchanged(self) -> bool:
        """Whether no camera is known or suspected to have changed."""
        return not self.with_status("moved", "suspect", "lens changed")


def find_drift(detections: SiteDetections, document: RigDocument, options: DriftOptions) -> Drift:
    """Compare a rig with new views of its board.

    Args:
        detections: Views of cameras of the rig, in rig order.
        document: The rig file.
        options: The limit.

    Raises:
        DriftError: where the views judge no camera at all.
    """
    rig = rig_of(document)
    calibrated = {camera.id: camera.rmse_px.refined for camera in document.cameras}
    lenses = held_lenses(detections, document)
    changed: dict[str, LensChange] = {}
    while True:
        usable = {camera_id: lens for camera_id, lens in lenses.items() if camera_id not in changed}
        measured = measured_groups(detections, usable)
        groups = tuple(_judged(group, comparable_poses(document, group.poses), rig, options) for group in measured)
        other = [found for group in groups if (found := _other_lens(group, document))]
        if not other:
            break
        changed |= dict(other)
    cameras = {c: _with_other_lens(c, change, len(lenses[c].views)) for c, change in changed.items()}
    for group in groups:
        for camera_id in group.measured.poses.ids:
            cameras[camera_id] = _camera(camera_id, group, rig, calibrated[camera_id], options)
    for camera_id in rig.camera_ids:
        if camera_id not in cameras:
            views = len(lenses[camera_id].views) if camera_id in lenses else 0
            cameras[camera_id] = _not_seen(camera_id, views, list(detections.camera_ids))
    drift = Drift(tuple(cameras[camera_id] for camera_id in rig.camera_ids), groups, options.limit_px)
    if len(drift.with_status("not judged")) == len(drift.cameras):
        raise _too_few_views(detections, drift)
    return drift


def _judged(group: MeasuredGroup, old: RelativePoses, rig: Rig, options: DriftOptions) -> GroupDrift:
    new = group.poses

    def exceeds(held: Sequence[str], camera_id: str) -> bool:
        return options.exceeded_by(_movement(group, place_cameras(new, old, held, [camera_id]), held, camera_id, rig))

    found = find_stayed(
        new.ids,
        lambda one, two: not (exceeds([one], two) or exceeds([two], one)),
        lambda held: misfit(new, old, held),
    )
    sets = sorted((found.best, *found.as_good), key=lambda held: rig.reference not in held)
    stayed = sets[0]
    moved = [camera_id for camera_id in new.ids if camera_id not in stayed]
    placement = place_cameras(new, old, stayed, moved) if moved else None
    return GroupDrift(group, old, stayed, tuple(sets[1:]), placement)


def _other_lens(group: GroupDrift, document: RigDocument) -> tuple[str, LensChange] | None:
    """Of the cameras that may have moved, the one whose views another focal length explains best, if any."""
    sigma = {camera.id: camera.sigma for camera in document.cameras}
    always = set(group.stayed).intersection(*group.alternatives)
    found = [
        (camera_id, change)
        for camera_id in group.measured.poses.ids
        if camera_id not in always and (change := lens_change(group.measured, camera_id, sigma[camera_id]))
    ]
    return min(found, key=lambda one: one[1].freed_rmse_px / one[1].rmse_px, default=None)


def _movement(group: MeasuredGroup, placement: Placement, held: Sequence[str], camera_id: str, rig: Rig) -> Movement:
    points = group.poses.pose(held[0]).apply(group.points_seen_by(camera_id))
    return placement.movement(camera_id, rig.camera(camera_id).camera, points)


def _camera(
    camera_id: str, group: GroupDrift, rig: Rig, calibrated: float | None, options: DriftOptions
) -> CameraDrift:
    measured, sets = group.measured, (group.stayed, *group.alternatives)
    without = [held for held in sets if camera_id not in held]
    held = without[0] if without else tuple(c for c in group.stayed if c != camera_id)
    movement = _movement(measured, place_cameras(measured.poses, group.old, held, [camera_id]), held, camera_id, rig)
    residual = rmse_px(measured.joint.residuals_of(measured.poses.ids.index(camera_id)))
    status, reason = _status(movement, sets, without, options)
    views, remark = measured.views_of(camera_id), _remark(residual, calibrated)
    return CameraDrift(camera_id, status, reason, views, remark, movement, None, residual, calibrated)


def _remark(rmse_px: float | None, calibrated_px: float | None) -> str:
    if not rmse_px or not calibrated_px or rmse_px <= GROWN * calibrated_px:
        return ""
    return (
        f"its residual is {rmse_px:.2f} px against {calibrated_px:.2f} px when calibrated, wherever it stands: a "
        "blurred or moving board, cameras that are not exposed together, or another focus"
    )


def _status(
    movement: Movement,
    sets: Sequence[tuple[str, ...]],
    without: Sequence[tuple[str, ...]],
    options: DriftOptions,
) -> tuple[Status, str]:
    if len(without) == len(sets):
        return "moved", f"moved against {', '.join(sets[0])}: re-solve it with --resolve, or calibrate again"
    if without:
        others = " or ".join("{" + ", ".join(held) + "}" for held in sets)
        return "suspect", f"the views cannot tell whether {others} stayed; look which camera was touched"
    if movement.shift_sigma_px > BLIND * options.limit_px:
        return "not judged", (
            f"a shift of {SIGMAS * movement.shift_sigma_px:.1f} px would go unseen: show it and its neighbours the "
            "board in more positions"
        )
    return "stayed", "agrees with the other cameras"


def _with_other_lens(camera_id: str, change: LensChange, views: int) -> CameraDrift:
    reason = (
        f"the lens changed (focal length {change.focal_percent:+.2f} +- {change.focal_sigma_percent:.2f} %): lock zoom "
        f"and focus, and calibrate {camera_id} again"
    )
    return CameraDrift(camera_id, "lens changed", reason, views, "", None, change, change.freed_rmse_px, change.rmse_px)


def _not_seen(camera_id: str, views: int, captured: Sequence[str]) -> CameraDrift:
    if camera_id not in captured:
        reason = "no images of it in the capture"
    elif views == 0:
        reason = "the board was not found in its images"
    else:
        reason = f"its {views} views share fewer than {MIN_SHARED_VIEWS} instants with another usable camera"
    return CameraDrift(camera_id, "not judged", reason, views)


def _too_few_views(detections: SiteDetections, drift: Drift) -> DriftError:
    instants = (detections.instants.frame_idx >= 0).sum(axis=1)
    return DriftError(
        "these views cannot tell whether a camera moved",
        where=f"{len(detections.cameras)} cameras; {int((instants > 1).sum())} instants with two or more of them, "
        f"grouped by {detections.instants.rule}",
        expected=f"{MIN_SHARED_VIEWS} or more board positions, seen by two cameras at the same instant",
        got="; ".join(f"{camera.camera_id}: {camera.reason}" for camera in drift.cameras),
        do_next="show the board, held still, to neighbouring cameras together in several positions",
    )
