"""When live frames were taken, by the camera's own clock.

A camera that sends RTCP sender reports tells with each which moment of its wall clock belongs to which time of its
stream (RFC 3550, section 6.4.1). FFmpeg extends the last report to every frame and hands it on as producer reference
time; between reports the stream's clock runs free, so that the difference of the two moves in stairs. The first
frame of each stair lies next to its report: these are the anchors of the mapping from stream to wall clock.
"""

from __future__ import annotations

import numpy as np

from rigcal.geometry import Bools, Floats, Ints
from rigcal.sync.exchanges import UNKNOWN

_STAIR_S = 10e-6
"""The difference moves by less than this between reports: both times are rounded, to 1 us and to 11 us."""
_CRYSTALS_PPM = 100.0
"""Clocks of one camera differ by less; what exceeds it is a stream that counts frames instead of time."""
_REPORT_S = 2e-3
"""How wrong a single report is allowed to be without the two clocks being taken to differ in rate."""
_STEP_S = 5e-3
"""Anchors that lie farther from their line than this follow a clock that was stepped."""
_MOST = 0.02
"""No stream runs faster or slower than its wall clock by more than this."""
_WRAP = 2**32
"""RTP counts time modulo this."""


def producer_stamps(stream_s: Floats, producer_ns: Ints, *, clock_hz: float) -> Floats | None:
    """Capture stamps in seconds since the epoch (n,); None where the camera tells too little.

    A line through the anchors makes good the reports' own errors, unless the camera's clock was stepped: then every
    frame has the time of the report before it, so that the step is seen. Frames before the first report are filled in.

    Args:
        stream_s: (n,) presentation times.
        producer_ns: (n,) producer reference times in nanoseconds since the epoch, ``UNKNOWN`` where a frame has none.
        clock_hz: The rate of the stream's clock.
    """
    told = np.flatnonzero(producer_ns != UNKNOWN)[1:]  # the first one that FFmpeg hands on is a frame off
    if not len(told):
        return None
    origin_ns = int(producer_ns[told[0]])
    ahead_s = (producer_ns[told] - origin_ns) * 1e-9 - stream_s[told]
    ahead_s = _unwrapped(ahead_s, _WRAP / clock_hz)
    first = np.concatenate([[True], np.abs(np.diff(ahead_s)) > _STAIR_S])
    anchors_s, offsets_s = stream_s[told[first]], ahead_s[first]
    rate = _rate(anchors_s, offsets_s)
    level_s = offsets_s - rate * anchors_s
    away_s = np.abs(level_s - np.median(level_s))
    if away_s.max() > _STEP_S:
        in_force = np.maximum(np.searchsorted(anchors_s, stream_s, side="right") - 1, 0)
        level = level_s[in_force]
    else:
        level = np.full(len(stream_s), np.median(level_s))
    return np.asarray(origin_ns * 1e-9 + (stream_s * (1 + rate) + level))


def came_when_sent(stream_s: Floats, monotonic_ns: Ints) -> Bools:
    """(n,) which frames came when they were sent: not those that FFmpeg held back while it opened the stream.

    Those come in one burst; the first frame for which one had to wait ends it.
    """
    waited_s = np.diff(monotonic_ns) * 1e-9
    real = np.flatnonzero(waited_s > 0.5 * np.abs(np.diff(stream_s)))
    kept = np.zeros(len(stream_s), dtype=np.bool_)
    kept[int(real[0]) + 1 if len(real) else 0 :] = True
    return kept


def _rate(anchors_s: Floats, offsets_s: Floats) -> float:
    """How much faster the wall clock runs than the stream's, as a share."""
    if len(anchors_s) < 2:
        return 0.0
    rate = float(np.median(np.diff(offsets_s) / np.maximum(np.diff(anchors_s), 1e-3)))
    span_s = float(np.ptp(anchors_s))
    if abs(rate) > _MOST:
        return 0.0
    if abs(rate) > max(_CRYSTALS_PPM * 1e-6, 2 * _REPORT_S / span_s):
        return rate
    return float(np.clip(rate, -_CRYSTALS_PPM * 1e-6, _CRYSTALS_PPM * 1e-6))


def _unwrapped(ahead_s: Floats, turn_s: float) -> Floats:
    """Differences without the turns of the RTP clock that FFmpeg overlooks until the next report."""
    return np.asarray(ahead_s - turn_s * np.round((ahead_s - np.median(ahead_s)) / turn_s))
