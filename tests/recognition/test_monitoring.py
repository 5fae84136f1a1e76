"""What is said beside every result: how well a site is monitored, and whether clocks can be trusted."""

from dataclasses import replace

import numpy as np
import pytest

from recognition.monitoring import ClockWatch, Coverage, clock_faults, judged
from recognition.observations import FrameSet, Scene
from recognition.synthetic import semicircle_rig
from rigcal.rig import ClockModel

MS = 1_000_000
NOW_S = 1_795_000_000.0
IDS = ("cam0", "cam1", "cam2")


def frame_set(*times_ns):
    return FrameSet(0, 5, (None,) * len(times_ns), times_ns)


def test_every_wanted_camera_monitors():
    verdict = judged(IDS, (True, True, False), frame_set(5, 6, None))
    assert (verdict.status, verdict.reason, verdict.cameras) == ("MONITORED", "", 2)


def test_fewer_cameras_degrade_and_the_absent_are_named():
    verdict = judged(IDS, (True,) * 3, frame_set(5, None, 6), {1: "lost: no route"})
    assert (verdict.status, verdict.cameras) == ("DEGRADED", 2)
    assert verdict.reason == "2 of 3 cameras (cam1: lost: no route)"


def test_one_camera_monitors_nothing():
    verdict = judged(IDS, (True,) * 3, frame_set(None, None, 6))
    assert verdict.status == "NOT MONITORED"
    assert verdict.reason == "1 of 3 cameras (cam0: no frame; cam1: no frame)"


def test_a_rig_of_which_one_camera_is_wanted_is_not_monitored():
    assert judged(IDS, (True, False, False), frame_set(5, None, None)).status == "NOT MONITORED"


def test_where_monitoring_ends_and_begins_is_said_once_and_the_time_is_counted():
    coverage = Coverage()
    course = [
        ("NOT MONITORED", "0 of 3 cameras"), ("NOT MONITORED", "1 of 3 cameras"), ("DEGRADED", "2 of 3 cameras"),
        ("MONITORED", ""), ("DEGRADED", "2 of 3 cameras"), ("NOT MONITORED", "1 of 3 cameras"), ("MONITORED", ""),
    ]  # fmt: skip
    scenes = [Scene(n, n * 500 * MS, (), (), status, reason) for n, (status, reason) in enumerate(course)]
    assert [coverage.see(scene) for scene in scenes] == [
        "NOT MONITORED: 0 of 3 cameras",
        None,
        "monitored from here on, after 1.0 s: DEGRADED, 2 of 3 cameras",
        None,
        None,
        "NOT MONITORED: 1 of 3 cameras",
        "monitored from here on, after 0.5 s",
    ]
    assert coverage.seconds == {"NOT MONITORED": 1.5, "DEGRADED": 1.0, "MONITORED": 0.5}


def test_what_is_monitored_from_the_start_is_not_said():
    assert Coverage().see(Scene(0, 0, (), ())) is None


def clock(age_s=60.0, bound_s=1e-4, drift_bound_ppm=0.1, method="probe"):
    at = np.datetime64(round((NOW_S - age_s) * 1e3), "ms")
    return ClockModel(0.0, 0.0, f"{at}Z", bound_s, drift_bound_ppm, method)


def faults_of(*clocks, use=None, max_age_s=86400.0):
    rig = semicircle_rig(len(clocks))
    rig = replace(rig, cameras=tuple(replace(c, clock=k) for c, k in zip(rig.cameras, clocks, strict=True)))
    used = use or (True,) * len(clocks)
    return dict(clock_faults(rig, used, NOW_S, max_age_s=max_age_s, period_s=1 / 30))


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (None, "its clock was never measured; measure it: rigcal sync probe"),
        (clock(age_s=90_000.0), "its clock was measured 25.0 h ago, the limit is 24 h; measure it: rigcal sync probe"),
        (clock(age_s=-90_000.0), "its clock was measured 25.0 h ago, the limit is 24 h; measure it: rigcal sync probe"),
        (
            clock(age_s=40_000.0, drift_bound_ppm=1.0),
            "its clock is known to 40.1 ms, half a frame is 16.7 ms; measure it: rigcal sync probe",
        ),
    ],
)
def test_a_clock_that_cannot_be_trusted_is_named(bad, words):
    assert faults_of(clock(), clock(), bad) == {2: words}


def test_the_reference_needs_no_clock_where_the_others_were_measured_by_its_video():
    assert faults_of(None, clock(method="video"), clock(method="video")) == {}
    assert set(faults_of(None, clock(method="video"), clock())) == {0}


def test_cameras_that_are_left_out_need_no_clock():
    assert faults_of(clock(), None, use=(True, False)) == {}


def watched(stamps_ms, lags_ms=None):
    """The fault after each frame."""
    watch, found = ClockWatch(), []
    for n, t_ms in enumerate(stamps_ms):
        receive = None if lags_ms is None else round((t_ms + lags_ms[n]) * MS)
        watch.see(round(t_ms * MS), receive)
        found.append(watch.fault)
    return found


def steady(count, seed=0):
    """Stamps at 30 fps with the jitter of a sensor's, milliseconds."""
    return 1000 / 30 * np.arange(count) + np.random.default_rng(seed).normal(0, 0.05, count)


@pytest.mark.parametrize("seed", range(5))
def test_steady_stamps_with_lost_frames_and_late_arrivals_are_trusted(seed):
    random = np.random.default_rng(seed)
    stamps = np.delete(steady(600, seed), random.integers(10, 590, 12))
    lags = 20 + random.gamma(2.0, 4.0, len(stamps))
    lags[200:230] += np.linspace(800, 0, 30)  # the network stood still for a while
    assert set(watched(stamps, lags)) == {None}
    assert set(watched(stamps)) == {None}


@pytest.mark.parametrize("step_ms", [-5000.0, -100.0, 500.0, 5000.0])
def test_a_clock_that_is_set_shows_at_once(step_ms):
    true = steady(200)
    stamps = true + np.where(np.arange(200) >= 120, step_ms, 0.0)
    found = watched(stamps, true + 25 - stamps)
    assert set(found[:120]) == {None}
    assert f"its clock was set by {step_ms * 1e-3:+.1f}"[:-1] in found[120]
    assert None not in found[120:]


def test_a_small_step_shows_within_a_second_in_the_grid_of_the_stamps():
    true = steady(300)
    stamps = true + np.where(np.arange(300) >= 200, 13.0, 0.0)
    found = watched(stamps, true + 25 - stamps)
    assert set(found[:200]) == {None}
    assert found[260] is not None
    assert found[260].startswith("its clock was set by +0.013 s")


def test_a_clock_that_is_set_back_to_what_it_was_is_trusted_again():
    true = steady(400)
    stamps = true + np.where((np.arange(400) >= 120) & (np.arange(400) < 250), 2000.0, 0.0)
    found = watched(stamps, true + 25 - stamps)
    assert all(found[120:279])
    assert found[-1] is None


def test_a_gap_after_an_interruption_is_no_step():
    watch = ClockWatch()
    for n, t_ms in enumerate(np.concatenate([steady(100), 4711.0 + steady(200) + 1000 / 30 * 100])):
        if n == 100:
            watch.interrupted()
        watch.see(round(t_ms * MS), round((t_ms + 25) * MS))
        assert watch.fault is None


def test_a_step_that_was_reported_counts_from_the_interruption_on():
    watch = ClockWatch()
    watch.see(0, 25 * MS)
    watch.interrupted(-0.25)
    assert watch.fault == "its clock was set by -0.250 s; measure it: rigcal sync probe"
