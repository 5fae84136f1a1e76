"""A host's clock is told from exchanges with it, with a bound that holds the truth."""

import numpy as np
import pytest
from scipy.optimize import linprog

from rigcal.errors import NoExchangesError, OptionError, SyncError
from rigcal.sync.estimator.estimate import EstimateOptions, estimate_clock
from rigcal.sync.estimator.networks import (
    LAN,
    NETWORKS,
    START_NS,
    UPLINK,
    WIFI,
    HostOscillator,
    Network,
    Queue,
    Setting,
    simulate_exchanges,
    true_clock,
)
from rigcal.sync.exchanges import Exchanges

EACH_NETWORK = pytest.mark.parametrize("network", NETWORKS, ids=lambda network: network.name)
DOUBLE_S = 1e-6


def run(oscillator=HostOscillator(0.0123, 20.0), network=LAN, *, seconds=60.0, rate_hz=1.0, seed=0):
    exchanges = simulate_exchanges(network, oscillator, seconds=seconds, rate_hz=rate_hz, seed=seed)
    return exchanges, true_clock(oscillator, seconds=seconds, seed=seed)


def error_s(model, clock, elapsed_s):
    """Error of a model's offset at a rig time after the start, and the bound that it gives there."""
    host_s = float(clock.host_ns(np.array([elapsed_s]))[0]) * 1e-9
    offset_s = float(clock.offset_s(np.array([elapsed_s]))[0])
    return model.rig_time_s(host_s) - host_s - offset_s, model.bound_at_s(host_s)


def covers(model, clock, elapsed_s):
    error, bound_s = error_s(model, clock, elapsed_s)
    return abs(error) <= bound_s + DOUBLE_S


def end_s(exchanges):
    return float(exchanges.returned_ns[-1] - START_NS) * 1e-9


def plain_offset_s(exchanges):
    """Middle of the two linear programs at the last answer, over every exchange."""
    t_low, t_high = ((t - exchanges.replied_ns[-1]) * 1e-9 for t in (exchanges.received_ns, exchanges.replied_ns))
    one = np.ones(len(exchanges))
    matrix = np.vstack([np.column_stack([-one, -t_low]), np.column_stack([one, t_high])])
    limits = np.concatenate([-exchanges.least_offset_s, exchanges.greatest_offset_s]) * 1e6
    ends = [linprog([s, 0], matrix, limits, bounds=[(None, None), (-300, 300)]).x[0] for s in (1, -1)]
    return np.mean(ends) * 1e-6


@EACH_NETWORK
@pytest.mark.parametrize("rate_hz", [1.0, 4.0])
def test_errors_are_below_a_plain_program_and_half_those_of_the_quickest_exchange(network, rate_hz):
    errors = []
    for seed in range(10):
        exchanges, clock = run(network=network, rate_hz=rate_hz, seed=seed)
        quickest = np.argmin(exchanges.round_trip_s)
        quickest_s = (exchanges.least_offset_s + exchanges.greatest_offset_s)[quickest] / 2
        truth_s = clock.offset_s(np.array([end_s(exchanges)]))[0]
        found_s = estimate_clock(exchanges).model.offset_s
        errors.append(np.array([found_s, plain_offset_s(exchanges), quickest_s]) - truth_s)
    ours, plain, quickest = np.sqrt(np.mean(np.square(errors), axis=0))
    assert ours <= 1.1 * plain
    assert ours <= quickest / 2


def test_the_bound_holds_the_truth_in_every_run_at_once_before_and_ten_minutes_ahead():
    rng = np.random.default_rng(5)
    for seed in range(80):
        oscillator = HostOscillator(rng.uniform(-10, 10), rng.uniform(-150, 150))
        exchanges, clock = run(oscillator, NETWORKS[seed % 4], seed=seed)
        model = estimate_clock(exchanges).model
        for elapsed_s in (0.0, 30.0, end_s(exchanges), 660.0):
            assert covers(model, clock, elapsed_s), (seed, elapsed_s)


@pytest.mark.parametrize(("out_s", "back_s"), [(20e-6, 2e-3), (2e-3, 20e-6)])
def test_the_bound_holds_the_truth_where_one_way_is_longer_which_nobody_can_see(out_s, back_s):
    lopsided = Network("lopsided", Queue(40e-6), Queue(40e-6), base_out_s=out_s, base_back_s=back_s)
    exchanges, clock = run(network=lopsided)
    found = estimate_clock(exchanges)
    error, bound_s = error_s(found.model, clock, end_s(exchanges))
    assert 0.9e-3 < abs(error) < bound_s
    assert found.asymmetry.base_share > 0.9


def test_the_drift_is_within_a_fiftieth_of_a_ppm_over_ten_minutes_of_lan():
    for seed in range(8):
        oscillator = HostOscillator(0.0, -50.0 + 13 * seed)
        exchanges, _ = run(oscillator, seconds=600.0, rate_hz=0.2, seed=seed)
        assert estimate_clock(exchanges).model.drift_ppm == pytest.approx(oscillator.drift_ppm, abs=0.02)


@EACH_NETWORK
def test_the_bound_holds_the_truth_of_a_rate_that_wanders_by_a_tenth_ppm_a_minute(network):
    for seed in range(6):
        exchanges, clock = run(HostOscillator(0.0, 20.0, wander_ppm=0.1), network, seconds=600.0, seed=seed)
        model = estimate_clock(exchanges).model
        assert covers(model, clock, end_s(exchanges))
        assert covers(model, clock, end_s(exchanges) + 600.0)


def test_the_model_is_of_the_hosts_time_of_the_last_exchange():
    exchanges, _ = run(HostOscillator(5.0, 20.0))
    model = estimate_clock(exchanges).model
    assert model.method == "probe"
    assert model.at_utc == "2026-11-18T11:07:33.998959Z"
    assert model.at_s == pytest.approx(exchanges.replied_ns[-1] * 1e-9, abs=2e-6)


def test_the_hard_interval_holds_the_model_and_is_within_its_bound():
    found = estimate_clock(run(network=UPLINK)[0])
    assert found.least_offset_s < found.model.offset_s < found.greatest_offset_s
    farther_s = max(found.greatest_offset_s - found.model.offset_s, found.model.offset_s - found.least_offset_s)
    assert found.model.bound_s == pytest.approx(farther_s)


def test_round_trips_and_counts_are_told():
    exchanges, _ = run()
    found = estimate_clock(exchanges)
    assert (found.exchanges, found.used) == (60, 60)
    assert found.round_trip_min_s == exchanges.round_trip_s.min()
    assert found.round_trip_min_s < found.round_trip_median_s < found.round_trip_p99_s < 1e-3
    assert not found.wanders
    assert found.steps == ()


def test_no_answer_at_all_is_an_error_that_says_what_to_do():
    with pytest.raises(NoExchangesError) as caught:
        estimate_clock(run()[0][:0])
    assert isinstance(caught.value, SyncError)
    assert str(caught.value) == (
        "the host's clock cannot be told from its answers\n"
        "  expected: one answered probe at least, better 60\n"
        "  got:      no answer\n"
        "  do next:  start `rigcal sync serve` (or chronyd) on the host, let UDP to it pass the firewall, probe again"
    )


def test_answers_before_their_requests_are_no_answers():
    exchanges, _ = run()
    turned = Exchanges(
        exchanges.returned_ns,
        exchanges.received_ns,
        exchanges.replied_ns,
        exchanges.sent_ns,
        exchanges.rig_monotonic_ns,
        exchanges.host_monotonic_ns,
    )
    with pytest.raises(NoExchangesError) as caught:
        estimate_clock(turned)
    assert str(caught.value) == (
        "the host's clock cannot be told from its answers\n"
        "  expected: one answered probe at least, better 60\n"
        "  got:      60 answered, each before it was asked by one of the two clocks\n"
        "  do next:  let nothing set the clocks of this computer or of the host meanwhile, and probe again"
    )


def test_a_single_impossible_exchange_does_not_count():
    exchanges, clock = run()
    returned_ns = exchanges.returned_ns.copy()
    returned_ns[20] -= 1_000_000
    spoilt = Exchanges(
        exchanges.sent_ns,
        exchanges.received_ns,
        exchanges.replied_ns,
        returned_ns,
        exchanges.rig_monotonic_ns,
        exchanges.host_monotonic_ns,
    )
    found = estimate_clock(spoilt)
    assert (found.exchanges, found.used) == (60, 59)
    assert covers(found.model, clock, end_s(exchanges))


def test_one_exchange_gives_an_offset_and_leaves_the_drift_open():
    exchanges, clock = run()
    found = estimate_clock(exchanges[:1])
    assert not found.drift_known
    assert found.model.bound_s == pytest.approx(exchanges.round_trip_s[0] / 2, rel=0.02)
    assert found.model.drift_bound_ppm >= 300.0
    assert all(covers(found.model, clock, t) for t in (0.0, 1.0, 600.0))


def test_two_exchanges_tell_something_of_the_drift():
    exchanges, clock = run()
    found = estimate_clock(exchanges[[0, 30]])
    assert found.used == 2
    assert found.drift_known
    assert found.model.drift_bound_ppm < 20.0
    assert all(covers(found.model, clock, t) for t in (0.0, 30.0, 600.0))


def test_exchanges_older_than_the_window_do_not_count():
    exchanges, _ = run(seconds=300.0)
    assert estimate_clock(exchanges, EstimateOptions(window_s=120.0)).used == 120


def test_only_what_came_after_a_step_counts():
    exchanges, clock = run(HostOscillator(0.3, 20.0, settings=(Setting(40.5, 0.05),)))
    found = estimate_clock(exchanges)
    assert [step.clock for step in found.steps] == ["host"]
    assert found.used == 19
    assert covers(found.model, clock, end_s(exchanges))
    assert covers(found.model, clock, end_s(exchanges) + 600.0)


def test_a_clock_that_is_slewed_wanders_and_is_not_stepped():
    exchanges, clock = run(HostOscillator(0.3, 20.0, slews=((20.0, 40.0, 500.0),)))
    found = estimate_clock(exchanges)
    assert found.steps == ()
    assert found.wanders
    assert found.wander_ppm > 100
    assert found.used < 20
    assert covers(found.model, clock, end_s(exchanges))


def test_a_clock_that_is_still_being_slewed_is_bounded_as_fast_as_it_goes():
    exchanges, clock = run(HostOscillator(0.3, 20.0, slews=((40.0, 90.0, 500.0),)))
    found = estimate_clock(exchanges)
    assert found.wanders
    assert all(covers(found.model, clock, end_s(exchanges) + later) for later in (0.0, 10.0, 25.0))


@pytest.mark.parametrize(
    ("network", "hint"),
    [
        (LAN, ""),
        (WIFI, ""),
        (
            UPLINK,
            "answers wait 4.7 ms in the network, requests 0.03 ms: something fills the way from this host; "
            "probe it longer, or while no video is sent",
        ),
        (
            Network("downlink", UPLINK.back, UPLINK.out),
            "requests wait 4.6 ms in the network, answers 0.028 ms: something fills the way to this host; "
            "probe it longer, or while no video is sent",
        ),
    ],
    ids=["LAN", "Wi-Fi", "full uplink", "full downlink"],
)
def test_a_way_that_is_fuller_than_the_other_is_told(network, hint):
    assert estimate_clock(run(network=network)[0]).asymmetry.hint == hint


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"window_s": 0.0}, "option window_s is out of range"),
        ({"most_drift_ppm": -1.0}, "option most_drift_ppm is out of range"),
        ({"wander_ppm": -0.1}, "option wander_ppm is out of range"),
        ({"wander_ppm": float("nan")}, "option wander_ppm is out of range"),
    ],
)
def test_options_out_of_range_are_refused(options, message):
    with pytest.raises(OptionError, match=message):
        EstimateOptions(**options)
