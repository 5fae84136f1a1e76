"""Estimates of hosts' clocks over simulated networks, beside a plain linear program and the quickest exchange.

Errors are of the offset at the last exchange. The plain program is the middle of the least and the greatest offset at
that time, each by ``linprog`` over every exchange; it shares no code with the package. ``covered`` counts runs whose
bound held the truth. Steps are told by their size beside the bound of the same network without a step.

    python tools/bench/sync_estimator.py
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from scipy.optimize import linprog

from rigcal.geometry import Floats
from rigcal.rig import ClockModel
from rigcal.sync.estimator.estimate import estimate_clock
from rigcal.sync.estimator.networks import (
    LAN,
    NETWORKS,
    START_NS,
    WIFI,
    HostOscillator,
    Network,
    Setting,
    TrueClock,
    simulate_exchanges,
    true_clock,
)
from rigcal.sync.estimator.track import track_clock
from rigcal.sync.exchanges import Exchanges

Line = Mapping[str, Any]
_MOST_DRIFT = 300e-6
_AHEAD_S = 600.0
_RATES_HZ = (1.0, 10.0)


def accuracy(seeds: int = 40) -> Iterator[Line]:
    """A minute of probes of a clock that drifts by 20 ppm: errors beside the peers' on the same exchanges."""
    oscillator = HostOscillator(offset_s=0.0123, drift_ppm=20.0)
    for network in NETWORKS:
        for rate_hz in _RATES_HZ:
            errors = np.empty((seeds, 3))
            bounds_s, covered = [], 0
            for seed in range(seeds):
                exchanges, clock = _run(network, oscillator, seconds=60, rate_hz=rate_hz, seed=seed)
                truth_s = _truth_s(clock, exchanges)
                found = estimate_clock(exchanges)
                errors[seed] = found.model.offset_s, plain_offset_s(exchanges), quickest_offset_s(exchanges)
                errors[seed] -= truth_s
                bounds_s.append(found.model.bound_s)
                covered += abs(errors[seed, 0]) <= found.model.bound_s
            ours, plain, quickest = 1e6 * np.sqrt(np.mean(errors**2, axis=0))
            yield {
                "name": f"clock_offset.{network.name}.{round(60 * rate_hz)}",
                "ours_rms_us": ours,
                "plain_lp_rms_us": plain,
                "quickest_rms_us": quickest,
                "ratio_plain_lp": ours / plain,
                "times_better_than_quickest": quickest / ours,
                "bound_us": 1e6 * float(np.mean(bounds_s)),
                "covered": f"{covered}/{seeds}",
            }


def coverage(runs: int = 1040) -> Iterator[Line]:
    """Clocks of any offset and drift at a constant rate: does the bound hold, at once and ten minutes later."""
    rng = np.random.default_rng(0)
    now = later = false_steps = 0
    for run in range(runs):
        network, rate_hz = NETWORKS[run % 4], _RATES_HZ[run // 4 % 2]
        oscillator = HostOscillator(rng.uniform(-1, 1), rng.uniform(-100, 100))
        exchanges, clock = _run(network, oscillator, seconds=60, rate_hz=rate_hz, seed=run)
        found = estimate_clock(exchanges)
        now += _covers(found.model, clock, _end_s(exchanges))
        later += _covers(found.model, clock, _end_s(exchanges) + _AHEAD_S)
        false_steps += bool(found.steps)
    yield {
        "name": "clock_bound.constant_rate",
        "runs": runs,
        "covered": now,
        "covered_10_min_ahead": later,
        "false_steps": false_steps,
    }


def drift(seeds: int = 40) -> Iterator[Line]:
    """Ten minutes of LAN probes."""
    for rate_hz in (0.1, 1.0):
        errors = []
        for seed in range(seeds):
            oscillator = HostOscillator(offset_s=-0.3, drift_ppm=-37.0 + seed)
            exchanges, _ = _run(LAN, oscillator, seconds=600, rate_hz=rate_hz, seed=seed)
            errors.append(estimate_clock(exchanges).model.drift_ppm - oscillator.drift_ppm)
        yield {
            "name": f"clock_drift.LAN.10_min.{round(600 * rate_hz)}",
            "rms_ppm": float(np.sqrt(np.mean(np.square(errors)))),
            "worst_ppm": float(np.abs(errors).max()),
        }


def wander(seeds: int = 50) -> Iterator[Line]:
    """A rate that walks by 0.1 ppm a minute (one sigma): ten minutes, then ten more without a probe; and as a track."""
    for network in NETWORKS:
        now = later = 0
        tracked = []
        for seed in range(seeds):
            oscillator = HostOscillator(offset_s=0.2, drift_ppm=20.0, wander_ppm=0.1)
            exchanges, clock = _run(network, oscillator, seconds=600, rate_hz=1.0, seed=seed)
            found = estimate_clock(exchanges)
            now += _covers(found.model, clock, _end_s(exchanges))
            later += _covers(found.model, clock, _end_s(exchanges) + _AHEAD_S)
            elapsed_s = np.linspace(0.0, 600.0, 1201)
            series = track_clock(exchanges).offset_series(clock.rig_ns(elapsed_s) * 1e-9)
            tracked.append(np.mean(np.abs(series.offset_s - clock.offset_s(elapsed_s)) <= series.bound_s))
        yield {
            "name": f"clock_bound.wander_0.1_ppm.{network.name}",
            "covered": f"{now}/{seeds}",
            "covered_10_min_ahead": f"{later}/{seeds}",
            "covered_in_track": float(np.mean(tracked)),
        }


def steps(seeds: int = 20) -> Iterator[Line]:
    """A host that is set once in the minute, by so many times the mean bound without: steps missed, bounds that hold.

    A step that is missed leaves either nothing that contradicts a constant rate, or is told as a change of the rate.
    """
    for network in NETWORKS:
        for rate_hz in _RATES_HZ:
            bound_s = _mean_bound_s(network, rate_hz)
            for tells, sizes in ((False, (2, 3, 5, 7, 10)), (True, (1, 5))):
                missed, covered = dict.fromkeys(sizes, 0), dict.fromkeys(sizes, 0)
                wanders = false_steps = 0
                for times in sizes:
                    for seed in range(seeds):
                        at_s = float(np.random.default_rng([seed, 7]).uniform(6, 54))
                        setting = Setting(at_s, times * bound_s * (-1) ** seed)
                        oscillator = HostOscillator(0.1, 20.0, settings=(setting,), tells_monotonic=tells)
                        exchanges, clock = _run(network, oscillator, seconds=60, rate_hz=rate_hz, seed=seed)
                        found = estimate_clock(exchanges)
                        missed[times] += not found.steps
                        wanders += found.wanders and not found.steps
                        false_steps += max(len(found.steps) - 1, 0)
                        covered[times] += _covers(found.model, clock, _end_s(exchanges))
                yield {
                    "name": f"clock_step.{network.name}.{round(60 * rate_hz)}{'.monotonic' if tells else ''}",
                    "bound_us": 1e6 * bound_s,
                    "runs_each": seeds,
                    "missed_by_times_bound": missed,
                    "of_these_told_as_wander": wanders,
                    "false_steps": false_steps,
                    "covered_by_times_bound": covered,
                }


def _mean_bound_s(network: Network, rate_hz: float) -> float:
    oscillator = HostOscillator(0.1, 20.0)
    runs = [_run(network, oscillator, seconds=60, rate_hz=rate_hz, seed=seed)[0] for seed in range(10)]
    return float(np.mean([estimate_clock(exchanges).model.bound_s for exchanges in runs]))


def slews(seeds: int = 10) -> Iterator[Line]:
    """A host whose clock is slewed forward and back: ntpd (500 ppm for 20 s), chrony (83333 ppm for 1.2 s); no step."""
    for name, begin_s, end_s, ppm in (("ntpd", 20.0, 40.0, 500.0), ("chrony", 30.0, 31.2, 83333.0)):
        for network in NETWORKS:
            false_steps = covered = 0
            for seed in range(seeds):
                for rate_hz in _RATES_HZ:
                    oscillator = HostOscillator(0.1, 20.0, slews=((begin_s, end_s, ppm * (-1) ** seed),))
                    exchanges, clock = _run(network, oscillator, seconds=60, rate_hz=rate_hz, seed=seed)
                    found = estimate_clock(exchanges)
                    false_steps += bool(found.steps)
                    covered += _covers(found.model, clock, _end_s(exchanges))
            yield {
                "name": f"clock_slew.{name}.{network.name}",
                "runs": 2 * seeds,
                "called_a_step": false_steps,
                "covered": covered,
            }


def speed() -> Iterator[Line]:
    """Wall time of an estimate, and of a track over a recording."""
    for count in (60, 600, 6000):
        exchanges, _ = _run(WIFI, HostOscillator(0.1, 20.0), seconds=600, rate_hz=count / 600, seed=0)
        ours_s = _median_s(lambda e=exchanges: estimate_clock(e))
        plain_s = _median_s(lambda e=exchanges: plain_offset_s(e))
        yield {
            "name": f"clock_estimate.{count}",
            "ms": 1e3 * ours_s,
            "plain_lp_ms": 1e3 * plain_s,
            "ratio": ours_s / plain_s,
        }
    exchanges, _ = _run(LAN, HostOscillator(0.1, 20.0, wander_ppm=0.1), seconds=3600, rate_hz=1, seed=0)
    yield {"name": "clock_track.hour_at_1_hz", "s": _median_s(lambda: track_clock(exchanges))}
    exchanges, _ = _run(WIFI, HostOscillator(0.1, 20.0, wander_ppm=0.1), seconds=600, rate_hz=10, seed=0)
    yield {"name": "clock_track.10_min_at_10_hz", "s": _median_s(lambda: track_clock(exchanges))}


def sync_estimator() -> Iterator[Line]:
    """All of them."""
    for part in (accuracy, coverage, drift, wander, steps, slews, speed):
        yield from part()


def plain_offset_s(exchanges: Exchanges) -> float:
    """Middle of the least and greatest offset at the last answer, by two linear programs over all exchanges."""
    end_ns, near_ns = int(exchanges.replied_ns[-1]), round(quickest_offset_s(exchanges) * 1e9)
    t_low, t_high = (exchanges.received_ns - end_ns) * 1e-9, (exchanges.replied_ns - end_ns) * 1e-9
    low = (exchanges.sent_ns - exchanges.received_ns - near_ns) * 1e-3  # microseconds
    high = (exchanges.returned_ns - exchanges.replied_ns - near_ns) * 1e-3
    one = np.ones(len(exchanges))
    matrix = np.vstack([np.column_stack([-one, -t_low]), np.column_stack([one, t_high])])
    limits = [(None, None), (-1e6 * _MOST_DRIFT, 1e6 * _MOST_DRIFT)]
    ends = [linprog([sign, 0], matrix, np.concatenate([-low, high]), bounds=limits).x[0] for sign in (1, -1)]
    return float(near_ns * 1e-9 + np.mean(ends) * 1e-6)


def quickest_offset_s(exchanges: Exchanges) -> float:
    """Offset by the exchange with the least round trip, as a plain NTP client takes it."""
    best = int(np.argmin(exchanges.round_trip_s))
    return float((exchanges.least_offset_s[best] + exchanges.greatest_offset_s[best]) / 2)


def _run(
    network: Network, oscillator: HostOscillator, *, seconds: float, rate_hz: float, seed: int
) -> tuple[Exchanges, TrueClock]:
    exchanges = simulate_exchanges(network, oscillator, seconds=seconds, rate_hz=rate_hz, seed=seed)
    return exchanges, true_clock(oscillator, seconds=seconds, seed=seed)


def _end_s(exchanges: Exchanges) -> float:
    """Rig time of the last answer, in seconds after the start."""
    return float(exchanges.returned_ns[-1] - START_NS) * 1e-9


def _truth_s(clock: TrueClock, exchanges: Exchanges) -> float:
    return float(clock.offset_s(np.array([_end_s(exchanges)]))[0])


def _covers(model: ClockModel, clock: TrueClock, elapsed_s: float) -> bool:
    """Whether the model's bound holds the true offset at a time after the start."""
    at = np.array([elapsed_s])
    host_s: Floats = clock.host_ns(at) * 1e-9
    error_s = model.rig_time_s(float(host_s[0])) - float(host_s[0]) - float(clock.offset_s(at)[0])
    return bool(abs(error_s) <= model.bound_at_s(float(host_s[0])) + 1e-6)  # doubles of this century: 0.2 microseconds


def _median_s(action: Any) -> float:
    action()
    times = []
    for _ in range(3):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return float(np.median(times))


if __name__ == "__main__":
    for line in sync_estimator():
        rounded = {key: float(f"{v:.4g}") if isinstance(v, float) else v for key, v in line.items()}
        print(json.dumps(rounded), flush=True)
