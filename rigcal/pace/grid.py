"""The grid that stamps sit on: what they are rounded to, and the time between frames, whatever is missing or late."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter, minimum_filter1d

from rigcal.geometry import Bools, Floats

_WINDOW, _WINDOW_S = 31, 1.0
"""Frames, and time, over which a local rate is told at least."""
_NEAR = 0.3
"""Intervals within this share of their neighbours' median count as one period; a lost frame makes it 1.0 more."""
_QUANTA_S = (0.1, 0.01, 1 / 600, 1e-3, 1e-4, 1 / 12288, 1 / 12800, 1 / 15360, 1 / 30000, 1 / 90000, 1e-5, 1e-6)
"""What stamps are rounded to in practice: decimals, QuickTime's 1/600, muxers' time bases, RTP's and MPEG's 1/90000."""
_VARIES, _LEAPS = 0.02, 0.1
"""A rate that creeps by less than 2 % or leaps by less than 10 % is no change of exposure; clocks differ by 0.01 %."""
_QUIET = 0.1
"""Intervals that scatter by more than this share of the period are arrival times, and take a second to tell a rate."""
_SCATTER = 0.02
"""Intervals that scatter by this share of the period allow one window; ones that scatter more need as many more."""
_TOGETHER = 0.5
"""Phases whose mean is shorter than this are no phase: links that stall several times a second."""
_NO_PHASE = 0.1
"""Mean phases shorter than this come from rates that change, or from so few frames that chance makes them."""
_SPANS = 20_000
"""As many spans of a length tell the period to a thousandth of their jitter."""
_TURNED = 0.75
"""Phases that turn by more than this share of a half turn are not trusted: the median of the intervals tells then."""
_LAG = 4
"""Frames over which the phase of the grid is followed: a rate 12 % off goes half around in so many."""


def quantum_s(t_s: Floats, period_s: float) -> float:
    """The coarsest rounding that all stamps keep, counted from the first; 0 where none shows.

    A rounding coarser than half the period is no rounding but the grid itself, and in a grid without any
    deviation no rounding shows.
    """
    resolution_s = 4 * float(np.spacing(np.abs(t_s).max()))
    intervals_s = np.diff(t_s)
    least_s = float(intervals_s[intervals_s > period_s / 2].min(initial=period_s))
    if np.all(_off_multiples(intervals_s, least_s) <= resolution_s):
        return 0.0
    for quantum in _QUANTA_S:
        tolerance_s = max(resolution_s, 1e-3 * quantum)
        fine = quantum <= period_s / 2 and tolerance_s <= quantum / 4
        if fine and np.all(_off_multiples(t_s - t_s[0], quantum) <= tolerance_s):
            return quantum
    return 0.0


def _off_multiples(values_s: Floats, of_s: float) -> Floats:
    """How far values are from the nearest multiple."""
    return np.asarray(np.abs(values_s - of_s * np.round(values_s / of_s)))


def coarse_period_s(t_s: Floats) -> float:
    """The usual time between frames, to some per cent; 0 where time does not go on.

    Frames that are delivered in bursts have intervals of two kinds, neither of which is the period: then the time that
    the fewest frames take of which most such times agree.
    """
    for lag in (1, 2, 3, 4, 6, 8):
        if lag >= len(t_s):
            break
        spans_s = (t_s[lag:] - t_s[:-lag]) / lag
        period_s = float(np.median(spans_s))
        if period_s > 0 and np.mean(np.abs(spans_s - period_s) < _NEAR * period_s) > 0.5:
            return period_s
    return max(float(np.median(np.diff(t_s))), 0.0)


def window_frames(period_s: float) -> int:
    """Frames over which a local rate is told."""
    return max(_WINDOW, 2 * round(_WINDOW_S / period_s / 2) + 1)


def steady_period_s(t_s: Floats, coarse_s: float) -> float:
    """The time between frames of one steady rate, from ever longer spans.

    A span of frames turns the phase of a grid by whole turns and by what its period is off; missing frames turn it by
    whole turns more. The median over all spans passes over stalls and steps, and each length makes the period good
    enough for the next not to turn by half.
    """
    best_s, lag, every = coarse_s, 1, len(t_s) // _SPANS + 1
    while lag <= max(len(t_s) // 4, 1) and lag <= 1024:
        turns = np.exp(2j * np.pi / best_s * (t_s[lag::every] - t_s[:-lag:every]))
        mean = turns.mean()
        if abs(mean) < _NO_PHASE:
            break
        around = np.median(np.angle(turns * np.conj(mean)))
        best_s *= 1 + float(np.angle(mean) + around) / (2 * np.pi * lag)
        lag *= 2
    return best_s


def local_periods_s(t_s: Floats, steady_s: float, quantum_s: float) -> Floats | None:
    """(n - 1,) time between frames around each interval, of a rate that changes; None where it is steady.

    A rate that creeps shows in the phase of the stamps on the steady grid, which missing frames leave alone; one that
    leaps shows in the median of the intervals. Both have to exceed eight times what the scatter of the intervals
    makes of them.
    """
    intervals_s, window = np.diff(t_s), _WINDOW
    if len(intervals_s) < 2 * window:
        return None
    middle_s = median_filter(intervals_s, size=window, mode="nearest")
    scatter = _scatter(intervals_s - middle_s, steady_s, quantum_s)
    if scatter > _QUIET:
        window = window_frames(steady_s)
        middle_s = median_filter(intervals_s, size=window, mode="nearest")
    if len(intervals_s) < 2 * window:
        return None
    leaps = np.abs(middle_s / steady_s - 1) > max(_LEAPS, 8 * 1.25 * scatter / np.sqrt(window))
    wide = window * int(np.clip(np.ceil(scatter / _SCATTER), 1, (len(t_s) - 1 - _LAG) // window))
    creep = _creep(t_s, steady_s, wide)
    followed = ~leaps & ~np.isnan(creep)
    creeps = followed.any() and np.ptp(creep[followed]) > max(_VARIES, 8 * 2 * scatter / (_LAG * wide))
    if not (creeps or _lasts(leaps, window // 2)):
        return None
    return np.asarray(np.where(followed, steady_s * (1 + creep), _near_mean(intervals_s, middle_s, window)))


def passable(t_s: Floats, local_s: Floats) -> Floats:
    """(n - 1,) period at each interval of a changing rate: the one of those around it that is nearest.

    An interval that is near enough to them is its own period.
    """
    intervals_s = np.diff(t_s)
    around = window_frames(float(np.median(local_s))) // 3
    shortest_s, longest_s = minimum_filter1d(local_s, around), maximum_filter1d(local_s, around)
    usual = (intervals_s > (1 - _NEAR) * shortest_s) & (intervals_s < (1 + _NEAR) * longest_s)
    return np.asarray(np.where(usual, intervals_s, np.clip(intervals_s, shortest_s, longest_s)))


def _scatter(strays_s: Floats, period_s: float, quantum_s: float) -> float:
    """Robust scatter of intervals as a share of the period; that of rounding, 0.41 quanta, at least."""
    return max(1.4826 * float(np.median(np.abs(strays_s))), 0.41 * quantum_s) / period_s


def _creep(t_s: Floats, steady_s: float, window: int) -> Floats:
    """(n - 1,) how much longer than the steady period the intervals are, as a share, by the turn of the phase.

    NaN where the phases of a window do not agree, or have turned so far that they may have turned the other way.
    """
    turns = np.exp(2j * np.pi * (t_s[_LAG:] - t_s[:-_LAG]) / steady_s)
    sums = np.cumsum(np.concatenate([[0], turns]))
    mean = (sums[window:] - sums[:-window]) / window
    angle = np.angle(mean)
    clear = (np.abs(mean) > _TOGETHER) & (np.abs(angle) < _TURNED * np.pi)
    share = np.where(clear, angle / (2 * np.pi * _LAG), np.nan)
    before = (len(t_s) - 1 - len(share)) // 2
    return np.pad(share, (before, len(t_s) - 1 - len(share) - before), mode="edge")


def _lasts(marked: Bools, least: int) -> bool:
    """Whether as many in a row are marked: half a window, since the median turns with half of its values."""
    ends = np.flatnonzero(np.diff(np.concatenate([[0], marked.astype(np.int8), [0]])))
    return bool(np.any(ends[1::2] - ends[::2] >= least))


def _near_mean(intervals_s: Floats, middle_s: Floats, window: int) -> Floats:
    """Mean of the intervals in the window that are near its median."""
    kernel = np.ones(window)
    near = (np.abs(intervals_s - middle_s) < _NEAR * middle_s).astype(np.float64)
    count = np.convolve(near, kernel, mode="same")
    total_s = np.convolve(near * intervals_s, kernel, mode="same")
    return np.asarray(np.where(count > 0.5, total_s / np.maximum(count, 1), middle_s))
