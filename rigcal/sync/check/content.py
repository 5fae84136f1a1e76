"""What the cameras' pictures say of their clocks: the only check that sees the whole chain from sensor to stamp."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rigcal.sync.check.findings import Colour, Finding, duration
from rigcal.sync.check.readings import CameraReadings
from rigcal.sync.record import ClockLimits

NOTICEABLE_S = 0.001
"""An offset below this is no finding, however certain: 2 mm at 2 m/s."""
MAJORITY = 3
"""Cameras that are needed to tell which of them is off."""


@dataclass(frozen=True, slots=True)
class ContentState:
    """How far a camera's pictures are from where its stamps and the rig file put them."""

    residual_s: float
    """To be added to its stamps still; 0 where all is well."""
    bound_s: float
    drift_ppm: float
    drift_bound_ppm: float


def content_states(readings: Sequence[CameraReadings]) -> dict[str, ContentState]:
    """Per camera whose content decides, beside the middle of all of them, so that one that is off is named.

    Lags are relative to a reference; where that is the one that is off, all others seem to be. With three cameras
    and more the middle is where most agree: the reference, unless most are away from it to the same side.
    """
    known = {r.camera_id: r.lag for r in readings if r.lag is not None and r.lag.confident}
    figures = np.array([(lag.offset_s, lag.bound_s, lag.drift_ppm, lag.drift_bound_ppm) for lag in known.values()])
    if len(known) < MAJORITY:
        return {camera_id: ContentState(*row) for camera_id, row in zip(known, figures.tolist(), strict=True)}
    low, high = (np.quantile(figures, 0.5, axis=0, method=side) for side in ("lower", "higher"))
    middle_s, _, middle_ppm, _ = np.clip(0.0, low, high).tolist()
    _, bound_s, _, bound_ppm = np.median(figures, axis=0).tolist()
    return {
        camera_id: ContentState(offset - middle_s, max(bound, bound_s), drift - middle_ppm, max(width, bound_ppm))
        for camera_id, (offset, bound, drift, width) in zip(known, figures.tolist(), strict=True)
    }


def content_findings(
    readings: CameraReadings, state: ContentState | None, limits: ClockLimits, *, compared: int
) -> Iterator[Finding]:
    """What is wrong with a camera's pictures; ``compared`` cameras were."""
    if readings.swapped_with is not None:
        yield Finding(
            "swapped cameras",
            Colour.RED,
            f"its pictures are those of {readings.swapped_with}",
            f"exchange the cables or the files of {readings.camera_id} and {readings.swapped_with}, and check again",
        )
        return
    if readings.lag is not None and not readings.lag.confident:
        yield Finding(
            "content undecided",
            Colour.AMBER,
            f"its pictures do not tell its clock: {readings.lag.reason}",
            "move the board quickly, in curves, through what this camera and others see for 10 s, and check again",
        )
    if state is None:
        return
    certain_s = abs(state.residual_s) - state.bound_s
    if certain_s > NOTICEABLE_S:
        yield _off(state, limits, compared)
    if abs(state.drift_ppm) > state.drift_bound_ppm:
        yield _drifts(state, limits)


def _off(state: ContentState, limits: ClockLimits, compared: int) -> Finding:
    late = "later" if state.residual_s < 0 else "earlier"
    red = abs(state.residual_s) + state.bound_s > limits.error_s
    which = "" if compared >= MAJORITY else " than the reference camera's; two cameras cannot tell whose stamps are off"
    return Finding(
        "offset",
        Colour.RED if red else Colour.AMBER,
        f"its stamps are {duration(abs(state.residual_s))} (+- {duration(state.bound_s)}) {late} than its pictures"
        + which,
        "run `rigcal sync video` on this capture to write the offset into the rig file",
    )


def _drifts(state: ContentState, limits: ClockLimits) -> Finding:
    hold_s = max(limits.error_s - abs(state.residual_s) - state.bound_s, 0.0) / abs(state.drift_ppm * 1e-6)
    return Finding(
        "drift",
        Colour.RED,
        f"its pictures drift {abs(state.drift_ppm):.0f} ppm (+- {state.drift_bound_ppm:.0f}) away from its stamps",
        f"run `rigcal sync probe` or `rigcal sync video` now and every {duration(hold_s)}, or enable its PTP or NTP",
    )
