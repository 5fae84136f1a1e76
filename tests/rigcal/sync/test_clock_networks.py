"""Simulated exchanges are what a probe of the true clock would have measured."""

import numpy as np
import pytest

from rigcal.sync.estimator.networks import (
    LAN,
    NETWORKS,
    START_NS,
    HostOscillator,
    Network,
    Queue,
    Setting,
    simulate_exchanges,
    true_clock,
)
from rigcal.sync.exchanges import UNKNOWN

EMPTY = Network("empty", Queue(0.0), Queue(0.0), base_out_s=1e-3, base_back_s=3e-3)


def run(oscillator, network=EMPTY, *, seconds=60.0, rate_hz=1.0, seed=0):
    exchanges = simulate_exchanges(network, oscillator, seconds=seconds, rate_hz=rate_hz, seed=seed)
    return exchanges, true_clock(oscillator, seconds=seconds, seed=seed)


def test_without_queues_the_round_trip_is_the_base_delay():
    exchanges, _ = run(HostOscillator(0.25, 50.0))
    assert exchanges.round_trip_s == pytest.approx(0.004, abs=5e-9)


@pytest.mark.parametrize("network", NETWORKS, ids=lambda network: network.name)
def test_every_exchange_allows_the_true_offset(network):
    oscillator = HostOscillator(-0.7, 80.0, wander_ppm=0.1)
    exchanges, clock = run(oscillator, network, rate_hz=10.0)
    sent_s = (exchanges.sent_ns - START_NS) * 1e-9
    returned_s = (exchanges.returned_ns - START_NS) * 1e-9
    drift_on_the_way_s = 100e-6 * (returned_s - sent_s) + 5e-9
    assert (exchanges.least_offset_s <= clock.offset_s(sent_s) + drift_on_the_way_s).all()
    assert (exchanges.greatest_offset_s >= clock.offset_s(returned_s) - drift_on_the_way_s).all()


def test_the_offset_drifts_by_the_rate_and_has_the_sign_of_the_rig_file():
    _, clock = run(HostOscillator(0.25, 50.0))
    assert clock.offset_s(np.array([0.0, 1000.0])) == pytest.approx([0.25, 0.25 + 50e-6 * 1000 / (1 + 50e-6)], abs=3e-9)


def test_a_host_set_forward_has_a_lower_offset_and_a_rig_set_forward_a_higher_one():
    _, host = run(HostOscillator(settings=(Setting(30.0, 2.0),)))
    _, rig = run(HostOscillator(settings=(Setting(30.0, 2.0, "rig"),)))
    assert host.offset_s(np.array([29.0, 31.0])) == pytest.approx([0.0, -2.0])
    assert rig.offset_s(np.array([29.0, 31.0])) == pytest.approx([0.0, 2.0])


def test_monotonic_clocks_are_never_set():
    settings = (Setting(20.0, -5.0), Setting(30.0, 5.0, "rig"))
    exchanges, _ = run(HostOscillator(settings=settings, tells_monotonic=True))
    for monotonic_ns in (exchanges.rig_monotonic_ns, exchanges.host_monotonic_ns):
        assert np.diff(monotonic_ns) == pytest.approx(1e9, abs=5)


def test_a_host_that_tells_no_monotonic_clock_says_so():
    exchanges, _ = run(HostOscillator())
    assert (exchanges.host_monotonic_ns == UNKNOWN).all()


def test_a_slewed_host_gains_what_the_slew_says():
    _, clock = run(HostOscillator(slews=((10.0, 30.0, 500.0),)))
    assert clock.offset_s(np.array([10.0, 60.0])) == pytest.approx([0.0, -0.01], abs=1e-5)


def test_wander_is_the_change_of_the_rate_in_a_minute():
    changes = []
    for seed in range(400):
        clock = true_clock(HostOscillator(wander_ppm=0.1), seconds=100.0, seed=seed)
        rates_ppm = np.diff(clock.rig_s - clock.host_s) * 1e6
        changes.append(rates_ppm[62] - rates_ppm[2])
    assert np.std(changes) == pytest.approx(0.1, rel=0.15)


def test_the_same_seed_gives_the_same_exchanges_and_another_seed_others():
    one, again, other = (run(HostOscillator(), LAN, seed=seed)[0] for seed in (1, 1, 2))
    assert (one.returned_ns == again.returned_ns).all()
    assert (one.returned_ns != other.returned_ns).any()


def test_lost_probes_are_missing():
    lossy = Network("lossy", Queue(1e-4), Queue(1e-4), loss=0.5)
    assert 400 < len(run(HostOscillator(), lossy, rate_hz=16.0)[0]) < 560
