"""Axes of the figures of clocks: round values along time and along an offset, and where they lie."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import UTC, datetime

from rigcal.geometry import Floats
from rigcal.report.numbers import round_up

WIDTH, HEIGHT = 600.0, 100.0
"""Of every figure, in its units; a unit of the width is about a pixel's column on a screen."""
TIME_LABELS = 5
"""Labels along the time, at the most: as many clock times as a phone has room for."""
VALUE_LABELS = 5
_TIME_STEPS_S = (
    0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 10800, 21600, 43200
)  # fmt: skip
_DAY_S = 86400.0
_ELAPSED = ((3600.0, "h"), (60.0, "min"), (1.0, "s"))


@dataclass(frozen=True, slots=True)
class Label:
    """A labelled place on an axis."""

    percent: float
    """From the left or from the top, in percent of the figure."""
    text: str
    other: str = ""
    """The same in the unit of the figure's other side."""


@dataclass(frozen=True, slots=True)
class TimeAxis:
    """The time that all figures of a page share."""

    start_s: float
    end_s: float
    labels: tuple[Label, ...]

    def x(self, t_s: Floats) -> Floats:
        """Places of times, in a figure's units."""
        return (t_s - self.start_s) * (WIDTH / (self.end_s - self.start_s))


@dataclass(frozen=True, slots=True)
class ValueAxis:
    """A vertical axis; greater values are higher."""

    low: float
    high: float
    labels: tuple[Label, ...]

    def y(self, values: Floats) -> Floats:
        """Places of values, in a figure's units; beyond the axis they lie just outside the figure."""
        places = (self.high - values) * (HEIGHT / (self.high - self.low))
        return places.clip(-0.2 * HEIGHT, 1.2 * HEIGHT)


def time_axis(start_s: float, end_s: float, *, epoch: bool) -> TimeAxis:
    """An axis from the first to the last frame; at least a second long.

    Args:
        start_s: time of the first frame.
        end_s: time of the last one.
        epoch: whether they count from the Unix epoch and so are labelled as times of day (UTC).
    """
    end_s = max(end_s, start_s + 1.0)
    span_s = end_s - start_s
    days_s = math.ceil(span_s / _DAY_S / TIME_LABELS) * _DAY_S
    step_s = next((s for s in _TIME_STEPS_S if span_s / s <= TIME_LABELS), days_s)
    first = math.ceil(start_s / step_s - 1e-6)
    times_s = [i * step_s for i in range(first, math.floor(end_s / step_s + 1e-6) + 1)]
    text = _time_of_day if epoch else _elapsed
    return TimeAxis(start_s, end_s, tuple(Label(100 * (t - start_s) / span_s, text(t, step_s)) for t in times_s))


def value_axis(low: float, high: float, *, scale: float, other: float = 0.0) -> ValueAxis:
    """An axis that holds two values, labelled at round values.

    Args:
        low: a value that it holds.
        high: another, not below it.
        scale: what a label multiplies values by: 1000 for seconds in milliseconds.
        other: the same for the labels of the other side; none where it is 0.
    """
    margin = 0.06 * (high - low) or 0.5 / scale
    low, high = low - margin, high + margin
    step = round_up((high - low) * scale / VALUE_LABELS)
    marks = range(math.ceil(low * scale / step), math.floor(high * scale / step) + 1)
    labels = (
        Label(
            100 * (high - mark * step / scale) / (high - low),
            f"{mark * step:.6g}",
            f"{mark * step / scale * other:.3g}" if other else "",
        )
        for mark in marks
    )
    return ValueAxis(low, high, tuple(labels))


def _time_of_day(t_s: float, step_s: float) -> str:
    form = "%d %b" if step_s >= _DAY_S else "%H:%M" if step_s >= _ELAPSED[1][0] else "%H:%M:%S"
    text = datetime.fromtimestamp(round(t_s, 3), UTC).strftime(form)
    return text if step_s >= 1 else f"{text}.{round(t_s * 10) % 10}"


def _elapsed(t_s: float, step_s: float) -> str:
    unit_s, unit = next((entry for entry in _ELAPSED if step_s >= entry[0]), _ELAPSED[-1])
    return f"{t_s / unit_s:g} {unit}"
