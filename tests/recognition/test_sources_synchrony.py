"""What is told of the cameras' timekeeping: counts, clocks at the capture's own time, and what may spoil the result."""

from pathlib import Path

import numpy as np
import pytest

from recognition.sources.synchrony import judge_synchrony
from recognition.sources.timing import capture_clocks, capture_timing
from recognition.synthetic import semicircle_rig
from rigcal.captures import Capture, CaptureCamera
from rigcal.rig import ClockModel

START_S = 1_775_986_200.0
AT = "2026-04-12T09:30:00Z"  # the same, in UTC
PERIOD_NS = 40_000_000
WHOLE = round(START_S) * 10**9 + 120 * 10**9 + PERIOD_NS * np.arange(100)
"""Stamps of 100 frames at 25 fps, two minutes later."""


def clock(bound_s=1e-4, drift_bound_ppm=0.5, **changes):
    known = {"offset_s": 0.0, "drift_ppm": 0.0, "at_utc": AT, "method": "probe"} | changes
    return ClockModel(bound_s=bound_s, drift_bound_ppm=drift_bound_ppm, **known)


def judged(stamps_ns, clocks=None, *, names=None, times_s=()):
    cameras = []
    for i, given in enumerate(stamps_ns):
        frames = tuple(names[i] if names else [str(t) for t in given])
        kind = "video" if times_s else "images"
        own = tuple(times_s[i]) if times_s else ()
        cameras.append(CaptureCamera(f"cam{i}", kind, (Path("x"),), frames, (8, 8), None, own))
    capture = Capture(Path("nowhere"), tuple(cameras))
    found = capture_clocks(capture, clocks or {})
    columns = range(len(cameras))
    timing = capture_timing(capture, found, columns, fps=25.0)
    return judge_synchrony(timing, found, columns, capture.cameras, semicircle_rig(len(cameras)))


def test_frames_missing_repeated_and_alone_are_counted_per_camera():
    lost, twice = (
        np.delete(WHOLE + 3_000_000, [20, 21, 60]),
        np.sort(np.append(WHOLE - 2_000_000, WHOLE[50] - 2_000_000)),
    )
    report = judged([WHOLE, lost, twice])
    assert [(c.frames, c.missing, c.repeated, c.alone) for c in report.cameras] == [
        (100, 0, 0, 0), (97, 3, 0, 0), (101, 0, 1, 1),
    ]  # fmt: skip
    assert (report.rule, report.instants, report.alone) == ("file times", 101, 1)
    assert report.spread_median_s == pytest.approx(0.005)
    assert report.spread_worst_s == pytest.approx(0.005)
    assert report.warnings == ()


def test_a_clock_is_judged_by_its_bound_and_age_at_the_time_of_the_capture():
    """Measured two minutes before the first frame, 124 s before the last: 0.1 ms + 124 s x 0.5 ppm."""
    report = judged([WHOLE, WHOLE], {"cam0": clock(), "cam1": clock(at_utc="2026-04-12T10:30:00Z")})
    before, after = (camera.clock for camera in report.cameras)
    assert before.method == "probe"
    assert before.age_s == pytest.approx(123.96)
    assert before.bound_s == pytest.approx(1e-4 + 123.96 * 0.5e-6)
    assert after.age_s == pytest.approx(-3480.0)
    lines = list(report.lines())
    assert lines == [
        "instants by file times: 100, 0 of a single camera; frames within an instant are 0.0 ms apart in the median, "
        "0.0 ms at worst",
        "  cam0: 100 frames, 0 missing, 0 repeated, 0 without a partner; clock by probe, within 0.162 ms, measured "
        "2.07 min before the capture",
        "  cam1: 100 frames, 0 missing, 0 repeated, 0 without a partner; clock by probe, within 1.84 ms, measured "
        "58 min after the capture",
    ]


def test_a_bound_beyond_half_a_frame_is_a_warning():
    report = judged([WHOLE, WHOLE], {"cam0": clock(), "cam1": clock(drift_bound_ppm=200.0)})
    assert report.warnings == (
        "cam1: its frames may be grouped with the wrong ones, because at the time of this capture its clock is known "
        "to 24.9 ms only and half a frame is 20 ms. It was measured 2.07 min before the capture: measure it from the "
        "capture (rigcal sync video)",
    )


def test_no_clock_at_all_is_accepted_and_reported():
    report = judged([WHOLE, WHOLE])
    assert [camera.clock for camera in report.cameras] == [None, None]
    assert "no clock model applied" in list(report.lines())[1]
    assert report.warnings == ()


def test_a_clock_for_some_cameras_only_is_a_warning():
    report = judged([WHOLE, WHOLE], {"cam1": clock()})
    assert report.warnings == (
        "the stamps of cam0 are taken as rig time, while other cameras have a clock model: measure every camera's "
        "clock (rigcal sync probe, or rigcal sync video)",
    )


def test_the_reference_needs_no_clock_where_video_measured_the_others_beside_it():
    assert judged([WHOLE, WHOLE], {"cam1": clock(method="video")}).warnings == ()
    assert len(judged([WHOLE, WHOLE], {"cam0": clock(method="video")}).warnings) == 1


def test_a_camera_without_any_partner_is_a_warning():
    report = judged([WHOLE, WHOLE, WHOLE + 3600 * 10**9])
    assert report.warnings == (
        "cam2: none of its 100 frames is within half a frame of another camera's: check its stamps, and measure its "
        "clock (rigcal sync probe, or rigcal sync video)",
    )


def test_a_stepped_clock_is_a_warning():
    stepped = WHOLE + np.where(np.arange(100) < 60, 0, 13_000_000)
    (warning,) = judged([WHOLE, stepped]).warnings
    assert warning.startswith("cam1: its stamps jump by 1")
    assert warning.endswith(
        " ms at frame 60, as they do where a clock is stepped or a camera restarts: one clock model cannot serve both "
        "sides, so split the capture there"
    )


def test_frames_missing_from_a_video_whose_frames_are_counted_are_a_warning():
    times = np.arange(100) / 25
    report = judged(
        [times, times[:97]], names=[["x"] * 100, ["x"] * 97], times_s=[times, np.delete(times, [50, 51, 52])]
    )
    assert report.warnings == (
        "cam1: 3 frames are missing after frame 49, and instants count frames: from there on its frames are grouped "
        "with the wrong ones. Give their times in timestamps.csv",
    )


def test_images_that_nothing_puts_together_are_a_warning():
    report = judged([WHOLE[:2], WHOLE[:2]], names=[["a", "b"], ["a", "b"]])
    assert report.rule == "none"
    assert report.alone == 4
    assert [camera.missing for camera in report.cameras] == [None, None]
    assert "no stamps" in list(report.lines())[1]
    assert report.warnings == (
        "nothing says which frames belong together, so that nothing is known in 3D: add timestamps.csv, or end the "
        "images' names with equal numbers",
    )


def test_a_clock_of_another_epoch_is_a_warning(tmp_path):
    (tmp_path / "timestamps.csv").write_text("cam_id,frame_time\n" + "".join(f"cam0,{t / 25}\n" for t in range(40)))
    frames = tuple(f"{i}" for i in range(40))
    capture = Capture(tmp_path, (CaptureCamera("cam0", "images", (Path("x"),), frames, (8, 8)),))
    found = capture_clocks(capture, {"cam0": clock()})
    timing = capture_timing(capture, found, [0], fps=25.0)
    report = judge_synchrony(timing, found, [0], capture.cameras, semicircle_rig(1))
    assert report.cameras[0].clock is None
    assert report.warnings == (
        "cam0: its clock model was not applied, because its stamps count from another epoch than the clock: stamp "
        "frames with seconds since 1970 (UTC)",
    )
    assert report.document["cameras"][0]["camera_id"] == "cam0"
