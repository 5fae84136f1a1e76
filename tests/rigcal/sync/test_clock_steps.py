"""A clock that was set in one go is told from one whose rate changes, and whose clock it was."""

import numpy as np
import pytest

from rigcal.sync.estimator.networks import (
    BUSY,
    LAN,
    NETWORKS,
    START_NS,
    WIFI,
    HostOscillator,
    Setting,
    simulate_exchanges,
)
from rigcal.sync.estimator.steps import split_at_steps

EACH_NETWORK = pytest.mark.parametrize("network", NETWORKS, ids=lambda network: network.name)


def steps_of(oscillator, network=LAN, *, seconds=60.0, rate_hz=1.0, seed=0):
    return split_at_steps(simulate_exchanges(network, oscillator, seconds=seconds, rate_hz=rate_hz, seed=seed))[1]


@EACH_NETWORK
@pytest.mark.parametrize("jump_s", [0.02, -0.02, 3600.0, -1e8])
def test_a_host_that_was_set_is_found_by_its_offsets(network, jump_s):
    (step,) = steps_of(HostOscillator(0.1, 20.0, settings=(Setting(30.5, jump_s),)), network)
    assert (step.clock, step.evidence) == ("host", "offsets")
    assert 31.0 < step.at_s - START_NS * 1e-9 < 33.0
    assert step.at_s - START_NS * 1e-9 - step.within_s < 30.5
    assert abs(step.jump_s + jump_s) <= step.bound_s + 1e-7
    assert step.bound_s < 0.006


def test_a_host_that_was_set_is_found_at_once_by_its_monotonic_clock():
    setting = Setting(30.5, 200e-6)
    (step,) = steps_of(HostOscillator(settings=(setting,), tells_monotonic=True), WIFI)
    assert (step.clock, step.evidence) == ("host", "monotonic")
    assert step.jump_s == pytest.approx(-200e-6, abs=1e-8)
    assert abs(step.jump_s + 200e-6) <= step.bound_s


@pytest.mark.parametrize("jump_s", [0.001, -0.001, 37.0, -37.0])
def test_a_step_of_the_rigs_own_clock_is_not_blamed_on_the_host(jump_s):
    (step,) = steps_of(HostOscillator(settings=(Setting(30.5, jump_s, "rig"),)))
    assert (step.clock, step.evidence) == ("rig", "monotonic")
    assert step.jump_s == pytest.approx(jump_s, abs=1e-8)


@pytest.mark.parametrize("tells", [True, False])
def test_a_step_before_the_very_last_exchange_is_found(tells):
    settings = (Setting(58.5, 0.01),)
    assert len(steps_of(HostOscillator(settings=settings, tells_monotonic=tells))) == 1


def test_each_of_several_steps_is_found():
    settings = (Setting(100.5, 0.05), Setting(400.5, -0.02), Setting(450.2, 3.0, "rig"), Setting(900.5, 0.01))
    found = steps_of(HostOscillator(0.1, 20.0, settings=settings), seconds=1000.0)
    assert [step.clock for step in found] == ["host", "host", "rig", "host"]
    assert [step.jump_s for step in found] == pytest.approx([-0.05, 0.02, 3.0, -0.01], abs=1e-4)


def test_exchanges_on_either_side_of_a_step_are_in_runs_of_their_own():
    oscillator = HostOscillator(0.1, 20.0, settings=(Setting(30.5, 0.02),))
    runs, _ = split_at_steps(simulate_exchanges(LAN, oscillator, seconds=60.0, rate_hz=1.0, seed=0))
    assert [(run.first, run.end) for run in runs] == [(0, 31), (31, 60)]


@pytest.mark.parametrize(("network", "rate_hz"), [(LAN, 1.0), (BUSY, 1.0), (WIFI, 5.0)], ids=["LAN", "busy", "Wi-Fi"])
@pytest.mark.parametrize("slew", [(20.0, 40.0, 500.0), (20.0, 40.0, -500.0), (30.0, 31.2, 83333.0)])
def test_a_slewed_host_was_not_set(slew, network, rate_hz):
    assert steps_of(HostOscillator(0.1, 20.0, slews=(slew,)), network, rate_hz=rate_hz) == ()


@pytest.mark.parametrize("tells", [True, False])
def test_an_oscillator_that_wanders_was_not_set(tells):
    oscillator = HostOscillator(0.1, 20.0, wander_ppm=0.3, tells_monotonic=tells)
    assert steps_of(oscillator, seconds=3600.0) == ()


def test_a_monotonic_clock_that_is_read_late_now_and_then_is_no_step():
    exchanges = simulate_exchanges(LAN, HostOscillator(tells_monotonic=True), seconds=600.0, rate_hz=1.0, seed=0)
    late_ns = exchanges.host_monotonic_ns.copy()
    late_ns[[40, 41, 300, 500]] += 3_000_000
    assert split_at_steps(with_monotonic(exchanges, late_ns))[1] == ()


def test_a_monotonic_clock_that_is_not_slewed_with_the_host_is_no_step():
    oscillator = HostOscillator(slews=((200.0, 260.0, 500.0),), tells_monotonic=True)
    exchanges = simulate_exchanges(LAN, oscillator, seconds=600.0, rate_hz=1.0, seed=0)
    elapsed_s = (exchanges.rig_monotonic_ns - exchanges.rig_monotonic_ns[0]) * 1e-9
    free_ns = exchanges.rig_monotonic_ns + np.rint(30e-6 * elapsed_s * 1e9).astype(np.int64)
    assert split_at_steps(with_monotonic(exchanges, free_ns))[1] == ()


def with_monotonic(exchanges, host_monotonic_ns):
    return type(exchanges)(
        exchanges.sent_ns,
        exchanges.received_ns,
        exchanges.replied_ns,
        exchanges.returned_ns,
        exchanges.rig_monotonic_ns,
        host_monotonic_ns,
    )
