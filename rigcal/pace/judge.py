"""From a camera's stamps to its pace."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from rigcal.errors import StampsError
from rigcal.geometry import Bools, Floats, Ints
from rigcal.pace.events import find_events
from rigcal.pace.grid import coarse_period_s, local_periods_s, passable, quantum_s, steady_period_s
from rigcal.pace.levels import tolerance
from rigcal.pace.results import Pace, PaceOptions
from rigcal.pace.spread import source_of, steady_spread, varying_spread


def judge_pace(t_s: ArrayLike, *, declared_fps: float | None = None, options: PaceOptions | None = None) -> Pace:
    """How regularly a camera's frames come.

    Missing frames are told from late ones by whether the stamps return to their grid, from a stepped clock by whether
    the jump is a whole number of periods, and from a frame rate that changes by whether the new interval lasts for a
    second. A step by a whole number of periods cannot be told from missing frames, nor a restarted camera from a
    stepped clock: the stamps are the same.

    Args:
        t_s: (n,) stamps in seconds of one camera's frames, in the order in which they came (live: were delivered).
        declared_fps: What the camera or the file declares.
        options: What counts as a sensor's stamp.

    Raises:
        StampsError: where stamps are not finite, or not in one row.
    """
    stamps_s = _checked(t_s)
    coarse_s = coarse_period_s(stamps_s) if len(stamps_s) >= 3 else 0.0
    if coarse_s == 0:
        return _untold(stamps_s, declared_fps)
    quantum = quantum_s(stamps_s, coarse_s)
    steady_s = steady_period_s(stamps_s, coarse_s)
    local_s = local_periods_s(stamps_s, steady_s, quantum)
    periods_s = np.full(len(stamps_s) - 1, steady_s) if local_s is None else passable(stamps_s, local_s)
    events = find_events(stamps_s, periods_s, tolerance(stamps_s, periods_s, quantum), steady=local_s is None)
    on_grid_s, number = events.on_grid(stamps_s)
    if local_s is None:
        spread = steady_spread(on_grid_s, number, about_s=steady_s, quantum_s=quantum)
    else:
        spread = varying_spread(on_grid_s, number, local_s, quantum_s=quantum)
    if spread.period_s <= 0:
        return _untold(stamps_s, declared_fps)
    source, reason = source_of(len(stamps_s), events.late, spread, quantum, options or PaceOptions())
    return Pace(
        frames=len(stamps_s),
        period_s=spread.period_s,
        period_sigma_s=spread.period_sigma_s,
        declared_fps=declared_fps,
        jitter_s=spread.jitter_s,
        worst_s=spread.worst_s,
        quantum_s=quantum,
        exact=spread.exact,
        varies=local_s is not None,
        rates_fps=None if local_s is None else (1 / float(local_s.max()), 1 / float(local_s.min())),
        late=events.late,
        missing=tuple(events.missing),
        repeated=np.union1d(_where(np.diff(stamps_s) == 0), np.array(events.twice, dtype=np.int64)),
        backwards=_where(np.diff(stamps_s) < 0),
        steps=tuple(events.steps),
        source=source,
        reason=reason,
    )


def _checked(t_s: ArrayLike) -> Floats:
    stamps_s = np.asarray(t_s, dtype=np.float64)
    if stamps_s.ndim != 1:
        raise StampsError(problem="the stamps are not in one row", expected="shape (n,)", got=f"shape {stamps_s.shape}")
    bad = np.flatnonzero(~np.isfinite(stamps_s))
    if len(bad):
        got = f"{stamps_s[bad[0]]} for frame {bad[0]}, {len(bad)} such of {len(stamps_s)}"
        raise StampsError(problem="a stamp is no number", expected="seconds, finite, for every frame", got=got)
    return stamps_s


def _where(marked: Bools) -> Ints:
    """Indices of the frames after the marked intervals."""
    return np.flatnonzero(marked).astype(np.int64) + 1


def _untold(stamps_s: Floats, declared_fps: float | None) -> Pace:
    """The pace of too few frames, or of stamps that do not go on: what is plain to see, and nothing else."""
    few = len(stamps_s) < 3
    return Pace(
        frames=len(stamps_s),
        period_s=None,
        period_sigma_s=None,
        declared_fps=declared_fps,
        jitter_s=0.0,
        worst_s=0.0,
        quantum_s=0.0,
        exact=False,
        varies=False,
        rates_fps=None,
        late=0,
        missing=(),
        repeated=_where(np.diff(stamps_s) == 0),
        backwards=_where(np.diff(stamps_s) < 0),
        steps=(),
        source="unknown",
        reason=f"only {len(stamps_s)} frames" if few else "the stamps do not go on",
    )
