"""The page of ``rigcal sync report``: every camera's clock, its bound and its frames over a recording.

One HTML page that works offline, on a phone, in the dark and printed on A4; the same bytes for one history. It
measures nothing itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from jinja2 import Template

from rigcal import __version__
from rigcal.report import clocks_words as clock_words
from rigcal.report import numbers, words
from rigcal.report.clocks_axes import TimeAxis, time_axis
from rigcal.report.clocks_figures import Marks, OffsetFigure, RateFigure, marks_of, offset_figure, rate_figure
from rigcal.report.templates import page_environment
from rigcal.sync.check.findings import Colour, worst
from rigcal.sync.history.judged import colour_of
from rigcal.sync.history.minutes import Minute, minutes_of
from rigcal.sync.history.remarks import moment
from rigcal.sync.history.series import CameraHistory, OffsetSeries, SyncHistory

PARTS = 60
"""Stretches of a recording whose figures are told when one points at them, and that the tables list, at the most."""
_PART_WIDTHS_S = (1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1200.0, 1800.0, 3600.0, 7200.0, 14400.0)


@dataclass(frozen=True, slots=True)
class Part:
    """A stretch of the recording, drawn over a figure to be pointed at."""

    x: float
    """In percent of the figure's width."""
    width: float
    time: str
    minute: Minute

    @property
    def quiet(self) -> bool:
        """Whether no frame is missing or repeated and the clock was not stepped."""
        return not (self.minute.missing or self.minute.repeated or self.minute.steps)


@dataclass(frozen=True, slots=True)
class CameraFigures:
    """What the page says of one camera."""

    camera: CameraHistory
    colour: Colour
    verdict: str
    error_m: float | None
    offset_s: float | None
    """Mean of the offset, rig minus camera."""
    drift_ppm: float | None
    bound_s: float | None
    """The greatest bound."""
    offset: OffsetFigure | None
    rate: RateFigure | None
    marks: Marks
    parts: tuple[Part, ...]


def sync_report(history: SyncHistory) -> str:
    """The clocks of a recording as one page.

    Args:
        history: every camera over the recording; at least one of them has a frame.
    """
    start_s, end_s = history.span_s
    axis = time_axis(start_s, end_s, epoch=history.epoch)
    pages = tuple(_figures(history, camera, axis) for camera in history.cameras)
    colour = worst(page.colour for page in pages)
    return _template().render(
        history=history,
        axis=axis,
        pages=pages,
        colour=colour,
        sentence=clock_words.sentence(history),
        span=clock_words.span(history),
        facts=clock_words.facts(history),
        limit_mm=numbers.significant(1e3 * history.clock_error_m),
        speed=f"{history.fastest_motion_m_per_s:g} m/s",
        step=clock_words.width(_part_width_s(axis)),
        version=__version__,
    )


@cache
def _template() -> Template:
    environment = page_environment()
    environment.filters |= {
        "fixed": numbers.fixed,
        "scaled": numbers.scaled,
        "told": clock_words.told,
        "evidence": clock_words.evidence,
    }
    environment.globals |= {"counted": words.counted}
    return environment.get_template("clocks.html.j2")


def _figures(history: SyncHistory, camera: CameraHistory, axis: TimeAxis) -> CameraFigures:
    colour = colour_of(history, camera)
    clock = camera.clock
    return CameraFigures(
        camera=camera,
        colour=colour,
        verdict=clock_words.verdict(history, camera),
        error_m=history.error_m(camera),
        offset_s=None if clock is None else float(np.nanmean(clock.offset_s)),
        drift_ppm=_drift_ppm(camera, clock),
        bound_s=None if clock is None else float(np.nanmax(clock.bound_s)),
        offset=offset_figure(history, camera, axis),
        rate=rate_figure(camera, axis),
        marks=marks_of(camera, axis),
        parts=_parts(history, camera, axis),
    )


def _drift_ppm(camera: CameraHistory, clock: OffsetSeries | None) -> float | None:
    """Drift to a thousandth; of a clock that was stepped, no line tells it."""
    drift_ppm = None if clock is None or len(camera.steps_t_s) else clock.drift_ppm
    return None if drift_ppm is None else round(drift_ppm, 3)


def _parts(history: SyncHistory, camera: CameraHistory, axis: TimeAxis) -> tuple[Part, ...]:
    width_s, span_s = _part_width_s(axis), axis.end_s - axis.start_s
    parts = []
    for minute in minutes_of(history, camera, width_s=width_s):
        low_s = max(minute.start_s, axis.start_s)
        high_s = min(minute.start_s + width_s, axis.end_s)
        x, width = 100 * (low_s - axis.start_s) / span_s, 100 * (high_s - low_s) / span_s
        parts.append(Part(x, width, moment(low_s, epoch=history.epoch), minute))
    return tuple(parts)


def _part_width_s(axis: TimeAxis) -> float:
    span_s = axis.end_s - axis.start_s
    return next((width for width in _PART_WIDTHS_S if span_s / width < PARTS - 1), span_s / (PARTS - 2))
