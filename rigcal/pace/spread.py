"""How far stamps lie from their grid, and what that says of where they were made."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from rigcal.geometry import Floats
from rigcal.pace.grid import window_frames
from rigcal.pace.results import PaceOptions, Source

_BLOCK = 300
"""Residuals are taken from a line through the medians of so many frames, so that a clock may wander over hours."""
_EXACT = 1.05
"""Spread of the stamps around a line, in their quantum: rounding makes 1. 20 us of jitter in stamps of 1 ms make more
than this in two of three recordings of a thousand frames, and in one of twenty-five of a hundred frames."""
_ROUNDED = 2
"""Stamps that spread no wider than this many quanta are as near their grid as rounding tells: where the period is a
multiple of the quantum, a jitter of a tenth of it makes stamps flip between two values."""
_CATCHING_UP = -0.2
"""Correlation of neighbouring intervals below which late ones are followed by short ones: -0.5 for stamps that scatter
around a grid, 0 for a loop that sleeps between frames."""
_LATE_SHARE, _LATE_LEAST = 0.005, 3
"""Share and number of late stamps that give arrival times away on a quiet host; sensors have none."""
_COARSE = 4
"""Stamps rounded to this many times the jitter of arrival times hide it."""


@dataclass(frozen=True, slots=True)
class Spread:
    """How the stamps lie around their grid."""

    period_s: float
    period_sigma_s: float
    jitter_s: float
    worst_s: float
    range_s: float
    """From the earliest to the latest, beside the grid."""
    exact: bool
    catching_up: float
    """Correlation of neighbouring intervals, less their period."""


def steady_spread(t_s: Floats, number: Floats, *, about_s: float, quantum_s: float) -> Spread:
    """Around one line through the stamps (n,) of the frames of these numbers (n,), whose slope is about known."""
    slope_s, residual_s = _line(number, t_s - about_s * number)
    wander_s, sigma_s = _wander(number, residual_s)
    finest_s = quantum_s or 8 * float(np.spacing(np.abs(t_s).max()))
    return Spread(
        about_s + slope_s,
        max(sigma_s, float(np.spacing(np.abs(t_s).max())) / max(float(np.ptp(number)), 1.0)),
        _jitter_s(residual_s - wander_s, quantum_s),
        float(np.abs(residual_s - wander_s).max()),
        float(np.ptp(residual_s - wander_s)),
        float(np.ptp(residual_s)) <= _EXACT * finest_s,
        _catching_up(np.diff(residual_s)),
    )


def varying_spread(t_s: Floats, number: Floats, periods_s: Floats, *, quantum_s: float) -> Spread:
    """Around a grid whose period (n - 1,) changes on the way."""
    strays_s = np.diff(t_s) - periods_s * np.diff(number)
    ahead_s = np.concatenate([[0.0], np.cumsum(strays_s)])
    period_s = float(np.median(periods_s))
    window = window_frames(period_s)
    residual_s = ahead_s - median_filter(ahead_s, size=window, mode="nearest")
    windows = max(len(periods_s) / window, 1.0)
    return Spread(
        period_s,
        float(np.mean(np.abs(periods_s - period_s)) / np.sqrt(windows)),
        _jitter_s(residual_s, quantum_s),
        float(np.abs(residual_s).max()),
        float(np.ptp(residual_s)),
        False,
        _catching_up(strays_s),
    )


def source_of(frames: int, late: int, spread: Spread, quantum_s: float, options: PaceOptions) -> tuple[Source, str]:
    """Where the stamps were made, as far as their scatter tells, and why."""
    jitter = f"{spread.jitter_s * 1e3:.3g} ms"
    if frames < options.least_frames:
        return "unknown", f"only {frames} frames, {options.least_frames} are needed"
    if quantum_s > _COARSE * options.arrival_jitter_s and spread.jitter_s < quantum_s:
        return "unknown", f"stamps are rounded to {quantum_s * 1e3:.3g} ms, which hides how they scatter"
    if late >= _LATE_LEAST and late >= _LATE_SHARE * frames:
        return "arrival", f"{late} of {frames} stamps are late, up to {spread.worst_s * 1e3:.3g} ms, and catch up"
    if spread.jitter_s <= options.sensor_jitter_s or spread.range_s <= _ROUNDED * quantum_s:
        return "sensor", "perfectly regular" if spread.exact else f"stamps keep a grid within {jitter}"
    if spread.jitter_s < options.arrival_jitter_s:
        return "unknown", f"a jitter of {jitter} may be a sensor's or a quiet link's"
    if spread.catching_up <= _CATCHING_UP:
        return "arrival", f"stamps scatter by {jitter} around their grid, and late ones catch up"
    return "unknown", f"intervals scatter by {jitter}, and stamps do not come back to a grid"


def _line(number: Floats, values_s: Floats) -> tuple[float, Floats]:
    """Slope of a robust line, and what is left: least squares over what lies within four sigma, to convergence."""
    x, slope_s = number - number.mean(), 0.0
    residual_s = values_s - np.median(values_s)
    for _ in range(5):
        away_s = np.abs(residual_s - np.median(residual_s))
        kept = away_s <= max(4 * 1.4826 * float(np.median(away_s)), 1e-9)
        near_x, near_s = x[kept] - x[kept].mean(), residual_s[kept]
        more_s = float(near_x @ near_s) / max(float(near_x @ near_x), 1e-12)
        slope_s += more_s
        residual_s = residual_s - more_s * x
        if abs(more_s) * float(np.ptp(x)) < 1e-9:
            break
    return slope_s, residual_s - np.median(residual_s)


def _wander(number: Floats, residual_s: Floats) -> tuple[Floats, float]:
    """Slow course of the residuals (n,), 0 for short recordings, and the standard deviation of their line's slope."""
    blocks = len(residual_s) // _BLOCK
    span = max(float(np.ptp(number)), 1.0)
    if blocks < 4:
        middle_s = _trimmed(residual_s)
        together = float(np.clip(_correlation(middle_s), 0, 0.95))
        effective = len(middle_s) * (1 - together) / (1 + together)
        return np.zeros(len(number)), float(np.std(middle_s) * np.sqrt(12 / max(effective, 1)) / span)
    whole = blocks * _BLOCK
    at = np.median(number[:whole].reshape(blocks, _BLOCK), axis=1)
    course_s = np.median(residual_s[:whole].reshape(blocks, _BLOCK), axis=1)
    return np.interp(number, at, course_s), float(np.std(course_s) * np.sqrt(12 / blocks) / span)


def _trimmed(values_s: Floats) -> Floats:
    """The values within five robust sigma of their median."""
    away_s = np.abs(values_s - np.median(values_s))
    return values_s[away_s <= 5 * 1.4826 * float(np.median(away_s)) + 1e-12]


def _jitter_s(residual_s: Floats, quantum_s: float) -> float:
    """Root-mean-square of the residuals without outliers, less the part that is rounding."""
    return float(np.sqrt(max(float(np.var(_trimmed(residual_s))) - quantum_s**2 / 12, 0.0)))


def _catching_up(strays_s: Floats) -> float:
    """Correlation of neighbouring strays of the intervals, outliers clipped."""
    scale_s = 5 * 1.4826 * float(np.median(np.abs(strays_s)))
    return _correlation(np.clip(strays_s, -scale_s, scale_s))


def _correlation(values: Floats) -> float:
    """Correlation of neighbours; 0 where the values do not change."""
    centred = values - values.mean()
    total = float(centred @ centred)
    return float(centred[1:] @ centred[:-1]) / total if total > 0 else 0.0
