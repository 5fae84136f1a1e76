"""Where a clock was set in one go, told from a clock whose rate changes.

Context: time daemons set a clock (a step) or let it run faster or slower until it is right (a slew), and oscillators
wander. Only a step cuts a series in two. Decision: where a monotonic clock was told beside the clock itself, the
difference of the two decides, since it changes by a step and by nothing else. Otherwise a step is what contradicts a
constant rate *and* is a jump: the lines before it and those after it, each of a rate that a quartz has, are apart from
the last exchange surely before to the first surely after. Cost: a slew that is over before the waits in the network let
anyone see it looks like a step, and a step that is small beside them like a change of the rate.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.ndimage import median_filter

from rigcal.geometry import Floats, Ints
from rigcal.sync.estimator.hull import Lines, bounding_lines, some_line
from rigcal.sync.exchanges import UNKNOWN, Exchanges

_STEEPEST_PPM = 1000.0
"""A clock that is being slewed has a constant rate as well: kernels slew by 500 ppm (``adjtime``, ntpd), and add the
oscillator's own drift and its correction. That of chrony (up to 83333 ppm) is over within some exchanges."""
_ROUND_TRIPS = 1.5
"""Quickest round trips that a jump must be worth: lines squeezed through a wandering clock are wrong by up to half of
one, those before and after it."""
_READ_TOGETHER_S = 100e-6
"""Two clocks that a program reads one after the other are read within this, but for a process put aside between."""
_AT_ONCE = 600
"""Exchanges that are searched at once: a linear program of them takes some milliseconds."""
_SETTLED = 3
"""Exchanges that a clock must have kept its rate for, on either side of a step."""
_SMOOTHED = 5
_ENOUGH_FOR_A_RATE = 8


@dataclass(frozen=True, slots=True)
class ClockStep:
    """A clock that was set in one go."""

    clock: Literal["host", "rig"]
    """Whose."""
    at_s: float
    """Rig time in seconds since the epoch of the first exchange that is surely after it."""
    within_s: float
    """Time since the last exchange that is surely before it."""
    jump_s: float
    """Change of the offset (rig minus host): a host that is set forward has a negative one, a rig a positive one."""
    bound_s: float
    """Half-width of the interval that holds the true jump."""
    evidence: Literal["monotonic", "offsets"]
    """What tells: the clock's difference from its monotonic clock, or offsets that no slew explains."""


@dataclass(frozen=True, slots=True)
class SteplessRun:
    """Exchanges between which no clock was set: indices ``first`` to before ``end``."""

    first: int
    end: int


def split_at_steps(exchanges: Exchanges) -> tuple[tuple[SteplessRun, ...], tuple[ClockStep, ...]]:
    """The runs between steps, and the steps, in order; exchanges that may be on either side are in no run.

    Args:
        exchanges: One or more, none with a negative round trip.
    """
    steps: list[tuple[int, ClockStep]] = []
    steps += _told(exchanges, "rig", exchanges.returned_ns, exchanges.rig_monotonic_ns)
    host_tells = bool((exchanges.host_monotonic_ns != UNKNOWN).all())
    if host_tells:
        steps += _told(exchanges, "host", exchanges.replied_ns, exchanges.host_monotonic_ns)
    cuts = sorted({index for index, _ in steps})
    runs = []
    for begin, end in zip([0, *cuts], [*cuts, len(exchanges)], strict=True):
        # The clock may have been set between the two stamps of its own in the first exchange after.
        run = SteplessRun(begin + (0 < begin < end - 1), end)
        if host_tells:
            runs.append(run)
            continue
        parts, found = _split_by_offsets(exchanges, run)
        runs += parts
        steps += found
    return tuple(runs), tuple(step for _, step in sorted(steps, key=lambda found: found[0]))


def _told(
    exchanges: Exchanges, clock: Literal["host", "rig"], real_ns: Ints, monotonic_ns: Ints
) -> list[tuple[int, ClockStep]]:
    """Steps of a clock against its monotonic clock, each with the index of the first exchange after it."""
    if len(real_ns) < 2:
        return []
    ahead_ns = (real_ns - real_ns[0]) - (monotonic_ns - monotonic_ns[0])
    jumps_s = _jumps_s(ahead_ns * 1e-9, (monotonic_ns - monotonic_ns[0]) * 1e-9)
    sign = 1.0 if clock == "rig" else -1.0
    return [
        (
            index,
            _step(exchanges, clock, (index - 1, index), sign * float(jumps_s[index]), _READ_TOGETHER_S, "monotonic"),
        )
        for index in np.flatnonzero(jumps_s).tolist()
    ]


def _jumps_s(ahead_s: Floats, t_s: Floats) -> Floats:
    """(n,) by how much a clock jumped ahead of its monotonic clock before each reading; 0 for nearly all.

    Single readings far apart are no jump, and neither are several in a row: such a clock is slewed, on a system whose
    monotonic clock is not.
    """
    if len(ahead_s) > _ENOUGH_FOR_A_RATE:
        rates = np.diff(ahead_s) / np.maximum(np.diff(t_s), 1e-9)
        ahead_s = ahead_s - np.median(rates) * t_s
    jumps_s = np.diff(median_filter(ahead_s, _SMOOTHED, mode="nearest"), prepend=ahead_s[0])
    large = np.abs(jumps_s) > _READ_TOGETHER_S
    beside = np.concatenate([[False], large[:-1]]) | np.concatenate([large[1:], [False]])
    return np.where(large & ~beside, jumps_s, 0.0)


def _split_by_offsets(exchanges: Exchanges, run: SteplessRun) -> tuple[list[SteplessRun], list[tuple[int, ClockStep]]]:
    """Parts of a run between the steps that its offsets show, and these steps."""
    parts: list[SteplessRun] = []
    steps: list[tuple[int, ClockStep]] = []
    begin = first = run.first
    while first < run.end:
        end = min(first + _AT_ONCE, run.end)
        if _steady(exchanges, first, end):
            first = end if end == run.end else first + _AT_ONCE // 2
            continue
        after = _reach_forward(exchanges, first, end)
        last = _reach_forward(exchanges, after, min(after + _AT_ONCE, run.end))
        before = _reach_back(exchanges, first, after, last)
        settled = (before - first >= _SETTLED or first == run.first) and (last - after >= _SETTLED or last == run.end)
        step = _jump(exchanges, SteplessRun(first, before), SteplessRun(after, last)) if settled else None
        if step is not None:
            parts.append(SteplessRun(begin, before))
            steps.append((after, step))
            begin = after
        first = after
    return [*parts, SteplessRun(begin, run.end)], steps


def _steady(exchanges: Exchanges, first: int, end: int) -> bool:
    """Whether a clock of constant rate explains the exchanges from ``first`` to before ``end``."""
    about_ns = int(exchanges.replied_ns[end - 1])
    return some_line(exchanges[first:end], about_ns=about_ns, most_drift_ppm=_STEEPEST_PPM)


def _reach_forward(exchanges: Exchanges, first: int, limit: int) -> int:
    """The greatest ``end`` up to a limit so that the exchanges from ``first`` to before it have a constant rate."""
    if _steady(exchanges, first, limit):
        return limit
    known, too_far = first + 1, limit
    while too_far - known > 1:
        middle = (known + too_far) // 2
        known, too_far = (middle, too_far) if _steady(exchanges, first, middle) else (known, middle)
    return known


def _reach_back(exchanges: Exchanges, limit: int, first: int, end: int) -> int:
    """The least index above a limit from which the exchanges up to before ``end`` have a constant rate."""
    too_far, known = limit, first
    while known - too_far > 1:
        middle = (known + too_far) // 2
        known, too_far = (middle, too_far) if _steady(exchanges, middle, end) else (known, middle)
    return known


def _jump(exchanges: Exchanges, before: SteplessRun, after: SteplessRun) -> ClockStep | None:
    """The step between two runs; None where the clock may have gone from one to the other without."""
    between = (before.end - 1, after.first)
    start_ns, end_ns = (int(exchanges.replied_ns[index]) for index in between)
    one = bounding_lines(exchanges[before.first : before.end], about_ns=start_ns)
    other = bounding_lines(exchanges[after.first : after.end], about_ns=end_ns)
    if one is None or other is None:  # on one side the clock is being slewed
        return None
    elapsed_ns = round(_elapsed_s(exchanges, between) * 1e9)
    # Each upper end is convex over time and each lower end concave: what is apart at both edges is apart between.
    at_start = _apart_s(one, start_ns, other, end_ns - elapsed_ns)
    at_end = _apart_s(one, start_ns + elapsed_ns, other, end_ns)
    least_s, best_s, greatest_s = np.transpose([at_start, at_end])
    if not (least_s.min() > 0 or greatest_s.max() < 0):
        return None
    sharper = int(np.argmin(greatest_s - least_s))
    quickest_s = float(exchanges.round_trip_s[before.first : after.end].min())
    if abs(best_s[sharper]) < _ROUND_TRIPS * quickest_s:
        return None
    bound_s = float(max(best_s[sharper] - least_s[sharper], greatest_s[sharper] - best_s[sharper]))
    return _step(exchanges, "host", between, float(best_s[sharper]), bound_s, "offsets")


def _apart_s(before: Lines, before_ns: int, after: Lines, after_ns: int) -> tuple[float, float, float]:
    """Least, best and greatest difference of the offsets that two sets of lines allow, at one time by either clock."""
    low_before, high_before = before.interval_s(before_ns)
    low_after, high_after = after.interval_s(after_ns)
    best_s = after.offset_s(after_ns) - before.offset_s(before_ns)
    return low_after - high_before, best_s, high_after - low_before


def _elapsed_s(exchanges: Exchanges, between: tuple[int, int]) -> float:
    return float(exchanges.rig_monotonic_ns[between[1]] - exchanges.rig_monotonic_ns[between[0]]) * 1e-9


def _step(
    exchanges: Exchanges,
    clock: Literal["host", "rig"],
    between: tuple[int, int],
    jump_s: float,
    bound_s: float,
    evidence: Literal["monotonic", "offsets"],
) -> ClockStep:
    at_s = float(exchanges.returned_ns[between[1]]) * 1e-9
    return ClockStep(clock, at_s, _elapsed_s(exchanges, between), jump_s, bound_s, evidence)
