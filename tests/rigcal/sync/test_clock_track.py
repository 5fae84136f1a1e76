"""A clock over a whole recording: its bound holds the truth at every time of it."""

import numpy as np
import pytest

from rigcal.errors import NoExchangesError
from rigcal.sync.estimator.networks import (
    LAN,
    NETWORKS,
    START_NS,
    HostOscillator,
    Setting,
    simulate_exchanges,
    true_clock,
)
from rigcal.sync.estimator.track import track_clock

EACH_NETWORK = pytest.mark.parametrize("network", NETWORKS, ids=lambda network: network.name)
DOUBLE_S = 1e-6


def run(oscillator, network=LAN, *, seconds=600.0, rate_hz=1.0, seed=0):
    exchanges = simulate_exchanges(network, oscillator, seconds=seconds, rate_hz=rate_hz, seed=seed)
    return exchanges, true_clock(oscillator, seconds=seconds, seed=seed)


def series_and_error(track, clock, elapsed_s):
    series = track.offset_series(clock.rig_ns(elapsed_s) * 1e-9)
    return series, np.abs(series.offset_s - clock.offset_s(elapsed_s))


@EACH_NETWORK
def test_the_bound_holds_at_every_time_of_a_recording_and_around_it(network):
    exchanges, clock = run(HostOscillator(0.4, 20.0, wander_ppm=0.1), network, seconds=1200.0)
    series, error_s = series_and_error(track_clock(exchanges), clock, np.linspace(-0.5, 1800.0, 5000))
    assert (error_s <= series.bound_s + DOUBLE_S).all()


def test_an_hour_of_lan_is_known_to_a_quarter_of_a_millisecond_throughout():
    exchanges, clock = run(HostOscillator(0.4, 20.0, wander_ppm=0.1), seconds=3600.0)
    track = track_clock(exchanges)
    series, error_s = series_and_error(track, clock, np.linspace(0.0, 3599.0, 5000))
    assert (error_s <= series.bound_s + DOUBLE_S).all()
    assert series.bound_s.max() < 250e-6
    assert np.sqrt(np.mean(error_s**2)) < 20e-6
    assert track.steps == ()


def test_without_times_the_series_is_at_the_exchanges():
    exchanges, _ = run(HostOscillator(0.4, 20.0))
    series = track_clock(exchanges).offset_series()
    assert series.method == "probe"
    assert series.t_s == pytest.approx(exchanges.returned_ns * 1e-9)
    assert series.offset_s == pytest.approx(0.4, abs=0.013)


def test_the_model_at_a_time_says_what_the_series_says():
    exchanges, clock = run(HostOscillator(0.4, 20.0))
    track = track_clock(exchanges)
    t_s = START_NS * 1e-9 + 333.25
    series, model = track.offset_series(np.array([t_s])), track.model_at(t_s)
    assert model.offset_s == series.offset_s[0]
    assert model.bound_s == series.bound_s[0]
    assert model.rig_time_s(float(clock.host_ns(np.array([333.25]))[0]) * 1e-9) == pytest.approx(t_s, abs=5e-6)


@pytest.mark.parametrize("side", ["host", "rig"])
@pytest.mark.parametrize("jump_s", [0.02, -0.02, 5.0, -5.0])
def test_the_bound_holds_up_to_a_step_across_it_and_after(side, jump_s):
    exchanges, clock = run(HostOscillator(0.4, 20.0, settings=(Setting(300.4, jump_s, side),)))
    track = track_clock(exchanges)
    (step,) = track.steps
    assert step.clock == side
    elapsed_s = np.linspace(0.0, 599.0, 6000)
    if side == "rig" and jump_s < 0:  # the rig showed these times twice
        elapsed_s = elapsed_s[(elapsed_s < 300.4 + jump_s) | (elapsed_s > 302.5)]
    series, error_s = series_and_error(track, clock, elapsed_s)
    assert (error_s <= series.bound_s + DOUBLE_S).all()
    clear = np.abs(elapsed_s - 300.4) > 5.1
    assert series.bound_s[clear].max() < 500e-6


def test_the_bound_widens_over_a_gap():
    everything, clock = run(HostOscillator(0.4, 20.0, wander_ppm=0.1), seconds=1800.0)
    elapsed_s = np.arange(len(everything))
    exchanges = everything[(elapsed_s < 600) | (elapsed_s >= 1200)]
    series, error_s = series_and_error(track_clock(exchanges), clock, np.linspace(0.0, 1799.0, 3600))
    assert (error_s <= series.bound_s + DOUBLE_S).all()
    assert series.bound_s[1800] > 2 * series.bound_s[600]


@pytest.mark.parametrize("slew", [(100.0, 110.0, 500.0), (100.0, 101.2, 83333.0)])
def test_the_bound_holds_while_the_host_is_slewed(slew):
    exchanges, clock = run(HostOscillator(0.4, 20.0, slews=(slew,)), seconds=200.0)
    track = track_clock(exchanges)
    series, error_s = series_and_error(track, clock, np.linspace(0.0, 199.0, 3000))
    assert (error_s <= series.bound_s + DOUBLE_S).all()
    assert track.steps == ()
    assert track.wander_ppm > 20


def test_one_exchange_makes_a_track():
    exchanges, clock = run(HostOscillator(0.4, 20.0))
    series, error_s = series_and_error(track_clock(exchanges[:1]), clock, np.array([-0.5, 0.0, 60.0]))
    assert (error_s <= series.bound_s + DOUBLE_S).all()


def test_no_exchange_makes_none():
    with pytest.raises(NoExchangesError):
        track_clock(run(HostOscillator())[0][:0])


def test_progress_is_told_to_the_end():
    told = []
    exchanges, _ = run(HostOscillator(settings=(Setting(300.4, 1.0),)))
    track_clock(exchanges, progress=lambda done, of: told.append((done, of)))
    assert told[-1] == (600, 600)
    assert len(told) == 2
