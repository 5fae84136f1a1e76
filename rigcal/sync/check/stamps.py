"""What the stamps of a camera's frames say: where they come from, how regular they are, and what is missing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from rigcal.pace import FreeRunning, Pace
from rigcal.sync.check.findings import Colour, Finding, duration
from rigcal.sync.check.readings import StampReading
from rigcal.sync.record import ClockLimits

SPREAD = 3.0
"""Standard deviations of the jitter that count as a frame's possible error."""
FEW_PERCENT = 0.1
"""Missing frames below this share are told, and stop no recording: one in half a minute at 30 fps."""
DECLARED_PPM = 1000.0
"""How far a rate may be from the declared one: 29.97 is called 30 everywhere."""
LATE_SHARE = 0.05
"""Of the rate: by what frames that come may be fewer than the stamps say; ten seconds of arrivals tell 0.5 %."""
MORE_THAN_A_FRAME = 1.5
"""Frames that the stamps of cameras which began and ended together do not differ by, but for a step."""
RULES_OF_A_FILE = frozenset({"presentation times"})
"""Stamps that a recorder wrote into a video; the camera's clock may never have been asked."""


def stamp_error_s(stamps: StampReading | None) -> float:
    """How far single frames may be from where the clock puts them, by the jitter of their stamps."""
    if stamps is None or stamps.pace.source != "arrival":
        return 0.0
    return SPREAD * stamps.pace.jitter_s


def skipped_s(stamps: StampReading, others: Sequence[StampReading]) -> float | None:
    """By how much a clock seems to have been stepped by whole frames; None where it does not.

    Such a step looks like frames that were dropped, or sent twice. But a camera that gave as many frames as the others,
    and whose stamps span another time, has lost none, unless it was told how many to record.
    """
    pace = stamps.pace
    alike = [other for other in others if other is not stamps and abs(other.pace.frames - pace.frames) <= 1]
    uneven = bool(pace.missing) or len(pace.repeated) > 0 or len(pace.backwards) > 0
    if not alike or not uneven or pace.period_s is None:
        return None
    longer_s = stamps.span_s - float(np.median([other.span_s for other in alike]))
    return longer_s if abs(longer_s) > MORE_THAN_A_FRAME * pace.period_s else None


def stamp_findings(
    stamps: StampReading | None, slip: FreeRunning | None, stepped_s: float | None, limits: ClockLimits
) -> Iterator[Finding]:
    """What is wrong with a camera's stamps.

    Args:
        stamps: What was read of them.
        slip: How its frame rate differs from the other cameras'.
        stepped_s: As of :func:`skipped_s`.
        limits: What errors are held against.
    """
    if stamps is None:
        return
    if stamps.trouble:
        yield Finding(
            "dead source",
            Colour.RED,
            f"its pictures cannot be had: {stamps.trouble}",
            "check the camera's cable, address and account, and check again",
        )
        return
    pace = stamps.pace
    yield from _source(stamps, limits)
    if pace.steps:
        largest = max(pace.steps, key=lambda step: abs(step.jump_s))
        yield Finding(
            "stepped clock",
            Colour.RED,
            f"its clock was stepped: stamps jump by {duration(abs(largest.jump_s))} at frame {largest.at}, and stay",
            "let its time service settle (chrony: makestep only at the start) before the recording",
        )
    if stepped_s is not None:
        yield Finding(
            "stepped clock",
            Colour.RED,
            "its clock was stepped: it gave as many frames as the others, and its stamps span "
            f"{duration(abs(stepped_s))} {'more' if stepped_s > 0 else 'less'}",
            "let its time service settle (chrony: makestep only at the start) before the recording",
        )
    else:
        yield from _frames(pace)
    yield from _rate(pace, slip)
    yield from _delivery(stamps)


def _source(stamps: StampReading, limits: ClockLimits) -> Iterator[Finding]:
    pace = stamps.pace
    if stamps.rule == "arrival" or pace.source == "arrival":
        error_s = stamp_error_s(stamps)
        jitter = f", which scatters by {duration(pace.jitter_s)}" if pace.source == "arrival" else ""
        yield Finding(
            "arrival stamps",
            Colour.RED if error_s > limits.error_s else Colour.AMBER,
            f"its stamps say when frames arrived, not when they were taken{jitter}",
            "have the camera stamp its frames (PTP, or NTP with RTCP sender reports); until then measure its mean "
            "delay by `rigcal sync video`",
        )
    elif stamps.rule in RULES_OF_A_FILE:
        yield Finding(
            "no stamps",
            Colour.AMBER,
            "its video holds no times but its own frame count",
            "record timestamps.csv, or name images by their capture time",
        )


def _frames(pace: Pace) -> Iterator[Finding]:
    if pace.missing:
        yield Finding(
            "dropped frames",
            Colour.RED if pace.missing_percent > FEW_PERCENT else Colour.AMBER,
            f"{pace.missing_frames} of {pace.frames + pace.missing_frames} frames are missing "
            f"(first after frame {pace.missing[0].after})",
            "look for what cannot keep up: network load, disk, USB bandwidth, the camera's bit rate",
        )
    if len(pace.repeated):
        yield Finding(
            "repeated frames",
            Colour.AMBER,
            f"{len(pace.repeated)} frames came twice (first at frame {pace.repeated[0]})",
            "look for a recorder or network that sends frames again",
        )
    if len(pace.backwards):
        yield Finding(
            "time runs backwards",
            Colour.RED,
            f"{len(pace.backwards)} stamps lie before the one that came before (first at frame {pace.backwards[0]})",
            "look for a clock that is set while recording, or frames that are delivered out of order",
        )
    if pace.varies and pace.rates_fps is not None:
        yield Finding(
            "changing rate",
            Colour.AMBER,
            f"its frame rate changes between {pace.rates_fps[0]:.3g} and {pace.rates_fps[1]:.3g} per second",
            "fix the exposure time, so that the camera keeps its rate in the dark",
        )


def _rate(pace: Pace, slip: FreeRunning | None) -> Iterator[Finding]:
    if slip is not None:
        beside = "the others run" if slip.against == "the others" else "it is declared"
        after = duration(slip.half_frame_after_s)
        yield Finding(
            "frame rate",
            Colour.RED,
            f"it free-runs at {slip.fps:.5g} frames per second where {beside} at {slip.expected_fps:.5g}: half a frame "
            f"apart after {after}",
            f"set its frame rate, enable its PTP or trigger, or re-measure every {after}",
        )
    elif pace.off_ppm is not None and abs(pace.off_ppm) > DECLARED_PPM:
        yield Finding(
            "declared rate",
            Colour.AMBER,
            f"it delivers {pace.delivered_fps:.5g} frames per second and declares {pace.declared_fps:.5g}",
            "mend the rate in the camera or in the site file; nothing may count time by its frame numbers",
        )


def _delivery(stamps: StampReading) -> Iterator[Finding]:
    """A camera whose stamps count more frames than come: they are made from a rate that it does not reach."""
    fps, arrived = stamps.pace.delivered_fps, stamps.arrived_fps
    if fps is not None and arrived is not None and arrived < (1 - LATE_SHARE) * fps and not stamps.pace.missing:
        yield Finding(
            "wrong stamps",
            Colour.RED,
            f"its stamps count {fps:.4g} frames per second, and {arrived:.4g} arrive: they are not its frames' times",
            "lower its frame rate or bit rate to what it delivers, and have it stamp its frames by its clock",
        )
