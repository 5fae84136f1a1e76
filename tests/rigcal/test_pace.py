"""The pace of a camera's frames: planted faults are found, each as what it is, and healthy stamps are left alone."""

import csv
import time
from pathlib import Path

import numpy as np
import pytest

from rigcal.captures import open_capture
from rigcal.errors import OptionError, StampsError
from rigcal.pace import Gap, PaceOptions, free_running, judge_pace

DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data"
EPOCH_S = 1_764_000_000.0
RATES = (5.0, 6.0, 15.0, 24.0, 25.0, 29.97, 30.0, 50.0, 60.0, 120.0)


def sensor(rng, frames, fps, *, jitter_s=50e-6, quantum_s=0.0):
    """Stamps on a grid that is some ppm off, with the jitter of a sensor's clock."""
    t_s = rng.uniform(0, 1 / fps) + np.arange(frames) / fps * (1 + rng.normal(0, 20e-6))
    t_s = EPOCH_S + t_s + rng.normal(0, jitter_s, frames)
    return np.round(t_s / quantum_s) * quantum_s if quantum_s else t_s


def arrival(rng, exposed_s, *, delay_s=1.5e-3, stalls=0.02):
    """Times of arrival over a link that delays every frame, stalls now and then, keeps the order and catches up."""
    frames = len(exposed_s)
    late_s = (
        exposed_s + rng.exponential(delay_s, frames) + (rng.random(frames) < stalls) * rng.exponential(0.03, frames)
    )
    service_s = 0.3e-3 * np.arange(frames)
    return EPOCH_S + np.maximum.accumulate(late_s - service_s) + service_s


def healthy(seed, kind, rates=RATES):
    rng = np.random.default_rng(seed)
    fps, frames = float(rng.choice(rates)), int(rng.integers(60, 1500))
    if kind == "sensor":
        return fps, sensor(rng, frames, fps, jitter_s=rng.uniform(20e-6, 100e-6))
    if kind == "milliseconds":
        return fps, sensor(rng, frames, fps, jitter_s=rng.uniform(20e-6, 100e-6), quantum_s=1e-3)
    return fps, arrival(rng, np.arange(frames) / fps, delay_s=rng.uniform(1e-3, 2.5e-3))


def found(pace):
    """Every kind of fault that a pace reports."""
    kinds = {
        "missing": pace.missing,
        "repeated": len(pace.repeated),
        "backwards": len(pace.backwards),
        "steps": pace.steps,
        "varies": pace.varies,
    }
    return {kind for kind, value in kinds.items() if value}


@pytest.mark.parametrize(("kind", "source"), [("sensor", "sensor"), ("milliseconds", "sensor"), ("wire", "arrival")])
def test_healthy_stamps_have_no_fault_and_tell_where_they_were_made(kind, source):
    for seed in range(200):
        fps, t_s = healthy(seed, kind)
        pace = judge_pace(t_s, declared_fps=fps)
        assert found(pace) == set(), (seed, fps)
        assert pace.source == source, (seed, fps, pace.reason)
        assert abs(pace.off_ppm) < 100 + 5 * pace.delivered_fps_sigma / fps * 1e6, (seed, fps)


FAULTY_RATES = (15.0, 24.0, 25.0, 29.97, 30.0, 60.0)


@pytest.mark.parametrize("kind", ["sensor", "milliseconds", "wire"])
class TestEachFaultIsFoundAsWhatItIs:
    """Over 40 seeds. Arrival times tell a fault only from what follows it, so that none is planted in the last 3 s."""

    def captures(self, kind):
        for seed in range(40):
            fps, t_s = healthy(1000 + seed, kind, FAULTY_RATES)
            margin = round(3.3 * fps) if kind == "wire" else 0
            if len(t_s) > 2 * margin + 60:
                rng = np.random.default_rng(seed)
                yield fps, t_s, rng, int(rng.integers(30, len(t_s) - 30 - margin))

    def test_missing_frames_by_number_and_place(self, kind):
        for _, t_s, _, at in self.captures(kind):
            for count in (1, 2, 7):
                pace = judge_pace(np.delete(t_s, np.arange(at, at + count)))
                assert found(pace) == {"missing"}
                assert pace.missing_frames == count
                assert abs(pace.missing[0].after - (at - 1)) <= (3 if kind == "wire" else 0)

    def test_frames_that_are_lost_at_random(self, kind):
        for fps, t_s, rng, _ in self.captures(kind):
            kept = rng.random(len(t_s)) > 0.05
            kept[:20] = kept[-20 - round(3.3 * fps) :] = True
            pace = judge_pace(t_s[kept])
            assert found(pace) <= {"missing"}
            assert pace.missing_frames == np.sum(~kept)

    def test_a_frame_that_came_twice(self, kind):
        for _, t_s, _, at in self.captures(kind):
            pace = judge_pace(np.insert(t_s, at, t_s[at - 1]))
            assert (found(pace), pace.repeated.tolist()) == ({"repeated"}, [at])

    def test_a_stamp_that_was_not_renewed_is_no_missing_frame(self, kind):
        for _, t_s, _, at in self.captures(kind):
            t_s[at] = t_s[at - 1]
            pace = judge_pace(t_s)
            assert (found(pace), pace.repeated.tolist()) == ({"repeated"}, [at])

    def test_frames_in_the_wrong_order(self, kind):
        for _, t_s, _, at in self.captures(kind):
            t_s[[at - 1, at]] = t_s[[at, at - 1]]
            pace = judge_pace(t_s)
            assert (found(pace), pace.backwards.tolist()) == ({"backwards"}, [at])

    def test_a_stepped_clock(self, kind):
        for fps, t_s, rng, at in self.captures(kind):
            jump_s = rng.choice([-1, 1]) * (rng.uniform(0.4, 0.6) + rng.choice([0, 0, 3, 60])) / fps
            jump_s = np.round(jump_s, 3) if kind == "milliseconds" else jump_s
            t_s[at:] += jump_s
            pace = judge_pace(t_s)
            assert found(pace) - {"backwards"} == {"steps"}
            assert abs(pace.steps[0].at - at) <= (5 if kind == "wire" else 0)
            assert abs(pace.steps[0].jump_s - jump_s) < {"sensor": 0.5e-3, "milliseconds": 1.2e-3, "wire": 4e-3}[kind]

    def test_one_late_stamp_is_neither_a_step_nor_a_gap(self, kind):
        for fps, t_s, _, at in self.captures(kind):
            t_s[at] += np.round(0.6 / fps, 3)
            pace = judge_pace(t_s)
            assert found(pace) <= ({"backwards"} if kind == "wire" else set())
            assert pace.late >= 1 or kind == "wire"

    @pytest.mark.parametrize("slower", [0.5, 0.8, 0.95])
    def test_a_rate_that_changes_is_no_missing_frame(self, kind, slower):
        for fps, full_s, rng, _ in self.captures(kind):
            third, dark = len(full_s) // 3, round(5 * slower * fps) + 40
            exposed_s = np.cumsum(np.repeat([1 / fps, 1 / slower / fps, 1 / fps], [third, dark, third]))
            if kind == "wire":
                stamps_s = arrival(rng, exposed_s, stalls=0)
            else:
                stamps_s = exposed_s + rng.normal(0, 50e-6, len(exposed_s))
            pace = judge_pace(np.round(stamps_s, 3) if kind == "milliseconds" else stamps_s)
            assert found(pace) == {"varies"}
            assert pace.rates_fps == pytest.approx((slower * fps, fps), rel=0.06 if kind == "wire" else 0.03)


def test_a_small_step_of_a_sensor_clock_is_measured():
    for seed in range(60):
        rng = np.random.default_rng(seed)
        t_s = sensor(rng, 300, 30.0)
        t_s[140:] += 0.003
        (step,) = judge_pace(t_s).steps
        assert step.at == 140
        assert step.jump_s == pytest.approx(0.003, abs=0.3e-3)


def test_several_gaps_close_together_keep_their_places():
    t_s = np.delete(sensor(np.random.default_rng(0), 200, 30.0), [50, 52, 55, 56])
    assert judge_pace(t_s).missing == (Gap(49, 1), Gap(50, 1), Gap(52, 2))


def test_a_camera_that_loses_every_sixth_frame_keeps_its_cadence():
    t_s = np.delete(sensor(np.random.default_rng(0), 600, 25.0), np.arange(5, 600, 6)[:-1])
    pace = judge_pace(t_s, declared_fps=25.0)
    assert (pace.missing_frames, found(pace)) == (99, {"missing"})
    assert pace.missing_percent == pytest.approx(16.5, abs=0.1)
    assert pace.delivered_fps == pytest.approx(25.0, rel=100e-6)


@pytest.mark.parametrize("quantum_s", [1e-2, 1e-3, 1e-4, 1 / 90_000, 1 / 15_360])
def test_rounding_is_recognised_and_is_no_jitter(quantum_s):
    rng = np.random.default_rng(1)
    t_s = sensor(rng, 900, 29.97, quantum_s=quantum_s) - EPOCH_S
    t_s = np.round(t_s / quantum_s) * quantum_s
    pace = judge_pace(t_s)
    assert pace.quantum_s == pytest.approx(quantum_s)
    if quantum_s > 5e-3:
        assert pace.source == "unknown"
        assert pace.reason == "stamps are rounded to 10 ms, which hides how they scatter"
    else:
        assert (pace.source, found(pace)) == ("sensor", set())
        assert pace.jitter_s == pytest.approx(50e-6, abs=60e-6)


def test_stamps_without_rounding_have_none():
    assert judge_pace(sensor(np.random.default_rng(0), 300, 30.0)).quantum_s == 0


@pytest.mark.parametrize("fps", [6.0, 24000 / 1001, 25.0, 29.97, 60.0])
def test_stamps_that_a_muxer_made_up_are_exact_and_measured_ones_are_not(fps):
    ticks = np.round(np.arange(300) * 90_000 / fps) / 90_000
    assert judge_pace(ticks, declared_fps=fps).exact
    assert judge_pace(np.round(ticks, 3)).exact
    assert not judge_pace(ticks + np.random.default_rng(0).normal(0, 20e-6, 300)).exact


def test_a_free_running_camera_is_told_from_its_declared_rate_within_its_sigma():
    scores = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        t_s = np.arange(300) / 29.83 + rng.normal(0, 50e-6, 300)
        pace = judge_pace(t_s, declared_fps=30.0)
        assert pace.off_ppm == pytest.approx(-5670, abs=20)
        scores.append((pace.delivered_fps - 29.83) / pace.delivered_fps_sigma)
    assert 0.85 < np.std(scores) < 1.15  # measured 1.0


def test_missing_frames_do_not_lower_the_delivered_rate():
    t_s = np.delete(sensor(np.random.default_rng(2), 1000, 30.0), np.arange(100, 900, 7))
    assert judge_pace(t_s).delivered_fps == pytest.approx(30.0, rel=100e-6)


def test_too_few_frames_are_said_to_be_too_few():
    pace = judge_pace(np.arange(12) / 30, declared_fps=30.0)
    assert (pace.source, pace.reason) == ("unknown", "only 12 frames, 30 are needed")
    assert pace.delivered_fps == pytest.approx(30.0)
    for frames, period_s in ((0, None), (1, None), (2, None)):
        few = judge_pace(np.arange(frames) / 30)
        assert (few.frames, few.period_s, few.source, few.off_ppm) == (frames, period_s, "unknown", None)
    assert judge_pace(np.zeros(50)).reason == "the stamps do not go on"


def test_no_stamps_whatever_break_it():
    for seed in range(150):
        rng = np.random.default_rng(seed)
        frames = int(rng.integers(0, 80))
        for t_s in (rng.uniform(0, 9, frames), np.cumsum(rng.standard_cauchy(frames)), -np.arange(frames) / 30.0):
            pace = judge_pace(t_s)
            assert pace.frames == frames
            assert pace.period_s is None or pace.period_s > 0


def test_ten_hours_take_seconds():
    t_s = sensor(np.random.default_rng(0), 10 * 3600 * 30, 30.0)
    t_s[500_000:] += 0.012
    started_s = time.process_time()
    pace = judge_pace(np.delete(t_s, [70_000]))
    assert time.process_time() - started_s < 5.0  # measured 0.9 s
    assert (pace.missing, pace.steps[0].at) == ((Gap(69_999, 1),), 499_999)


def test_stamps_that_are_no_times_are_refused():
    with pytest.raises(StampsError) as caught:
        judge_pace([0.0, float("nan"), 2.0])
    assert str(caught.value) == (
        "a stamp is no number\n"
        "  expected: seconds, finite, for every frame\n"
        "  got:      nan for frame 1, 1 such of 3\n"
        "  do next:  leave those frames out, or mend their stamps"
    )
    with pytest.raises(StampsError, match="not in one row"):
        judge_pace(np.zeros((2, 3)))


def test_options_are_checked():
    with pytest.raises(OptionError, match="option least_frames is out of range"):
        PaceOptions(least_frames=2)
    with pytest.raises(OptionError, match="option sensor_jitter_s is out of range"):
        PaceOptions(sensor_jitter_s=1.0)


def paces(declared=None, **rates):
    rng = np.random.default_rng(0)
    return {
        name: judge_pace(np.arange(600) / fps + rng.normal(0, 50e-6, 600), declared_fps=declared)
        for name, fps in rates.items()
    }


def test_the_camera_that_runs_alone_is_named_with_its_slip():
    (slow,) = free_running(paces(cam0=30.0, cam1=30.0005, cam2=29.83))
    assert (slow.camera_id, slow.against) == ("cam2", "the others")
    assert slow.expected_fps == pytest.approx(30.0, rel=1e-4)
    assert slow.slip_frames_per_min == pytest.approx(10.2, abs=0.1)
    assert slow.half_frame_after_s == pytest.approx(2.94, abs=0.03)


def test_a_camera_at_twice_the_rate_keeps_step():
    assert free_running(paces(cam0=30.0, cam1=60.0, cam2=30.0)) == ()


def test_cameras_that_agree_with_nobody_are_held_against_what_they_declare():
    (slow,) = free_running(paces(30.0, cam0=30.0, cam1=29.83))
    assert (slow.camera_id, slow.against, slow.expected_fps) == ("cam1", "declared", 30.0)
    assert free_running(paces(cam0=30.0, cam1=29.83)) == ()


def test_cameras_of_one_rate_that_none_of_them_declares_keep_step():
    assert free_running(paces(30.0, cam0=29.97, cam1=29.97)) == ()


def test_a_recorder_s_webcams_are_arrival_times_without_losses():
    path = DATA / "calibration/caliscope_charuco_calibration/calibration/extrinsic/timestamps.csv"
    if not path.exists():
        pytest.skip("the real captures are not here")
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    for camera in "0123":
        pace = judge_pace([float(row["frame_time"]) for row in rows if row["cam_id"] == camera], declared_fps=6.0)
        assert (pace.source, found(pace)) == ("arrival", set()), pace.reason
        assert 1.0e-3 < pace.jitter_s < 1.5e-3
        assert abs(pace.off_ppm) < 30


def test_the_presentation_times_of_real_videos_are_exact():
    path = DATA / "calibration/pose2sim_singleperson/videos"
    if not path.exists():
        pytest.skip("the real captures are not here")
    for camera in open_capture(path).cameras:
        pace = judge_pace(camera.times_s, declared_fps=camera.fps)
        assert (pace.exact, pace.delivered_fps) == (True, pytest.approx(60.0))
