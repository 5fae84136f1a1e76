"""A clock model maps camera time to rig time and back, and its bound widens away from when it was measured."""

from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigcal.rig import ClockModel

MODELS = st.builds(
    ClockModel,
    offset_s=st.floats(-100.0, 100.0),
    drift_ppm=st.floats(-500.0, 500.0),
    at_utc=st.datetimes(datetime(2020, 1, 1), datetime(2040, 1, 1)).map(lambda t: t.isoformat() + "Z"),
    bound_s=st.floats(0.0, 1.0),
    drift_bound_ppm=st.floats(0.0, 500.0),
    method=st.just("probe"),
)
AFTER_S = st.floats(-1e5, 1e5)
DOUBLE_S = 1e-6
"""A double holds a time of this century to 0.24 microseconds; a round trip rounds a few times."""


@given(MODELS, AFTER_S)
def test_camera_time_is_the_inverse_of_rig_time(clock, after_s):
    t_cam_s = clock.at_s + after_s
    assert clock.camera_time_s(clock.rig_time_s(t_cam_s)) == pytest.approx(t_cam_s, abs=DOUBLE_S)


@given(MODELS, AFTER_S)
def test_rig_time_is_the_inverse_of_camera_time(clock, after_s):
    t_rig_s = clock.at_s + after_s
    assert clock.rig_time_s(clock.camera_time_s(t_rig_s)) == pytest.approx(t_rig_s, abs=DOUBLE_S)


@given(MODELS, AFTER_S)
def test_nanoseconds_say_the_same_as_seconds(clock, after_s):
    t_cam_ns = round((clock.at_s + after_s) * 1e9)
    assert clock.rig_time_ns(t_cam_ns) * 1e-9 == pytest.approx(clock.rig_time_s(t_cam_ns * 1e-9), abs=DOUBLE_S)


@given(MODELS, st.integers(0, 999))
def test_nanoseconds_between_two_stamps_are_kept(clock, later_ns):
    t_cam_ns = round(clock.at_s * 1e9)
    gained_ns = clock.rig_time_ns(t_cam_ns + later_ns) - clock.rig_time_ns(t_cam_ns)
    assert abs(gained_ns - later_ns) <= 1


@given(MODELS)
def test_the_offset_is_what_to_add_at_the_time_of_the_model(clock):
    assert clock.rig_time_s(clock.at_s) - clock.at_s == pytest.approx(clock.offset_s, abs=DOUBLE_S)


@given(MODELS, AFTER_S)
def test_the_bound_is_least_at_its_time_and_alike_before_and_after(clock, after_s):
    assert clock.bound_at_s(clock.at_s) == clock.bound_s
    assert clock.bound_at_s(clock.at_s + after_s) >= clock.bound_s
    assert clock.bound_at_s(clock.at_s + after_s) == pytest.approx(clock.bound_at_s(clock.at_s - after_s), abs=1e-9)


def test_the_time_of_a_model_is_read_as_utc():
    clock = ClockModel(0.0, 0.0, "2026-11-22T09:28:40.250000Z", 0.0, 0.0, "probe")
    assert clock.at_s == datetime(2026, 11, 22, 9, 28, 40, 250_000, tzinfo=UTC).timestamp()


def test_a_clock_that_is_behind_and_slow_is_put_right():
    clock = ClockModel(0.5, 100.0, "2026-11-22T09:00:00Z", 0.001, 2.0, "probe")
    assert clock.rig_time_s(clock.at_s + 100.0) - clock.at_s == pytest.approx(100.51, abs=DOUBLE_S)
    assert clock.bound_at_s(clock.at_s + 100.0) == pytest.approx(0.0012)
