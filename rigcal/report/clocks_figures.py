"""What the figures of a camera's clock draw: its offset with the bound, its frame rate, and where frames are missing.

A figure stretches with the page, so places are in units of the figure and labels are text of the page. Long
recordings are drawn by column: whatever lies between the least and the greatest value of a column is filled, so that
nothing that lasted a moment is lost.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rigcal.geometry import Floats, Ints
from rigcal.report.clocks_axes import HEIGHT, WIDTH, Label, TimeAxis, ValueAxis, value_axis
from rigcal.report.svgpath import dots, polygon, polyline, short
from rigcal.sync.history.series import CameraHistory, OffsetSeries, SyncHistory

RATE_WINDOW_S = 1.0
"""Over which the frame rate is counted; shorter in recordings of less than four seconds."""
LIMIT_IN_SIGHT = 2.0
"""The limit is drawn where it lies within so many times what the offset spans; farther out it would flatten that."""


@dataclass(frozen=True, slots=True)
class DrawnSeries:
    """An offset over time, ready to be drawn."""

    method: str
    band: str
    """Path around everything that the bound allows."""
    line: str


@dataclass(frozen=True, slots=True)
class OffsetFigure:
    """A camera's offset, ready to be drawn."""

    series: tuple[DrawnSeries, ...]
    model_band: str
    """Path along both edges of what the rig file's clock claims, where something else was measured; or empty."""
    limits: tuple[float, ...]
    """Places of the limit in percent from the top, where it is in sight."""
    zero: float | None
    """Place of no error in percent from the top, where it is in sight."""
    labels: tuple[Label, ...]
    mean_s: float | None
    """What offsets are drawn relative to, where no clock model corrects them; None: relative to the model."""


@dataclass(frozen=True, slots=True)
class RateFigure:
    """A camera's frame rate, ready to be drawn."""

    band: str
    declared: float | None
    """Place of the declared rate, in percent from the top."""
    labels: tuple[Label, ...]


@dataclass(frozen=True, slots=True)
class Marks:
    """Where frames are missing or repeated and where the clock was stepped, as paths."""

    missing: str
    repeated: str
    steps: str


def offset_figure(history: SyncHistory, camera: CameraHistory, axis: TimeAxis) -> OffsetFigure | None:
    """A camera's offset over time; None where nothing is known of it."""
    if not camera.misplaced:
        return None
    mean_s = None if camera.model else float(np.nanmean(camera.misplaced[0].offset_s))
    shown = [OffsetSeries(s.method, s.t_s, s.offset_s - (mean_s or 0.0), s.bound_s) for s in camera.misplaced]
    low = min(float(np.nanmin(s.offset_s - s.bound_s)) for s in shown)
    high = max(float(np.nanmax(s.offset_s + s.bound_s)) for s in shown)
    limits_s = np.array([-history.limit_s, history.limit_s]) - (mean_s or 0.0)
    room = LIMIT_IN_SIGHT * max(high - low, 1e-9)
    for limit_s in limits_s.tolist():
        if high < limit_s <= high + room or low - room <= limit_s < low:
            low, high = min(low, limit_s), max(high, limit_s)
    values = value_axis(low, high, scale=1e3, other=1e3 * history.fastest_motion_m_per_s)
    return OffsetFigure(
        tuple(DrawnSeries(s.method, _band(s, axis, values), _line(s, axis, values)) for s in shown),
        _model_band(camera, axis, values),
        tuple(_percent(values, limit_s) for limit_s in limits_s.tolist() if values.low <= limit_s <= values.high),
        _percent(values, -(mean_s or 0.0)) if values.low <= -(mean_s or 0.0) <= values.high else None,
        values.labels,
        mean_s,
    )


def rate_figure(camera: CameraHistory, axis: TimeAxis) -> RateFigure | None:
    """A camera's frame rate over time, counted over a second; None where it has fewer than two frames."""
    frames_s = np.sort(camera.frame_t_s)
    if len(frames_s) < 2:
        return None
    window_s = min(RATE_WINDOW_S, (axis.end_s - axis.start_s) / 4)
    times_s = np.arange(axis.start_s + window_s / 2, axis.end_s - window_s / 2 + 1e-9, window_s / 2)
    passed = np.arange(len(frames_s), dtype=np.float64)
    ends = (np.interp(times_s + side * window_s / 2, frames_s, passed) for side in (1, -1))
    rate = (next(ends) - next(ends)) / window_s
    usual = camera.declared_fps or camera.delivered_fps or float(np.median(rate))
    values = value_axis(0.0, max(1.2 * usual, 1.0), scale=1.0)
    band = _envelope(axis.x(times_s), values.y(rate), values.y(rate))
    declared = None if camera.declared_fps is None else _percent(values, camera.declared_fps)
    return RateFigure(band, declared, values.labels)


def marks_of(camera: CameraHistory, axis: TimeAxis) -> Marks:
    """A camera's marks along the time."""
    missing, repeated, steps = (
        np.unique(axis.x(t_s).round()) for t_s in (camera.missing_t_s, camera.repeated_t_s, camera.steps_t_s)
    )
    middle = np.full(len(repeated), HEIGHT / 2)
    return Marks(_uprights(missing), dots(np.stack([repeated, middle], axis=1)), _uprights(steps))


def _uprights(places: Floats) -> str:
    return "".join(f"M{short(x)} 0v{HEIGHT:g}" for x in places.tolist())


def _percent(values: ValueAxis, value: float) -> float:
    return float(values.y(np.array([value]))[0]) * 100 / HEIGHT


def _band(series: OffsetSeries, axis: TimeAxis, values: ValueAxis) -> str:
    top, bottom = values.y(series.offset_s + series.bound_s), values.y(series.offset_s - series.bound_s)
    x = axis.x(series.t_s)
    return "".join(_envelope(x[run], top[run], bottom[run]) for run in _known_runs(series.offset_s))


def _line(series: OffsetSeries, axis: TimeAxis, values: ValueAxis) -> str:
    x, y = axis.x(series.t_s), values.y(series.offset_s)
    return "".join(_trace(x[run], y[run]) for run in _known_runs(series.offset_s))


def _model_band(camera: CameraHistory, axis: TimeAxis, values: ValueAxis) -> str:
    if camera.model is None or not camera.measured:
        return ""
    x, bound_s = axis.x(camera.model.t_s), camera.model.bound_s
    return _trace(x, values.y(bound_s)) + _trace(x, values.y(-bound_s))


def _known_runs(values: Floats) -> Iterator[slice]:
    """Stretches without a NaN."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], np.isfinite(values), [False]]).astype(np.int8)))
    yield from (slice(int(low), int(high)) for low, high in edges.reshape(-1, 2))


def _envelope(x: Floats, top: Floats, bottom: Floats) -> str:
    """The outline of what lies between two curves, by column where there are more points than columns."""
    columns = _columns(x)
    places, tops = columns.middle(x), columns.reduced(np.minimum, top)
    bottoms = columns.reduced(np.maximum, bottom)
    there, back = np.stack([places, tops], axis=1), np.stack([places, bottoms], axis=1)
    return polygon(np.concatenate([there, back[::-1]]))


def _trace(x: Floats, y: Floats) -> str:
    """The line through the points; by column, it goes through the least and the greatest of each."""
    columns = _columns(x)
    if len(columns.starts) == len(x):
        return polyline(np.stack([x, y], axis=1))
    places = np.repeat(columns.middle(x), 2)
    ends = np.stack([columns.reduced(np.minimum, y), columns.reduced(np.maximum, y)], axis=1)
    return polyline(np.stack([places, ends.ravel()], axis=1))


@dataclass(frozen=True, slots=True, eq=False)
class _Columns:
    """Ascending points gathered by column."""

    starts: Ints
    """(c,) index of each column's first point."""

    def middle(self, x: Floats) -> Floats:
        """(c,) place of each column: the middle of its points."""
        return np.asarray((np.minimum.reduceat(x, self.starts) + np.maximum.reduceat(x, self.starts)) / 2)

    def reduced(self, how: np.ufunc, values: Floats) -> Floats:
        """(c,) one value for each column."""
        return np.asarray(how.reduceat(values, self.starts))


def _columns(x: Floats) -> _Columns:
    if len(x) <= WIDTH:
        return _Columns(np.arange(len(x)))
    return _Columns(np.flatnonzero(np.diff(np.floor(x), prepend=-np.inf)))
