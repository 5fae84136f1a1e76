"""Simulated hosts behind simulated networks: what a probe would have measured, and the clock that it was to find.

The four networks are those of the comparison of estimators that this package is held against: a quiet LAN, a busy one,
Wi-Fi, and a host whose video saturates its own uplink, so that only the answers queue. Queues are exponential or gamma
distributed with a share of spikes, on a constant base delay each way; requests leave at a steady rate.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from rigcal.geometry import Floats, Ints, freeze
from rigcal.sync.exchanges import UNKNOWN, Exchanges

Side: TypeAlias = Literal["host", "rig"]

START_NS = 1_795_000_000_000_000_000
"""When simulations start, by the rig's clock: in November 2026."""
_RIG_BOOTED_NS, _HOST_BOOTED_NS = START_NS - 86_400_000_000_000, START_NS - 3_600_000_000_000
_HOST_THINKS_S = 20e-6
_AHEAD_S = 7200.0
_MINUTE_S = 60.0


@dataclass(frozen=True, slots=True)
class Queue:
    """What a packet waits on one way, beyond the base delay: gamma distributed, and more in a share of cases."""

    mean_s: float
    shape: float = 1.0
    """1: exponential; greater: seldom near nothing."""
    spike_share: float = 0.0
    spike_mean_s: float = 0.0
    """Mean of the exponential wait that a share of packets suffers besides."""

    def draw_s(self, count: int, rng: np.random.Generator) -> Floats:
        """(count,) waits in seconds."""
        waits = rng.gamma(self.shape, self.mean_s / self.shape, count)
        return np.asarray(waits + (rng.random(count) < self.spike_share) * rng.exponential(self.spike_mean_s, count))


@dataclass(frozen=True, slots=True)
class Network:
    """The way to a host and back."""

    name: str
    out: Queue
    """Of requests."""
    back: Queue
    """Of answers."""
    base_out_s: float = 100e-6
    base_back_s: float = 100e-6
    loss: float = 0.0
    """Share of the probes that are never answered."""


LAN = Network("LAN", Queue(40e-6), Queue(40e-6))
_SHARED = Queue(300e-6, spike_share=0.2, spike_mean_s=5e-3)
BUSY = Network("busy", _SHARED, _SHARED)
_AIR = Queue(2.4e-3, shape=2.0, spike_share=0.05, spike_mean_s=20e-3)
WIFI = Network("Wi-Fi", _AIR, _AIR)
UPLINK = Network("one direction saturated", Queue(40e-6), Queue(6e-3))
NETWORKS = (LAN, BUSY, WIFI, UPLINK)


@dataclass(frozen=True, slots=True)
class Setting:
    """A clock is set, in one go."""

    at_s: float
    """When, in seconds after the start."""
    jump_s: float
    """By how much; positive: set forward."""
    side: Side = "host"


@dataclass(frozen=True, slots=True)
class HostOscillator:
    """A host's clock as it truly is."""

    offset_s: float = 0.0
    """Rig minus host at the start."""
    drift_ppm: float = 0.0
    """Rate of the rig's clock beside the host's, at the start."""
    wander_ppm: float = 0.0
    """Standard deviation of what the rate changes by within a minute (a random walk)."""
    settings: tuple[Setting, ...] = ()
    slews: tuple[tuple[float, float, float], ...] = ()
    """Times when the host's clock is slewed: from and until, in seconds after the start, and by how many ppm."""
    tells_monotonic: bool = False
    """Whether its answers hold its monotonic clock."""


@dataclass(frozen=True, slots=True, eq=False)
class TrueClock:
    """One realisation of a host's clock: what every estimate is held against."""

    oscillator: HostOscillator
    host_s: Floats
    """(k,) the host's monotonic time, in seconds after the start."""
    rig_s: Floats
    """(k,) the rig's monotonic time at those; linear between."""

    def __post_init__(self) -> None:
        count = len(self.host_s)
        freeze(self, np.float64, host_s=(count,), rig_s=(count,))

    def host_elapsed_s(self, rig_elapsed_s: Floats) -> Floats:
        """The host's monotonic time at times of the rig's, both after the start."""
        return np.interp(rig_elapsed_s, self.rig_s, self.host_s)

    def host_ns(self, rig_elapsed_s: Floats) -> Ints:
        """What the host's clock shows at times of the rig's monotonic clock after the start."""
        shown_s = self.host_elapsed_s(rig_elapsed_s) - self.oscillator.offset_s + self._set_s("host", rig_elapsed_s)
        return START_NS + np.rint(shown_s * 1e9).astype(np.int64)

    def rig_ns(self, rig_elapsed_s: Floats) -> Ints:
        """What the rig's clock shows at times of its monotonic clock after the start."""
        return START_NS + np.rint((rig_elapsed_s + self._set_s("rig", rig_elapsed_s)) * 1e9).astype(np.int64)

    def offset_s(self, rig_elapsed_s: Floats) -> Floats:
        """Rig minus host at times of the rig's monotonic clock after the start."""
        return np.asarray((self.rig_ns(rig_elapsed_s) - self.host_ns(rig_elapsed_s)) * 1e-9)

    def _set_s(self, side: Side, rig_elapsed_s: Floats) -> Floats:
        total = np.zeros(np.shape(rig_elapsed_s))
        for setting in self.oscillator.settings:
            if setting.side == side:
                total += setting.jump_s * (rig_elapsed_s >= setting.at_s)
        return total


def true_clock(oscillator: HostOscillator, *, seconds: float, seed: int) -> TrueClock:
    """The clock that :func:`simulate_exchanges` with the same arguments has; it goes on for two hours afterwards."""
    host_s = np.arange(-1.0, seconds + _AHEAD_S)
    walk = np.random.default_rng([seed, 1]).normal(0.0, oscillator.wander_ppm / np.sqrt(_MINUTE_S), len(host_s) - 1)
    rates_ppm = oscillator.drift_ppm + np.cumsum(walk) - walk[0]
    for begin_s, end_s, slew_ppm in oscillator.slews:
        rates_ppm -= slew_ppm * ((host_s[:-1] >= begin_s) & (host_s[:-1] < end_s))
    gained_s = np.concatenate([[0.0], np.cumsum(rates_ppm * 1e-6 * np.diff(host_s))])
    return TrueClock(oscillator, host_s, host_s + gained_s - np.interp(0.0, host_s, gained_s))


def simulate_exchanges(
    network: Network, oscillator: HostOscillator, *, seconds: float, rate_hz: float, seed: int
) -> Exchanges:
    """Probes of a host at a steady rate; the truth is :func:`true_clock` of the same arguments."""
    rng = np.random.default_rng([seed, 0])
    clock = true_clock(oscillator, seconds=seconds, seed=seed)
    sent = np.arange(round(seconds * rate_hz)) / rate_hz
    received = sent + network.base_out_s + network.out.draw_s(len(sent), rng)
    replied = received + _HOST_THINKS_S
    returned = replied + network.base_back_s + network.back.draw_s(len(sent), rng)
    answered = rng.random(len(sent)) >= network.loss
    monotonic = _HOST_BOOTED_NS + np.rint(clock.host_elapsed_s(replied) * 1e9).astype(np.int64)
    everything = Exchanges(
        clock.rig_ns(sent),
        clock.host_ns(received),
        clock.host_ns(replied),
        clock.rig_ns(returned),
        _RIG_BOOTED_NS + np.rint(returned * 1e9).astype(np.int64),
        monotonic if oscillator.tells_monotonic else np.full(len(sent), UNKNOWN),
    )
    return everything[answered]
