"""When the frames of a live camera were taken: from its media clock to its wall clock, by RTCP sender reports.

Every frame bears a time of the camera's media clock (RTP, 90 kHz), which says nothing of when that was. From time to
time a sender report gives the same moment on both clocks (RFC 3550, 6.4.1). :class:`MediaClock` puts a line through
the latest reports of a session, a median of slopes (Theil and Sen) and a median of offsets, so that single reports may
be wrong. The time of a frame is on that line, be it before the first report or after the last. Arrival times are not
used: they are late by the transport, by an unknown amount.

Decision: a step of the wall clock is taken out of all later reports, not followed. The media clock runs through it, the
clock model of the rig was measured before it, and times that jump would break tracks and recordings. The cost: where
the step was a correction and no clock model was measured, times stay as wrong as they had been, until the camera is
opened again; so every step is reported, and the user told to measure again.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from rigcal.geometry import Floats

KEPT = 16
"""Reports on the line: 80 s of them at the usual one in 5 s. Fewer leave more of each one's error; more follow a clock
that NTP slews (by 500 ppm at most, RFC 5905) too late."""
RATE_SIGMA = 1e-4
"""How far the rates of the two clocks may be apart before there is anything to tell it from; a quartz keeps 100 ppm."""
FIRST = 5
"""So many reports are needed for their spread to say something."""
SPREAD_FIRST_S = 0.005
"""The spread that is believed of fewer: a network camera's that takes the time when it sends the report."""
STEP_S, STEP_FIRST_S, STEP_SIGMAS = 0.02, 0.1, 6.0
"""Two reports in a row that are off the line by more, and agree, are a step: by ``STEP_FIRST_S`` among the first ones,
then by ``STEP_S`` or so many sigmas of their spread."""
_SIGMA_OF_MAD = 1.4826


class Report(NamedTuple):
    """A moment on both clocks."""

    media_ns: int
    """Of the session's media clock, which counts from anywhere."""
    wall_ns: int
    """Of the camera's wall clock, since 1970."""


class MediaClock:
    """The line from a session's media time to the camera's wall clock."""

    def __init__(self) -> None:
        self._origin = Report(0, 0)
        self._reports: deque[tuple[float, float]] = deque(maxlen=KEPT)
        self._rate, self._offset_s, self._spread_s = 0.0, 0.0, SPREAD_FIRST_S
        self._stepped_s = 0.0
        self._suspect_s: float | None = None

    @property
    def is_known(self) -> bool:
        """Whether there was a report."""
        return bool(self._reports)

    def add(self, report: Report) -> float | None:
        """Take note of a sender report; returns by how much the wall clock was set, in seconds, once that is certain.

        A report that is off the line and alone is passed over.
        """
        if not self._reports:
            self._origin = report
        media_s = (report.media_ns - self._origin.media_ns) * 1e-9
        ahead_s = (report.wall_ns - self._origin.wall_ns - report.media_ns + self._origin.media_ns) * 1e-9
        ahead_s -= self._stepped_s
        off_s, within_s = ahead_s - self._ahead_s(media_s), self._tolerance_s()
        suspect_s, self._suspect_s = self._suspect_s, None
        if abs(off_s) <= within_s:
            self._fit(media_s, ahead_s)
            return None
        if suspect_s is None or abs(off_s - suspect_s) > within_s:
            self._suspect_s = off_s
            return None
        step_s = (suspect_s + off_s) / 2
        self._stepped_s += step_s
        self._fit(media_s, ahead_s - step_s)
        return step_s

    def wall_ns(self, media_ns: int) -> int:
        """The camera's wall clock at a media time, nanoseconds since 1970.

        Raises:
            ValueError: before the first report.
        """
        if not self._reports:
            raise ValueError("no sender report yet")
        since_ns = media_ns - self._origin.media_ns
        return self._origin.wall_ns + since_ns + round(self._ahead_s(since_ns * 1e-9) * 1e9)

    def _ahead_s(self, media_s: float) -> float:
        """By the line, how much further the wall clock went since the first report than the media clock did."""
        return self._offset_s + self._rate * media_s

    def _tolerance_s(self) -> float:
        return STEP_FIRST_S if len(self._reports) < FIRST else max(STEP_S, STEP_SIGMAS * self._spread_s)

    def _fit(self, media_s: float, ahead_s: float) -> None:
        self._reports.append((media_s, ahead_s))
        media, ahead = np.array(self._reports).T
        slope, count = _theil_sen(media, ahead), len(media)
        if count >= FIRST:
            self._spread_s = _sigma(ahead - slope * media) * (count / (count - 2)) ** 0.5
        # The slope as far as the reports know better than the prior: its variance is that of evenly spaced ones.
        sigma = self._spread_s * (12 / count) ** 0.5 / max(media[-1] - media[0], 1e-9)
        self._rate = slope * RATE_SIGMA**2 / (RATE_SIGMA**2 + sigma**2)
        self._offset_s = float(np.median(ahead - self._rate * media))


def _theil_sen(x: Floats, y: Floats) -> float:
    """Median slope over all pairs of points; 0 for one."""
    if len(x) < 2:
        return 0.0
    first, second = np.triu_indices(len(x), 1)
    return float(np.median((y[second] - y[first]) / (x[second] - x[first])))


def _sigma(values: Floats) -> float:
    """Robust standard deviation."""
    return _SIGMA_OF_MAD * float(np.median(np.abs(values - np.median(values))))
