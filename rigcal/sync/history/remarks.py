"""What a user should know of a recording's clocks and frames, in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np

from rigcal.geometry import Floats
from rigcal.pace import Pace
from rigcal.rig import ClockModel
from rigcal.sync.check.findings import duration
from rigcal.sync.content.lags import CameraLag
from rigcal.sync.estimator.steps import ClockStep
from rigcal.sync.history.series import CameraHistory, OffsetSeries
from rigcal.sync.record import ClockLimits

NAMED_GAPS = 3
"""Gaps that are named one by one; of more, the longest is."""
BOUND_GROWTH = 1.5
"""How many times its bound at measurement a clock model's bound may be before it is worth a word."""


@dataclass(frozen=True, slots=True)
class CameraFacts:
    """What the remarks on a camera are made from, beside its history."""

    pace: Pace
    frame_t_s: Floats
    """(F,) time of each frame, in the order in which they came, on the history's axis."""
    epoch: bool
    clock: ClockModel | None
    """The rig file's, where the frames are placed with it."""
    limits: ClockLimits
    logged: bool | None
    """Whether the log of probes tells the clock of its host at that time; None where there is no log."""
    host_steps: Sequence[ClockStep] = ()
    """Steps of its host's clock, or of the rig's, that the probes show."""
    lag: CameraLag | None = None
    """What its pictures say, where they were compared."""
    declared: bool = False
    """Whether rig time is taken to be this camera's own."""


def moment(t_s: float, *, epoch: bool) -> str:
    """A time of a history: of day (UTC) where it counts from the epoch, else from the first frame."""
    if epoch:
        return f"{datetime.fromtimestamp(t_s, UTC):%H:%M:%S}"
    minutes, seconds = divmod(t_s, 60)
    return f"{int(minutes)} min {seconds:04.1f} s" if minutes else f"{seconds:.1f} s"


def camera_remarks(camera: CameraHistory, facts: CameraFacts) -> tuple[str, ...]:
    """Remarks on one camera, the gravest first."""
    return (
        *_step_remarks(facts),
        *_clock_remarks(camera, facts),
        *_gap_remarks(facts),
        *_order_remarks(facts),
        *_rate_remarks(camera, facts.pace, epoch=facts.epoch),
    )


def _step_remarks(facts: CameraFacts) -> Iterator[str]:
    for step in facts.pace.steps:
        yield (
            f"its stamps jump by {1e3 * step.jump_s:+.3g} ms at {_at(facts, step.at)} and stay there: its clock was "
            "stepped, or the camera restarted; no single clock model serves both sides, so split the recording there"
        )
    for set_by in facts.host_steps:
        whose = "its host's clock" if set_by.clock == "host" else "the rig's own clock"
        ahead_s = set_by.jump_s if set_by.clock == "rig" else -set_by.jump_s
        yield (
            f"{whose} was set {'forward' if ahead_s > 0 else 'back'} by {1e3 * abs(ahead_s):.3g} ms at "
            f"{_time(facts, set_by.at_s)}, as probes show: let its time service slew the clock, never step it, while "
            "cameras record"
        )


def _clock_remarks(camera: CameraHistory, facts: CameraFacts) -> Iterator[str]:
    if facts.declared:
        yield "rig time is taken to be its own: the others were compared with it, and no rig file holds a clock of it"
    elif facts.clock is None and facts.epoch:
        yield "no clock of it is in the rig file, so that nothing corrects its stamps: run rigcal sync probe or video"
    if camera.model is not None and facts.clock is not None:
        if not camera.measured:
            yield from _age_remarks(camera.model, facts.clock, facts.limits)
        yield from (text for series in camera.measured for text in _departure_remarks(series, camera.model, facts))
    if camera.latency_unknown:
        yield (
            "the clock of its host is known, what the camera adds until it stamps a frame is not: give "
            "capture_latency_s and its bound in the site file, or measure both by rigcal sync video"
        )
    if facts.logged is False:
        yield "the log holds no probes of its host from the time of this recording that tell its clock"
    if facts.lag is not None and not facts.lag.confident:
        yield f"its pictures do not tell its clock: {facts.lag.reason}"


def _age_remarks(model: OffsetSeries, clock: ClockModel, limits: ClockLimits) -> Iterator[str]:
    latest = int(np.argmax(model.bound_s))
    bound_s, age_s = float(model.bound_s[latest]), float(model.t_s[latest]) - clock.at_s
    if bound_s > BOUND_GROWTH * clock.bound_s:
        yield (
            f"its clock was measured {duration(abs(age_s))} {'before' if age_s > 0 else 'after'} "
            f"{'the end' if latest else 'the start'} of the recording: by then the bound has grown from "
            f"{1e3 * clock.bound_s:.3g} to {1e3 * bound_s:.3g} ms, "
            f"{1e3 * bound_s * limits.fastest_motion_m_per_s:.3g} mm at {limits.fastest_motion_m_per_s:g} m/s"
        )


def _departure_remarks(measured: OffsetSeries, model: OffsetSeries, facts: CameraFacts) -> Iterator[str]:
    """Where a measurement and the rig file's clock exclude each other."""
    offset_s = measured.offset_s - np.interp(measured.t_s, model.t_s, model.offset_s)
    claimed_s = np.interp(measured.t_s, model.t_s, model.bound_s)
    beyond_s = np.where(np.isfinite(offset_s), np.abs(offset_s) - measured.bound_s - claimed_s, -np.inf)
    if beyond_s.max() > 0:
        worst, first = int(np.argmax(beyond_s)), int(np.argmax(beyond_s > 0))
        source = "probes" if measured.method == "probe" else "pictures"
        yield (
            f"{source} and the rig file's clock exclude each other from {_time(facts, measured.t_s[first])} on, by up "
            f"to {1e3 * abs(offset_s[worst]):.3g} ms: measure this camera's clock again before its frames are used"
        )


def _gap_remarks(facts: CameraFacts) -> Iterator[str]:
    gaps, total = facts.pace.missing, facts.pace.missing_frames
    if not gaps:
        return
    verb = "1 frame is" if total == 1 else f"{total} frames are"
    if len(gaps) <= NAMED_GAPS:
        yield f"{verb} missing: " + ", ".join(f"{gap.count} after {_at(facts, gap.after)}" for gap in gaps)
        return
    longest = max(gaps, key=lambda gap: gap.count)
    yield f"{verb} missing in {len(gaps)} places, most after {_at(facts, longest.after)}: {longest.count} in a row"


def _order_remarks(facts: CameraFacts) -> Iterator[str]:
    for frames, one, many in (
        (facts.pace.repeated, "1 frame or its stamp came twice", "{} frames or their stamps came twice"),
        (facts.pace.backwards, "1 stamp lies before the one that came before", "{} stamps lie before the one before"),
    ):
        if len(frames):
            yield f"{one if len(frames) == 1 else many.format(len(frames))}, the first at {_at(facts, frames[0])}"


def _rate_remarks(camera: CameraHistory, pace: Pace, *, epoch: bool) -> Iterator[str]:
    off = camera.rate_off_percent
    if off is not None:
        yield (
            f"it declares {pace.declared_fps:g} fps and delivers {pace.delivered_fps:.4g} ({off:+.2g} %): it "
            "runs freely, or its exposure is too long"
        )
    if pace.rates_fps is not None:
        yield f"its frame rate changes between {pace.rates_fps[0]:.3g} and {pace.rates_fps[1]:.3g} fps"
    if pace.exact and not epoch:
        yield "its times are as regular as times made from frame numbers: lost frames and clocks do not show in such"
    if pace.source == "arrival":
        yield (
            f"its stamps look like times of arrival, not of exposure ({pace.reason}): a clock says nothing of when "
            "these frames were taken, and only a comparison of pictures (rigcal sync video) does"
        )


def _at(facts: CameraFacts, frame: int | np.int64) -> str:
    return _time(facts, facts.frame_t_s[frame])


def _time(facts: CameraFacts, t_s: float) -> str:
    return moment(float(t_s), epoch=facts.epoch)
