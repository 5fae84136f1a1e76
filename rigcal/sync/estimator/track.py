"""A host's clock over a whole recording: a model about every so many exchanges, and a bound at every time.

Used after a recording, when what came later is known as well: each model has exchanges before and after its time, so
that the bound grows only half as far from one to the next.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise

import numpy as np

from rigcal.geometry import Bools, Floats, Ints, freeze
from rigcal.rig import ClockModel
from rigcal.sync.estimator.estimate import EstimateOptions, possible_exchanges
from rigcal.sync.estimator.fit import ClockFit, fit_clock
from rigcal.sync.estimator.steps import ClockStep, split_at_steps
from rigcal.sync.exchanges import Exchanges
from rigcal.sync.history.series import OffsetSeries

_MOST_IN_A_WINDOW = 600
_MODELS_PER_WINDOW = 8
"""More make the bound flatter between models, and take longer; with 8 it grows for 38 s on either side at 1 Hz."""


@dataclass(frozen=True, slots=True)
class TrackPiece:
    """One model of a track, with the exchanges that it comes from; times are rig times in seconds since the epoch."""

    model: ClockModel
    t_s: float
    """When it holds best."""
    first_s: float
    """Time of the first exchange used."""
    last_s: float
    """Time of the last exchange used."""
    drift_bound_ppm: float
    """How fast the bound grows between these; before and after them ``model.drift_bound_ppm`` holds."""
    run: int
    """Which run between steps it belongs to, counted from 0."""
    joined: bool
    """Whether it shares exchanges with the piece before it; where not, the clock did what it liked between."""


@dataclass(frozen=True, slots=True, eq=False)
class ClockTrack:
    """A clock over time."""

    pieces: tuple[TrackPiece, ...]
    """In order of time; one at least."""
    run_first_s: Floats
    """(r,) rig time of the first exchange of each run between steps."""
    run_last_s: Floats
    """(r,) rig time of the last exchange of each run."""
    exchange_t_s: Floats
    """(n,) rig time of the exchanges."""
    steps: tuple[ClockStep, ...]
    """When the host's or the rig's clock was set, in order."""
    wander_ppm: float
    """The greatest change of the clock's rate within a window; 0 where a constant rate explains each of them."""

    def __post_init__(self) -> None:
        runs = len(self.run_first_s)
        freeze(self, np.float64, run_first_s=(runs,), run_last_s=(runs,), exchange_t_s=(None,))

    @property
    def models(self) -> tuple[ClockModel, ...]:
        """The models of the pieces."""
        return tuple(piece.model for piece in self.pieces)

    def offset_series(self, t_s: Floats | None = None) -> OffsetSeries:
        """Offset and bound at (n,) rig times in seconds since the epoch; None: at the exchanges.

        Between two pieces that share exchanges the one with the narrower interval holds. Where they share none, or
        where the clock was set between them, the interval is all that both allow and what is between.
        """
        t_s = self.exchange_t_s if t_s is None else np.asarray(t_s, dtype=np.float64)
        left, right, joined = self._neighbours(t_s)
        one, other = self._told(left, t_s), self._told(right, t_s)
        narrower = np.where(one[1] <= other[1], one, other)
        least, greatest = np.minimum(one[0] - one[1], other[0] - other[1]), np.maximum(one.sum(0), other.sum(0))
        offset_s, bound_s = np.where(joined, narrower, np.array([least + greatest, greatest - least]) / 2)
        return OffsetSeries("probe", t_s, offset_s, bound_s)

    def model_at(self, t_s: float) -> ClockModel:
        """The clock's model about a rig time in seconds since the epoch."""
        series = self.offset_series(np.array([t_s]))
        offset_s = float(series.offset_s[0])
        nearest = min(self.pieces, key=lambda piece: abs(piece.t_s - t_s)).model
        at = datetime.fromtimestamp(round(t_s - offset_s, 6), UTC)
        return ClockModel(
            offset_s=offset_s,
            drift_ppm=nearest.drift_ppm,
            at_utc=at.isoformat(timespec="microseconds")[:-6] + "Z",
            bound_s=float(series.bound_s[0]),
            drift_bound_ppm=nearest.drift_bound_ppm,
            method=nearest.method,
        )

    def _neighbours(self, t_s: Floats) -> tuple[Ints, Ints, Bools]:
        """(n,) pieces before and after each time, and whether they are to be taken for one clock."""
        run_of = np.array([piece.run for piece in self.pieces])
        piece_t_s = np.array([piece.t_s for piece in self.pieces])
        shares = np.array([piece.joined for piece in self.pieces])
        run = np.zeros(len(t_s), dtype=np.int64)
        for index, first_s in enumerate(self.run_first_s.tolist()):
            run[t_s >= first_s] = index
        left, right = np.zeros_like(run), np.zeros_like(run)
        for index, last_s in enumerate(self.run_last_s.tolist()):
            own, asked = np.flatnonzero(run_of == index), np.flatnonzero(run == index)
            after = own[0] + np.searchsorted(piece_t_s[own], t_s[asked])
            left[asked], right[asked] = np.maximum(after - 1, own[0]), np.minimum(after, own[-1])
            behind = asked[t_s[asked] > last_s]
            right[behind] = min(own[-1] + 1, len(self.pieces) - 1)
        return left, right, (left == right) | shares[right]

    def _told(self, piece: Ints, t_s: Floats) -> Floats:
        """(2, n) offset and bound at rig times, by one piece each."""
        rows = [
            (p.model.offset_s, p.model.drift_ppm, p.model.at_s, p.model.bound_s, p.model.drift_bound_ppm)
            + (p.drift_bound_ppm, p.first_s, p.last_s)
            for p in self.pieces
        ]
        offset_s, drift_ppm, at_s, bound_s, outer_ppm, inner_ppm, first_s, last_s = np.array(rows).T[:, piece]
        after_s = (t_s - at_s - offset_s) / (1 + drift_ppm * 1e-6)  # camera time after the model's own
        outside_s = np.maximum(np.maximum(first_s - t_s, t_s - last_s), 0.0)
        growth = inner_ppm * np.maximum(np.abs(after_s) - outside_s, 0.0) + outer_ppm * outside_s
        return np.array([offset_s + drift_ppm * 1e-6 * after_s, bound_s + growth * 1e-6])


def track_clock(
    exchanges: Exchanges,
    options: EstimateOptions = EstimateOptions(),
    *,
    progress: Callable[[int, int], None] | None = None,
) -> ClockTrack:
    """A host's clock over all exchanges with it.

    Args:
        exchanges: In the order in which they were sent.
        options: What is assumed of clocks; ``window_s`` is the length of the window about each model.
        progress: Called with the number of exchanges that are done, and of all.

    Raises:
        NoExchangesError: where there is no exchange, or none that can be (each with a negative round trip).
    """
    possible = possible_exchanges(exchanges)
    t_s = np.asarray(possible.returned_ns * 1e-9)
    runs, steps = split_at_steps(possible)
    pieces: list[TrackPiece] = []
    wander_ppm = 0.0
    for index, run in enumerate(runs):
        fits = _fits(possible[run.first : run.end], options)
        pieces += _pieces(fits, t_s[run.first : run.end], index)
        wander_ppm = max(wander_ppm, *(fit.wander_ppm for _, fit in fits))
        if progress is not None:
            progress(run.end, len(possible))
    return ClockTrack(
        pieces=tuple(pieces),
        run_first_s=np.array([t_s[run.first] for run in runs]),
        run_last_s=np.array([t_s[run.end - 1] for run in runs]),
        exchange_t_s=t_s,
        steps=steps,
        wander_ppm=wander_ppm,
    )


def _pieces(fits: list[tuple[int, ClockFit]], t_s: Floats, run: int) -> list[TrackPiece]:
    """Pieces of a run from its fits, each with the index of its exchange."""
    joined = [False, *(after.first < before.end for (_, before), (_, after) in pairwise(fits))]
    return [
        TrackPiece(
            fit.model,
            float(t_s[about]),
            float(t_s[fit.first]),
            float(t_s[fit.end - 1]),
            fit.inner_drift_bound_ppm,
            run,
            shares,
        )
        for (about, fit), shares in zip(fits, joined, strict=True)
    ]


def _fits(exchanges: Exchanges, options: EstimateOptions) -> list[tuple[int, ClockFit]]:
    """Models of a run, each with the index of its exchange; closer together where the clock's rate changes."""
    reach = _reach(exchanges, options.window_s)
    hop = max(2 * reach // _MODELS_PER_WINDOW, 1)
    wanted = sorted({*range(0, len(exchanges), hop), len(exchanges) - 1}, reverse=True)
    fits: dict[int, ClockFit] = {}
    done: list[int] = []
    while wanted:
        about = wanted[-1]
        if about not in fits:
            fits[about] = fit_clock(
                exchanges, about, reach=reach, wander_ppm=options.wander_ppm, most_drift_ppm=options.most_drift_ppm
            )
        if done and fits[about].first >= fits[done[-1]].end and about - done[-1] > 1:
            wanted.append((about + done[-1]) // 2)
        else:
            done.append(wanted.pop())
    return [(about, fits[about]) for about in done]


def _reach(exchanges: Exchanges, window_s: float) -> int:
    """How many exchanges half a window has."""
    if len(exchanges) < 2:
        return 1
    apart_s = float(np.median(np.diff(exchanges.rig_monotonic_ns))) * 1e-9
    return int(np.clip(window_s / 2 / max(apart_s, 1e-3), 1, _MOST_IN_A_WINDOW // 2))
