"""The check before a recording: each fault is named on its camera, with its light and what to do; health passes."""

from dataclasses import replace

import numpy as np
import pytest

from rigcal.pace import judge_pace
from rigcal.rig import ClockModel
from rigcal.sync.check import CameraReadings, Colour, HostReading, StampReading, check_sync
from rigcal.sync.check.findings import duration
from rigcal.sync.content.lags import CameraLag
from rigcal.sync.estimator.estimate import estimate_clock
from rigcal.sync.estimator.networks import LAN, HostOscillator, Setting, simulate_exchanges
from rigcal.sync.record import ClockLimits, Latency, utc_of

LIMITS = ClockLimits(2.0, 0.02)
NOW_S = 1_795_000_000.0
IDS = ("cam0", "cam1", "cam2", "cam3")
LATENCY = Latency(0.0, 0.0005, "site file")


def probed(offset_s=0.0, drift_ppm=0.0, settings=(), seconds=60, seed=0, claimed=0.02):
    oscillator = HostOscillator(offset_s=offset_s, drift_ppm=drift_ppm, settings=settings)
    exchanges = simulate_exchanges(LAN, oscillator, seconds=seconds, rate_hz=8, seed=seed)
    return HostReading(f"10.0.0.{seed}", estimate_clock(exchanges), claimed_bound_s=claimed)


def kept(host, ago_s=60.0):
    """The rig file's clock of a host: as the probe has it, measured a while ago."""
    model = host.clock.model
    before_s = model.at_s - ago_s
    offset_s = model.offset_s - model.drift_ppm * 1e-6 * ago_s
    return replace(model, offset_s=offset_s, at_utc=utc_of(before_s), drift_bound_ppm=2.0)


def stamped(t_s=None, rule="timestamps.csv", fps=30.0, declared=30.0, jitter_s=20e-6, seed=0):
    if t_s is None:
        t_s = np.arange(300) / fps
    noise = np.random.default_rng(seed).normal(0, jitter_s, len(t_s))
    return StampReading(rule, judge_pace(t_s + noise, declared_fps=declared), span_s=float(np.ptp(t_s)))


def lag(camera_id, offset_s=0.0, bound_s=0.0001, drift_ppm=0.0, drift_bound_ppm=20.0, confident=True, reason=""):
    return CameraLag(camera_id, confident, reason, offset_s, 5.0, bound_s, drift_ppm, drift_bound_ppm)


def healthy():
    readings = []
    for seed, camera_id in enumerate(IDS):
        host = probed(offset_s=0.004 * seed, drift_ppm=3.0 * seed, seed=seed)
        model = kept(host)
        readings.append(
            CameraReadings(camera_id, model, LATENCY, host, stamped(seed=seed), lag(camera_id, 1e-5 * seed))
        )
    return readings


def now_of(readings):
    return max(r.host.clock.model.at_s for r in readings if r.host and r.host.clock)


def checked(readings, limits=LIMITS):
    return check_sync(readings, limits, now_s=now_of(readings) if any(r.host for r in readings) else NOW_S)


def only_fault(check, camera_id, fault, colour):
    """The camera's finding of that name; asserts that no other camera has one."""
    named = {c.camera_id: [f for f in c.findings if f.colour is not Colour.GREEN] for c in check.cameras}
    assert [c for c, findings in named.items() if findings] == [camera_id], named
    found = [f for f in named[camera_id] if f.fault == fault]
    assert found, named
    assert found[0].colour is colour
    return found[0]


def changed(readings, camera_id, **changes):
    return [replace(r, **changes) if r.camera_id == camera_id else r for r in readings]


def test_a_healthy_site_is_green_and_says_how_good_it_is():
    check = checked(healthy())
    assert check.colour is Colour.GREEN, [c.findings for c in check.cameras]
    assert all(c.error_m < 0.001 for c in check.cameras)


def test_a_host_that_does_not_answer_is_named():
    silent = HostReading("10.0.0.7", None, "no answer on ports 12123 and 123")
    finding = only_fault(checked(changed(healthy(), "cam2", host=silent)), "cam2", "dead host", Colour.RED)
    assert finding.what == "its host 10.0.0.7 does not answer: no answer on ports 12123 and 123"
    assert "rigcal sync serve" in finding.do_next


def test_a_clock_that_was_set_since_the_rig_file_was_written_is_called_stepped():
    readings = healthy()
    model = readings[1].model
    moved = replace(model, offset_s=model.offset_s + 0.2)
    finding = only_fault(checked(changed(readings, "cam1", model=moved)), "cam1", "stepped clock", Colour.RED)
    assert "200 ms from where the rig file has it, 60 s after" in finding.what


def test_a_clock_that_steps_while_it_is_probed_is_called_stepped():
    host = probed(settings=(Setting(30.0, 0.05),), seed=9)
    finding = only_fault(checked(changed(healthy(), "cam3", host=host)), "cam3", "stepped clock", Colour.RED)
    assert "50 ms" in finding.what


def test_a_clock_that_drifted_away_is_called_drifting_not_stepped():
    readings = healthy()
    ago_s = 600.0
    model = kept(readings[2].host, ago_s)
    drifted = replace(model, offset_s=model.offset_s - 40e-6 * ago_s)
    finding = only_fault(checked(changed(readings, "cam2", model=drifted)), "cam2", "drift", Colour.RED)
    assert "40 ppm" in finding.what


def test_a_drift_that_the_rig_file_does_not_have_is_told_with_the_time_until_it_matters():
    readings = healthy()
    model = readings[2].model
    at_s = now_of(readings)
    wrong = replace(model, offset_s=model.rig_time_s(at_s) - at_s, drift_ppm=model.drift_ppm - 40, at_utc=utc_of(at_s))
    finding = only_fault(checked(changed(readings, "cam2", model=wrong)), "cam2", "drift", Colour.RED)
    assert finding.what == "its clock drifts 40 ppm off what the rig file says"
    assert "every 3.9" in finding.do_next  # (10 ms - .6) / 40 ppm = 235 s


def test_pictures_that_are_later_than_their_stamps_are_named_though_clocks_are_right():
    readings = changed(healthy(), "cam1", lag=lag("cam1", -0.012))
    finding = only_fault(checked(readings), "cam1", "offset", Colour.RED)
    assert finding.what == "its stamps are 12 ms (+- 0.1 ms) later than its pictures"
    assert checked(readings).cameras[1].error_m == pytest.approx(2.0 * 0.0121, rel=0.02)


def test_a_reference_that_is_off_is_named_in_place_of_the_others():
    readings = [replace(r, lag=lag(r.camera_id, 0.0 if r.camera_id == "cam0" else 0.012)) for r in healthy()]
    only_fault(checked(readings), "cam0", "offset", Colour.RED)


def test_two_cameras_alone_cannot_tell_whose_stamps_are_off():
    readings = changed(healthy()[:2], "cam1", lag=lag("cam1", -0.012))
    assert "two cameras cannot tell whose" in only_fault(checked(readings), "cam1", "offset", Colour.RED).what


def test_pictures_that_drift_from_their_stamps_are_named():
    readings = changed(healthy(), "cam3", lag=lag("cam3", 0.0, drift_ppm=40, drift_bound_ppm=5))
    finding = only_fault(checked(readings), "cam3", "drift", Colour.RED)
    assert finding.what == "its pictures drift 40 ppm (+- 20) away from its stamps"


def test_exchanged_files_are_named_on_both():
    readings = [replace(r, lag=None, swapped_with={"cam1": "cam2", "cam2": "cam1"}.get(r.camera_id)) for r in healthy()]
    check = checked(readings)
    assert [c.camera_id for c in check.cameras if c.colour is Colour.RED] == ["cam1", "cam2"]
    assert check.cameras[1].findings[0].what == "its pictures are those of cam2"


def test_dropped_frames_are_counted():
    t_s = np.delete(np.arange(300) / 30, [100, 101, 200])
    finding = only_fault(checked(changed(healthy(), "cam1", stamps=stamped(t_s))), "cam1", "dropped frames", Colour.RED)
    assert finding.what == "3 of 300 frames are missing (first after frame 99)"


def test_a_camera_that_free_runs_is_told_its_rate_and_when_it_is_half_a_frame_off():
    readings = changed(healthy(), "cam2", stamps=stamped(fps=29.83))
    finding = only_fault(checked(readings), "cam2", "frame rate", Colour.RED)
    assert finding.what.startswith("it free-runs at 29.83 frames per second where the others run at 30:")
    assert "re-measure every 2.9" in finding.do_next


def test_arrival_stamps_are_never_green():
    rng = np.random.default_rng(1)
    for scale, colour in ((0.001, Colour.AMBER), (0.008, Colour.RED)):
        t_s = np.arange(600) / 30 + rng.gamma(1.5, scale, 600)
        finding = only_fault(checked(changed(healthy(), "cam3", stamps=stamped(t_s))), "cam3", "arrival stamps", colour)
        assert "when frames arrived" in finding.what


def test_a_step_in_the_stamps_of_a_capture_is_named():
    t_s = np.arange(300) / 30
    t_s[150:] += 0.4104
    finding = only_fault(checked(changed(healthy(), "cam0", stamps=stamped(t_s))), "cam0", "stepped clock", Colour.RED)
    assert "at frame 150" in finding.what


@pytest.mark.parametrize(("jump_s", "words"), [(0.5, "span 500 ms more"), (-0.5, "span 500 ms less")])
def test_a_step_by_whole_frames_is_told_from_dropped_frames_by_the_frames_that_came(jump_s, words):
    t_s = np.arange(300) / 30
    t_s[150:] += jump_s
    blind = [replace(r, lag=None) for r in healthy()]
    stepped = changed(blind, "cam0", stamps=stamped(np.sort(t_s)))  # sorted, as timestamps.csv is read
    assert words in only_fault(checked(stepped), "cam0", "stepped clock", Colour.RED).what


def test_a_camera_that_dropped_frames_and_recorded_longer_is_not_called_stepped_where_pictures_tell():
    t_s = np.delete(np.arange(310) / 30, range(100, 110))
    only_fault(checked(changed(healthy(), "cam0", stamps=stamped(t_s))), "cam0", "dropped frames", Colour.RED)


def test_time_that_runs_backwards_is_named():
    t_s = np.arange(300) / 30
    t_s[[100, 101]] = t_s[[101, 100]]
    only_fault(checked(changed(healthy(), "cam0", stamps=stamped(t_s))), "cam0", "time runs backwards", Colour.RED)


def test_a_dead_source_is_named():
    dead = StampReading("arrival", judge_pace(np.zeros(0)), trouble="cannot connect")
    finding = only_fault(checked(changed(healthy(), "cam1", stamps=dead)), "cam1", "dead source", Colour.RED)
    assert finding.what == "its pictures cannot be had: cannot connect"


def test_stamps_that_count_more_frames_than_arrive_are_named():
    lying = replace(stamped(fps=25.0, declared=25.0), rule="producer", arrived_fps=21.0)
    honest = replace(lying, arrived_fps=24.8)
    readings = [replace(r, stamps=honest) for r in healthy()]
    assert checked(readings).colour is Colour.GREEN
    finding = only_fault(checked(changed(readings, "cam1", stamps=lying)), "cam1", "wrong stamps", Colour.RED)
    assert "count 25 frames per second, and 21 arrive" in finding.what


def test_tai_is_recognised():
    host = replace(probed(), confusion="the camera's host is ahead by 37.000 s")
    only_fault(checked(changed(healthy(), "cam1", host=host)), "cam1", "time scale", Colour.RED)


def test_a_model_that_is_old_is_held_against_the_limit_by_its_grown_bound():
    old = ClockModel(0.001, 0.0, utc_of(NOW_S - 36000), 0.0001, 1.0, "probe")
    readings = [
        CameraReadings("cam0", old, LATENCY),
        CameraReadings("cam1", replace(old, drift_bound_ppm=0.1), LATENCY),
    ]
    check = check_sync(readings, LIMITS, now_s=NOW_S)
    assert check.cameras[0].findings[0].fault == "wide bound"
    assert "known to 36.1 ms only, 10 h after it was measured" in check.cameras[0].findings[0].what
    assert check.cameras[1].colour is Colour.GREEN


def test_unknown_latency_is_amber_unless_pictures_were_compared():
    readings = [replace(r, latency=None, lag=None) for r in healthy()]
    check = checked(readings)
    assert {f.fault for c in check.cameras for f in c.findings} == {"unknown latency"}
    assert check.colour is Colour.AMBER
    assert checked([replace(r, latency=None) for r in healthy()]).colour is Colour.GREEN


def test_a_rig_without_clocks_is_told_to_probe():
    near = [replace(r, model=None, host=probed(offset_s=0.001), lag=None) for r in healthy()]
    assert {f.fault for f in checked(near).cameras[0].findings} == {"no clock"}
    far = changed(near, "cam2", host=probed(offset_s=0.03, seed=9))
    check = checked(far)
    assert [c.camera_id for c in check.cameras if c.colour is Colour.RED] == ["cam2"]
    assert check.cameras[2].findings[0].fault == "offset"


def test_a_camera_of_which_nothing_is_known_is_red_and_says_what_to_do():
    check = check_sync([CameraReadings("cam0", None)], LIMITS, now_s=NOW_S)
    assert check.cameras[0].error_m is None
    assert check.cameras[0].findings[0].fault == "not measured"
    assert "carried about" in check.cameras[0].findings[0].do_next
    assert check.colour is Colour.RED


def test_content_that_does_not_decide_is_told_with_its_reason():
    readings = changed(healthy(), "cam1", lag=lag("cam1", confident=False, reason="nothing moves"))
    finding = only_fault(checked(readings), "cam1", "content undecided", Colour.AMBER)
    assert finding.what == "its pictures do not tell its clock: nothing moves"


def test_a_host_that_is_alone_with_its_time_is_a_stranger_though_the_rig_file_knows_it():
    readings = healthy()
    away = probed(offset_s=0.5, seed=9)
    check = checked(changed(readings, "cam3", host=away, model=kept(away)))
    finding = only_fault(check, "cam3", "stranger", Colour.AMBER)
    assert "496 ms from the other hosts" in finding.what or "494 ms from the other hosts" in finding.what


@pytest.mark.parametrize(
    ("seconds", "words"), [(0.25, "250 ms"), (40, "40 s"), (720, "12 min"), (12600, "3.5 h"), (181440, "2.1 days")]
)
def test_durations_are_told_in_the_unit_that_one_would_use(seconds, words):
    assert duration(seconds) == words
