"""Instants of a capture in rig time: each frame once, at its own time to the nanosecond, and never backwards."""

from pathlib import Path

import numpy as np
import pytest

from recognition.sources.timing import capture_clocks, capture_timing
from rigcal.captures import Capture, CaptureCamera
from rigcal.rig import ClockModel

START_NS = 1_775_986_200_000_000_000
AT = "2026-04-12T09:30:00Z"  # the same, in UTC


def camera(name, stamps_ns):
    frames = tuple(str(t) for t in stamps_ns)
    return CaptureCamera(name, "images", tuple(Path(f"{f}.png") for f in frames), frames, (8, 8))


def timed(stamps_ns, clocks=None, columns=None):
    """Timing of cameras ``cam0, cam1, ...`` whose frames are named by these stamps."""
    capture = Capture(Path("nowhere"), tuple(camera(f"cam{i}", s) for i, s in enumerate(stamps_ns)))
    found = capture_clocks(capture, clocks or {})
    return capture_timing(capture, found, columns or range(len(stamps_ns)), fps=30.0)


def stamps(rng, rate_hz, seconds, jitter=0.1):
    """Stamps of a camera with jitter, lost frames, repeated stamps and a random start."""
    period_s = 1 / rate_hz
    t_s = np.arange(0, seconds, period_s) + rng.uniform(0, period_s) + rng.normal(0, jitter * period_s, 1)
    t_s = np.sort(t_s + rng.uniform(-jitter, jitter, len(t_s)) * period_s)
    t_s = t_s[rng.random(len(t_s)) > 0.1]
    t_s = np.sort(np.concatenate([t_s, t_s[rng.random(len(t_s)) > 0.95]]))
    return START_NS + np.rint(t_s * 1e9).astype(np.int64)


@pytest.mark.parametrize("seed", range(40))
def test_every_frame_comes_once_and_no_camera_runs_backwards(seed):
    rng = np.random.default_rng(seed)
    rates = rng.choice([5.0, 15.0, 25.0, 29.83, 30.0, 60.0, 120.0], rng.integers(2, 6))
    given = [stamps(rng, rate, rng.uniform(1, 4), rng.choice([0.0, 0.1, 0.45])) for rate in rates]
    timing = timed(given)
    for v, expected in enumerate(given):
        rows = timing.seen[:, v]
        assert sorted(timing.frame_idx[rows, v].tolist()) == list(range(len(expected)))
        assert timing.frame_t_ns[rows, v].tolist() == sorted(expected.tolist())
    counts = timing.seen.sum(axis=1)
    mean = np.where(timing.seen, timing.frame_t_ns - START_NS, 0).sum(axis=1) / counts
    assert np.abs(timing.t_ns - START_NS - mean).max() <= 0.5
    assert (
        timing.frame_t_ns[~timing.seen] == np.repeat(timing.t_ns, len(rates)).reshape(timing.seen.shape)[~timing.seen]
    ).all()


def test_a_fast_camera_among_slow_ones_would_run_backwards_in_order_of_the_common_times():
    """Its frame at 4 ms is grouped with two at -16 ms: the common time is -7 ms, ahead of its own frame at -4.3 ms."""
    period = 33_333_333
    slow = START_NS + period * np.arange(1, 13)
    fast = np.sort(np.concatenate([slow[:4] + 4_000_000, slow[:4] - 4_300_000]))
    given = [slow, slow - 16_000_000, slow - 16_000_000, fast]
    timing = timed(given)
    by_common_time = timing.frame_t_ns[np.argsort(timing.t_ns, kind="stable"), 3]
    seen = timing.seen[np.argsort(timing.t_ns, kind="stable"), 3]
    assert (np.diff(by_common_time[seen]) < 0).any()
    assert (np.diff(timing.frame_t_ns[timing.seen[:, 3], 3]) > 0).all()


def test_clock_models_decide_what_belongs_together():
    true_ns = START_NS + 3_600_000_000_000 + np.rint(np.arange(300) / 30 * 1e9).astype(np.int64)
    clock = ClockModel(0.75, 20.0, AT, 1e-4, 0.1, "probe")
    shown = np.array([round(clock.camera_time_s(t * 1e-9) * 1e9) for t in true_ns.tolist()])
    timing = timed([true_ns, shown], {"cam1": clock})
    assert timing.frame_idx.tolist() == [[i, i] for i in range(300)]
    assert timing.spread_s.max() < 1e-6  # of the inverse in floating point
    expected = [clock.rig_time_ns(t) for t in shown.tolist()]
    assert timing.frame_t_ns[:, 1].tolist() == expected
    without = timed([true_ns, shown])
    pairs = without.frame_idx[without.seen.all(axis=1)]
    assert (pairs[:, 0] != pairs[:, 1]).all()  # 25 frames off, and nothing tells


def test_lost_frames_shift_nothing():
    whole = START_NS + 33_333_333 * np.arange(60)
    lost = np.delete(whole + 9_000_000, [7, 8, 30])
    timing = timed([whole, lost])
    together = timing.seen.all(axis=1)
    gaps = np.diff(timing.frame_t_ns[together], axis=1)
    assert (gaps == 9_000_000).all()
    assert timing.number[~together].tolist() == [7, 8, 30]
    assert (timing.frame_t_ns[~together, 0] == whole[[7, 8, 30]]).all()


def test_a_clock_in_utc_is_not_applied_to_stamps_from_the_start(tmp_path):
    (tmp_path / "timestamps.csv").write_text("cam_id,frame_time\n" + "".join(f"cam0,{t}\n" for t in (0.5, 0.75)))
    capture = Capture(tmp_path, (camera("cam0", ["a", "b"]),))
    clock = ClockModel(0.1, 20.0, AT, 1e-4, 0.1, "probe")
    clocks = capture_clocks(capture, {"cam0": clock})
    assert (dict(clocks.used), clocks.elsewhere) == ({}, frozenset({"cam0"}))
    assert capture_timing(capture, clocks, [0], fps=30).t_ns.tolist() == [500_000_000, 750_000_000]
    of_the_start = ClockModel(0.1, 20.0, "1970-01-01T00:00:00Z", 1e-4, 0.1, "video")
    clocks = capture_clocks(capture, {"cam0": of_the_start})
    assert capture_timing(capture, clocks, [0], fps=30).t_ns.tolist() == [600_010_000, 850_015_000]


def test_cameras_that_are_left_out_change_no_numbers():
    whole = START_NS + 33_333_333 * np.arange(10)
    given = [np.delete(whole, 3), whole + 1_000_000, whole - 2_000_000]
    every, some = timed(given), timed(given, columns=[0, -1, -1])
    assert every.number.tolist() == list(range(10))
    assert some.number.tolist() == [0, 1, 2, 4, 5, 6, 7, 8, 9]
    assert some.t_ns.tolist() == given[0].tolist()
