"""The bounds of an offset are those of a linear program over every exchange, found from the few that matter."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from rigcal.sync.estimator.hull import MOST_DRIFT_PPM, bounding_lines, least_wander_ppm, some_line, upper_hull
from rigcal.sync.estimator.networks import LAN, NETWORKS, WIFI, HostOscillator, Setting, simulate_exchanges
from rigcal.sync.estimator.polygon import centroid, clip
from rigcal.sync.exchanges import Exchanges

EACH_NETWORK = pytest.mark.parametrize("network", NETWORKS, ids=lambda network: network.name)


def exchanges_of(network=LAN, oscillator=HostOscillator(0.0123, 20.0), *, count=60, seed=0):
    return simulate_exchanges(network, oscillator, seconds=60.0, rate_hz=count / 60, seed=seed)


def plain_extremes(exchanges, cost, about_ns, near_ns, wander_ppm=0.0):
    """Least and greatest value of ``cost @ (offset, drift)`` over all exchanges: microseconds and ppm."""
    t_low, t_high = (exchanges.received_ns - about_ns) * 1e-9, (exchanges.replied_ns - about_ns) * 1e-9
    low = (exchanges.sent_ns - exchanges.received_ns - near_ns) * 1e-3 - wander_ppm * abs(t_low)
    high = (exchanges.returned_ns - exchanges.replied_ns - near_ns) * 1e-3 + wander_ppm * abs(t_high)
    one = np.ones(len(exchanges))
    matrix = np.vstack([np.column_stack([-one, -t_low]), np.column_stack([one, t_high])])
    limits = [(None, None), (-MOST_DRIFT_PPM, MOST_DRIFT_PPM)]
    least, greatest = (
        linprog(sign * np.array(cost), matrix, np.concatenate([-low, high]), bounds=limits) for sign in (1, -1)
    )
    return least.fun, -greatest.fun


@EACH_NETWORK
@pytest.mark.parametrize("wander_ppm", [0.0, 1.0])
def test_intervals_are_those_of_a_linear_program_over_every_exchange(network, wander_ppm):
    exchanges = exchanges_of(network, count=300)
    about_ns = int(exchanges.replied_ns[150])
    lines = bounding_lines(exchanges, about_ns=about_ns, wander_ppm=wander_ppm)
    for after_s in (-40.0, 0.0, 100.0):
        least, greatest = plain_extremes(exchanges, [1.0, after_s], about_ns, lines.near_ns, wander_ppm)
        interval_s = np.array(lines.interval_s(about_ns + round(after_s * 1e9))) - lines.near_ns * 1e-9
        slack_us = 0.003 * (1 + abs(after_s))  # stamps' rounding, and what it lets the drift turn
        assert interval_s * 1e6 == pytest.approx([least, greatest], abs=slack_us)
    extremes = plain_extremes(exchanges, [0.0, 1.0], about_ns, lines.near_ns, wander_ppm)
    assert lines.drift_interval_ppm == pytest.approx(extremes, abs=1e-3)


def test_the_hull_keeps_what_bounds_ten_thousand_exchanges():
    exchanges = exchanges_of(WIFI, count=10_000)
    about_ns = int(exchanges.replied_ns[-1])
    lines = bounding_lines(exchanges, about_ns=about_ns)
    least, greatest = plain_extremes(exchanges, [1.0, 0.0], about_ns, lines.near_ns)
    interval_us = 1e6 * (np.array(lines.interval_s(about_ns)) - lines.near_ns * 1e-9)
    assert interval_us == pytest.approx([least, greatest], abs=0.005)


POINTS = st.lists(st.tuples(st.integers(-50, 50), st.integers(-50, 50)), min_size=1, max_size=80)


@given(POINTS)
@settings(deadline=None)
def test_lines_above_the_corners_of_the_hull_are_above_every_point(points):
    x, y = np.array(points, dtype=np.float64).T
    corners = upper_hull(x, y)
    assert (np.diff(x[corners]) >= 0).all()
    for slope in np.linspace(-120, 120, 41):
        assert (y - slope * x)[corners].max() == (y - slope * x).max()


@given(POINTS)
@settings(deadline=None)
def test_the_hull_has_no_corner_to_spare(points):
    x, y = np.array(points, dtype=np.float64).T
    corners = upper_hull(x, y)
    slopes = np.diff(y[corners]) / np.maximum(np.diff(x[corners]), 1e-9)
    assert (np.diff(slopes) < 0).all()


@EACH_NETWORK
def test_the_best_line_is_one_of_the_lines(network):
    exchanges = exchanges_of(network)
    about_ns = int(exchanges.replied_ns[-1])
    lines = bounding_lines(exchanges, about_ns=about_ns)
    for host_ns in (int(exchanges.replied_ns[0]), about_ns):
        least_s, greatest_s = lines.interval_s(host_ns)
        assert least_s < lines.offset_s(host_ns) < greatest_s
    for waits_s in lines.waits_s(exchanges):
        assert waits_s.min() > 0


def test_no_digit_is_lost_on_a_clock_that_is_decades_off():
    near, decades_ns = exchanges_of(count=600), 1_700_000_000_000_000_000
    far = replace(near, received_ns=near.received_ns - decades_ns, replied_ns=near.replied_ns - decades_ns)
    far_lines, near_lines = (bounding_lines(e, about_ns=int(e.replied_ns[-1])) for e in (far, near))
    assert far_lines.near_ns - near_lines.near_ns == decades_ns
    assert (far_lines.corners == near_lines.corners).all()
    assert (far_lines.best == near_lines.best).all()


def test_one_exchange_bounds_the_offset_by_half_its_round_trip_and_leaves_the_drift_open():
    exchange = exchanges_of()[:1]
    lines = bounding_lines(exchange, about_ns=int(exchange.replied_ns[0]))
    least_s, greatest_s = lines.interval_s(int(exchange.replied_ns[0]))
    assert greatest_s - least_s == pytest.approx(exchange.round_trip_s[0], abs=2e-8)
    assert lines.drift_interval_ppm == pytest.approx((-MOST_DRIFT_PPM, MOST_DRIFT_PPM), abs=1e-6)
    assert lines.drift_ppm == pytest.approx(0.0, abs=10.0)


def test_an_exchange_without_any_delay_still_allows_a_line():
    times = np.array([1_795_000_000_000_000_000])
    exact = Exchanges(times, times, times, times, times, times)
    lines = bounding_lines(exact, about_ns=int(times[0]))
    assert lines.offset_s(int(times[0])) == pytest.approx(0.0, abs=1e-8)


def test_exchanges_on_both_sides_of_a_step_allow_no_line():
    exchanges = exchanges_of(oscillator=HostOscillator(settings=(Setting(30.5, 0.01),)))
    about_ns = int(exchanges.replied_ns[-1])
    assert bounding_lines(exchanges, about_ns=about_ns) is None
    assert not some_line(exchanges, about_ns=about_ns)
    assert some_line(exchanges[:30], about_ns=about_ns)


def test_a_step_of_decades_does_not_upset_the_solver():
    exchanges = exchanges_of(oscillator=HostOscillator(settings=(Setting(30.5, -1.7e9),)))
    assert bounding_lines(exchanges, about_ns=int(exchanges.replied_ns[-1])) is None


def test_a_clock_that_drifts_more_than_any_quartz_allows_no_line():
    exchanges = exchanges_of(oscillator=HostOscillator(0.0, 400.0))
    about_ns = int(exchanges.replied_ns[-1])
    assert bounding_lines(exchanges, about_ns=about_ns) is None
    assert bounding_lines(exchanges, about_ns=about_ns, most_drift_ppm=500.0).drift_ppm == pytest.approx(400, abs=0.3)


def test_the_least_wander_is_just_enough():
    exchanges = exchanges_of(oscillator=HostOscillator(0.0, 20.0, slews=((20.0, 60.0, 100.0),)))
    about_ns = int(exchanges.replied_ns[-1])
    least_ppm = least_wander_ppm(exchanges, about_ns=about_ns)
    assert bounding_lines(exchanges, about_ns=about_ns, wander_ppm=0.99 * least_ppm) is None
    assert bounding_lines(exchanges, about_ns=about_ns, wander_ppm=1.01 * least_ppm + 0.1) is not None


def test_a_steady_clock_needs_no_wander():
    exchanges = exchanges_of()
    assert least_wander_ppm(exchanges, about_ns=int(exchanges.replied_ns[-1])) == 0.0


SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])


def test_a_clipped_square_is_what_the_half_plane_leaves_of_it():
    assert clip(SQUARE, np.array([1.0, 0.0]), 3.0) is SQUARE
    assert sorted(clip(SQUARE, np.array([1.0, 0.0]), 1.0).tolist()) == [[0, 0], [0, 2], [1, 0], [1, 2]]
    assert len(clip(SQUARE, np.array([1.0, 0.0]), -1.0)) == 0


def test_the_centroid_is_of_the_area_and_not_of_the_corners():
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
    assert centroid(corners) == pytest.approx([1.0, 1.0])
    assert centroid(SQUARE[:1]) == pytest.approx([0.0, 0.0])
