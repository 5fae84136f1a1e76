"""The check of a recording minute by minute: clock, frames and frame rate of every camera, as values for JSON."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from rigcal.geometry import Floats, Ints
from rigcal.sync.history.judged import colour_of
from rigcal.sync.history.series import CameraHistory, OffsetSeries, SyncHistory

MINUTE_S = 60.0
LEAST_COVERED_S = 1.0
"""A shorter part of a minute at the ends of a recording gives no frame rate."""


@dataclass(frozen=True, slots=True)
class Minute:
    """One camera over one minute, or over as many seconds as the caller asked for."""

    start_s: float
    """On the history's time axis."""
    frames: int
    missing: int
    repeated: int
    steps: int
    delivered_fps: float | None
    """Frames over the part of the minute that lies within the recording; None where that is under a second."""
    offset_s: float | None
    """Rig minus camera: the mean over the minute, as measured, or as the rig file has it where nothing was."""
    bound_s: float | None
    """The greatest half-width of the interval that holds the true offset."""
    misplaced_s: float | None
    """How far from their true time frames are placed: the measured offset less the rig file's, mean over the minute."""
    error_m: float | None
    """The greatest error that any measurement allows, at the fastest motion."""


def minutes_of(history: SyncHistory, camera: CameraHistory, *, width_s: float = MINUTE_S) -> tuple[Minute, ...]:
    """One camera's minutes, from the first frame of any camera to the last; they begin at whole minutes of the axis.

    Args:
        history: The recording.
        camera: One of its cameras.
        width_s: Length of what is summed up.
    """
    start_s, end_s = history.span_s
    first, last = int(start_s // width_s), int(end_s // width_s)
    edges_s = np.arange(first, last + 2, dtype=np.float64) * width_s
    period_s = 1 / camera.delivered_fps if camera.delivered_fps else 0.0  # the last frame stands for as long
    covered_s = np.minimum(edges_s[1:], end_s + period_s) - np.maximum(edges_s[:-1], start_s)
    frames = _counts(camera.frame_t_s, edges_s)
    marks = [_counts(t_s, edges_s) for t_s in (camera.missing_t_s, camera.repeated_t_s, camera.steps_t_s)]
    clock, misplaced = camera.clock, camera.misplaced
    offsets = None if clock is None else _spread(clock, edges_s)
    departures = [_spread(series, edges_s) for series in misplaced]
    error_s = np.fmax.reduce([spread.greatest_s for spread in departures]) if departures else None
    return tuple(
        Minute(
            start_s=float(edges_s[i]),
            frames=int(frames[i]),
            missing=int(marks[0][i]),
            repeated=int(marks[1][i]),
            steps=int(marks[2][i]),
            delivered_fps=float(frames[i] / covered_s[i]) if covered_s[i] >= LEAST_COVERED_S else None,
            offset_s=_known(offsets.mean_s[i]) if offsets else None,
            bound_s=_known(offsets.bound_s[i]) if offsets else None,
            misplaced_s=_known(departures[0].mean_s[i]) if departures else None,
            error_m=_known(error_s[i] * history.fastest_motion_m_per_s) if error_s is not None else None,
        )
        for i in range(len(frames))
    )


def summary_per_minute(history: SyncHistory) -> dict[str, Any]:
    """Every camera, as a whole and minute by minute, as values that JSON can hold."""
    return {
        "title": history.title,
        "fastest_motion_m_per_s": history.fastest_motion_m_per_s,
        "clock_error_m": history.clock_error_m,
        "remarks": list(history.remarks),
        "cameras": [_camera_summary(history, camera) for camera in history.cameras],
    }


def _camera_summary(history: SyncHistory, camera: CameraHistory) -> dict[str, Any]:
    return {
        "camera": camera.camera_id,
        "colour": str(colour_of(history, camera)),
        "frames": len(camera.frame_t_s),
        "missing": len(camera.missing_t_s),
        "repeated": len(camera.repeated_t_s),
        "steps": len(camera.steps_t_s),
        "declared_fps": camera.declared_fps,
        "delivered_fps": camera.delivered_fps,
        "measured_by": [series.method for series in camera.measured],
        "error_m": history.error_m(camera),
        "remarks": list(camera.remarks),
        "minutes": [_minute_summary(history, minute) for minute in minutes_of(history, camera)],
    }


def _minute_summary(history: SyncHistory, minute: Minute) -> dict[str, Any]:
    values = asdict(minute)
    start_s = values.pop("start_s")
    if not history.epoch:
        return {"start_s": start_s} | values
    return {"start_utc": datetime.fromtimestamp(start_s, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")} | values


@dataclass(frozen=True, slots=True, eq=False)
class _Spread:
    """A series within each of B bins; NaN where it says nothing."""

    mean_s: Floats
    bound_s: Floats
    greatest_s: Floats


def _spread(series: OffsetSeries, edges_s: Floats) -> _Spread:
    inside = np.isfinite(series.offset_s) & (series.t_s >= edges_s[0]) & (series.t_s < edges_s[-1])
    offset_s, bound_s = series.offset_s[inside], series.bound_s[inside]
    bins = np.searchsorted(edges_s, series.t_s[inside], side="right") - 1
    count = np.bincount(bins, minlength=len(edges_s) - 1)
    total_s = np.bincount(bins, weights=offset_s, minlength=len(count))
    mean_s = np.divide(total_s, count, out=np.full(len(count), np.nan), where=count > 0)
    return _Spread(
        mean_s, _greatest(bound_s, bins, len(count)), _greatest(np.abs(offset_s) + bound_s, bins, len(count))
    )


def _greatest(values: Floats, bins: Ints, count: int) -> Floats:
    """(count,) the greatest value of each bin; NaN where it has none."""
    greatest = np.full(count, np.nan)
    np.fmax.at(greatest, bins, values)
    return greatest


def _counts(t_s: Floats, edges_s: Floats) -> Ints:
    return np.asarray(np.histogram(t_s, edges_s)[0], dtype=np.int64)


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
