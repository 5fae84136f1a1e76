"""A clock about one exchange of a series: its model, from as many exchanges before and after as steadiness allows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np

from rigcal.rig import ClockModel
from rigcal.sync.estimator.hull import Lines, bounding_lines, least_wander_ppm, some_line
from rigcal.sync.exchanges import Exchanges

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_MICROSECOND_NS = 1_000
_ITS_RANGE = 2.0
"""A rate that was seen to differ by so much to either side may go from one end of its range to the other."""


@dataclass(frozen=True, slots=True)
class ClockFit:
    """A clock's model, and the exchanges that it comes from."""

    model: ClockModel
    least_s: float
    """Least offset that the exchanges allow at the model's time."""
    greatest_s: float
    """Greatest offset, likewise."""
    lines: Lines
    """The best line, and the set that it was chosen from."""
    first: int
    """Index of the first exchange used."""
    end: int
    """Index behind the last exchange used."""
    wander_ppm: float
    """By how much the clock's rate must have changed within reach; 0 where a constant one explains the exchanges."""
    inner_drift_bound_ppm: float
    """How fast the bound grows as far as the exchanges used go; behind them ``model.drift_bound_ppm`` holds, which
    allows for the wander that was seen."""


def fit_clock(exchanges: Exchanges, about: int, *, reach: int, wander_ppm: float, most_drift_ppm: float) -> ClockFit:
    """The clock at exchange ``about``, from those up to ``reach`` before and after it.

    The bound allows the clock's rate to change by ``wander_ppm``; the best line is one of constant rate where there is
    one. Where the rate changed more than that within reach, fewer exchanges are used, down to one, and the bound grows
    behind them as fast as the change that was seen.

    Args:
        exchanges: Without steps between, and none with a negative round trip.
        about: Index of an exchange.
        reach: How many exchanges before and after it may be used.
        wander_ppm: Change of the clock's rate that the bound allows for.
        most_drift_ppm: Limit of the drift.
    """
    about_ns = int(exchanges.replied_ns[about]) // _MICROSECOND_NS * _MICROSECOND_NS

    def within(reach: int) -> slice:
        return slice(max(about - reach, 0), min(about + reach + 1, len(exchanges)))

    def lines(reach: int, wander_ppm: float) -> Lines | None:
        used = exchanges[within(reach)]
        return bounding_lines(used, about_ns=about_ns, wander_ppm=wander_ppm, most_drift_ppm=most_drift_ppm)

    def explained(reach: int) -> bool:
        used = exchanges[within(reach)]
        return some_line(used, about_ns=about_ns, wander_ppm=wander_ppm, most_drift_ppm=most_drift_ppm)

    steady, bounds, wandered_ppm = lines(reach, 0.0), lines(reach, wander_ppm), 0.0
    if steady is None:
        used = exchanges[within(reach)]
        wandered_ppm = least_wander_ppm(used, about_ns=about_ns, most_drift_ppm=most_drift_ppm)
    if bounds is None:
        # The farthest exchanges that still fit are those of another rate that nearly contradict it: half is clear.
        reach = _farthest(explained, reach) // 2
        steady, bounds = lines(reach, 0.0), lines(reach, wander_ppm)
    if bounds is None:
        raise ValueError(f"exchange {about} has a negative round trip")
    best, window = steady or bounds, within(reach)
    model = _model(best, bounds, about_ns, max(wander_ppm, _ITS_RANGE * wandered_ppm))
    inner_ppm = _farther(bounds.drift_interval_ppm, best.drift_ppm) + wander_ppm
    return ClockFit(model, *bounds.interval_s(about_ns), best, window.start, window.stop, wandered_ppm, inner_ppm)


def _farthest(explained: Callable[[int], bool], limit: int) -> int:
    """The greatest reach below a limit that one line explains, found from short to long."""
    known, too_far = 0, 1
    while too_far < limit and explained(too_far):
        known, too_far = too_far, 2 * too_far
    too_far = min(too_far, limit)
    while too_far - known > 1:
        middle = (known + too_far) // 2
        known, too_far = (middle, too_far) if explained(middle) else (known, middle)
    return known


def _model(best: Lines, bounds: Lines, about_ns: int, wander_ppm: float) -> ClockModel:
    """The best line, with bounds that hold every line of ``bounds``, and a rate that changes by ``wander_ppm``."""
    offset_s, drift_ppm = best.offset_s(about_ns), best.drift_ppm
    return ClockModel(
        offset_s=offset_s,
        drift_ppm=drift_ppm,
        at_utc=_utc(about_ns),
        bound_s=_farther(bounds.interval_s(about_ns), offset_s) + float(np.spacing(abs(offset_s))),
        drift_bound_ppm=_farther(bounds.drift_interval_ppm, drift_ppm) + wander_ppm,
        method="probe",
    )


def _farther(interval: tuple[float, float], value: float) -> float:
    """Distance of a value from the farther end of an interval."""
    return max(value - interval[0], interval[1] - value)


def _utc(ns: int) -> str:
    """ISO 8601 of whole microseconds since the epoch."""
    return (_EPOCH + timedelta(microseconds=ns // _MICROSECOND_NS)).isoformat(timespec="microseconds")[:-6] + "Z"
