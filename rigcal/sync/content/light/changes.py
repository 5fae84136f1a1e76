"""Sudden changes of the light in one camera: a lamp switched on or off, or a flash.

A change is sudden where it is over within four frames and most of what changes goes the same way. Slow changes (clouds,
exposure that settles) are taken out first: from each step between frames, the median of the steps around it. People who
walk through brighten some cells and darken others, and so cancel.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, TypeAlias

import numpy as np
from scipy.ndimage import median_filter

from rigcal.geometry import Floats
from rigcal.sync.content.light.brightness import BrightnessSeries

Kind: TypeAlias = Literal["on", "off", "flash", "dip"]

FLASH_S = 0.2
"""Light that comes and goes within this time is one flash (or, the other way, one dip), not two switchings."""
LEAST_FRAMES = 12
"""Frames that a camera must have for a change to be told from its noise."""
_SLOW_FRAMES = 15  # frames over which a steady change is taken out
_LONGEST_FRAMES = 4  # exposure and readout, each a frame period at most, spread a switching over three steps
_SIGMAS = 6.0  # how far a step must stand out of the camera's own steps
_LEAST_SCORE = 0.25  # and at least this: 3 % of the cells at the limit below
_SCORE_LIMIT = 8.0  # sigmas that one cell may contribute: few cells that change much must not pass for many
_LEAST_NOISE_GREY = 0.15  # frames of a compressed video may repeat exactly; below this, steps are the encoder's
LEAST_GREY = 3.0
"""Grey levels by which a cell must change to count as lit by the lamp."""
_LEAST_CELLS = 0.03  # share of the cells that must see the lamp
_LEAST_AGREEMENT = 0.8  # share of the changing cells that must change the same way
_SETTLING = 0.25  # a change of less than this part of one close by is that one's echo: exposure that settles


@dataclass(frozen=True, slots=True)
class LightChange:
    """A sudden change of the light, in frames of one camera."""

    kind: Kind
    first: int
    """The last frame before the light began to change."""
    last: int
    """The first frame after it had changed (of a flash: after it was over)."""
    t_s: float
    """About when, by the camera's clock: the middle of the two frames."""
    grey: float
    """Mean change over the cells that see it, in grey levels; of a flash, its first half."""
    share: float
    """Share of the image's cells that see it."""


@dataclass(frozen=True, slots=True)
class _Run:
    """Consecutive steps between frames that go the same way: ``cells[first]`` before, ``cells[last]`` after."""

    first: int
    last: int
    sign: int
    grey: float
    share: float


def find_changes(series: BrightnessSeries) -> tuple[LightChange, ...]:
    """The sudden changes of a camera's light, in order of time; none where there are fewer than 12 frames."""
    if len(series.t_s) < LEAST_FRAMES:
        return ()
    cells = series.cells.reshape(len(series.t_s), -1)
    return tuple(change for burst in _bursts(_runs(cells), series.t_s) if (change := _change(burst, series.t_s)))


def cell_noise(cells: Floats) -> Floats:
    """(N,) standard deviation of the step from one frame to the next, of each cell's (F, N) brightness."""
    steps = np.diff(cells, axis=0)
    sigma = 1.4826 * np.median(np.abs(steps - np.median(steps, axis=0)), axis=0)
    return np.asarray(np.maximum(sigma, _LEAST_NOISE_GREY))


def _runs(cells: Floats) -> list[_Run]:
    steps = np.diff(cells, axis=0)
    steps = steps - median_filter(steps, size=(_SLOW_FRAMES, 1), mode="nearest")
    noise = cell_noise(cells)
    score = np.clip(steps / noise, -_SCORE_LIMIT, _SCORE_LIMIT).mean(axis=1)
    spread = 1.4826 * float(np.median(np.abs(score - np.median(score))))
    signs = np.where(np.abs(score) > max(_SIGMAS * spread, _LEAST_SCORE), np.sign(score), 0.0)
    edges = np.flatnonzero(np.diff(signs, prepend=0.0, append=0.0))
    found = [(int(a), int(b)) for a, b in pairwise(edges) if signs[a] and b - a <= _LONGEST_FRAMES]
    runs = [run for a, b in found if (run := _run(steps[a:b].sum(axis=0), a, b, int(signs[a]), noise))]
    return [run for run in runs if not any(_echoes(run, other) for other in runs)]


def _run(change: Floats, first: int, last: int, sign: int, noise: Floats) -> _Run | None:
    """The run, where enough cells change enough, and the same way."""
    changing = np.abs(change) > np.maximum(LEAST_GREY, _SIGMAS * noise)
    lit = changing & (np.sign(change) == sign)
    if lit.mean() < _LEAST_CELLS or lit.sum() < _LEAST_AGREEMENT * changing.sum():
        return None
    return _Run(first, last, sign, float(np.abs(change[lit]).mean()), float(lit.mean()))


def _echoes(run: _Run, other: _Run) -> bool:
    """Whether a change only follows, or prepares, a much greater one close by."""
    apart = max(run.first - other.last, other.first - run.last)
    return run is not other and apart <= _SLOW_FRAMES // 2 and run.grey < _SETTLING * other.grey


def _bursts(runs: list[_Run], t_s: Floats) -> list[list[_Run]]:
    """Runs that follow each other within the time of a flash."""
    bursts: list[list[_Run]] = []
    for run in runs:
        if bursts and t_s[run.first] - t_s[bursts[-1][-1].last] < FLASH_S:
            bursts[-1].append(run)
        else:
            bursts.append([run])
    return bursts


def _change(burst: list[_Run], t_s: Floats) -> LightChange | None:
    """A burst as one change; None where light comes and goes more than once in it."""
    first, last = burst[0], burst[-1]
    signs = tuple(run.sign for run in burst)
    kinds: dict[tuple[int, ...], Kind] = {(1,): "on", (-1,): "off", (1, -1): "flash", (-1, 1): "dip"}
    if signs not in kinds or t_s[last.last] - t_s[first.first] > 2 * FLASH_S:
        return None
    middle_s = float(t_s[first.first] + t_s[last.last]) / 2
    return LightChange(kinds[signs], first.first, last.last, middle_s, first.grey, first.share)
