"""What a probe and the rig file say of a camera's clock, held against each other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rigcal.rig import ClockModel
from rigcal.stamps import same_epoch
from rigcal.sync.check.findings import Colour, Finding, duration
from rigcal.sync.check.readings import CameraReadings, HostReading
from rigcal.sync.record import ClockLimits

FAST_DRIFT_PPM = 100.0
"""A clock that went further than this since the rig file was written was set, not left to drift: quartz stays within
50 ppm, and the hosts of a data centre within 30 (Huygens, NSDI 2018)."""
LONGEST_HOLD_S = 600.0
"""A clock that stays within its limit for this long needs no word about measuring again: a recording of ten minutes."""


@dataclass(frozen=True, slots=True)
class ClockState:
    """A camera's clock now."""

    offset_s: float
    """What is added to its stamps, by the rig file where it has a clock, else by the probe."""
    drift_ppm: float
    bound_s: float
    """How far the stamps, so corrected, may be from rig time now."""
    age_s: float | None
    """Time since the rig file's clock was measured; None where it has none."""
    method: str | None
    off_by_s: float | None
    """What the probe says, minus what the rig file says; None where there are not both."""


def clock_state(readings: CameraReadings, now_s: float) -> ClockState | None:
    """A camera's clock now; None where neither the rig file nor a probe says anything.

    A clock that was measured by stamps since the start of a recording is judged at the end of the capture.
    """
    model, fresh = readings.model, _fresh(readings)
    if model is not None and not same_epoch(np.array([now_s]), model):
        if readings.stamped_s is None or not same_epoch(np.array([readings.stamped_s]), model):
            return None
        at_s = readings.stamped_s
        offset_s = model.rig_time_s(at_s) - at_s
        return ClockState(offset_s, model.drift_ppm, model.bound_at_s(at_s), None, model.method, None)
    if model is None and fresh is None:
        return None
    if model is None:
        return (
            None
            if fresh is None
            else ClockState(0.0, 0.0, abs(fresh.rig_time_s(now_s) - now_s) + fresh.bound_at_s(now_s), None, None, None)
        )
    offset_s, age_s = model.rig_time_s(now_s) - now_s, now_s - model.at_s
    if fresh is None:
        return ClockState(offset_s, model.drift_ppm, model.bound_at_s(now_s), age_s, model.method, None)
    off_by_s = fresh.rig_time_s(now_s) - model.rig_time_s(now_s)
    bound_s = abs(off_by_s) + fresh.bound_at_s(now_s)
    return ClockState(offset_s, model.drift_ppm, bound_s, age_s, model.method, off_by_s)


def clock_findings(readings: CameraReadings, limits: ClockLimits, now_s: float) -> Iterator[Finding]:
    """What is wrong with a camera's clock."""
    host = readings.host
    if host is not None and host.clock is None:
        yield Finding(
            "dead host",
            Colour.RED,
            f"its host {host.name} does not answer: {host.silence}",
            f"see that {host.name} is on, in the network, and runs `rigcal sync serve` or an NTP server; check again",
        )
    if host is not None and host.confusion:
        yield Finding("time scale", Colour.RED, host.confusion, "set the host's time scale to UTC, and probe again")
    if host is not None and host.clock is not None:
        yield from _steps_while_probing(host)
    state = clock_state(readings, now_s)
    if state is None:
        return
    if readings.model is None:
        yield from _not_in_the_rig_file(state, limits)
        return
    fresh = _fresh(readings)
    moved = _moved(readings.model, fresh, state, limits, now_s) if fresh is not None else None
    if moved is not None:
        yield moved
    elif limits.error_s < state.bound_s:
        yield _too_wide(state, limits)
    else:
        yield from _lasting(readings.model, fresh, state, limits)
    if readings.model.method == "probe" and readings.latency is None and readings.lag is None:
        yield Finding(
            "unknown latency",
            Colour.AMBER,
            "the clock of its host is known, what the camera adds until it stamps a frame is not",
            "give capture_latency_s and its bound in the site file, or measure both by `rigcal sync video`",
        )


def _fresh(readings: CameraReadings) -> ClockModel | None:
    """The camera's clock by the probe, its latency taken into account."""
    from rigcal.sync.record import clock_of_host

    if readings.host is None or readings.host.clock is None:
        return None
    return clock_of_host(readings.host.clock.model, readings.latency)


def _steps_while_probing(host: HostReading) -> Iterator[Finding]:
    steps = host.clock.steps if host.clock else ()
    if steps:
        largest = max(steps, key=lambda step: abs(step.jump_s))
        whose = f"of {host.name}" if largest.clock == "host" else "of this machine"
        yield Finding(
            "stepped clock",
            Colour.RED,
            f"the clock {whose} was stepped by {duration(abs(largest.jump_s))} while it was probed",
            "let its time service settle (chrony: makestep only at the start), then probe and check again",
        )


def _not_in_the_rig_file(state: ClockState, limits: ClockLimits) -> Iterator[Finding]:
    within = state.bound_s <= limits.error_s
    yield Finding(
        "no clock" if within else "offset",
        Colour.AMBER if within else Colour.RED,
        f"its stamps are up to {duration(state.bound_s)} from rig time, and the rig file has no clock for it",
        "write the clocks into the rig file with `rigcal sync probe`",
    )


def _moved(
    model: ClockModel, fresh: ClockModel, state: ClockState, limits: ClockLimits, now_s: float
) -> Finding | None:
    """The clock is no longer where the rig file's model has it by now, beyond what either is known to."""
    off_by_s = state.off_by_s or 0.0
    if abs(off_by_s) <= model.bound_at_s(now_s) + fresh.bound_at_s(now_s):
        return None
    age_s = max(abs(state.age_s or 0.0), 1e-3)
    rate_ppm = abs(off_by_s) / age_s * 1e6
    red = abs(off_by_s) > limits.error_s / 2 or state.bound_s > limits.error_s
    colour = Colour.RED if red else Colour.AMBER
    if rate_ppm > FAST_DRIFT_PPM:
        return Finding(
            "stepped clock",
            colour,
            f"its clock is {duration(abs(off_by_s))} from where the rig file has it, {duration(age_s)} after it was "
            "measured: it was stepped or set",
            "run `rigcal sync probe` again, and find out what sets this clock (chrony: makestep only at the start)",
        )
    return Finding(
        "drift",
        colour,
        f"its clock is {duration(abs(off_by_s))} from where the rig file has it: it drifted by {rate_ppm:.0f} ppm more",
        "run `rigcal sync probe` again before each recording, or let NTP or PTP discipline this clock",
    )


def _too_wide(state: ClockState, limits: ClockLimits) -> Finding:
    measured = "as probed now" if state.off_by_s is not None else "by this capture's stamps"
    if state.off_by_s is None and state.age_s is not None:
        measured = f"{duration(state.age_s)} after it was measured"
    again = "`rigcal sync video` again with a board that moves faster and for longer"
    if state.method == "probe":
        again = "`rigcal sync probe` again, by cable and without other traffic"
    return Finding(
        "wide bound",
        Colour.RED,
        f"its clock is known to {duration(state.bound_s)} only, {measured}; {duration(limits.error_s)} are needed",
        f"run {again}",
    )


def _lasting(model: ClockModel, fresh: ClockModel | None, state: ClockState, limits: ClockLimits) -> Iterator[Finding]:
    """How long the clock stays within its limit; what the probe proves of a drift that the model does not have."""
    left_s = limits.error_s - state.bound_s
    if fresh is not None:
        off_ppm = abs(fresh.drift_ppm - model.drift_ppm)
        proven_ppm = off_ppm - fresh.drift_bound_ppm - model.drift_bound_ppm
        if proven_ppm > 0:
            hold_s = left_s / (off_ppm * 1e-6)
            yield Finding(
                "drift",
                Colour.RED if hold_s < LONGEST_HOLD_S else Colour.AMBER,
                f"its clock drifts {off_ppm:.0f} ppm off what the rig file says",
                f"run `rigcal sync probe` now and every {duration(hold_s)}, or let NTP or PTP discipline this clock",
            )
            return
    bound_ppm = _drift_bound_ppm(model, fresh, state)
    hold_s = left_s / (bound_ppm * 1e-6) if bound_ppm else LONGEST_HOLD_S
    if hold_s < LONGEST_HOLD_S:
        yield Finding(
            "drift bound",
            Colour.AMBER,
            f"its drift is known to {bound_ppm:.2g} ppm, which uses up the limit in {duration(hold_s)}",
            f"run `rigcal sync probe` again within {duration(hold_s)}, or probe for longer to know the drift better",
        )


def _drift_bound_ppm(model: ClockModel, fresh: ClockModel | None, state: ClockState) -> float:
    """What the drift may be off by: as the rig file has it, or less by how little the clock moved until now."""
    if fresh is None or not state.age_s or state.age_s <= 0:
        return model.drift_bound_ppm
    return min(model.drift_bound_ppm, (state.bound_s + model.bound_s) / state.age_s * 1e6)
