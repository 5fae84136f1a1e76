"""The check before a recording: every camera's light, and its clock error in millimetres at the fastest motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rigcal.pace import free_running
from rigcal.sync.check.clock import ClockState, clock_findings, clock_state
from rigcal.sync.check.content import ContentState, content_findings, content_states
from rigcal.sync.check.findings import Colour, Finding, duration, worst
from rigcal.sync.check.hosts import disagreeing_hosts
from rigcal.sync.check.readings import CameraReadings, StampReading
from rigcal.sync.check.stamps import skipped_s, stamp_error_s, stamp_findings
from rigcal.sync.record import ClockLimits


@dataclass(frozen=True, slots=True)
class CameraCheck:
    """One camera's line."""

    camera_id: str
    clock: ClockState | None
    stamps: StampReading | None
    content: ContentState | None
    error_s: float | None
    """How far the camera's frames may be from rig time; None where nothing was measured."""
    error_m: float | None
    """The same at the site's fastest motion."""
    findings: tuple[Finding, ...]

    @property
    def colour(self) -> Colour:
        """The worst of what was found."""
        return worst(finding.colour for finding in self.findings)


@dataclass(frozen=True, slots=True)
class SyncCheck:
    """The whole check."""

    cameras: tuple[CameraCheck, ...]
    limits: ClockLimits

    @property
    def colour(self) -> Colour:
        """The worst camera's."""
        return worst(camera.colour for camera in self.cameras)


def check_sync(readings: Sequence[CameraReadings], limits: ClockLimits, *, now_s: float) -> SyncCheck:
    """Judge what was read of every camera.

    Args:
        readings: In rig order.
        limits: Fastest motion, and how far its product with the clock error may go.
        now_s: Rig time of the check in seconds since the epoch.
    """
    states = content_states(readings)
    paces = {r.camera_id: r.stamps.pace for r in readings if r.stamps is not None and not r.stamps.trouble}
    slips = {slip.camera_id: slip for slip in free_running(paces)}
    strangers = disagreeing_hosts(readings)
    stamped = [r.stamps for r in readings if r.stamps is not None and not r.stamps.trouble]
    checks = []
    for one in readings:
        clock, content = clock_state(one, now_s), states.get(one.camera_id)
        error_s = _error_s(one, clock, content)
        findings = [
            *clock_findings(one, limits, now_s),
            *([strangers[one.camera_id]] if one.camera_id in strangers else []),
            *stamp_findings(one.stamps, slips.get(one.camera_id), _stepped_s(one.stamps, stamped, content), limits),
            *content_findings(one, content, limits, compared=len(states)),
        ]
        findings += _whole(one, error_s, limits, findings)
        error_m = None if error_s is None else error_s * limits.fastest_motion_m_per_s
        checks.append(CameraCheck(one.camera_id, clock, one.stamps, content, error_s, error_m, tuple(findings)))
    return SyncCheck(tuple(checks), limits)


def _stepped_s(
    stamps: StampReading | None, others: Sequence[StampReading], content: ContentState | None
) -> float | None:
    """A step by whole frames, unless the pictures are where the stamps have them."""
    stepped_s = None if stamps is None or stamps.trouble else skipped_s(stamps, others)
    told = content is not None and stepped_s is not None and abs(content.residual_s) < abs(stepped_s) / 4
    return None if told else stepped_s


def _error_s(readings: CameraReadings, clock: ClockState | None, content: ContentState | None) -> float | None:
    """What content says, since it sees the whole chain, else what the clock is known to; and the stamps' jitter."""
    if content is not None:
        known = abs(content.residual_s) + content.bound_s
    elif clock is not None:
        known = clock.bound_s
    else:
        return None
    return known + stamp_error_s(readings.stamps)


def _whole(
    readings: CameraReadings, error_s: float | None, limits: ClockLimits, findings: Sequence[Finding]
) -> list[Finding]:
    """What is to be said of the whole, where nothing more exact was said."""
    red = any(finding.colour is Colour.RED for finding in findings)
    if red or (error_s is None and readings.lag is not None):
        return []
    if error_s is None:
        return [
            Finding(
                "not measured",
                Colour.RED,
                "nothing says how far its frames are from the other cameras'",
                "record ten seconds of a board that is carried about before all cameras, and check that capture; or "
                "name its host as clock = in the site file",
            )
        ]
    if error_s <= limits.error_s:
        return []
    return [
        Finding(
            "clock error",
            Colour.RED,
            f"its frames may be {duration(error_s)} from rig time; {duration(limits.error_s)} are allowed",
            "mend what stands above, or measure its clock by `rigcal sync probe` or `rigcal sync video`",
        )
    ]
