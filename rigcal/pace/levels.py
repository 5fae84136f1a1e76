"""Levels that stamps share beside their grid, and how far stamps stray from them without anything being amiss."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigcal.geometry import Floats

SUPPORT = 3
"""As many stamps at one level make it a level: the least that tells a step from a late stamp and its neighbour."""
PAST = 15
"""Stamps that tell a level well: the floor of so many arrival times is known to a tenth of their scatter."""
_QUIET_AHEAD = 4
"""Stamps after an event in which late ones of a sensor come back."""
_NOISY_AHEAD_S = 3.0
"""Time after an event in which late arrivals come back: longer than a link may stall without losing frames."""
_QUIET_S = 0.5e-3
"""Intervals that scatter more than this, and more than rounding explains, are arrival times."""
_LEAST_S = 50e-6
"""Nothing finer is looked at: the jitter of good sensors."""
_MOST = 0.3
"""What strays by more than this share of the period is looked at, however much the stamps scatter."""


@dataclass(frozen=True, slots=True)
class Tolerance:
    """How far stamps stray without anything being amiss."""

    interval_s: float
    """Of an interval from the period, before it is looked at."""
    level_s: float
    """Of a well-told level from another one that is the same."""
    ahead: int
    """In how many frames late ones come back."""
    first: int
    """So many frames at the start of the recording may all be late."""
    end: int
    """How many frames tell a gap from a late frame at the end of the recording."""
    support: int
    """How many stamps tell a step from late ones."""
    rate: float
    """How far off the period may be, as a share."""


def tolerance(t_s: Floats, periods_s: Floats, quantum_s: float) -> Tolerance:
    """How far the stamps of this camera stray, from the middle half of its intervals and floors.

    Args:
        t_s: (n,) stamps.
        periods_s: (n - 1,) the period at each interval.
        quantum_s: What the stamps are rounded to.
    """
    strays_s = np.diff(t_s) - periods_s
    scatter_s = _beyond_rounding_s(strays_s, quantum_s)
    period_s = float(np.median(periods_s))
    least_s = max(1.5 * quantum_s, _LEAST_S)
    interval_s = float(np.clip(least_s + 6 * scatter_s, least_s, max(_MOST * period_s, least_s)))
    rate = 4 * scatter_s / (len(t_s) * period_s) + 1e-6
    if scatter_s < _QUIET_S:
        return Tolerance(interval_s, interval_s, _QUIET_AHEAD, first=2, end=1, support=SUPPORT, rate=rate)
    level_s = float(np.clip(8 * _floor_scatter_s(strays_s), least_s, interval_s))
    ahead = max(int(_NOISY_AHEAD_S / period_s), 3 * SUPPORT)
    return Tolerance(interval_s, level_s, ahead, first=PAST, end=5, support=PAST, rate=rate)


def _beyond_rounding_s(strays_s: Floats, quantum_s: float) -> float:
    """Robust scatter of intervals, less the most that rounding at both ends makes of them: half a quantum each."""
    middle_s = float(np.median(np.abs(strays_s)))
    usual = strays_s[np.abs(strays_s) <= 5 * 1.4826 * max(middle_s, quantum_s) + 1e-12]
    variance = min((1.4826 * middle_s) ** 2, float(np.mean(usual**2))) if len(usual) else 0.0
    return float(np.sqrt(max(variance - quantum_s**2 / 2, 0.0)))


def _floor_scatter_s(strays_s: Floats) -> float:
    """How much the floors of neighbouring groups of stamps differ: one standard deviation, robust."""
    ahead_s = np.cumsum(strays_s)
    whole = len(ahead_s) // PAST * PAST
    if whole < 4 * PAST:
        return float(1.4826 * np.median(np.abs(strays_s)) / np.sqrt(2))
    floors_s = np.sort(ahead_s[:whole].reshape(-1, PAST), axis=1)[:, SUPPORT - 1]
    return float(1.4826 * np.median(np.abs(np.diff(floors_s))) / np.sqrt(2))


def shared_level(values: Floats, width_s: float) -> float | None:
    """The lowest value that enough others follow within a width; None where the values share no level."""
    need = min(SUPPORT, max(len(values), 1))
    ordered = np.sort(values)
    shared = ordered[need - 1 :] - ordered[: len(ordered) - need + 1] <= width_s
    if not shared.any():
        return None
    first = int(np.argmax(shared))
    return float(ordered[first : first + need].mean())


def floor_of(values: Floats, width_s: float) -> float:
    """The lowest level that values share; their median where they share none."""
    level = shared_level(values, width_s)
    return float(np.median(values)) if level is None else level


def look_ahead(r: Floats, before_s: float, allowed: Tolerance) -> tuple[Floats, float | None]:
    """How far the next stamps lie above a level, and the other level that they share.

    As many stamps as it takes for one of them to be back (no other level then), or for them to share one. Where the
    level sank, late stamps lie where it was, and most have to be back.
    """
    reach = allowed.ahead
    while True:
        ahead = r[:reach] - before_s
        sank = float(np.median(ahead)) < -allowed.level_s
        if not sank and np.abs(ahead).min() <= allowed.level_s:
            return ahead, None
        level = shared_level(ahead, allowed.level_s)
        if level is not None or reach >= len(r):
            return ahead, level
        reach *= 2
