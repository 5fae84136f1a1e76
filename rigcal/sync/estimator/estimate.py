"""A host's clock now: offset, drift, hard bound, steps, and what the bound is made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigcal.errors import NoExchangesError, OptionError
from rigcal.geometry import Floats
from rigcal.rig import ClockModel
from rigcal.sync.estimator.fit import ClockFit, fit_clock
from rigcal.sync.estimator.hull import MOST_DRIFT_PPM
from rigcal.sync.estimator.steps import ClockStep, split_at_steps
from rigcal.sync.exchanges import Exchanges

_UNEVEN, _NOTABLE_S = 3.0, 50e-6
_MINUTE_S = 60.0


@dataclass(frozen=True, slots=True)
class EstimateOptions:
    """What is assumed of clocks.

    Raises:
        OptionError: for a value that is not positive, or a negative wander.
    """

    window_s: float = 600.0
    """Exchanges older than this beside the last do not count: oscillators wander."""
    wander_ppm: float = 1.0
    """By how much a clock's rate may change within the window and after it; the bound holds as long as it does not
    change more. chrony assumes as much of a clock between its updates (``maxclockerror``), and a computer's crystal
    changes about as much with one degree, and a few times as much over a day (Mills, Computer Network Time
    Synchronization, 2nd edition, 2011)."""
    most_drift_ppm: float = MOST_DRIFT_PPM
    """Limit of the drift: a clock that drifts more is not explained, and is said to wander."""

    def __post_init__(self) -> None:
        for name in ("window_s", "most_drift_ppm"):
            if not getattr(self, name) > 0:
                raise OptionError(name, expected="greater than 0", got=getattr(self, name))
        if not self.wander_ppm >= 0:
            raise OptionError("wander_ppm", expected="0 or more", got=self.wander_ppm)


@dataclass(frozen=True, slots=True)
class Asymmetry:
    """How the ways to a host and back differ, and what cannot be known of it."""

    base_share: float
    """Share of the bound that no estimator can remove, between 0 and 1: the least time that packets took, which may all
    have passed on one of the two ways."""
    out_wait_s: float
    """Median of what requests took beyond the least, in seconds."""
    back_wait_s: float
    """Median of what answers took beyond the least."""

    @property
    def hint(self) -> str:
        """What a user can do about it; empty where the ways are alike."""
        out, back = max(self.out_wait_s, _NOTABLE_S), max(self.back_wait_s, _NOTABLE_S)
        if max(out, back) < _UNEVEN * min(out, back):
            return ""
        slow, quick, way = ("answers", "requests", "from") if back > out else ("requests", "answers", "to")
        return (
            f"{slow} wait {1e3 * max(self.out_wait_s, self.back_wait_s):.2g} ms in the network, "
            f"{quick} {1e3 * min(self.out_wait_s, self.back_wait_s):.2g} ms: something fills the way {way} this host; "
            "probe it longer, or while no video is sent"
        )


@dataclass(frozen=True, slots=True)
class HostClock:
    """A host's clock at the last exchange with it."""

    model: ClockModel
    """From the host's clock to rig time; its ``at_utc`` is the host's time of the last exchange."""
    least_offset_s: float
    """Least offset at the model's time that the exchanges allow."""
    greatest_offset_s: float
    """Greatest offset, likewise; with the least it is narrower than the model's bound where the best guess is not in
    the middle."""
    exchanges: int
    """How many were given."""
    used: int
    """How many of them the model comes from."""
    round_trip_min_s: float
    round_trip_median_s: float
    round_trip_p99_s: float
    asymmetry: Asymmetry
    steps: tuple[ClockStep, ...]
    """When the host's or the rig's clock was set, in order; only what came after counts for the model."""
    wander_ppm: float
    """By how much the clock's rate must have changed since the last step, within the window; 0 where a constant rate
    explains the exchanges."""
    drift_known: bool
    """Whether the exchanges say anything of the drift; if not, only its limit is certain."""

    @property
    def wanders(self) -> bool:
        """Whether no constant rate explains the exchanges."""
        return self.wander_ppm > 0


def estimate_clock(exchanges: Exchanges, options: EstimateOptions = EstimateOptions()) -> HostClock:
    """A host's clock at the last exchange, from those in the window before it and after the last step.

    One exchange gives an offset and its bound, and a drift that is next to 0 and not known (``drift_known``).

    Args:
        exchanges: In the order in which they were sent.
        options: What is assumed of clocks.

    Raises:
        NoExchangesError: where there is no exchange, or none that can be (each with a negative round trip).
    """
    possible = possible_exchanges(exchanges)
    runs, steps = split_at_steps(possible)
    recent = _recent(possible[runs[-1].first : runs[-1].end], options.window_s)
    fit = fit_clock(
        recent,
        len(recent) - 1,
        reach=len(recent),
        wander_ppm=options.wander_ppm,
        most_drift_ppm=options.most_drift_ppm,
    )
    used = recent[fit.first : fit.end]
    round_trip_s = used.round_trip_s
    return HostClock(
        model=fit.model,
        least_offset_s=fit.least_s,
        greatest_offset_s=fit.greatest_s,
        exchanges=len(exchanges),
        used=len(used),
        round_trip_min_s=float(round_trip_s.min()),
        round_trip_median_s=float(np.median(round_trip_s)),
        round_trip_p99_s=float(np.quantile(round_trip_s, 0.99)),
        asymmetry=_asymmetry(used, fit),
        steps=steps,
        wander_ppm=fit.wander_ppm,
        drift_known=fit.model.drift_bound_ppm < options.most_drift_ppm,
    )


def possible_exchanges(exchanges: Exchanges) -> Exchanges:
    """Those that can be: no answer before its request, by either clock.

    Raises:
        NoExchangesError: where there is none.
    """
    possible = (exchanges.round_trip_s >= 0) & (exchanges.replied_ns >= exchanges.received_ns)
    if not possible.any():
        raise NoExchangesError(impossible=len(exchanges))
    return exchanges[possible]


def _recent(exchanges: Exchanges, window_s: float) -> Exchanges:
    age_ns = exchanges.rig_monotonic_ns[-1] - exchanges.rig_monotonic_ns
    return exchanges[age_ns <= window_s * 1e9]


def _asymmetry(used: Exchanges, fit: ClockFit) -> Asymmetry:
    """From what requests and answers waited beside the best line, in the last minute: a wandering clock leaves it."""
    out_s, back_s = (_beyond_least(waits) for waits in fit.lines.waits_s(_recent(used, _MINUTE_S)))
    share = min(fit.lines.margin_s / fit.model.bound_s, 1.0)
    return Asymmetry(share, float(np.median(out_s)), float(np.median(back_s)))


def _beyond_least(waits_s: Floats) -> Floats:
    return np.asarray(waits_s - waits_s.min())
