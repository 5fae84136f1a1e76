"""What a change of the light says of when rows were exposed: inequalities that hold whatever the camera's tone curve.

A row whose middle is exposed at ``s`` and for ``E`` has gathered the part ``l = (s + E/2 - tau) / E`` of the light of a
lamp that was switched on at ``tau`` (0 before, 1 after). Its grey value tells ``l`` only as far as the tone curve is
known, so each band of rows gives an interval of ``l``, and with it at most two inequalities that are linear in all
unknowns: ``s + E/2 - tau >= l_least E`` and ``s + E/2 - tau <= l_greatest E``. Of a flash between ``tau_1`` and
``tau_2`` only that is used which needs no amount: whether a row saw any of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigcal.geometry import Bools, Floats, Ints, freeze
from rigcal.sync.content.light.brightness import BrightnessSeries
from rigcal.sync.content.light.changes import LEAST_GREY, LightChange, cell_noise

_GAMMAS = (0.8, 2.6)
"""Tone curves lie between these powers: sRGB is about 2.2, and a flatter start than the lamp's light is rare."""
_LEVEL_FRAMES = 3  # frames that tell the light before a change, and after it
_SIGMAS = 6.0  # how far a cell must change to count
_LEAST_TOLERANCE = 0.03  # of the lamp's light: exposure that follows, encoding
_CODED_GREY = 5.0
"""Grey levels by which an encoder may misstate a small change: H.264 at crf 28 put bands of 320 x 180 renders off by
up to 4. Stronger compression (crf 35: up to 10) shows as changes that contradict each other."""
_GREATEST_TOLERANCE = 0.45  # a band that is less sure of what is dark and lit says nothing
_MOST_CLIPPED = 0.01  # share of white pixels above which a cell does not tell how much light there is
_UNSEEN, _SEEN = 0.05, 0.25  # parts of the greatest change that a flash leaves where rows did not, and did, see it
_UNSEEN_EXPOSURE = 0.1  # of its exposure a row may have shared with a flash that it counts as not having seen

_PARTLY_BANDS = 8  # of a frame are used where more are partly lit: the others say the same again

START, END = 0, 1
"""Which of a change's two times: when the light changes, and when a flash is over."""


@dataclass(frozen=True, slots=True, eq=False)
class Exposures:
    """Inequalities ``sign (s + exposure E - tau) <= 0`` of one camera and one change of the light."""

    sign: Floats
    """(m,) 1 or -1."""
    t_s: Floats
    """(m,) the frame's stamp."""
    row: Floats
    """(m,) -1/2 to 1/2, first row to last: rows are exposed at ``s = stamp + readout * row``, in the camera's time."""
    exposure: Floats
    """(m,) how much of the exposure time enters."""
    end: Ints
    """(m,) ``START`` or ``END``: the time ``tau`` that it is about."""

    def __post_init__(self) -> None:
        count = len(self.sign)
        freeze(self, np.float64, sign=(None,), t_s=(count,), row=(count,), exposure=(count,))
        freeze(self, np.int64, end=(count,))


def exposures(series: BrightnessSeries, changes: Sequence[LightChange]) -> tuple[Exposures | None, ...]:
    """What each change says; None for one that is too close to another one, or too unsteady, to say anything."""
    if not changes:
        return ()
    noise = cell_noise(series.cells.reshape(len(series.t_s), -1)).reshape(series.clipped.shape)
    greatest = {kind: _greatest_flash(series, changes, kind, noise) for kind in ("flash", "dip")}
    found: list[Exposures | None] = []
    for index, change in enumerate(changes):
        levels = _levels(series, changes, index)
        if levels is None:
            rows = []
        elif change.kind in greatest:
            rows = _flash(series, change, levels, greatest[change.kind])
        else:
            rows = _switching(series, change, levels, noise)
        found.append(_joined(rows) if rows else None)
    return tuple(found)


@dataclass(frozen=True, slots=True, eq=False)
class _Levels:
    """The light before a change and after it."""

    before: Floats
    """(n, B, C) frames before."""
    after: Floats
    """(n, B, C) frames after."""


def _levels(series: BrightnessSeries, changes: Sequence[LightChange], index: int) -> _Levels | None:
    """Frames beside a change whose light is steady; None where other changes leave none."""
    change = changes[index]
    start = changes[index - 1].last + 1 if index else 0
    stop = changes[index + 1].first if index + 1 < len(changes) else len(series.t_s)
    before = series.cells[max(change.first - _LEVEL_FRAMES, start) : change.first]
    after = series.cells[change.last + 1 : min(change.last + 1 + _LEVEL_FRAMES, stop)]
    return _Levels(before, after) if len(before) and len(after) else None


def _window(series: BrightnessSeries, change: LightChange) -> Ints:
    """Frames that a change may have touched, and one on either side."""
    return np.arange(max(change.first - 1, 0), min(change.last + 2, len(series.t_s)))


def _switching(series: BrightnessSeries, change: LightChange, levels: _Levels, noise: Floats) -> list[Exposures]:
    """Inequalities of a lamp that is switched: its light where it goes on, the light that is missing where off."""
    before, after = np.median(levels.before, axis=0), np.median(levels.after, axis=0)
    dark, lit = (before, after) if change.kind == "on" else (after, before)
    tells = lit - dark > np.maximum(LEAST_GREY, _SIGMAS * noise)
    exact = tells & (series.clipped < _MOST_CLIPPED)
    tells = exact if exact.any() else tells
    unsure = np.maximum(*(_unsteadiness(_part(frames, dark, lit, tells)) for frames in (levels.before, levels.after)))
    tolerance = _LEAST_TOLERANCE + 2 * unsure
    if series.coded:
        tolerance = tolerance + _CODED_GREY / _median((lit - dark)[None], tells)[0]
    part = _part(series.cells[_window(series, change)], dark, lit, tells)
    least = _median(np.minimum(*(_light(part - tolerance[:, None], dark, lit, power) for power in _GAMMAS)), tells)
    most = _median(np.maximum(*(_light(part + tolerance[:, None], dark, lit, power) for power in _GAMMAS)), tells)
    middle = _median(part, tells)
    if not exact.any():
        least = np.zeros_like(least)
    some = (middle > tolerance) & (tolerance < _GREATEST_TOLERANCE)  # NaN, a band without the lamp, compares false
    missing = (middle < 1 - tolerance) & (tolerance < _GREATEST_TOLERANCE)
    if change.kind == "off":
        some, missing, least, most = missing, some, 1 - most, 1 - least
    return [
        rows
        for t_s, *bands in zip(series.t_s[_window(series, change)], some, missing, least, most, strict=True)
        for rows in _of_frame(float(t_s), series.rows, *bands)
    ]


def _part(frames: Floats, dark: Floats, lit: Floats, tells: Bools) -> Floats:
    """(n, B, C) how far each cell is from dark to lit, in grey levels; NaN in cells that do not tell."""
    return np.asarray((frames - dark) / np.where(tells, lit - dark, np.nan))


def _median(values: Floats, tells: Bools) -> Floats:
    """(n, B) median over the cells of a band that tell; NaN for a band without any."""
    found = np.full(values.shape[:2], np.nan)
    bands = tells.any(axis=1)
    found[:, bands] = np.nanmedian(np.where(tells, values, np.nan)[:, bands], axis=2)
    return found


def _unsteadiness(part: Floats) -> Floats:
    """(B,) how far a band strays from its median over frames of steady light; NaN for a band that does not tell."""
    middle = _median(part, np.isfinite(part[0]))
    return np.asarray(np.abs(middle - np.median(middle, axis=0)).max(axis=0))


def _light(part: Floats, dark: Floats, lit: Floats, power: float) -> Floats:
    """The part of the lamp's light behind a part of its grey levels, where grey is light to the power ``1/power``."""
    grey = dark + np.clip(part, 0.0, 1.0) * (lit - dark)
    return np.asarray((grey**power - dark**power) / np.where(lit == dark, np.nan, lit**power - dark**power))


def _of_frame(t_s: float, rows: Floats, some: Bools, missing: Bools, least: Floats, most: Floats) -> list[Exposures]:
    """Inequalities of one frame's bands, of which those wholly before or after the change count as one range."""
    before, after = missing & ~some, some & ~missing
    partly = np.flatnonzero(some & missing)
    partly = partly[:: len(partly) // _PARTLY_BANDS + 1]
    found = [
        _inequalities(-1, t_s, rows[partly], 0.5 - least[partly], START),
        _inequalities(1, t_s, rows[partly], 0.5 - most[partly], START),
    ]
    if before.any():
        found.append(_inequalities(1, t_s, _ends(rows[before]), 0.5 - most[before].max(), START))
    if after.any():
        found.append(_inequalities(-1, t_s, _ends(rows[after]), 0.5 - least[after].min(), START))
    return found


def _greatest_flash(series: BrightnessSeries, changes: Sequence[LightChange], kind: str, noise: Floats) -> Floats:
    """(B, C) the most by which a flash of that kind changed each cell; NaN for a cell that none of them reached."""
    greatest = np.zeros(noise.shape)
    for index, change in enumerate(changes):
        levels = _levels(series, changes, index)
        if change.kind == kind and levels is not None:
            greatest = np.maximum(greatest, _flashed(series, change, levels).max(axis=0))
    return np.asarray(np.where(greatest > np.maximum(LEAST_GREY, _SIGMAS * noise), greatest, np.nan))


def _flashed(series: BrightnessSeries, change: LightChange, levels: _Levels) -> Floats:
    """(n, B, C) grey levels that a flash adds, or a dip takes, in each frame of its window."""
    steady = np.median(np.concatenate((levels.before, levels.after)), axis=0)
    return np.asarray((series.cells[_window(series, change)] - steady) * (1 if change.kind == "flash" else -1))


def _flash(series: BrightnessSeries, change: LightChange, levels: _Levels, greatest: Floats) -> list[Exposures]:
    """Inequalities of a flash: rows that saw some of it, and rows that were over before it or began after it.

    Which rows of the same frame came before the flash is known by the order in which rows are read: from the top.
    """
    part = _median(_flashed(series, change, levels) / greatest, np.isfinite(greatest))
    seen, unseen, t_s = part > _SEEN, part < _UNSEEN, series.t_s[_window(series, change)]
    frames = np.flatnonzero(seen.any(axis=1))
    if not len(frames):
        return []
    first, last, found = int(frames[0]), int(frames[-1]), []
    for frame in range(len(part)):
        bands = np.flatnonzero(seen[frame])
        above = np.arange(len(series.rows)) < (bands[0] if len(bands) else 0)
        below = np.arange(len(series.rows)) > (bands[-1] if len(bands) else len(series.rows))
        before = unseen[frame] & (above if frame == first else np.full_like(above, frame < first))
        after = unseen[frame] & (below if frame == last else np.full_like(below, frame > last))
        touch = 0.5 - _UNSEEN_EXPOSURE
        found += [
            _inequalities(1, t_s[frame], _ends(series.rows[before]), touch, START),
            _inequalities(-1, t_s[frame], _ends(series.rows[after]), -touch, END),
            _inequalities(-1, t_s[frame], _ends(series.rows[bands]), 0.5, START),
            _inequalities(1, t_s[frame], _ends(series.rows[bands]), -0.5, END),
        ]
    return found


def _ends(rows: Floats) -> Floats:
    """The least and greatest of a range of rows: what holds for both, holds for all in between."""
    return rows[[0, -1]] if len(rows) else rows


def _inequalities(sign: int, t_s: float, rows: Floats, exposure: Floats | float, end: int) -> Exposures:
    count = len(rows)
    return Exposures(
        np.full(count, sign), np.full(count, t_s), rows, np.broadcast_to(exposure, count), np.full(count, end)
    )


def _joined(parts: Sequence[Exposures]) -> Exposures:
    columns = zip(*((p.sign, p.t_s, p.row, p.exposure, p.end) for p in parts), strict=True)
    return Exposures(*(np.concatenate(column) for column in columns))
