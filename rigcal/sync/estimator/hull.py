"""The lines that no exchange contradicts: hard bounds on a clock's offset and drift, and the best line among them.

No packet arrives before it was sent. So each exchange says ``T1 - T2 <= offset`` at the host's time T2, and
``offset <= T4 - T3`` at T3. Where the clock runs at a constant rate its offset is a line over the host's time that
passes above all of the first and below all of the second: two convex hulls and linear programs, as Moon, Skelly and
Towsley have it for one direction (Estimation and removal of clock skew from network delay measurements, INFOCOM 1999).
What all such lines have in common is certain, whatever the packets waited and whichever way.

**The best line.** Every line of the set is possible; which errs least depends on how packets wait. Error of the offset
at the end of a minute of 60 and of 600 probes, RMS in microseconds over 140 runs:

==================================  =====  =====  =====  =====  =====  =====  =====  =====
line                                     LAN          busy          Wi-Fi      full uplink
----------------------------------  ------------  ------------  ------------  ------------
middle of the interval at that time   5.8    1.9   24.5    5.9    188     59    192     35
widest margin                         1.7    0.2   17.1    1.5    219     65     83    8.2
centroid of all lines                 4.1    1.2   19.1    4.1    177     53    155     23
centroid of the widest (taken)        1.7    0.2   15.2    1.7    189     54     82    7.9
==================================  =====  =====  =====  =====  =====  =====  =====  =====

The widest margin (the separating line of Huygens, NSDI 2018) is best where some packets hardly wait at all, so that the
hulls are sharp; the centroid of all lines where none is spared. Taken is the centroid of the lines that keep a share of
the widest margin, a share that falls from one to nothing as the waits near the hulls grow beside the margin itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from rigcal.geometry import Floats, Ints, freeze
from rigcal.sync.estimator.polygon import centroid, clip
from rigcal.sync.exchanges import Exchanges

MOST_DRIFT_PPM = 300.0
"""A quartz of a computer or camera is within 100 ppm of its nominal rate, with its temperature and age, and two of them
within 200 of each other; the rest is for a clock that a time daemon corrects meanwhile."""
_ROUNDING_S = 2e-9
"""Each bound is the difference of two stamps that were each rounded to a nanosecond."""
_NEAR_THE_HULL = 0.07
"""Quantile of the waits that tells how sharp the hulls are; 0.05 costs 4 % on Wi-Fi, 0.1 costs 16 % on a busy LAN."""
_LARGEST_SHARE = 0.999
"""Where many lines have the widest margin, their middle is taken: a thousandth less makes them an area."""
_LEAST_MARGIN = 1e-3
"""Of the quickest packet's time: with less the exchanges contradict each other as far as doubles and HiGHS can tell."""
_NEIGHBOURHOODS = 24
_LEAST_SCALE_S, _LEAST_SPAN_S = 1e-6, 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """All lines of offset over host time that a set of exchanges allows, and the best of them."""

    about_ns: int
    """Host time that the lines are told about."""
    near_ns: int
    """An offset near theirs, in nanoseconds, which the offsets below are told beside."""
    corners: Floats
    """(k, 2) corners of the set: offset at ``about_ns`` in seconds beside ``near_ns``, and drift (1 is a second per
    second)."""
    best: Floats
    """(2,) the best line, likewise."""
    margin_s: float
    """The most that a line can keep from every exchange: the least time that packets took each way, as far as known."""

    def __post_init__(self) -> None:
        freeze(self, np.float64, corners=(None, 2), best=(2,))

    def beside_s(self, offset_s: Floats) -> Floats:
        """Offsets beside ``near_ns`` as offsets."""
        return np.asarray(self.near_ns * 1e-9 + offset_s)

    def interval_s(self, host_ns: int) -> tuple[float, float]:
        """Least and greatest offset at a host time, in seconds."""
        at_corners = self.beside_s(self.corners @ [1.0, (host_ns - self.about_ns) * 1e-9])
        return float(at_corners.min()), float(at_corners.max())

    def offset_s(self, host_ns: int) -> float:
        """Offset of the best line at a host time, in seconds."""
        return float(self.beside_s(self.best @ [1.0, (host_ns - self.about_ns) * 1e-9]))

    def waits_s(self, exchanges: Exchanges) -> tuple[Floats, Floats]:
        """(n,) how long requests and answers were on the way, in seconds, if the best line is true."""
        lows, highs = exchanges.sent_ns - exchanges.received_ns, exchanges.returned_ns - exchanges.replied_ns
        at_low = self.best[0] + self.best[1] * _seconds(exchanges.received_ns - self.about_ns)
        at_high = self.best[0] + self.best[1] * _seconds(exchanges.replied_ns - self.about_ns)
        return at_low - _seconds(lows - self.near_ns), _seconds(highs - self.near_ns) - at_high

    @property
    def drift_interval_ppm(self) -> tuple[float, float]:
        """Least and greatest drift."""
        return float(self.corners[:, 1].min() * 1e6), float(self.corners[:, 1].max() * 1e6)

    @property
    def drift_ppm(self) -> float:
        """Drift of the best line."""
        return float(self.best[1] * 1e6)


def bounding_lines(
    exchanges: Exchanges, *, about_ns: int, wander_ppm: float = 0.0, most_drift_ppm: float = MOST_DRIFT_PPM
) -> Lines | None:
    """The lines that the exchanges allow; None where they contradict each other.

    Args:
        exchanges: One or more, none with a negative round trip.
        about_ns: Host time about which the clock is asked for.
        wander_ppm: By how much the clock's mean rate between ``about_ns`` and any exchange may differ from its rate at
            ``about_ns``: an exchange counts the less, the further away it is.
        most_drift_ppm: Limit of the drift.
    """
    bands = _Bands.of(exchanges, about_ns, wander_ppm)
    steepest = bands.steepest(most_drift_ppm)
    hull = bands.hull()
    widest = _widest(hull, steepest)
    if widest is None:
        return None
    share = min(1 / (1 + (bands.wait_near(widest) / widest[2]) ** 2), _LARGEST_SHARE)
    units = bands.scale_s * np.array([1.0, 1 / bands.span_s])
    return Lines(
        about_ns,
        bands.near_ns,
        _corners(hull, steepest) * units,
        centroid(_corners(hull, steepest, keep=share * widest[2])) * units,
        float(widest[2] * bands.scale_s),
    )


def some_line(
    exchanges: Exchanges, *, about_ns: int, wander_ppm: float = 0.0, most_drift_ppm: float = MOST_DRIFT_PPM
) -> bool:
    """Whether :func:`bounding_lines` finds any, in half its time."""
    bands = _Bands.of(exchanges, about_ns, wander_ppm)
    return _widest(bands.hull(), bands.steepest(most_drift_ppm)) is not None


def least_wander_ppm(exchanges: Exchanges, *, about_ns: int, most_drift_ppm: float = MOST_DRIFT_PPM) -> float:
    """The least ``wander_ppm`` with which :func:`bounding_lines` finds a line; 0 where none is needed."""
    bands = _Bands.of(exchanges, about_ns, 0.0)
    steepest = bands.steepest(most_drift_ppm)
    hull = bands.hull_on_either_side()
    above = np.column_stack([-np.ones_like(hull.x_low), -hull.x_low, -np.abs(hull.x_low)])
    below = np.column_stack([np.ones_like(hull.x_high), hull.x_high, -np.abs(hull.x_high)])
    found = _solve([0, 0, 1], np.vstack([above, below]), hull, [(None, None), (-steepest, steepest), (0, None)])
    return float(found[2] * bands.scale_s / bands.span_s * 1e6)


@dataclass(frozen=True, slots=True, eq=False)
class _Bands:
    """What a line must pass between, scaled so that times are within one and waits about one."""

    near_ns: int
    scale_s: float
    span_s: float
    x_low: Floats
    low: Floats
    x_high: Floats
    high: Floats

    @classmethod
    def of(cls, exchanges: Exchanges, about_ns: int, wander_ppm: float) -> _Bands:
        """Differences are taken of integers: a double holds a time of this century only to 0.2 microseconds."""
        quickest = int(np.argmin(exchanges.round_trip_s))
        lows, highs = exchanges.sent_ns - exchanges.received_ns, exchanges.returned_ns - exchanges.replied_ns
        near_ns = (int(lows[quickest]) + int(highs[quickest])) // 2
        scale_s = max(float(exchanges.round_trip_s[quickest]) / 2, _LEAST_SCALE_S)
        t_low, t_high = _seconds(exchanges.received_ns - about_ns), _seconds(exchanges.replied_ns - about_ns)
        span_s = max(np.abs(t_low).max(), np.abs(t_high).max(), _LEAST_SPAN_S)
        low = _seconds(lows - near_ns) - _ROUNDING_S - wander_ppm * 1e-6 * np.abs(t_low)
        high = _seconds(highs - near_ns) + _ROUNDING_S + wander_ppm * 1e-6 * np.abs(t_high)
        return cls(near_ns, scale_s, span_s, t_low / span_s, low / scale_s, t_high / span_s, high / scale_s)

    def hull(self) -> _Bands:
        """The same for every line, by the fewest points: the others lie behind these."""
        return self._only(upper_hull(self.x_low, self.low), upper_hull(self.x_high, -self.high))

    def hull_on_either_side(self) -> _Bands:
        """The same for every two lines that meet at ``about_ns``, one for what is before it and one for after."""
        low, high = (
            np.concatenate([side[upper_hull(x[side], y[side])] for side in map(np.flatnonzero, (x < 0, x >= 0))])
            for x, y in ((self.x_low, self.low), (self.x_high, -self.high))
        )
        return self._only(low, high)

    def _only(self, low: Ints, high: Ints) -> _Bands:
        points = self.x_low[low], self.low[low], self.x_high[high], self.high[high]
        return _Bands(self.near_ns, self.scale_s, self.span_s, *points)

    def steepest(self, most_drift_ppm: float) -> float:
        """A drift, scaled."""
        return most_drift_ppm * 1e-6 * self.span_s / self.scale_s

    def wait_near(self, line: Floats) -> float:
        """How far the exchanges nearest to a line with a margin are from it, on the side where they are nearer."""
        offset, drift, margin = line
        out = offset + drift * self.x_low - self.low - margin
        back = self.high - offset - drift * self.x_high - margin
        return max(min(float(np.quantile(waits, _NEAR_THE_HULL)) for waits in (out, back)), 0.0)


def _seconds(ns: Ints) -> Floats:
    return np.asarray(ns * 1e-9)


def upper_hull(x: Floats, y: Floats) -> Ints:
    """Indices of the corners of the upper convex hull of points, from left to right (Andrew's monotone chain, 1979)."""
    chain: list[int] = []
    if not len(x):
        return np.zeros(0, dtype=np.int64)
    candidates = _not_below_some_chord(x, y)
    xs, ys = x.tolist(), y.tolist()
    for i in candidates[np.lexsort((y[candidates], x[candidates]))].tolist():
        while len(chain) > 1:
            a, b = chain[-2], chain[-1]
            if (xs[b] - xs[a]) * (ys[i] - ys[a]) < (ys[b] - ys[a]) * (xs[i] - xs[a]):
                break
            chain.pop()
        chain.append(i)
    return np.array(chain, dtype=np.int64)


def _not_below_some_chord(x: Floats, y: Floats) -> Ints:
    """Indices of the points that may be corners of the upper hull.

    The highest of each neighbourhood are joined by chords, and what is below a chord is inside the hull.
    """
    order = np.argsort(x, kind="stable")
    highest = np.array([part[np.argmax(y[part])] for part in np.array_split(order, _NEIGHBOURHOODS) if len(part)])
    chord = np.interp(x, x[highest], y[highest], left=-np.inf, right=-np.inf)
    return np.flatnonzero(y >= chord)


def _widest(bands: _Bands, steepest: float) -> Floats | None:
    """(3,) offset, drift and margin of a line with the widest margin; None where no line passes."""
    if bands.low.max() - bands.high.min() > 2 * steepest:  # spares HiGHS numbers that are far apart
        return None
    above = np.column_stack([-np.ones_like(bands.x_low), -bands.x_low, np.ones_like(bands.x_low)])
    below = np.column_stack([np.ones_like(bands.x_high), bands.x_high, np.ones_like(bands.x_high)])
    limits = [(None, None), (-steepest, steepest), (None, None)]
    found = _solve([0, 0, -1], np.vstack([above, below]), bands, limits)
    return found if found[2] > _LEAST_MARGIN else None


def _solve(cost: list[int], matrix: Floats, bands: _Bands, limits: list[tuple[float | None, float | None]]) -> Floats:
    """The linear program over ``matrix @ x <= (-low, high)``, by HiGHS."""
    found = linprog(cost, matrix, np.concatenate([-bands.low, bands.high]), bounds=limits, method="highs")
    if found.status != 0:
        raise ArithmeticError(f"HiGHS did not solve the lines of a clock: {found.message}")
    return np.asarray(found.x)


def _corners(bands: _Bands, steepest: float, keep: float = 0.0) -> Floats:
    """(k, 2) corners of the set of lines that keep a margin from every exchange: offset and drift, scaled."""
    least, greatest = bands.low.min() - 2 * steepest, bands.high.max() + 2 * steepest
    corners = np.array([[least, -steepest], [greatest, -steepest], [greatest, steepest], [least, steepest]])
    for x, low in zip(bands.x_low, bands.low, strict=True):
        corners = clip(corners, np.array([-1.0, -x]), -low - keep)
    for x, high in zip(bands.x_high, bands.high, strict=True):
        corners = clip(corners, np.array([1.0, x]), high - keep)
    return corners
