"""From media time to the camera's wall clock: exact where reports are, robust where they are not, steps taken out."""

import numpy as np
import pytest

from recognition.sources.rtsp_time import MediaClock, Report

START_NS = 1_795_000_000_123_456_789
MEDIA_NS = 47_721_858_844_444  # anywhere


def wall_ns(t_s, drift=0.0):
    return START_NS + round(t_s * 1e9) + round(t_s * drift * 1e9)


def reported(times_s, drift=0.0, error_s=None, clock=None):
    """A clock that was given reports at these times; and the steps that it saw."""
    clock = clock or MediaClock()
    errors_s = np.zeros(len(times_s)) if error_s is None else error_s
    steps = [
        clock.add(Report(MEDIA_NS + round(t * 1e9), wall_ns(t, drift) + round(e * 1e9)))
        for t, e in zip(times_s, errors_s, strict=True)
    ]
    return clock, [step for step in steps if step is not None]


def error_s(clock, t_s, drift=0.0):
    return (clock.wall_ns(MEDIA_NS + round(t_s * 1e9)) - wall_ns(t_s, drift)) * 1e-9


def test_nothing_is_known_before_the_first_report():
    clock = MediaClock()
    assert not clock.is_known
    with pytest.raises(ValueError, match="no sender report"):
        clock.wall_ns(0)


def test_one_report_times_all_frames_before_it_and_after_it():
    clock, _ = reported([5.0])
    assert clock.is_known
    assert [error_s(clock, t) for t in (0.0, 5.0, 60.0)] == [0.0, 0.0, 0.0]


def test_reports_without_error_give_the_rate_of_the_clock():
    times = np.arange(1.0, 81.0, 5.0)
    clock, steps = reported(times, drift=80e-6)
    assert not steps
    assert max(abs(error_s(clock, t, 80e-6)) for t in (0.0, 40.0, 85.0)) < 20e-6


@pytest.mark.parametrize(("jitter_s", "within_s"), [(1e-3, 1.5e-3), (5e-3, 7.5e-3)])
def test_reports_with_jitter_give_times_within_one_and_a_half_of_it(jitter_s, within_s):
    rng = np.random.default_rng(5)
    clock, worst_s, steps = MediaClock(), 0.0, []
    for t in np.arange(1.0, 301.0, 5.0):
        steps += reported([t], 50e-6, rng.uniform(-jitter_s, jitter_s, 1), clock)[1]
        worst_s = max(worst_s, *(abs(error_s(clock, t + later, 50e-6)) for later in (0.0, 5.0)))
    assert not steps
    assert worst_s < within_s


def test_a_report_that_is_wrong_alone_is_passed_over():
    clock, steps = reported([5.0, 10.0, 15.0, 20.0], error_s=[0.0, 0.0, 3600.0, 0.0])
    assert not steps
    assert error_s(clock, 22.0) == 0.0


@pytest.mark.parametrize("before", [1, 3, 12])
def test_a_step_is_seen_at_its_second_report_and_taken_out(before):
    times = [5.0 * (1 + n) for n in range(before)]
    clock, steps = reported(times)
    assert not steps
    after = [times[-1] + 5.0, times[-1] + 10.0]
    _, none = reported(after[:1], error_s=[-0.4], clock=clock)
    assert not none
    assert error_s(clock, after[0]) == 0.0
    _, steps = reported(after[1:], error_s=[-0.4], clock=clock)
    assert steps == [pytest.approx(-0.4)]
    _, later = reported([after[1] + 5.0], error_s=[-0.4], clock=clock)
    assert not later
    assert abs(error_s(clock, after[1] + 7.0)) < 1e-9


def test_a_clock_that_is_slewed_as_fast_as_ntp_may_is_followed():
    clock, worst_s = MediaClock(), 0.0
    for t in np.arange(0.0, 300.0, 5.0):
        slewed_s = 5e-4 * max(0.0, min(t, 200.0) - 100.0)
        _, steps = reported([t], error_s=[slewed_s], clock=clock)
        assert not steps
        worst_s = max(worst_s, abs(error_s(clock, t) - slewed_s))
    assert 0.001 < worst_s < 0.015
